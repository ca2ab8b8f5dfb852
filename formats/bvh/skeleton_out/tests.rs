#![allow(clippy::unwrap_used, clippy::indexing_slicing)]
use super::super::euler::{Rows, about};
use super::*;
use crate::bvh::Bvh;
use crate::rig::Joint;
use crate::{Format, Notes, Stated, Take, Unit};
use std::f64::consts::PI;

struct Random(u64);

impl Random {
    fn below(&mut self, most: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 20) % most
    }

    /// Between -1 and 1.
    fn signed(&mut self) -> f64 {
        self.below(2_000_001) as f64 / 1e6 - 1.0
    }

    fn place(&mut self, size: f64) -> [f64; 3] {
        std::array::from_fn(|_| size * self.signed())
    }

    fn direction(&mut self) -> [f64; 3] {
        loop {
            let v = self.place(1.0);
            let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
            if length > 0.1 {
                return v.map(|x| x / length);
            }
        }
    }

    fn axis(&mut self) -> [f64; 3] {
        let turned = if self.below(2) == 0 { 1.0 } else { -1.0 };
        match self.below(6) {
            0 => [turned, 0.0, 0.0],
            1 => [0.0, turned, 0.0],
            2 => [0.0, 0.0, turned],
            _ => self.direction(),
        }
    }
}

fn joint(name: &str, kind: JointKind, parent: Option<usize>, centre: [f64; 3]) -> Joint {
    Joint { name: name.to_owned(), kind, parent, centre, state: [0.0; 3] }
}

fn apply(rows: &Rows, v: [f64; 3]) -> [f64; 3] {
    rows.map(|row| row.iter().zip(v).map(|(a, b)| a * b).sum())
}

fn product(a: &Rows, b: &Rows) -> Rows {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

fn plus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] + b[i])
}

/// Where the states put the joints, and the ends of those that have any: the products of their transforms, applied to the reference pose.
fn posed(skeleton: &Skeleton, states: &[State], ends: &[Option<[f64; 3]>]) -> Vec<([f64; 3], Option<[f64; 3]>)> {
    let mut all: Vec<(Rows, [f64; 3])> = Vec::new();
    for (joint, state) in skeleton.joints.iter().zip(states) {
        let (rotation, shift) = match (state, joint.kind) {
            (State::Shift(shift), _) => (about([1.0, 0.0, 0.0], 0.0), *shift),
            (State::Angle(angle), JointKind::Revolute { axis }) => {
                let rotation = about(axis, *angle);
                (rotation, minus(joint.centre, apply(&rotation, joint.centre)))
            }
            (State::Rotation(rotation), _) => (*rotation, minus(joint.centre, apply(rotation, joint.centre))),
            (State::Angle(_), _) => unreachable!(),
        };
        let own = match joint.parent.map(|parent| all[parent]) {
            Some((above, moved)) => (product(&above, &rotation), plus(apply(&above, shift), moved)),
            None => (rotation, shift),
        };
        all.push(own);
    }
    let put = |(rotation, shift): &(Rows, [f64; 3]), place| plus(apply(rotation, place), *shift);
    all.iter().zip(&skeleton.joints).zip(ends).map(|((own, joint), end)| (put(own, joint.centre), end.map(|end| put(own, end)))).collect()
}

fn random_skeleton(random: &mut Random) -> Skeleton {
    let kind = |random: &mut Random| match random.below(5) {
        0 => JointKind::Translate,
        1 | 2 => JointKind::Revolute { axis: random.axis() },
        _ => JointKind::Ball,
    };
    let first = if random.below(4) == 0 { kind(random) } else { JointKind::Translate };
    let mut joints = vec![joint("j0", first, None, random.place(100.0))];
    let merged = random.below(2) == 0;
    if merged {
        joints.push(joint("j1", JointKind::Ball, Some(0), joints[0].centre));
    }
    for at in joints.len()..joints.len() + 3 + random.below(10) as usize {
        let least = usize::from(merged);
        let parent = least + random.below((at - least) as u64) as usize;
        let centre = plus(joints[parent].centre, random.direction().map(|x| 30.0 * x));
        let kind = kind(random);
        joints.push(joint(&format!("j{at}"), kind, Some(parent), centre));
    }
    Skeleton { joints }
}

fn random_state(kind: JointKind, random: &mut Random) -> State {
    let rotation = |random: &mut Random| match random.below(6) {
        0 => about([1.0, 0.0, 0.0], PI),
        1 => about(random.axis(), PI),
        2 => about([0.0, 1.0, 0.0], PI / 2.0),
        3 => product(&about([0.0, 0.0, 1.0], 3.0 * random.signed()), &about([1.0, 0.0, 0.0], PI / 2.0)),
        _ => about(random.direction(), PI * random.signed()),
    };
    match kind {
        JointKind::Translate => State::Shift(random.place(5.0)),
        JointKind::Revolute { .. } => State::Angle(4.0 * random.signed()),
        JointKind::Ball => State::Rotation(rotation(random)),
    }
}

fn written(motion: &Motion<'_>) -> String {
    let mut out = Vec::new();
    write_motion(motion, &mut out).unwrap();
    String::from_utf8(out).unwrap()
}

fn read(text: &str) -> Take {
    let stated = Stated { unit: Some(Unit::Millimetre), ..Stated::default() };
    let notes = Notes::new();
    let document = Bvh.open(text.as_bytes().to_vec(), &stated, &notes).unwrap_or_else(|e| panic!("{e}\n{text}"));
    assert_eq!(notes.take(), [], "{text}");
    document.take().clone()
}

#[track_caller]
fn same_places(motion: &Motion<'_>) {
    let text = written(motion);
    let take = read(&text);
    assert_eq!(take.frames(), motion.frames.len());
    let mut compared = 0;
    for (frame, states) in motion.frames.iter().enumerate() {
        for (joint, (place, end)) in motion.skeleton.joints.iter().zip(posed(motion.skeleton, states, &motion.ends)) {
            for (label, place) in [(joint.name.clone(), Some(place)), (format!("{}_end", joint.name), end)] {
                let column = take.markers.iter().position(|m| m.label == label);
                let (Some(column), Some(expected)) = (column, place) else { continue };
                let found = take.position_mm(frame, column).unwrap();
                let off = minus(found, expected).iter().map(|x| x * x).sum::<f64>().sqrt();
                assert!(off < 3e-5, "{label} in frame {frame} is off by {off:e}\n{text}");
                compared += 1;
            }
        }
    }
    assert!(compared >= motion.frames.len() * (motion.skeleton.joints.len() - 1), "{compared}\n{text}");
}

#[test]
fn the_written_file_puts_joints_where_the_states_do() {
    let mut random = Random(0x1234_5678_9abc_def1);
    for _ in 0..300 {
        let skeleton = random_skeleton(&mut random);
        let frames: Vec<Vec<State>> =
            (0..5).map(|_| skeleton.joints.iter().map(|joint| random_state(joint.kind, &mut random)).collect()).collect();
        let mut ends = vec![None; skeleton.joints.len()];
        for (at, joint) in skeleton.joints.iter().enumerate() {
            let leaf = skeleton.joints.iter().all(|other| other.parent != Some(at));
            ends[at] = (leaf && random.below(2) == 0).then(|| plus(joint.centre, random.direction().map(|x| 10.0 * x)));
        }
        for order in Order::ALL {
            same_places(&Motion { skeleton: &skeleton, ends: ends.clone(), frame_secs: 1.0 / 30.0, order, frames: &frames });
        }
    }
}

/// A body that turns a somersault with a twist: nothing that turns smoothly has angles that jump.
#[test]
fn angles_do_not_jump() {
    let skeleton = Skeleton {
        joints: vec![
            joint("place", JointKind::Translate, None, [0.0, 90.0, 0.0]),
            joint("body", JointKind::Ball, Some(0), [0.0, 90.0, 0.0]),
            joint("arm", JointKind::Ball, Some(1), [20.0, 140.0, 0.0]),
            joint("hinge", JointKind::Revolute { axis: [0.6, 0.0, 0.8] }, Some(2), [50.0, 140.0, 0.0]),
            joint("wheel", JointKind::Revolute { axis: [0.0, 0.0, -1.0] }, Some(1), [0.0, 60.0, 0.0]),
        ],
    };
    let frames: Vec<Vec<State>> = (0..720)
        .map(|frame| {
            let turn = f64::from(frame) * PI / 90.0;
            // about x, y and z each goes straight through the lock of some order
            let body = product(&about([1.0, 0.0, 0.0], turn), &about([0.0, 1.0, 0.0], 0.5 * turn));
            let arm = product(&about([0.0, 1.0, 0.0], turn), &about([0.0, 0.0, 1.0], 0.25 * turn));
            // a state that is kept between -π and π
            let wheel = (turn + PI).rem_euclid(2.0 * PI) - PI;
            vec![State::Shift([0.0, turn.sin(), 0.0]), State::Rotation(body), State::Rotation(arm), State::Angle(turn), State::Angle(wheel)]
        })
        .collect();
    for order in Order::ALL {
        let motion = Motion { skeleton: &skeleton, ends: vec![None; 5], frame_secs: 0.01, order, frames: &frames };
        same_places(&motion);
        let text = written(&motion);
        let rows: Vec<Vec<f64>> = text
            .lines()
            .skip_while(|l| !l.starts_with("Frame Time"))
            .skip(1)
            .map(|l| l.split(' ').map(|x| x.parse().unwrap()).collect())
            .collect();
        assert_eq!(rows.len(), 720);
        for pair in rows.windows(2) {
            for (a, b) in pair[0].iter().zip(&pair[1]) {
                assert!((a - b).abs() <= 180.000_001, "{order:?}: {a} to {b}\n{:?}\n{:?}", pair[0], pair[1]);
            }
        }
        assert!((rows[719].last().unwrap() + 1438.0).abs() < 1e-5, "the wheel goes on turning: {:?}", rows[719].last());
    }
}

#[test]
fn the_text_is_as_other_programs_read_it() {
    let skeleton = Skeleton {
        joints: vec![
            joint("root", JointKind::Translate, None, [0.0, 90.0, 1.0]),
            joint("torso 1", JointKind::Ball, Some(0), [0.0, 90.0, 1.0]),
            joint("elbow", JointKind::Revolute { axis: [0.0, -1.0, 0.0] }, Some(1), [20.0, 130.0, 1.0]),
            joint("slider{}", JointKind::Translate, Some(1), [0.0, 80.0, 1.0]),
        ],
    };
    let quarter = State::Rotation(about([0.0, 0.0, 1.0], PI / 2.0));
    let frames = vec![vec![State::Shift([1.0, 2.0, -1e-9]), quarter, State::Angle(PI / 4.0), State::Shift([0.0, 0.5, 0.0])]];
    let ends = vec![None, None, Some([20.0, 100.0, 1.0]), None];
    let motion = Motion { skeleton: &skeleton, ends, frame_secs: 1.0 / 30.0, order: Order::default(), frames: &frames };
    let expected = "HIERARCHY
ROOT torso_1
{
\tOFFSET 0.000000 0.000000 0.000000
\tCHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation
\tJOINT elbow
\t{
\t\tOFFSET 20.000000 40.000000 0.000000
\t\tCHANNELS 1 Yrotation
\t\tEnd Site
\t\t{
\t\t\tOFFSET 0.000000 -30.000000 0.000000
\t\t}
\t}
\tJOINT slider__
\t{
\t\tOFFSET 0.000000 -10.000000 0.000000
\t\tCHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation
\t\tEnd Site
\t\t{
\t\t\tOFFSET 0.000000 0.000000 0.000000
\t\t}
\t}
}
MOTION
Frames: 1
Frame Time: 0.03333333333
1.000000 92.000000 1.000000 90.000000 0.000000 0.000000 -45.000000 0.000000 -9.500000 0.000000 0.000000 0.000000 0.000000
";
    assert_eq!(written(&motion), expected);
}

#[test]
fn what_cannot_be_written_is_refused() {
    let skeleton = Skeleton { joints: vec![joint("a", JointKind::Ball, None, [0.0; 3])] };
    let upright = State::Rotation(about([1.0, 0.0, 0.0], 0.0));
    let mirrored = State::Rotation([[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    let refused = |skeleton: &Skeleton, states: Vec<State>, frame_secs: f64| {
        let frames = [states];
        let motion = Motion { skeleton, ends: Vec::new(), frame_secs, order: Order::Xyz, frames: &frames };
        write_motion(&motion, &mut Vec::new()).unwrap_err().to_string()
    };
    assert!(refused(&Skeleton::default(), Vec::new(), 0.1).contains("no joints"));
    assert!(refused(&skeleton, vec![upright], 0.0).contains("no time"));
    assert!(refused(&skeleton, vec![], 0.1).contains("has 0 states, but there are 1 joints"));
    for state in [State::Angle(0.0), State::Shift([0.0; 3]), mirrored, State::Rotation([[f64::NAN; 3]; 3])] {
        assert!(refused(&skeleton, vec![state], 0.1).contains("does not fit"));
    }
    let loose = Skeleton { joints: vec![joint("a", JointKind::Ball, Some(0), [0.0; 3])] };
    assert!(refused(&loose, vec![upright], 0.1).contains("does not hang on one before it"));
    let far = Skeleton { joints: vec![joint("a", JointKind::Ball, None, [f64::INFINITY; 3])] };
    assert!(refused(&far, vec![upright], 0.1).contains("too large"));
}

/// As deep as a file allows.
#[test]
fn depth_costs_nothing() {
    let joints = (0..20_000_usize).map(|at| joint(&format!("j{at}"), JointKind::Ball, at.checked_sub(1), [at as f64, 0.0, 0.0])).collect();
    let skeleton = Skeleton { joints };
    let frames = [vec![State::Rotation(about([1.0, 0.0, 0.0], 0.0)); 20_000]];
    let motion = Motion { skeleton: &skeleton, ends: Vec::new(), frame_secs: 0.1, order: Order::Xyz, frames: &frames };
    assert!(written(&motion).len() < 20_000_000);
}
