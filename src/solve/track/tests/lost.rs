//! Bodies and limbs that are not where they are expected.

use super::*;

/// Clouds of frames of gymnastics.
fn gymnastics(actor: &Actor, frames: std::ops::Range<usize>) -> Vec<(Cloud, Vec<Vec3>)> {
    let frame = |frame: usize| {
        let pose = actor.pose(Motion::Gym, frame as f64 / 30.0);
        let mesh = actor.scan(&pose, frame, &ScanOptions { points: 1200, ..ScanOptions::default() });
        let list = |list: &[[f64; 3]]| list.iter().map(|x| Vec3::from(*x)).collect();
        let joints = actor.joints(&pose).into_iter().map(Vec3::from).collect();
        (Cloud { points: list(&mesh.vertices), normals: list(&mesh.normals) }, joints)
    };
    frames.map(frame).collect()
}

/// A body that is in the middle of something when the clouds begin, although its skeleton says that it stands still: it is searched, and where it is
/// found, the frames before that are followed backwards. What is not right must be told.
#[test]
fn a_sequence_may_begin_in_another_pose_than_the_skeleton() {
    let (mut right, mut parts) = (0, 0);
    for seed in [1, 7] {
        let (actor, body, limits) = actor(seed);
        for first in [20, 40, 60] {
            let frames = gymnastics(&actor, first..first + 12);
            let mut tracker = Tracker::new(&body, Some(&limits), Pose::reference(&body.tree), Settings::default());
            let mut tracked: Vec<Tracked> = frames.iter().flat_map(|(cloud, _)| tracker.push(Some(cloud.clone()))).collect();
            tracked.extend(tracker.finish());
            assert_eq!(tracked.len(), frames.len());
            for (at, (tracked, (_, truth))) in tracked.iter().zip(&frames).enumerate() {
                for (joint, place) in truth.iter().enumerate().skip(1) {
                    let off = (place - tracked.centres[joint]).norm();
                    let above = body.tree.links[joint].parent.is_some_and(|parent| tracked.lost[parent]);
                    assert!(
                        off < 15.0 || tracked.lost[joint] || above,
                        "seed {seed}, frame {first} + {at}, joint {joint}: {off} cm in silence"
                    );
                    right += usize::from(off < 5.0);
                    parts += 1;
                }
            }
        }
    }
    assert!(20 * right > 19 * parts, "{right} of {parts} joints are where they should be");
}

#[test]
fn limbs_that_are_never_seen_are_told() {
    let (actor, body, limits) = actor(1);
    let arm: Vec<usize> = ["l_uarm", "l_farm", "l_hand"].iter().map(|name| actor.skeleton.joint(name).unwrap()).collect();
    let mut tracker = Tracker::new(&body, Some(&limits), Pose::reference(&body.tree), Settings::default());
    let mut tracked = Vec::new();
    for frame in 0..12 {
        let mut cloud = cloud(&actor, frame, 1500);
        let there = joints(&actor, frame);
        // what is nearest to the arm is not there
        let of_arm = |x: &Vec3| {
            let nearest = (1..there.len()).min_by(|a, b| (x - there[*a]).norm().total_cmp(&(x - there[*b]).norm())).unwrap();
            arm.contains(&nearest)
        };
        let kept: Vec<bool> = cloud.points.iter().map(|x| !of_arm(x)).collect();
        let mut keep = kept.iter();
        cloud.points.retain(|_| *keep.next().unwrap());
        let mut keep = kept.iter();
        cloud.normals.retain(|_| *keep.next().unwrap());
        tracked.extend(tracker.push(Some(cloud)));
    }
    assert!(tracked.is_empty(), "they wait for a frame in which the arm is found");
    tracked.extend(tracker.finish());
    assert_eq!(tracked.len(), 12);
    for (frame, tracked) in tracked.iter().enumerate() {
        assert!(arm[1..].iter().all(|&joint| tracked.lost[joint]), "frame {frame}: {:?}", tracked.lost);
        let others = (1..tracked.lost.len()).filter(|joint| !arm.contains(joint));
        assert!(others.clone().all(|joint| !tracked.lost[joint]), "frame {frame}: {:?}", tracked.lost);
    }
}

/// Frames that wait are not more than fit, and come out in order.
#[test]
fn frames_do_not_wait_forever() {
    let (_, body, limits) = actor(1);
    let mut tracker = Tracker::new(&body, Some(&limits), Pose::reference(&body.tree), Settings::default());
    // nothing that is like a body, wherever it is looked for
    let mut random = Random::new(1, Stream::Noise);
    let mut dust = |_| Cloud {
        points: (0..300).map(|_| point(&mut random, 2000.0)).collect(),
        normals: (0..300).map(|_| direction(&mut random)).collect(),
    };
    let clouds: Vec<Cloud> = (0..70).map(&mut dust).collect();
    let mut out = Vec::new();
    for (frame, cloud) in clouds.iter().enumerate() {
        out.extend(tracker.push(Some(cloud.clone())));
        assert!(frame + 1 - out.len() <= 60, "{} frames wait", frame + 1 - out.len());
    }
    assert_eq!(out.len(), 10);
    out.extend(tracker.finish());
    for (tracked, cloud) in out.iter().zip(&clouds) {
        assert!(tracked.lost.iter().all(|lost| *lost));
        assert_eq!(tracked.cloud.as_deref(), Some(cloud));
    }
    assert_eq!(out.len(), clouds.len());
}

#[test]
fn normals_that_point_inwards_are_turned() {
    let (actor, body, limits) = actor(1);
    let follow = |sign: f64| {
        let mut tracker = Tracker::new(&body, Some(&limits), Pose::reference(&body.tree), Settings::default());
        let mut tracked = Vec::new();
        for frame in 0..3 {
            let mut cloud = cloud(&actor, frame, 1200);
            for normal in &mut cloud.normals {
                *normal *= sign;
            }
            tracked.extend(tracker.push(Some(cloud)));
        }
        tracked.extend(tracker.finish());
        (tracker.turned(), tracked.into_iter().map(|tracked| tracked.pose).collect::<Vec<_>>())
    };
    let (one, other) = (follow(1.0), follow(-1.0));
    assert_eq!((one.0, other.0), (false, true));
    assert_eq!(one.1.len(), 3);
    assert_eq!(one.1, other.1);
}
