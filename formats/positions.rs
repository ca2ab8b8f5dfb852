//! Where the samples of a take are: exact, and in no more memory than that needs.
//!
//! Most files store 32-bit floats or integers times a step. Such a coordinate is kept as its 32-bit multiple of the step, and 64-bit numbers
//! are made of it when it is asked for. The first coordinate that this cannot hold bit for bit makes the whole table one of 64-bit numbers.

use crate::Grid;

/// A table of positions in mm; NaN where nothing was set.
#[derive(Clone, Debug)]
pub(crate) enum Positions {
    /// Multiples of a step in mm.
    Narrow { multiples: Grid<[f32; 3]>, step_mm: f64 },
    /// Any numbers.
    Wide(Grid<[f64; 3]>),
}

impl Positions {
    /// A table of NaN, in multiples of 1 mm until something else is set.
    pub fn new(frames: usize, columns: usize) -> Self {
        Self::Narrow { multiples: Grid::filled(frames, columns, [f32::NAN; 3]), step_mm: 1.0 }
    }

    /// Says of an empty table what its coordinates are multiples of.
    pub fn expect_step(&mut self, step: f64) {
        if let Self::Narrow { step_mm, .. } = self
            && step.is_normal()
        {
            *step_mm = step;
        }
    }

    /// A position in mm; `None` outside the table.
    pub fn get(&self, frame: usize, column: usize) -> Option<[f64; 3]> {
        match self {
            Self::Narrow { multiples, step_mm } => multiples.get(frame, column).map(|m| m.map(|m| f64::from(m) * step_mm)),
            Self::Wide(positions) => positions.get(frame, column).copied(),
        }
    }

    /// Sets a position to multiples of this many mm, which costs little if they are the ones expected.
    #[inline]
    pub fn set_multiples(&mut self, frame: usize, column: usize, multiples: [f32; 3], step: f64) {
        match self {
            Self::Narrow { multiples: grid, step_mm } if *step_mm == step => {
                if let Some(cell) = grid.get_mut(frame, column) {
                    *cell = multiples;
                }
            }
            _ => self.set(frame, column, multiples.map(|m| f64::from(m) * step)),
        }
    }

    /// Sets a position. A cell outside the table is none.
    pub fn set(&mut self, frame: usize, column: usize, position_mm: [f64; 3]) {
        if let Self::Narrow { multiples, step_mm } = self {
            let step = *step_mm;
            let narrow = position_mm.map(|x| (x / step) as f32);
            let exact = |(narrow, x): (&f32, &f64)| (f64::from(*narrow) * step).to_bits() == x.to_bits() || x.is_nan();
            if narrow.iter().zip(&position_mm).all(exact) {
                if let Some(cell) = multiples.get_mut(frame, column) {
                    *cell = narrow;
                }
                return;
            }
            *self = Self::Wide(multiples.map(|m| m.map(|m| f64::from(m) * step)));
        }
        if let Self::Wide(positions) = self
            && let Some(cell) = positions.get_mut(frame, column)
        {
            *cell = position_mm;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_set_comes_back_bit_for_bit() {
        let mut p = Positions::new(3, 1);
        p.expect_step(f64::from(0.1f32));
        let steps = |n: f32| f64::from(n) * f64::from(0.1f32);
        p.set(0, 0, [steps(1.0), steps(-32768.0), 0.0]);
        assert!(matches!(p, Positions::Narrow { .. }));
        p.set(1, 0, [-0.0, f64::NAN, 1e-300]);
        assert!(matches!(p, Positions::Wide(_)), "1e-300 is no 32-bit float");
        assert_eq!(p.get(0, 0), Some([steps(1.0), steps(-32768.0), 0.0]));
        assert_eq!(p.get(1, 0).map(|p| (p[0].is_sign_negative(), p[1].is_nan(), p[2])), Some((true, true, 1e-300)));
        assert!(p.get(2, 0).is_some_and(|p| p.iter().all(|x| x.is_nan())) && p.get(3, 0).is_none());
        p.set(9, 9, [1.0; 3]);
    }
}
