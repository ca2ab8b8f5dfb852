//! Whether a skeleton and a surface belong together.

use crate::solve::ik::Vec3;
use crate::solve::track::Body;

/// The centre of a joint is inside of the body or close to it: farther from its part than this share of the body's size, something is wrong.
const APART: f64 = 0.15;

/// Joints that are nowhere near the part they move, each with the distance of the part's nearest vertex, cm; and the number of joints with a part.
pub(super) fn apart(body: &Body) -> (Vec<(usize, f64)>, usize) {
    let most = APART * body.size_cm();
    let with_part = (0..body.tree.joints()).filter(|&joint| !body.surfaces[joint].is_empty());
    let distance = |joint: usize| {
        let centre = &body.tree.links[joint].centre;
        let places = body.surfaces[joint].iter().map(|&vertex| &body.vertices[vertex as usize]);
        places.map(|x| (x - centre).norm()).fold(f64::INFINITY, f64::min)
    };
    let all = with_part.clone().count();
    (with_part.map(|joint| (joint, distance(joint))).filter(|(_, distance)| *distance > most).collect(), all)
}

/// True if normals point inwards: those of most of the surface point towards the middle of their part.
pub(super) fn inside_out(body: &Body) -> bool {
    let mut outwards = 0.0;
    for surface in &body.surfaces {
        let places = || surface.iter().map(|&vertex| &body.vertices[vertex as usize]);
        let middle = places().sum::<Vec3>() / surface.len().max(1) as f64;
        let normals = surface.iter().map(|&vertex| &body.normals[vertex as usize]);
        outwards += places().zip(normals).map(|(x, normal)| (x - middle).dot(normal)).sum::<f64>();
    }
    outwards < 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::demo::actor::Actor;
    use crate::solve::ik::Tree;

    fn body(seed: u64) -> Body {
        let actor = Actor::new(seed);
        let points = |list: &[[f64; 3]]| list.iter().map(|x| Vec3::from(*x)).collect::<Vec<_>>();
        let (vertices, normals) = (points(&actor.mesh.vertices), points(&actor.mesh.normals));
        Body::new(Tree::new(&actor.skeleton, 1.0), vertices, normals, actor.mesh.faces.clone(), actor.parts.clone())
    }

    #[test]
    fn bodies_belong_to_their_skeletons_and_not_to_others() {
        for seed in [1, 2, 7] {
            let body = body(seed);
            assert_eq!(apart(&body).0, [], "body {seed}");
            let mut moved = body.clone();
            for link in &mut moved.tree.links {
                link.centre.y -= 90.0;
            }
            let (apart, all) = apart(&moved);
            assert!(apart.len() > all / 2, "{apart:?} of {all}");
        }
    }

    #[test]
    fn surfaces_that_are_inside_out_are_noticed() {
        for seed in [1, 2, 7] {
            let mut body = body(seed);
            assert!(!inside_out(&body));
            body.turn_normals();
            assert!(inside_out(&body));
        }
    }
}
