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
        // neither has to have one
        self.normal.dot(normal) > self.cosine || self.normal == Vec3::zeros() || *normal == Vec3::zeros()
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

/// Looks at every vertex: what the others are compared with, and what the report does.
#[derive(Clone, Copy, Debug)]
pub struct Brute<'a>(pub &'a Body);

impl Nearest for Brute<'_> {
    fn nearest(&self, part: usize, query: &Query, _: Option<u32>) -> Option<Found> {
        let mut found: Option<Found> = None;
        for &vertex in &self.0.surfaces[part] {
            let square = (self.0.vertices[vertex as usize] - query.point).norm_squared();
            if square < found.map_or(query.within, |f| f.square) && query.accepts(&self.0.normals[vertex as usize]) {
                found = Some(Found { vertex, square });
            }
        }
        found
    }
}

/// Vertices of a leaf, at most.
const LEAF: usize = 12;
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
    /// Vertices, as places in the tree's order.
    first: u32,
    last: u32,
    /// The second half's node; the first's comes right behind this one. 0 for a leaf.
    other: u32,
}

/// A tree of boxes for every part, with cones of normals.
#[derive(Clone, Debug)]
pub struct Boxes {
    parts: Vec<Part>,
    /// For each vertex of the body, its place in its part's order.
    places: Vec<u32>,
}

#[derive(Clone, Debug, Default)]
struct Part {
    nodes: Vec<Node>,
    vertices: Vec<Vec3>,
    normals: Vec<Vec3>,
    names: Vec<u32>,
}

impl Boxes {
    /// Builds the trees.
    pub fn new(body: &Body) -> Self {
        let mut places = vec![0; body.vertices.len()];
        let parts = body.surfaces.iter().map(|surface| {
            let mut names = surface.clone();
            let mut nodes = Vec::new();
            let count = names.len();
            if count > 0 {
                split(body, &mut names, 0, &mut nodes);
            }
            for (place, &name) in names.iter().enumerate() {
                places[name as usize] = place as u32;
            }
            let take = |from: &[Vec3]| names.iter().map(|&name| from[name as usize]).collect();
            Part { nodes, vertices: take(&body.vertices), normals: take(&body.normals), names }
        });
        Self { parts: parts.collect(), places }
    }
}

/// Makes the node of `names`, which begin at `first`, and all below it.
fn split(body: &Body, names: &mut [u32], first: usize, nodes: &mut Vec<Node>) {
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
    let at = nodes.len();
    nodes.push(Node {
        middle: (least + most) / 2.0,
        half: ((most - least) / 2.0).add_scalar(MARGIN_CM),
        axis,
        cosine,
        sine: (1.0 - cosine * cosine).max(0.0).sqrt(),
        first: first as u32,
        last: (first + names.len()) as u32,
        other: 0,
    });
    if names.len() > LEAF {
        let wide = (most - least).imax();
        let half = names.len() / 2;
        names.select_nth_unstable_by(half, |a, b| vertex(a)[wide].total_cmp(&vertex(b)[wide]).then(a.cmp(b)));
        let (left, right) = names.split_at_mut(half);
        split(body, left, first, nodes);
        nodes[at].other = nodes.len() as u32;
        split(body, right, first + half, nodes);
    } else {
        names.sort_unstable();
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

impl Nearest for Boxes {
    fn nearest(&self, part: usize, query: &Query, hint: Option<u32>) -> Option<Found> {
        let part = &self.parts[part];
        let sine = (1.0 - query.cosine * query.cosine).max(0.0).sqrt();
        let mut found: Option<Found> = None;
        let mut within = query.within;
        if let Some(hint) = hint {
            let place = self.places[hint as usize] as usize;
            let square = (part.vertices[place] - query.point).norm_squared();
            if square < within && query.accepts(&part.normals[place]) {
                found = Some(Found { vertex: hint, square });
                within = square;
            }
        }
        let mut waiting = [(0_u32, 0.0_f64); 32];
        let mut count = 0;
        let mut at = 0;
        let Some(root) = part.nodes.first() else { return found };
        let mut square = root.square(&query.point);
        loop {
            // what is as near as the best so far may hold a vertex that comes first
            if square <= within {
                let node = &part.nodes[at];
                if node.faces(query, sine) {
                    if node.other > 0 {
                        let (near, far) = (at + 1, node.other as usize);
                        let (a, b) = (part.nodes[near].square(&query.point), part.nodes[far].square(&query.point));
                        let (near, far, a, b) = if b < a { (far, near, b, a) } else { (near, far, a, b) };
                        waiting[count] = (far as u32, b);
                        count += 1;
                        (at, square) = (near, a);
                        continue;
                    }
                    for place in node.first as usize..node.last as usize {
                        let square = (part.vertices[place] - query.point).norm_squared();
                        let first = square < within || (square == within && found.is_some_and(|f| part.names[place] < f.vertex));
                        if first && query.accepts(&part.normals[place]) {
                            found = Some(Found { vertex: part.names[place], square });
                            within = square;
                        }
                    }
                }
            }
            if count == 0 {
                return found;
            }
            count -= 1;
            (at, square) = (waiting[count].0 as usize, waiting[count].1);
        }
    }
}
