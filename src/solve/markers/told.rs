//! Which joints the markers of a frame tell of: those of their parts, and all that carry them.

use super::Seen;
use crate::solve::ik::terms::Marker;
use crate::solve::ik::{Motion, Pose, Posed, Tree};

/// A marker is doubted that is farther from its place than so many times what is usual for it ...
const DOUBTED_TIMES: f64 = 5.0;
/// ... and this, cm.
const DOUBTED_CM: f64 = 2.0;

/// For every frame and joint, whether a marker tells of it: its own, or one of what hangs on it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Told {
    joints: usize,
    at_all: Vec<bool>,
    firm: Vec<bool>,
}

impl Told {
    /// Looks at what was seen and counts.
    pub fn new(tree: &Tree, markers: &[Marker], seen: &Seen) -> Self {
        let joints = tree.joints();
        let (mut told, mut firm) = (vec![false; joints * seen.frames], vec![false; joints * seen.frames]);
        let (mut own, mut behind) = (vec![0_usize; joints], vec![0_usize; joints]);
        let whole = tree.whole();
        let leaf: Vec<bool> = (0..joints).map(|joint| tree.children(joint) == 0).collect();
        for frame in 0..seen.frames {
            own.fill(0);
            for (at, ..) in seen.frame(frame) {
                own[markers[at].part] += 1;
            }
            behind.copy_from_slice(&own);
            for joint in (0..joints).rev() {
                if let Some(parent) = tree.links[joint].parent {
                    behind[parent] += behind[joint];
                }
                let enough = match tree.links[joint].motion {
                    Motion::Translate => true,
                    Motion::Revolute(_) => behind[joint] >= 2,
                    Motion::Ball if Some(joint) == whole => own[joint] >= 2 && behind[joint] >= 4,
                    Motion::Ball if leaf[joint] => own[joint] >= 2,
                    Motion::Ball => own[joint] >= 1 && behind[joint] >= 3,
                };
                told[frame * joints + joint] = behind[joint] > 0;
                firm[frame * joints + joint] = enough;
            }
            // what shifts the whole body is as firm as what turns it
            if let Some(whole) = whole {
                for joint in (0..joints).filter(|&joint| tree.links[joint].motion == Motion::Translate) {
                    firm[frame * joints + joint] = firm[frame * joints + whole];
                }
            }
        }
        Self { joints, at_all: told, firm }
    }

    /// Takes back that enough tells of a limb in frames in which markers of it are much farther from their places than they usually are.
    pub fn doubt(&mut self, tree: &Tree, markers: &[Marker], seen: &Seen, poses: &[Pose]) {
        let mut posed = Posed::new(tree);
        let mut off = vec![f64::NAN; seen.places.len()];
        for (frame, pose) in poses.iter().enumerate() {
            posed.set(tree, pose);
            for (at, x, _) in seen.frame(frame) {
                off[frame * seen.markers + at] = (posed.parts[markers[at].part].point(&markers[at].place()) - x).norm();
            }
        }
        let single = |joint: usize| tree.children(joint) <= 1;
        for (at, marker) in markers.iter().enumerate() {
            let mut all: Vec<f64> = (0..seen.frames).map(|frame| off[frame * seen.markers + at]).filter(|off| off.is_finite()).collect();
            if all.is_empty() {
                continue;
            }
            let middle = all.len() / 2;
            let most = DOUBTED_TIMES * *all.select_nth_unstable_by(middle, f64::total_cmp).1 + DOUBTED_CM;
            // the limb that carries it, from where it hangs on the trunk
            let mut top = marker.part;
            while let Some(parent) = tree.links[top].parent.filter(|&parent| single(parent) && tree.links[parent].parent.is_some()) {
                top = parent;
            }
            let limb = tree.behind(top);
            for frame in (0..seen.frames).filter(|frame| off[frame * seen.markers + at] > most) {
                for joint in (0..self.joints).filter(|&joint| limb[joint]) {
                    self.firm[frame * self.joints + joint] = false;
                }
            }
        }
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.at_all.len() / self.joints.max(1)
    }

    /// True if a marker tells of the joint.
    pub fn of(&self, frame: usize, joint: usize) -> bool {
        self.at_all[frame * self.joints + joint]
    }

    /// True if enough tells of it that the frame says by itself how the joint has turned.
    pub fn firmly(&self, frame: usize, joint: usize) -> bool {
        self.firm[frame * self.joints + joint]
    }

    /// True if no marker was seen in the frame.
    pub fn nothing(&self, frame: usize) -> bool {
        !self.at_all[frame * self.joints..][..self.joints].contains(&true)
    }

    /// The runs of frames in which nothing tells of the joint, or for `short` frames too little: from the first one to the one behind the last.
    pub fn silent(&self, joint: usize, short: usize) -> Vec<std::ops::Range<usize>> {
        let runs = |flags: &[bool]| {
            let mut runs: Vec<std::ops::Range<usize>> = Vec::new();
            for frame in (0..self.frames()).filter(|&frame| !flags[frame * self.joints + joint]) {
                match runs.last_mut() {
                    Some(run) if run.end == frame => run.end += 1,
                    _ => runs.push(frame..frame + 1),
                }
            }
            runs
        };
        let mut all = runs(&self.at_all);
        all.extend(runs(&self.firm).into_iter().filter(|run| run.len() <= short));
        all
    }
}
