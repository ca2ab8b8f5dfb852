//! Surfaces of what is given on a grid: surface nets (Gibson, "Constrained elastic surface nets", 1998).
//!
//! One vertex for each cell that the surface passes through, one quadrilateral for each edge of the grid that it crosses.

use nalgebra::Vector3;

/// A grid whose planes need not be evenly spaced.
#[derive(Clone, Debug)]
pub(super) struct Lattice {
    /// Where the planes are, by axis, rising.
    pub(super) planes: [Vec<f64>; 3],
}

impl Lattice {
    /// An even grid from `low` that reaches at least to `high`.
    pub(super) fn even(low: [f64; 3], high: [f64; 3], spacing: f64) -> Self {
        let planes = |axis: usize| {
            let count = ((high[axis] - low[axis]) / spacing).ceil() as usize + 1;
            (0..count).map(|i| low[axis] + i as f64 * spacing).collect()
        };
        Self { planes: [planes(0), planes(1), planes(2)] }
    }

    pub(super) fn size(&self) -> [usize; 3] {
        [self.planes[0].len(), self.planes[1].len(), self.planes[2].len()]
    }

    /// The place of a grid point in a list of values; the last axis runs fastest.
    pub(super) fn index(&self, at: [usize; 3]) -> usize {
        (at[0] * self.planes[1].len() + at[1]) * self.planes[2].len() + at[2]
    }

    /// Calls `visit` for every point of the grid in the order of [`Self::index`].
    pub(super) fn values<T>(&self, mut value: impl FnMut(Vector3<f64>) -> T) -> Vec<T> {
        let mut values = Vec::with_capacity(self.size().iter().product());
        for &x in &self.planes[0] {
            for &y in &self.planes[1] {
                for &z in &self.planes[2] {
                    values.push(value(Vector3::new(x, y, z)));
                }
            }
        }
        values
    }

    fn point(&self, at: [usize; 3]) -> Vector3<f64> {
        Vector3::new(self.planes[0][at[0]], self.planes[1][at[1]], self.planes[2][at[2]])
    }
}

/// Vertices, and quadrilaterals that are anticlockwise seen from outside. `values` are negative inside and positive at the rim of the grid.
pub(super) fn surface(lattice: &Lattice, values: &[f64]) -> (Vec<Vector3<f64>>, Vec<[u32; 4]>) {
    let size = lattice.size();
    let inside = |at: [usize; 3]| values[lattice.index(at)] < 0.0;
    let mut vertices = Vec::new();
    let mut vertex_of = vec![u32::MAX; values.len()];
    let cells = size.map(|n| n.saturating_sub(1));
    for x in 0..cells[0] {
        for y in 0..cells[1] {
            for z in 0..cells[2] {
                if let Some(vertex) = crossing(lattice, values, [x, y, z]) {
                    vertex_of[lattice.index([x, y, z])] = vertices.len() as u32;
                    vertices.push(vertex);
                }
            }
        }
    }
    let mut quads = Vec::new();
    for x in 1..cells[0] {
        for y in 1..cells[1] {
            for z in 1..cells[2] {
                let at = [x, y, z];
                for axis in 0..3 {
                    let mut end = at;
                    end[axis] += 1;
                    let (here, there) = (inside(at), inside(end));
                    if here == there {
                        continue;
                    }
                    let [second, third] = [(axis + 1) % 3, (axis + 2) % 3];
                    // The four cells around the edge, anticlockwise seen from its end.
                    let around = [[1, 1], [0, 1], [0, 0], [1, 0]].map(|back: [usize; 2]| {
                        let mut cell = at;
                        cell[second] -= back[0];
                        cell[third] -= back[1];
                        vertex_of[lattice.index(cell)]
                    });
                    quads.push(if here { around } else { [around[3], around[2], around[1], around[0]] });
                }
            }
        }
    }
    (vertices, quads)
}

/// Takes a few more points of the grid inside, until no cell is passed by two sheets of the surface: those would share a vertex,
/// and the surface would touch itself.
pub(super) fn join(lattice: &Lattice, values: &mut [f64]) {
    const JUST_INSIDE: f64 = -1e-3;
    let cells = lattice.size().map(|n| n.saturating_sub(1));
    let mut again = true;
    while again {
        again = false;
        for x in 0..cells[0] {
            for y in 0..cells[1] {
                for z in 0..cells[2] {
                    let corners: [usize; 8] = std::array::from_fn(|c| lattice.index([x + (c >> 2), y + (c >> 1 & 1), z + (c & 1)]));
                    let inside: u8 = (0..8).filter(|&c| values[corners[c]] < 0.0).map(|c| 1 << c).sum();
                    if inside == 0 || inside == u8::MAX || (in_one_piece(inside) && in_one_piece(!inside) && faces_are_plain(inside)) {
                        continue;
                    }
                    let outside = corners.into_iter().filter(|&corner| values[corner] >= 0.0);
                    if let Some(nearest) = outside.min_by(|&a, &b| values[a].total_cmp(&values[b])) {
                        values[nearest] = JUST_INSIDE;
                        again = true;
                    }
                }
            }
        }
    }
}

/// True if the corners of a cell that are in a set are connected along its edges. Bit 2 of a corner's number is x, bit 1 y, bit 0 z.
fn in_one_piece(set: u8) -> bool {
    let mut reached = 1 << set.trailing_zeros();
    for _ in 0..8 {
        let grown = (0..8).filter(|&c| (reached >> c) & 1 == 1).fold(reached, |all, c| all | 1 << (c ^ 1) | 1 << (c ^ 2) | 1 << (c ^ 4));
        reached = grown & set;
    }
    reached == set
}

/// True if no side of a cell is a chessboard.
fn faces_are_plain(set: u8) -> bool {
    let has = |corner: usize| (set >> corner) & 1 == 1;
    (0..3).all(|axis| {
        let [first, second] = [1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3)];
        [0, 1 << axis].into_iter().all(|base| {
            let [a, b, c, d] = [base, base | first, base | first | second, base | second].map(has);
            !(a == c && b == d && a != b)
        })
    })
}

/// The middle of where the surface crosses the edges of a cell.
fn crossing(lattice: &Lattice, values: &[f64], cell: [usize; 3]) -> Option<Vector3<f64>> {
    let (mut sum, mut count) = (Vector3::zeros(), 0.0);
    for axis in 0..3 {
        for corner in 0..4 {
            let mut from = cell;
            from[(axis + 1) % 3] += corner & 1;
            from[(axis + 2) % 3] += corner >> 1;
            let mut to = from;
            to[axis] += 1;
            let (a, b) = (values[lattice.index(from)], values[lattice.index(to)]);
            if (a < 0.0) != (b < 0.0) {
                sum += lattice.point(from).lerp(&lattice.point(to), a / (a - b));
                count += 1.0;
            }
        }
    }
    (count > 0.0).then(|| sum / count)
}

/// Cuts quadrilaterals along their shorter diagonals.
pub(super) fn triangles(vertices: &[Vector3<f64>], quads: &[[u32; 4]]) -> Vec<[u32; 3]> {
    let apart = |a: u32, b: u32| (vertices[a as usize] - vertices[b as usize]).norm_squared();
    let cut = |&[a, b, c, d]: &[u32; 4]| if apart(a, c) <= apart(b, d) { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
    quads.iter().flat_map(cut).collect()
}

/// True if every edge has exactly two faces, which pass it in opposite directions.
#[cfg(test)]
pub(super) fn is_closed(faces: &[[u32; 3]]) -> bool {
    let mut edges: Vec<(u32, u32)> = faces.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]).collect();
    edges.sort_unstable();
    let once = edges.windows(2).all(|pair| pair[0] != pair[1]);
    once && edges.iter().all(|&(a, b)| edges.binary_search(&(b, a)).is_ok())
}

/// The direction of every vertex: the mean of its faces, by area. 0 0 0 for vertices without a face.
pub(super) fn normals(vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> Vec<[f64; 3]> {
    let mut sums = vec![Vector3::zeros(); vertices.len()];
    for face in faces {
        let [a, b, c] = face.map(|vertex| Vector3::from(vertices[vertex as usize]));
        let area = (b - a).cross(&(c - a));
        for &vertex in face {
            sums[vertex as usize] += area;
        }
    }
    sums.into_iter().map(|sum| sum.try_normalize(1e-12).unwrap_or_default().into()).collect()
}

/// The vertices that share an edge with each vertex, rising.
pub(super) fn neighbours(vertices: usize, faces: &[[u32; 3]]) -> Vec<Vec<usize>> {
    let mut lists = vec![Vec::new(); vertices];
    for &[a, b, c] in faces {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            lists[from as usize].push(to as usize);
            lists[to as usize].push(from as usize);
        }
    }
    for list in &mut lists {
        list.sort_unstable();
        list.dedup();
    }
    lists
}
