//! The parts of the tracker against the plainest way to compute the same.
#![allow(clippy::unwrap_used)]

mod lost;

use super::expect::Expected;
use super::search::limbs;
use super::*;
use crate::demo::actor::{Actor, Motion, ScanOptions};
use crate::random::{Random, Stream};
use crate::solve::ik::terms::{At, Limits};
use crate::solve::ik::{Pose, Posed, Rigid, State, Term, Tree, Vec3};
use formats::rig::{Joint, JointKind, Skeleton};
use nalgebra::{Matrix3, UnitQuaternion};

/// A point at random.
fn point(random: &mut Random, size: f64) -> Vec3 {
    Vec3::from_fn(|_, _| random.between(-size, size))
}

/// A direction at random.
fn direction(random: &mut Random) -> Vec3 {
    loop {
        let x = point(random, 1.0);
        if x.norm() > 0.1 {
            return x.normalize();
        }
    }
}

/// A body of lumps: a part without vertices, one with a single one, and others with many, of which some lie on each other and some have no normal.
fn lumps(seed: u64) -> (Body, Random) {
    let mut random = Random::new(seed, Stream::Actor);
    let sizes = [0, 1, 2, 13, 300, 700];
    let joints = (0..sizes.len()).map(|at| Joint {
        name: format!("joint{at}"),
        kind: if at == 0 { JointKind::Translate } else { JointKind::Ball },
        parent: at.checked_sub(1),
        centre: point(&mut random, 30.0).into(),
        state: [0.0; 3],
    });
    let tree = Tree::new(&Skeleton { joints: joints.collect() }, 1.0);
    let (mut vertices, mut normals, mut parts) = (Vec::new(), Vec::new(), Vec::new());
    for (part, size) in sizes.into_iter().enumerate() {
        let first = vertices.len();
        for at in 0..size {
            let normal = direction(&mut random);
            let again = at > 3 && random.whole(0, 8) == 0;
            let place =
                if again { vertices[first + random.whole(0, at)] } else { tree.links[part].centre + normal * random.between(8.0, 10.0) };
            vertices.push(place);
            normals.push(if random.whole(0, 20) == 0 { Vec3::zeros() } else { normal });
            parts.push(part);
        }
    }
    (Body::new(tree, vertices, normals, Vec::new(), parts), random)
}

/// Somebody with a surface.
fn actor(seed: u64) -> (Actor, Body, Limits) {
    let actor = Actor::new(seed);
    let points = |list: &[[f64; 3]]| list.iter().map(|x| Vec3::from(*x)).collect::<Vec<_>>();
    let (vertices, normals) = (points(&actor.mesh.vertices), points(&actor.mesh.normals));
    let body = Body::new(Tree::new(&actor.skeleton, 1.0), vertices, normals, actor.mesh.faces.clone(), actor.parts.clone());
    let limits = Limits::new(&actor.limits, false, 1.0);
    (actor, body, limits)
}

fn posed(body: &Body, pose: &Pose) -> Posed {
    let mut posed = Posed::new(&body.tree);
    posed.set(&body.tree, pose);
    posed
}

/// A cloud of the vertices of a body in a pose, every so many, with noise.
fn vertices(body: &Body, parts: &[Rigid], every: usize, noise_cm: f64, random: &mut Random) -> Cloud {
    let mut cloud = Cloud::default();
    for at in (0..body.vertices.len()).step_by(every) {
        let part = &parts[body.parts[at]];
        cloud.points.push(part.point(&body.vertices[at]) + Vec3::from(random.normal3()) * noise_cm);
        cloud.normals.push(part.rotation * body.normals[at]);
    }
    cloud
}

#[test]
fn trees_of_boxes_find_what_looking_at_every_vertex_finds() {
    let mut found = 0;
    for seed in 0..8 {
        let (body, mut random) = lumps(seed);
        let (boxes, brute) = (Boxes::new(&body), Brute(&body));
        for part in 0..body.tree.joints() {
            let surface = &body.surfaces[part];
            let some = |random: &mut Random| (!surface.is_empty()).then(|| surface[random.whole(0, surface.len())]);
            for _ in 0..1000 {
                let place = |vertex: Option<u32>| vertex.map_or_else(Vec3::zeros, |vertex| body.vertices[vertex as usize]);
                let (one, other, hint) = (some(&mut random), some(&mut random), some(&mut random));
                let point = match random.whole(0, 4) {
                    0 => place(one),
                    1 => (place(one) + place(other)) / 2.0,
                    2 => place(one) + point(&mut random, 1.0),
                    _ => point(&mut random, 60.0),
                };
                let normal = match random.whole(0, 4) {
                    0 => Vec3::zeros(),
                    1 => one.map_or_else(Vec3::zeros, |vertex| body.normals[vertex as usize]),
                    _ => direction(&mut random),
                };
                let cosine = [-1.5, -1.0, -0.4, 0.0, 0.6, 0.999, 1.0][random.whole(0, 7)];
                let within = [f64::INFINITY, 1e4, 4.0, 0.01, 0.0][random.whole(0, 5)];
                let query = Query { point, normal, cosine, within };
                let expected = brute.nearest(part, &query, None);
                found += usize::from(expected.is_some());
                for hint in [None, hint, expected.map(|found| found.vertex)] {
                    assert_eq!(boxes.nearest(part, &query, hint), expected, "seed {seed}, part {part}, {query:?}, hint {hint:?}");
                }
            }
        }
    }
    assert!((10_000..40_000).contains(&found), "{found} of 48000 queries have an answer");
}

/// Of vertices at the same distance the first is found, whatever the hint: on a lattice many are equally far.
#[test]
fn of_vertices_at_one_distance_the_first_is_found() {
    let (body, mut random) = lumps(1);
    for offset in [0.0, 0.1, 1234.567] {
        let mut vertices: Vec<Vec3> = (0..512).map(|at| Vec3::new(f64::from(at % 8), f64::from(at / 8 % 8), f64::from(at / 64))).collect();
        // in no order
        vertices.sort_by_key(|x| (x.x as u64 * 5 + x.y as u64 * 3 + x.z as u64 * 7) % 8);
        for x in &mut vertices {
            *x = x.add_scalar(offset);
        }
        let count = vertices.len();
        let body = Body::new(body.tree.clone(), vertices, vec![Vec3::zeros(); count], Vec::new(), vec![2; count]);
        let (boxes, brute) = (Boxes::new(&body), Brute(&body));
        for _ in 0..3000 {
            let halves = Vec3::from_fn(|_, _| f64::from(u32::try_from(random.whole(0, 17)).unwrap()) / 2.0 - 0.5).add_scalar(offset);
            let query = Query { point: halves, normal: Vec3::y(), cosine: 0.6, within: 4.0 };
            let expected = brute.nearest(2, &query, None);
            for hint in [None, Some(random.whole(0, count) as u32), Some((count - 1) as u32)] {
                assert_eq!(boxes.nearest(2, &query, hint), expected, "{query:?}, hint {hint:?}");
            }
        }
    }
}

/// Where all normals of a box are the same but for rounding, angles are known to about 1e-8 only: their sines come from cosines.
#[test]
fn normals_at_the_very_edge_of_the_cone_are_not_missed() {
    let (body, _) = lumps(1);
    for tilt in [0.0, 1e-9, 1e-8, 2e-8, 1e-7, 1e-3] {
        let normals: Vec<Vec3> = (0..40).map(|at| if at % 2 == 0 { Vec3::y() } else { Vec3::new(tilt, 1.0, 0.0).normalize() }).collect();
        let vertices = (0..40).map(|at| Vec3::new(f64::from(at), 0.0, 0.0)).collect();
        let body = Body::new(body.tree.clone(), vertices, normals, Vec::new(), vec![3; 40]);
        let (boxes, brute) = (Boxes::new(&body), Brute(&body));
        for step in -200..=200 {
            let angle = 0.6_f64.acos() + f64::from(step) * (tilt / 100.0 + 1e-11);
            let query = Query { point: Vec3::x(), normal: Vec3::new(angle.sin(), angle.cos(), 0.0), cosine: 0.6, within: 1e9 };
            assert_eq!(boxes.nearest(3, &query, None), brute.nearest(3, &query, None), "tilt {tilt}, step {step}");
        }
    }
}

/// A mixture, a pose, and a cloud around it with points that belong to nothing.
fn scene(seed: u64) -> (Body, Vec<Rigid>, Cloud, Random) {
    let (body, mut random) = lumps(seed);
    let mut pose = Pose::reference(&body.tree);
    let update: Vec<f64> = (0..body.tree.freedom()).map(|_| random.between(-1.0, 1.0)).collect();
    pose.update(&body.tree, &update, 1.0);
    let parts = posed(&body, &pose).parts;
    let mut cloud = vertices(&body, &parts, 2, 0.8, &mut random);
    for _ in 0..300 {
        cloud.points.push(point(&mut random, 80.0));
        cloud.normals.push(if random.whole(0, 5) == 0 { Vec3::zeros() } else { direction(&mut random) });
    }
    (body, parts, cloud, random)
}

const MIXTURE: Mixture = Mixture { sigma_cm: 1.3, outlier: 0.1, cosine: 0.6, spacing_cm: 1.0, reach: 3.0 };

fn bits(found: &Expected) -> Vec<u64> {
    let pairs = found.pairs.iter().flat_map(|pair| [pair.weight, pair.point.x, pair.vertex.y, pair.normal.z]);
    let sums = [found.log_likelihood, found.inliers].into_iter().chain(found.mass.iter().copied()).chain(found.squares.iter().copied());
    pairs.chain(sums).map(f64::to_bits).collect()
}

#[test]
fn expectations_do_not_depend_on_how_vertices_are_found() {
    for seed in 0..4 {
        let (body, mut parts, cloud, mut random) = scene(seed);
        let (boxes, brute) = (Boxes::new(&body), Brute(&body));
        for every in [1, 3] {
            let (mut one, mut other) = (Expectation::default(), Expectation::default());
            one.forget(&body, &cloud);
            other.forget(&body, &cloud);
            // the second and third round have hints
            for sigma_cm in [4.0, 1.3, 0.4] {
                let mixture = Mixture { sigma_cm, ..MIXTURE };
                one.step(&body, &boxes, &cloud, &parts, &mixture, every);
                other.step(&body, &brute, &cloud, &parts, &mixture, every);
                assert_eq!(one.found.names, other.found.names);
                assert_eq!(bits(&one.found), bits(&other.found));
                for part in &mut parts {
                    part.shift += point(&mut random, 1.0);
                }
            }
        }
    }
}

/// Shares and likelihood, evaluated in the world with matrices of the Gaussians.
#[test]
fn expectations_are_what_the_mixture_says() {
    for (seed, spacing_cm) in [(0, 0.0), (1, 1.0), (2, 2.5)] {
        let (body, parts, cloud, _) = scene(seed);
        let mixture = Mixture { spacing_cm, ..MIXTURE };
        let mut expectation = Expectation::default();
        expectation.forget(&body, &cloud);
        expectation.step(&body, &Boxes::new(&body), &cloud, &parts, &mixture, 1);
        let found = &expectation.found;
        let surfaces = body.surfaces.iter().filter(|surface| !surface.is_empty()).count() as f64;
        let flat = mixture.sigma_cm.powi(2) + spacing_cm.powi(2);
        let peak = 1.0 / ((std::f64::consts::TAU).powf(1.5) * mixture.sigma_cm * flat);
        let (mut likelihood, mut inliers, mut at) = (0.0, 0.0, 0);
        for (name, (point, normal)) in cloud.points.iter().zip(&cloud.normals).enumerate() {
            let mut densities = Vec::new();
            for (part, surface) in body.surfaces.iter().enumerate() {
                let there = surface.iter().map(|&vertex| {
                    let off = parts[part].point(&body.vertices[vertex as usize]) - point;
                    (vertex, parts[part].rotation * body.normals[vertex as usize], off)
                });
                let fits = |n: &Vec3| n.dot(normal) > mixture.cosine || *n == Vec3::zeros() || *normal == Vec3::zeros();
                let nearest = there.filter(|(_, n, _)| fits(n)).min_by(|a, b| a.2.norm_squared().total_cmp(&b.2.norm_squared()));
                let Some((_, n, off)) = nearest.filter(|(.., off)| off.norm_squared() < mixture.reach.powi(2) * flat) else { continue };
                let covariance = Matrix3::identity() * flat - n * n.transpose() * spacing_cm.powi(2);
                let exponent = -0.5 * off.dot(&(covariance.try_inverse().unwrap() * off));
                densities.push((part, peak * exponent.exp()));
            }
            let sum = peak * mixture.outlier + densities.iter().map(|(_, density)| density).sum::<f64>();
            likelihood += (sum / (surfaces + 1.0)).ln();
            let mut shares = 0.0;
            for (part, density) in densities {
                let pair = &found.pairs[at];
                assert_eq!((found.names[at][0] as usize, pair.part as usize), (name, part));
                assert!((pair.weight - density / sum).abs() < 1e-9, "{} for {}", pair.weight, density / sum);
                assert_eq!(body.vertices[found.names[at][1] as usize], pair.vertex);
                shares += pair.weight;
                at += 1;
            }
            assert!(shares <= 1.0 + 1e-12, "{shares}");
            inliers += shares;
        }
        assert_eq!(at, found.pairs.len(), "pairs that should not be there");
        assert!((found.inliers - inliers / cloud.points.len() as f64).abs() < 1e-12);
        assert!((found.mass.iter().sum::<f64>() - inliers).abs() < 1e-9);
        assert!((found.log_likelihood - likelihood).abs() < 1e-7 * likelihood.abs(), "{} for {likelihood}", found.log_likelihood);
        assert!(inliers > 200.0 && at > 300);
    }
}

#[test]
fn part_of_the_points_tells_of_all() {
    let (body, parts, cloud, _) = scene(3);
    let boxes = Boxes::new(&body);
    let told = |every: usize, cloud: &Cloud| {
        let mut expectation = Expectation::default();
        expectation.forget(&body, cloud);
        expectation.step(&body, &boxes, cloud, &parts, &MIXTURE, every);
        expectation.found
    };
    let (all, some) = (told(1, &cloud), told(3, &cloud));
    assert!((all.inliers - some.inliers).abs() < 0.1, "{} {}", all.inliers, some.inliers);
    assert!((some.log_likelihood / all.log_likelihood - 1.0).abs() < 0.1);
    assert!(some.names.iter().all(|name| all.names.contains(name)), "they are found as they are among all");
    let none = told(1, &Cloud::default());
    assert_eq!((none.pairs.len(), none.inliers, none.log_likelihood), (0, 0.0, 0.0));
    assert_eq!(none.mass, vec![0.0; body.tree.joints()]);
    let two = Cloud { points: cloud.points[..2].to_vec(), normals: cloud.normals[..2].to_vec() };
    assert_eq!(told(5, &two).names, told(1, &two).names.into_iter().filter(|name| name[0] == 0).collect::<Vec<_>>());
}

#[test]
fn what_is_beside_a_surface_is_found_in_boxes_as_among_all_points() {
    for seed in 0..4 {
        let (body, parts, mut cloud, mut random) = scene(seed);
        if seed == 3 {
            cloud = Cloud::default();
        }
        // far outside of all boxes, and where there is no number for a box
        cloud.points.extend([Vec3::repeat(1e7), Vec3::repeat(-1e300), Vec3::new(0.0, f64::INFINITY, 0.0)]);
        cloud.normals.extend([Vec3::x(), Vec3::zeros(), Vec3::y()]);
        for size_cm in [0.5, 3.0, 40.0] {
            let places: Vec<Vec3> = body.posed(&parts).collect();
            let beside = Beside::new(&cloud, places.iter().copied(), size_cm);
            for cosine in [-1.0, 0.6] {
                for place in &places {
                    let normal = if random.whole(0, 8) == 0 { Vec3::zeros() } else { direction(&mut random) };
                    let most = size_cm * size_cm * [1.0, 0.3][random.whole(0, 2)];
                    let fits = |n: &Vec3| n.dot(&normal) > cosine || *n == Vec3::zeros() || normal == Vec3::zeros();
                    let near = cloud.points.iter().zip(&cloud.normals).filter(|(_, n)| fits(n)).map(|(x, _)| (x - place).norm_squared());
                    assert_eq!(beside.square(place, &normal, cosine, most), near.fold(most, f64::min), "{place}, boxes of {size_cm}");
                }
            }
            let shares = coverage(&body, &parts, &beside, 0.6, size_cm);
            for (part, surface) in body.surfaces.iter().enumerate() {
                let covered = surface.iter().filter(|&&vertex| {
                    let place = parts[part].point(&body.vertices[vertex as usize]);
                    let normal = parts[part].rotation * body.normals[vertex as usize];
                    let fits = |n: &Vec3| n.dot(&normal) > 0.6 || *n == Vec3::zeros() || normal == Vec3::zeros();
                    cloud.points.iter().zip(&cloud.normals).any(|(x, n)| fits(n) && (x - place).norm_squared() < size_cm * size_cm)
                });
                let expected = covered.count() as f64 / surface.len() as f64;
                assert!(shares[part] == expected || surface.is_empty() && shares[part].is_nan(), "{} for {expected}", shares[part]);
            }
        }
    }
    let nothing = Cloud::default();
    assert_eq!(Beside::new(&nothing, std::iter::empty(), 3.0).square(&Vec3::x(), &Vec3::y(), 0.6, 9.0), 9.0);
}

#[test]
fn limbs_are_chains_that_end_in_the_open() {
    let (actor, body, _) = actor(1);
    let names = |limb: &super::search::Limb| {
        let names = limb.joints.iter().map(|&joint| actor.skeleton.joints[joint].name.as_str());
        names.collect::<Vec<_>>().join(" ")
    };
    let found: Vec<String> = limbs(&body).iter().map(names).collect();
    assert_eq!(found, ["head", "l_uarm l_farm l_hand", "r_uarm r_farm r_hand", "l_thigh l_shank l_foot", "r_thigh r_shank r_foot"]);
    // a chain without branches has nothing to hang on
    assert_eq!(limbs(&lumps(1).0), []);
}

fn cloud(actor: &Actor, frame: usize, points: usize) -> Cloud {
    let mesh = actor.scan(&actor.pose(Motion::Walk, frame as f64 / 30.0), frame, &ScanOptions { points, ..ScanOptions::default() });
    let list = |list: &[[f64; 3]]| list.iter().map(|x| Vec3::from(*x)).collect();
    Cloud { points: list(&mesh.vertices), normals: list(&mesh.normals) }
}

fn farthest(truth: &[Vec3], found: &[Vec3]) -> f64 {
    truth.iter().zip(found).skip(1).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

fn joints(actor: &Actor, frame: usize) -> Vec<Vec3> {
    actor.joints(&actor.pose(Motion::Walk, frame as f64 / 30.0)).into_iter().map(Vec3::from).collect()
}

#[test]
fn poses_do_not_depend_on_the_number_of_cores_nor_on_how_vertices_are_found() {
    let (actor, body, limits) = actor(3);
    for method in [Method::Planes, Method::Report] {
        let follow = |threads: usize, every_vertex: bool| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let nearest: Box<dyn Nearest> = if every_vertex { Box::new(Brute(&body)) } else { Box::new(Boxes::new(&body)) };
                let mut tracker = Tracker::with(&body, nearest, Some(&limits), Pose::reference(&body.tree), Settings::of(method));
                let frames = (0..4).map(|frame| Some(cloud(&actor, 3 * frame, 1200)));
                let mut tracked: Vec<Tracked> = frames.flat_map(|cloud| tracker.push(cloud)).collect();
                tracked.extend(tracker.finish());
                assert_eq!(tracked.len(), 4);
                tracked
            })
        };
        let one = follow(1, false);
        for other in [follow(2, false), follow(2, true)] {
            for (one, other) in one.iter().zip(&other) {
                assert_eq!(one.pose, other.pose);
                assert_eq!(one.rounds.len(), other.rounds.len());
                let numbers = |tracked: &Tracked| {
                    tracked
                        .rounds
                        .iter()
                        .map(|r| [r.log_likelihood, r.sigma_cm, r.inliers, r.moved_cm].map(f64::to_bits))
                        .collect::<Vec<_>>()
                };
                assert_eq!(numbers(one), numbers(other));
            }
        }
    }
}

#[test]
fn frames_without_points_are_predicted_and_the_body_is_found_again() {
    let (actor, body, limits) = actor(2);
    let first = 40;
    let mut tracker = Tracker::new(&body, Some(&limits), Pose::reference(&body.tree), Settings::default());
    for frame in 0..first {
        tracker.push(Some(cloud(&actor, frame, 800)));
    }
    let clouds = [None, Some(cloud(&actor, first + 1, 800)), Some(Cloud::default()), Some(cloud(&actor, first + 3, 800)), None];
    let seen = clouds.clone().map(|cloud| cloud.is_some_and(|cloud| !cloud.points.is_empty()));
    let mut tracked = Vec::new();
    for (cloud, seen) in clouds.into_iter().zip(seen) {
        let done = tracker.push(cloud);
        assert_eq!(done.is_empty(), !seen, "frames without points wait for the next one that has some");
        tracked.extend(done);
    }
    tracked.extend(tracker.finish());
    assert_eq!(tracked.len(), seen.len());
    for (at, (tracked, seen)) in tracked.iter().zip(seen).enumerate() {
        assert_eq!(tracked.way == Way::Predicted, !seen, "frame {at}");
        assert_eq!((tracked.rounds.is_empty(), tracked.cloud.is_none()), (!seen, !seen));
        let off = farthest(&joints(&actor, first + at), &tracked.centres);
        // the last one stays where the one before it was
        assert!(off < if at + 1 < 5 { 3.0 } else { 6.0 }, "frame {at}: {off} cm");
    }
    assert!(tracker.finish().is_empty());
}

/// Arms and legs that are far from where they were in the frame before, and then stay there: followed or searched.
#[test]
fn limbs_that_jump_are_found() {
    let (actor, body, limits) = actor(1);
    let mut random = Random::new(1, Stream::Noise);
    let still = posed(&body, &Pose::reference(&body.tree));
    let mut told = Vec::new();
    let mut searched = 0;
    for (name, axis) in [("l_uarm", Vec3::z()), ("r_uarm", -Vec3::x()), ("l_thigh", -Vec3::x()), ("r_thigh", -Vec3::z())] {
        for degrees in [60.0_f64, 90.0, 120.0] {
            let mut pose = Pose::reference(&body.tree);
            let joint = actor.skeleton.joint(name).unwrap();
            pose.0[joint] = State::Rotation(UnitQuaternion::from_scaled_axis(axis * degrees.to_radians()));
            let there = posed(&body, &pose);
            assert_eq!(limits.energy(&At { tree: &body.tree, pose: &pose, posed: &there }), 0.0, "{name} by {degrees} is possible");
            let mut tracker = Tracker::new(&body, Some(&limits), Pose::reference(&body.tree), Settings::default());
            let parts = std::iter::repeat_n(&still, 10).chain(std::iter::repeat_n(&there, 3)).map(|posed| &posed.parts);
            let mut tracked: Vec<Tracked> =
                parts.flat_map(|parts| tracker.push(Some(vertices(&body, parts, 4, 0.2, &mut random)))).collect();
            tracked.extend(tracker.finish());
            let (before, after) = tracked.split_at(10);
            assert!(before.iter().all(|tracked| tracked.way == Way::Tracked && farthest(&still.centres, &tracked.centres) < 1.0));
            // in the second frame motion is expected to go on
            for (frame, (tracked, most)) in after.iter().zip([7.0, 5.0, 2.0]).enumerate() {
                let off = farthest(&there.centres, &tracked.centres);
                searched += usize::from(tracked.way == Way::Searched);
                if off > most || tracked.lost.contains(&true) {
                    told.push(format!("{name} by {degrees}, frame {frame}: {off} cm, {:?}, {:?}", tracked.way, tracked.lost));
                }
            }
        }
    }
    assert!(told.is_empty() && searched >= 6, "{searched} times searched; {told:#?}");
}
