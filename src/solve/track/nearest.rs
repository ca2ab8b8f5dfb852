//! The nearest vertex of a part whose normal is compatible.
//!
//! Parts are rigid: whatever finds vertices is built once in the reference pose, and points are taken there.

use super::body::Body;
use crate::solve::ik::Vec3;

/// What is asked.
#[derive(Clone, Copy, Debug)]
pub struct Query {
    /// The point, in the reference pose of the part, cm.
    pub point: Vec3,
    /// Its normal there; 0 if it has none, which is compatible with all.
    pub normal: Vec3,
    /// The least cosine between compatible normals.
    pub cosine: f64,
    /// Vertices at least as far as this do not count, cm².
    pub within: f64,
}

impl Query {
    /// True if a normal is compatible.
    #[inline]
    fn accepts(&self, normal: &Vec3) -> bool {
        let cosine = self.normal.x * normal.x + self.normal.y * normal.y + self.normal.z * normal.z;
        // neither has to have one
        cosine > self.cosine || self.normal == Vec3::zeros() || *normal == Vec3::zeros()
    }
}

/// A vertex that was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Which.
    pub vertex: u32,
    /// Its squared distance, cm².
    pub square: f64,
}

/// Finds nearest vertices. Of vertices at the same distance, the first.
pub trait Nearest: Sync {
    /// The nearest compatible vertex of `part`. `hint` is a vertex of it that may be near; it changes the time, not the answer.
    fn nearest(&self, part: usize, query: &Query, hint: Option<u32>) -> Option<Found>;
}

/// The squared distance, with its sum in an order of its own: all that find vertices have to agree to the last bit.
#[inline]
fn square(a: &Vec3, b: &Vec3) -> f64 {
    let off = [a.x - b.x, a.y - b.y, a.z - b.z];
    off[0] * off[0] + off[1] * off[1] + off[2] * off[2]
}

/// Looks at every vertex: what the others are compared with, and what the report does.
#[derive(Clone, Copy, Debug)]
pub struct Brute<'a>(pub &'a Body);

impl Nearest for Brute<'_> {
    fn nearest(&self, part: usize, query: &Query, _: Option<u32>) -> Option<Found> {
        let mut found: Option<Found> = None;
        for &vertex in &self.0.surfaces[part] {
            let square = square(&self.0.vertices[vertex as usize], &query.point);
            if square < found.map_or(query.within, |f| f.square) && query.accepts(&self.0.normals[vertex as usize]) {
                found = Some(Found { vertex, square });
            }
        }
        found
    }
}

/// Vertices that are looked at together.
const LANES: usize = 8;
/// Lanes of a leaf, at most.
const LEAF: usize = 2 * LANES;
/// Boxes reach farther than their vertices by this, cm, which is more than distances are rounded by: what is as near as the best must not hide.
const MARGIN_CM: f64 = 1e-9;
/// Cones of normals likewise: the sine of a small angle is known to 1e-8 only, because it comes from the cosine.
const MARGIN: f64 = 1e-7;

/// A box of vertices.
#[derive(Clone, Debug)]
struct Node {
    middle: Vec3,
    half: Vec3,
    /// Where all normals lie: around this axis ...
    axis: Vec3,
    /// ... within an angle of this cosine and sine; with a cosine of -1 anywhere.
    cosine: f64,
    sine: f64,
    /// Lanes of a leaf.
    first: u32,
    last: u32,
    /// The second half's node; the first's comes right behind this one. 0 for a leaf.
    other: u32,
}

/// Some vertices side by side, those that are missing infinitely far away.
#[derive(Clone, Debug)]
struct Lane {
    vertices: [[f64; LANES]; 3],
    normals: [[f64; LANES]; 3],
    /// Infinite for a vertex without a normal, which is compatible with all; else 0.
    bonus: [f64; LANES],
    names: [u32; LANES],
}

impl Lane {
    fn new(body: &Body, names: &[u32]) -> Self {
        let coordinate =
            |from: &[Vec3], k: usize, missing: f64| std::array::from_fn(|at| names.get(at).map_or(missing, |&name| from[name as usize][k]));
        let bonus = |name: &u32| if body.normals[*name as usize] == Vec3::zeros() { f64::INFINITY } else { 0.0 };
        Self {
            vertices: std::array::from_fn(|k| coordinate(&body.vertices, k, f64::INFINITY)),
            normals: std::array::from_fn(|k| coordinate(&body.normals, k, 0.0)),
            bonus: std::array::from_fn(|at| names.get(at).map_or(0.0, bonus)),
            names: std::array::from_fn(|at| names.get(at).copied().unwrap_or(u32::MAX)),
        }
    }
}

/// A tree of boxes for every part, with cones of normals.
#[derive(Clone, Debug)]
pub struct Boxes {
    parts: Vec<Part>,
    /// Places and normals of all vertices.
    vertices: Vec<Vec3>,
    normals: Vec<Vec3>,
    arch: pulp::Arch,
}

#[derive(Clone, Debug, Default)]
struct Part {
    nodes: Vec<Node>,
    lanes: Vec<Lane>,
}

impl Boxes {
    /// Builds the trees.
    pub fn new(body: &Body) -> Self {
        let parts = body.surfaces.iter().map(|surface| {
            let mut part = Part::default();
            if !surface.is_empty() {
                split(body, &mut surface.clone(), &mut part);
            }
            part
        });
        Self { parts: parts.collect(), vertices: body.vertices.clone(), normals: body.normals.clone(), arch: pulp::Arch::new() }
    }
}

/// Makes the node of `names` and all below it.
fn split(body: &Body, names: &mut [u32], part: &mut Part) {
    let vertex = |name: &u32| body.vertices[*name as usize];
    let (mut least, mut most, mut axis) = (vertex(&names[0]), vertex(&names[0]), Vec3::zeros());
    for name in names.iter() {
        least = least.inf(&vertex(name));
        most = most.sup(&vertex(name));
        axis += body.normals[*name as usize];
    }
    let axis = axis.try_normalize(1e-9).unwrap_or_default();
    let cosine = names.iter().map(|name| body.normals[*name as usize].dot(&axis)).fold(1.0, f64::min);
    let cosine = if axis == Vec3::zeros() || cosine <= 0.0 { -1.0 } else { cosine };
    let at = part.nodes.len();
    part.nodes.push(Node {
        middle: (least + most) / 2.0,
        half: ((most - least) / 2.0).add_scalar(MARGIN_CM),
        axis,
        cosine,
        sine: (1.0 - cosine * cosine).max(0.0).sqrt(),
        first: part.lanes.len() as u32,
        last: part.lanes.len() as u32,
        other: 0,
    });
    if names.len() > LEAF {
        let wide = (most - least).imax();
        let half = names.len() / 2;
        names.select_nth_unstable_by(half, |a, b| vertex(a)[wide].total_cmp(&vertex(b)[wide]).then(a.cmp(b)));
        let (left, right) = names.split_at_mut(half);
        split(body, left, part);
        part.nodes[at].other = part.nodes.len() as u32;
        split(body, right, part);
    } else {
        names.sort_unstable();
        part.lanes.extend(names.chunks(LANES).map(|names| Lane::new(body, names)));
        part.nodes[at].last = part.lanes.len() as u32;
    }
}

impl Node {
    /// The squared distance of a point from the box.
    #[inline]
    fn square(&self, point: &Vec3) -> f64 {
        let off = (point - self.middle).abs() - self.half;
        off.sup(&Vec3::zeros()).norm_squared()
    }

    /// False if no normal of the box can be within an angle of this cosine and sine of `normal`.
    #[inline]
    fn faces(&self, query: &Query, sine: f64) -> bool {
        if self.cosine < 0.0 || query.cosine < 0.0 {
            return true;
        }
        // the cosine of both angles together, which stay under half a turn
        let sum = self.cosine * query.cosine - self.sine * sine;
        query.normal.dot(&self.axis) > sum - MARGIN || query.normal == Vec3::zeros()
    }
}

/// A search in a part. A closure would not always be inlined into what is compiled for the machine's vector instructions.
struct Search<'a> {
    part: &'a Part,
    query: &'a Query,
    found: Option<Found>,
}

impl Nearest for Boxes {
    fn nearest(&self, part: usize, query: &Query, hint: Option<u32>) -> Option<Found> {
        let found = hint.and_then(|vertex| {
            let square = square(&self.vertices[vertex as usize], &query.point);
            (square < query.within && query.accepts(&self.normals[vertex as usize])).then_some(Found { vertex, square })
        });
        let part = &self.parts[part];
        let root = part.nodes.first()?;
        if root.square(&query.point) > found.map_or(query.within, |found| found.square) {
            return found;
        }
        self.arch.dispatch(Search { part, query, found })
    }
}

impl pulp::NullaryFnOnce for Search<'_> {
    type Output = Option<Found>;

    #[inline(always)]
    fn call(self) -> Option<Found> {
        let Self { part, query, mut found } = self;
        let sine = (1.0 - query.cosine * query.cosine).max(0.0).sqrt();
        // without a normal all are compatible
        let least = if query.normal == Vec3::zeros() { f64::NEG_INFINITY } else { query.cosine };
        let mut within = found.map_or(query.within, |found| found.square);
        let mut waiting = [(0_u32, 0.0_f64); 32];
        let mut count = 0;
        let (mut at, mut nearest) = (0, 0.0);
        loop {
            // what is as near as the best so far may hold a vertex that comes first
            if nearest <= within {
                let node = &part.nodes[at];
                if node.faces(query, sine) {
                    if node.other > 0 {
                        let (near, far) = (at + 1, node.other as usize);
                        let (a, b) = (part.nodes[near].square(&query.point), part.nodes[far].square(&query.point));
                        let (near, far, a, b) = if b < a { (far, near, b, a) } else { (near, far, a, b) };
                        waiting[count] = (far as u32, b);
                        count += 1;
                        (at, nearest) = (near, a);
                        continue;
                    }
                    for lane in &part.lanes[node.first as usize..node.last as usize] {
                        look(lane, query, least, &mut within, &mut found);
                    }
                }
            }
            if count == 0 {
                return found;
            }
            count -= 1;
            (at, nearest) = (waiting[count].0 as usize, waiting[count].1);
        }
    }
}

/// Takes the nearest compatible vertex of a lane, if it is nearer than the one that was found, or as near and before it.
#[inline(always)]
#[allow(clippy::needless_range_loop)] // all lists of a lane go in step
fn look(lane: &Lane, query: &Query, least: f64, within: &mut f64, found: &mut Option<Found>) {
    let mut squares = [0.0; LANES];
    let mut any = false;
    for (k, to) in squares.iter_mut().enumerate() {
        let off = [0, 1, 2].map(|axis| lane.vertices[axis][k] - query.point[axis]);
        let normals = [0, 1, 2].map(|axis| lane.normals[axis][k] * query.normal[axis]);
        let compatible = normals[0] + normals[1] + normals[2] + lane.bonus[k] > least;
        let square = off[0] * off[0] + off[1] * off[1] + off[2] * off[2];
        *to = if compatible { square } else { f64::INFINITY };
        any |= *to <= *within;
    }
    if any {
        for (&square, &vertex) in squares.iter().zip(&lane.names) {
            if square < *within || (square == *within && found.is_some_and(|found| vertex < found.vertex)) {
                *found = Some(Found { vertex, square });
                *within = square;
            }
        }
    }
}
