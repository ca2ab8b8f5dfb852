//! A dense table with one row per frame and one column per marker.

/// `frames × columns` cells, stored frame by frame.
///
/// Every access is checked: a cell outside the table is `None`, never a panic.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid<T> {
    frames: usize,
    columns: usize,
    cells: Vec<T>,
}

impl<T: Clone> Grid<T> {
    /// A table in which every cell holds `value`.
    pub fn filled(frames: usize, columns: usize, value: T) -> Self {
        Self { frames, columns, cells: vec![value; frames.saturating_mul(columns)] }
    }
}

impl<T> Grid<T> {
    /// Number of rows.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// The cell of `column` in `frame`.
    #[inline]
    pub fn get(&self, frame: usize, column: usize) -> Option<&T> {
        if column < self.columns { self.cells.get(frame.checked_mul(self.columns)?.checked_add(column)?) } else { None }
    }

    /// The cell of `column` in `frame`, to be changed.
    #[inline]
    pub fn get_mut(&mut self, frame: usize, column: usize) -> Option<&mut T> {
        if column < self.columns { self.cells.get_mut(frame.checked_mul(self.columns)?.checked_add(column)?) } else { None }
    }

    /// A table of the same size with what `f` makes of each cell.
    pub fn map<U>(&self, f: impl Fn(&T) -> U) -> Grid<U> {
        Grid { frames: self.frames, columns: self.columns, cells: self.cells.iter().map(f).collect() }
    }

    /// All cells of one frame; empty outside the table.
    pub fn row(&self, frame: usize) -> &[T] {
        let start = frame.saturating_mul(self.columns);
        self.cells.get(start..start.saturating_add(self.columns)).unwrap_or(&[])
    }
}
