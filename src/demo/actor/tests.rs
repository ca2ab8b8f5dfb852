//! Is it a body, does it move like one, and are the clouds what they say?

#![allow(clippy::unwrap_used, clippy::indexing_slicing)] // a test may fail

use super::*;
use formats::rig::JointKind;
use nalgebra::Rotation3;
use std::sync::LazyLock;

static ACTOR: LazyLock<Actor> = LazyLock::new(|| Actor::new(1));

fn vector(point: [f64; 3]) -> Vector3<f64> {
    Vector3::from(point)
}

fn largest_distance(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(&a, &b)| (vector(a) - vector(b)).norm()).fold(0.0, f64::max)
}

/// Volume inside a surface: signed, so that a surface inside out has a negative one.
fn litres(vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> f64 {
    let six: f64 = faces
        .iter()
        .map(|face| {
            let [a, b, c] = face.map(|k| vector(vertices[k as usize]));
            a.dot(&b.cross(&c))
        })
        .sum();
    six / 6000.0
}

/// How often a point is wound by the surface: 1 inside, 0 outside, by the solid angles of all faces (Van Oosterom and Strackee, 1983).
fn winding(vertices: &[[f64; 3]], faces: &[[u32; 3]], point: Vector3<f64>) -> f64 {
    let solid = |face: &[u32; 3]| {
        let [a, b, c] = face.map(|k| vector(vertices[k as usize]) - point);
        let (x, y, z) = (a.norm(), b.norm(), c.norm());
        2.0 * a.dot(&b.cross(&c)).atan2(x * y * z + a.dot(&b) * z + b.dot(&c) * x + c.dot(&a) * y)
    };
    faces.iter().map(solid).sum::<f64>() / (4.0 * std::f64::consts::PI)
}

#[test]
fn the_surface_is_closed_and_faces_outwards() {
    for seed in 1..=5 {
        let actor = Actor::new(seed);
        let mesh = &actor.mesh;
        assert!(net::is_closed(&mesh.faces), "seed {seed}");
        let vertices = mesh.vertices.len();
        assert!((2000..=3500).contains(&vertices), "seed {seed}: {vertices} vertices");
        assert_eq!(2 * vertices - mesh.faces.len(), 4, "seed {seed}: a body has no handles");
        assert!((40.0..110.0).contains(&litres(&mesh.vertices, &mesh.faces)), "seed {seed}: {} l", litres(&mesh.vertices, &mesh.faces));
        for vertex in (0..vertices).step_by(97) {
            let (at, out) = (vector(mesh.vertices[vertex]), vector(mesh.normals[vertex]));
            assert!((out.norm() - 1.0).abs() < 1e-9);
            assert!(winding(&mesh.vertices, &mesh.faces, at + out * 0.3) < 0.5, "seed {seed}, vertex {vertex}");
            assert!(winding(&mesh.vertices, &mesh.faces, at - out * 0.3) > 0.5, "seed {seed}, vertex {vertex}");
        }
        assert!(actor.weights.iter().all(|list| (list.iter().map(|(_, share)| share).sum::<f64>() - 1.0).abs() < 1e-9));
    }
}

#[test]
fn the_skeleton_is_inside_the_surface() {
    let names: Vec<&str> = ACTOR.skeleton.joints.iter().map(|joint| joint.name.as_str()).collect();
    assert_eq!(names.join(" "), "root torso head l_uarm l_farm l_hand r_uarm r_farm r_hand l_thigh l_shank l_foot r_thigh r_shank r_foot");
    assert_eq!(ACTOR.skeleton.freedom(), 29);
    for (index, joint) in ACTOR.skeleton.joints.iter().enumerate() {
        assert!(joint.parent.is_none_or(|parent| parent < index));
        assert!(winding(&ACTOR.mesh.vertices, &ACTOR.mesh.faces, vector(joint.centre)) > 0.5, "{}", joint.name);
        let owned = ACTOR.parts.iter().filter(|&&part| part == index).count();
        assert!(if index == 0 { owned == 0 } else { owned >= 60 }, "{} has {owned} vertices", joint.name);
        if let JointKind::Revolute { axis } = joint.kind {
            assert!((vector(axis).norm() - 1.0).abs() < 1e-12);
        }
    }
}

#[test]
fn a_seed_is_one_body_and_another_seed_another() {
    let again = Actor::new(1);
    assert_eq!((&again.mesh, &again.skeleton, &again.parts), (&ACTOR.mesh, &ACTOR.skeleton, &ACTOR.parts));
    let other = Actor::new(2);
    assert!(largest_distance(&joint_centres(&other), &joint_centres(&ACTOR)) > 1.0);
    let (pose, other_pose) = (ACTOR.pose(Motion::Walk, 2.0), other.pose(Motion::Walk, 2.0));
    assert_eq!(ACTOR.scan(&pose, 7, &ScanOptions::default()), again.scan(&again.pose(Motion::Walk, 2.0), 7, &ScanOptions::default()));
    assert_ne!(ACTOR.scan(&pose, 7, &ScanOptions::default()), ACTOR.scan(&pose, 8, &ScanOptions::default()));
    assert!(largest_distance(&ACTOR.joints(&pose), &other.joints(&other_pose)) > 3.0, "they walk differently");
}

fn joint_centres(actor: &Actor) -> Vec<[f64; 3]> {
    actor.skeleton.joints.iter().map(|joint| joint.centre).collect()
}

#[test]
fn motions_begin_in_the_reference_pose_and_leave_it_smoothly() {
    for motion in [Motion::Walk, Motion::Gym] {
        let start = ACTOR.pose(motion, 0.0);
        assert!(largest_distance(&ACTOR.surface(&start).0, &ACTOR.mesh.vertices) < 1e-9);
        assert!(largest_distance(&ACTOR.joints(&start), &joint_centres(&ACTOR)) < 1e-9);
        assert!(start.states.iter().flatten().all(|x| x.abs() < 1e-9));
        let next = ACTOR.joints(&ACTOR.pose(motion, 1.0 / 30.0));
        assert!(largest_distance(&next, &joint_centres(&ACTOR)) < 1.0, "{motion:?}");
    }
}

#[test]
fn a_frame_rate_samples_the_same_motion() {
    for motion in [Motion::Walk, Motion::Gym] {
        let (slow, fast) = (ACTOR.poses(motion, 60, 15.0), ACTOR.poses(motion, 120, 30.0));
        for (slow, fast) in slow.iter().zip(fast.iter().step_by(2)) {
            assert!(largest_distance(&ACTOR.joints(slow), &ACTOR.joints(fast)) < 1e-9);
        }
    }
}

/// No joint goes where the limits forbid, nothing moves faster than people do, and nothing sinks into the floor.
#[test]
fn motions_are_possible() {
    for seed in 1..=4 {
        let actor = Actor::new(seed);
        for motion in [Motion::Walk, Motion::Gym] {
            let rate = 60.0;
            let mut before: Option<Vec<[f64; 3]>> = None;
            for (frame, pose) in actor.poses(motion, 540, rate).iter().enumerate() {
                let place = |joint: usize| format!("seed {seed}, {motion:?}, frame {frame}, {}", actor.skeleton.joints[joint].name);
                for (joint, limit) in actor.limits.iter().enumerate() {
                    let state = pose.states[joint];
                    match limit {
                        Some(Limit::Revolute { least, most }) => {
                            assert!((*least..=*most).contains(&state[0]), "{}: {}", place(joint), state[0]);
                        }
                        Some(Limit::Ball { heading, heading_most, bank, bank_most }) => {
                            let turn = Rotation3::new(vector(state));
                            for (axis, farthest) in [(heading, heading_most), (bank, bank_most)] {
                                let angle = (turn * vector(*axis)).angle(&vector(*axis));
                                assert!(angle < *farthest, "{}: {angle} is beyond {farthest}", place(joint));
                            }
                        }
                        _ => {}
                    }
                }
                let joints = actor.joints(pose);
                if let Some(before) = &before {
                    let speed = largest_distance(before, &joints) * rate / 100.0;
                    assert!(speed < 12.0, "{}: {speed} m/s", place(0));
                }
                before = Some(joints);
                if frame % 12 == 0 {
                    let lowest = actor.surface(pose).0.iter().map(|vertex| vertex[1]).fold(f64::INFINITY, f64::min);
                    assert!((-5.0..35.0).contains(&lowest), "{}: {lowest} cm above the floor", place(0));
                }
            }
        }
    }
}

/// A rigid skeleton in the states of a pose has its legs where the truth has them, and its arms and head but for the bend of the back.
#[test]
fn states_put_a_rigid_skeleton_where_the_body_is() {
    let joints = &ACTOR.skeleton.joints;
    for motion in [Motion::Walk, Motion::Gym] {
        for pose in ACTOR.poses(motion, 40, 5.0) {
            let truth = ACTOR.joints(&pose);
            let mut placed: Vec<(Rotation3<f64>, Vector3<f64>)> = Vec::new();
            for (index, (joint, state)) in joints.iter().zip(&pose.states).enumerate() {
                let (turned, centre) = match joint.parent {
                    Some(parent) => {
                        let offset = vector(joint.centre) - vector(joints[parent].centre);
                        (placed[parent].0, placed[parent].1 + placed[parent].0 * offset)
                    }
                    None => (Rotation3::identity(), vector(joint.centre)),
                };
                placed.push(match joint.kind {
                    JointKind::Translate => (turned, centre + vector(*state)),
                    JointKind::Ball => (turned * Rotation3::new(vector(*state)), centre),
                    JointKind::Revolute { axis } => (turned * Rotation3::new(vector(axis) * state[0]), centre),
                });
                let error = (placed[index].1 - vector(truth[index])).norm();
                let bound = if (figure::HEAD..figure::LEG[0]).contains(&index) { 8.0 } else { 1e-6 };
                assert!(error < bound, "{motion:?}, {}: {error} cm", joint.name);
            }
        }
    }
}

/// The body bends where a skeleton of rigid parts cannot: a little when it walks.
#[test]
fn rigid_parts_are_wrong_by_millimetres() {
    let mut errors = Vec::new();
    for pose in ACTOR.poses(Motion::Walk, 60, 15.0) {
        let truth = ACTOR.joints(&pose);
        for arm in figure::ARM {
            // The distance between a shoulder and a hip changes, which it never does on a rigid torso.
            let length = |joints: &[[f64; 3]]| (vector(joints[arm]) - vector(joints[figure::LEG[0]])).norm();
            errors.push((length(&truth) - length(&joint_centres(&ACTOR))).abs());
        }
        for joint in [figure::ARM[0] + 1, figure::LEG[1] + 2] {
            let bone = |joints: &[[f64; 3]]| (vector(joints[joint]) - vector(joints[joint - 1])).norm();
            assert!((bone(&truth) - bone(&joint_centres(&ACTOR))).abs() < 1e-9, "bones are stiff");
        }
    }
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    assert!((0.1..1.5).contains(&mean), "{mean} cm");
}

/// The distance of a point from a triangle, by minimising over a grid that closes in: slow, and unlike anything that draws points.
fn distance_to_face(point: Vector3<f64>, [a, b, c]: [Vector3<f64>; 3]) -> f64 {
    let (mut best, mut at, mut width) = (f64::INFINITY, [1.0 / 3.0, 1.0 / 3.0], 0.5);
    for _ in 0..24 {
        let middle = at;
        for i in -2..=2 {
            for j in -2..=2 {
                let u = (middle[0] + f64::from(i) * width / 2.0).clamp(0.0, 1.0);
                let v = (middle[1] + f64::from(j) * width / 2.0).clamp(0.0, 1.0 - u);
                let distance = (a + (b - a) * u + (c - a) * v - point).norm();
                if distance < best {
                    (best, at) = (distance, [u, v]);
                }
            }
        }
        width *= 0.7;
    }
    best
}

#[test]
fn a_scan_without_noise_lies_on_the_surface() {
    let pose = ACTOR.pose(Motion::Gym, 1.4);
    let (vertices, _) = ACTOR.surface(&pose);
    let clean = ScanOptions { points: 150, noise_cm: 0.0, tilt_rad: 0.0, ..ScanOptions::default() };
    let cloud = ACTOR.scan(&pose, 3, &clean);
    assert_eq!((cloud.vertices.len(), cloud.normals.len(), cloud.faces.len()), (150, 150, 0));
    for (&point, &normal) in cloud.vertices.iter().zip(&cloud.normals) {
        let (point, normal) = (vector(point), vector(normal));
        assert!((normal.norm() - 1.0).abs() < 1e-9);
        let corners = |face: &[u32; 3]| face.map(|k| vector(vertices[k as usize]));
        let near = ACTOR.mesh.faces.iter().map(corners).filter(|[a, b, c]| ((a + b + c) / 3.0 - point).norm() < 6.0);
        let (distance, face) = near.map(|face| (distance_to_face(point, face), face)).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
        assert!(distance < 1e-3, "{distance} cm");
        let [a, b, c] = face;
        assert!((b - a).cross(&(c - a)).normalize().dot(&normal) > 0.4, "the normal is that of the place");
    }
}

#[test]
fn noise_holes_and_outliers_are_as_stated() {
    let pose = ACTOR.pose(Motion::Walk, 1.0);
    let options = ScanOptions { points: 4000, noise_cm: 0.0, tilt_rad: 0.0, ..ScanOptions::default() };
    let clean = ACTOR.scan(&pose, 0, &options);
    let noisy = ACTOR.scan(&pose, 0, &ScanOptions { noise_cm: 1.0, ..options });
    let square: f64 = clean.vertices.iter().zip(&noisy.vertices).map(|(&a, &b)| (vector(a) - vector(b)).norm_squared()).sum::<f64>();
    assert!((square / (3.0 * 4000.0) - 1.0).abs() < 0.05, "{square}");
    let holed = ACTOR.scan(&pose, 0, &ScanOptions { holes: 4, ..options });
    assert!((2000..3950).contains(&holed.vertices.len()), "{}", holed.vertices.len());
    let stray = ACTOR.scan(&pose, 0, &ScanOptions { outliers: 0.08, ..options });
    let (vertices, _) = ACTOR.surface(&pose);
    let far = |point: &&[f64; 3]| vertices.iter().all(|&vertex| (vector(vertex) - vector(**point)).norm() > 4.0);
    let share = stray.vertices.iter().filter(far).count() as f64 / 4000.0;
    assert!((0.03..0.09).contains(&share), "{share}");
}

#[test]
fn a_hull_contains_the_body_and_more() {
    let pose = ACTOR.pose(Motion::Gym, 1.5);
    let (vertices, _) = ACTOR.surface(&pose);
    let body = litres(&vertices, &ACTOR.mesh.faces);
    let mut volumes = Vec::new();
    for cameras in [8, 4] {
        let hull = ACTOR.hull(&pose, &Camera::ring(cameras, Motion::Gym.stage()), 2.5);
        assert_eq!(hull.vertices.len(), hull.normals.len());
        for &vertex in vertices.iter().step_by(41) {
            let vertex = vector(vertex);
            let near = hull.vertices.iter().map(|&point| (vector(point) - vertex).norm()).fold(f64::INFINITY, f64::min);
            // Half a cube and half a pixel may be carved away.
            assert!(near < 3.5 || winding(&hull.vertices, &hull.faces, vertex) > 0.5, "{cameras} cameras: {vertex} is outside");
        }
        let faces = net::normals(&hull.vertices, &hull.faces);
        let agree: f64 = faces.iter().zip(&hull.normals).map(|(&a, &b)| vector(a).dot(&vector(b))).sum::<f64>() / faces.len() as f64;
        assert!(agree > 0.85, "normals of the cubes and of the faces: {agree}");
        volumes.push(litres(&hull.vertices, &hull.faces));
    }
    assert!(volumes[0] > body * 0.98 && volumes[0] < body * 1.35, "{volumes:?} l of {body} l");
    assert!(volumes[1] > volumes[0] * 1.05, "fewer cameras leave more phantoms: {volumes:?}");
}

#[test]
fn a_depth_camera_sees_the_front_only() {
    let pose = ACTOR.pose(Motion::Gym, 4.2);
    let camera = Camera::depth(Motion::Gym.stage());
    let (vertices, normals) = ACTOR.surface(&pose);
    let cloud = ACTOR.depth(&pose, 0, &camera, 0.0);
    assert!((1500..6000).contains(&cloud.vertices.len()), "{} points", cloud.vertices.len());
    let eye = vector(camera.eye);
    for (&point, &normal) in cloud.vertices.iter().zip(&cloud.normals) {
        assert!(vector(normal).dot(&(vector(point) - eye)) < 1e-9);
    }
    let corners = |face: &[u32; 3]| face.map(|k| vector(vertices[k as usize]));
    for &point in cloud.vertices.iter().step_by(61) {
        // Nothing crosses the ray before the point (Möller and Trumbore, 1997).
        let ray = vector(point) - eye;
        let first = ACTOR.mesh.faces.iter().map(corners).filter_map(|[a, b, c]| {
            let (u, v) = (b - a, c - a);
            let determinant = u.dot(&ray.cross(&v));
            let from = eye - a;
            let (x, y) = (from.dot(&ray.cross(&v)) / determinant, ray.dot(&from.cross(&u)) / determinant);
            (x >= 0.0 && y >= 0.0 && x + y <= 1.0).then(|| v.dot(&from.cross(&u)) / determinant)
        });
        let first = first.filter(|&share| share > 0.0).fold(f64::INFINITY, f64::min);
        assert!((first - 1.0).abs() < 1e-3, "the surface is at {first} of the way");
    }
    let hidden = vertices.iter().zip(&normals).filter(|&(&at, &out)| vector(out).dot(&(vector(at) - eye)) > 0.0).count();
    assert!(hidden > vertices.len() / 3, "much of a body is turned away");
    let noisy = ACTOR.depth(&pose, 0, &camera, 0.2);
    let error = cloud.vertices.iter().zip(&noisy.vertices).map(|(&a, &b)| (vector(a) - vector(b)).norm_squared()).sum::<f64>();
    let error = (error / cloud.vertices.len() as f64).sqrt();
    assert!((0.14..0.24).contains(&error), "{error} cm at about 2.7 m");
}

#[test]
fn markers_are_on_the_skin_and_hidden_as_asked() {
    let map = ACTOR.marker_map();
    assert_eq!(map.len(), 41);
    assert_eq!((map[0].name.as_str(), map[7].name.as_str(), map[40].name.as_str()), ("torso_0", "head_0", "r_foot_2"));
    for marker in &map {
        assert_eq!(ACTOR.parts[marker.vertex], marker.joint);
        assert!(map.iter().all(|other| other == marker || other.vertex != marker.vertex));
    }
    let poses = ACTOR.poses(Motion::Walk, 300, 30.0);
    let all = ACTOR.markers(&poses, &MarkerOptions::default());
    for (frame, pose) in all.iter().zip(&poses).step_by(50) {
        for (sample, marker) in frame.iter().zip(&map) {
            assert!((vector(sample.unwrap()) - vector(ACTOR.vertex(pose, marker.vertex))).norm() < 0.4);
        }
    }
    for (hidden, gap_frames) in [(0.3, 1), (0.2, 25)] {
        let some = ACTOR.markers(&poses, &MarkerOptions { hidden, gap_frames, ..MarkerOptions::default() });
        let (mut gone, mut gaps) = (0.0, 0.0);
        for marker in 0..41 {
            for frame in 0..300 {
                if some[frame][marker].is_none() {
                    gone += 1.0;
                    gaps += if frame == 0 || some[frame - 1][marker].is_some() { 1.0 } else { 0.0 };
                } else {
                    assert_eq!(some[frame][marker], all[frame][marker], "what is seen does not depend on what is hidden");
                }
            }
        }
        let share: f64 = gone / (41.0 * 300.0);
        assert!((share - hidden).abs() < 0.08, "{share} of {hidden}");
        assert!(if gap_frames == 1 { gone / gaps < 2.0 } else { (15.0..35.0).contains(&(gone / gaps)) }, "{} frames", gone / gaps);
    }
}
