//! A body in motion as a page shows it: joints as markers, the lines between them as bones, and some points of what was measured.

use super::of_track::ByPart;
use super::positions::{STEP_MM, State, Track};
use super::{Note, Page, Positions};
use crate::log::{DescribedBone, Description};
use crate::rig::Rig;
use crate::runs::Stretch;
use crate::solve::ik::{Rigid, Vec3};
use serde::Serialize;

/// The page's unit of length for points of clouds, in mm.
pub const CLOUD_STEP_MM: f64 = 5.0;

/// The most points of a cloud that are shown ...
const MOST_POINTS: usize = 300;
/// ... and the most of all of them, or a long sequence would make a large file.
const MOST_POINTS_IN_ALL: usize = 150_000;

/// What a page shows of a body that was followed, besides the body itself.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Followed {
    /// What it is and how it was followed, in a few words each.
    pub facts: Vec<String>,
    /// The numbers that are asked for first.
    pub tiles: Vec<Tile>,
    /// What happened.
    pub events: Vec<Event>,
    /// What is said if nothing happened.
    pub uneventful: &'static str,
    /// Values over frames.
    pub curves: Vec<Series>,
    /// How each part was followed, and how each frame came about, for a body that was followed through clouds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub by_part: Option<ByPart>,
    /// The files of the body: what each is, and its name with its SHA-256.
    pub files: Vec<(String, String)>,
    /// What joints are that were seen, that were not, and what the points are.
    pub legend: [&'static str; 3],
}

/// A number.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Tile {
    /// What it is.
    pub title: &'static str,
    /// The number.
    pub value: String,
    /// Its unit.
    pub unit: &'static str,
    /// What it is about.
    pub about: String,
    /// The frame to look at, counted from 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame: Option<usize>,
    /// True if somebody should look at it.
    pub warn: bool,
}

/// Frames in a row with something to tell of.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Event {
    /// First frame, counted from 0.
    pub start: usize,
    /// Number of frames.
    pub frames: usize,
    /// `lost`, `predicted`, ...
    pub kind: &'static str,
    /// Index into [`Description::markers`], if it is about a joint.
    pub marker: Option<usize>,
    /// What or why, in words.
    pub about: String,
}

/// A value over frames.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Series {
    /// What it is.
    pub title: &'static str,
    /// For every frame; `None` if it is not known.
    pub values: Vec<Option<f64>>,
}

impl Series {
    /// Of values that are not numbers where they are not known.
    pub fn new(title: &'static str, decimals: i32, values: impl Iterator<Item = f64>) -> Self {
        let unit = 10.0_f64.powi(decimals);
        Self { title, values: values.map(|x| x.is_finite().then(|| (x * unit).round() / unit)).collect() }
    }

    /// The place of the value that `better` finds none better than, and the value.
    fn extreme(&self, better: fn(f64, f64) -> bool) -> Option<(usize, f64)> {
        let known = self.values.iter().enumerate().filter_map(|(at, x)| x.map(|x| (at, x)));
        known.reduce(|best, next| if better(next.1, best.1) { next } else { best })
    }

    /// The largest value, and its frame.
    pub fn largest(&self) -> Option<(usize, f64)> {
        self.extreme(|a, b| a > b)
    }

    /// The smallest value, and its frame.
    pub fn smallest(&self) -> Option<(usize, f64)> {
        self.extreme(|a, b| a < b)
    }
}

/// Events of the same kind.
pub fn events(
    kind: &'static str,
    marker: Option<usize>,
    about: &str,
    runs: impl IntoIterator<Item = (usize, usize)>,
) -> impl Iterator<Item = Event> {
    runs.into_iter().map(move |(start, end)| Event { start, frames: end - start, kind, marker, about: about.to_owned() })
}

/// What is shown of a body, frame by frame.
#[derive(Clone, Debug, Default)]
pub struct Figure {
    markers: Vec<String>,
    /// Two markers each.
    bones: Vec<(usize, usize, f64)>,
    /// Joints without children, and where their parts end in the reference pose, cm.
    ends: Vec<(usize, Vec3)>,
    tracks: Vec<Track>,
    cloud: Vec<Vec<[i32; 3]>>,
    most_points: usize,
}

/// A position in cm in steps of so many mm.
fn rounded(cm: &Vec3, step_mm: f64) -> [i32; 3] {
    [cm.x, cm.y, cm.z].map(|x| (x * 10.0 / step_mm).round() as i32)
}

impl Figure {
    /// Of a body that will be seen in so many frames.
    pub fn new(rig: &Rig, frames: usize) -> Self {
        let links = &rig.body.tree.links;
        let mut markers: Vec<String> = rig.names().map(str::to_owned).collect();
        let mut bones: Vec<_> = links
            .iter()
            .enumerate()
            .filter_map(|(at, link)| link.parent.map(|parent| (parent, at, (links[parent].centre - link.centre).norm())))
            .filter(|(.., length_cm)| *length_cm > 0.0)
            .collect();
        let leaf = |joint: &usize| links.iter().all(|link| link.parent != Some(*joint));
        let ends: Vec<_> = rig.ends().into_iter().enumerate().filter(|(joint, _)| leaf(joint)).collect();
        let ends: Vec<(usize, Vec3)> = ends.into_iter().filter_map(|(joint, end)| Some((joint, end?))).collect();
        for (joint, end) in &ends {
            bones.push((*joint, markers.len(), (links[*joint].centre - end).norm()));
            markers.push(format!("{} end", markers[*joint]));
        }
        let most_points = (MOST_POINTS_IN_ALL / frames.max(1)).min(MOST_POINTS);
        let tracks = vec![Track::default(); markers.len()];
        Self { markers, bones, ends, tracks, cloud: Vec::with_capacity(frames), most_points }
    }

    /// The next frame: joints, and where parts are; which joints were not seen; what was measured. All in cm.
    pub fn push(&mut self, centres: &[Vec3], parts: &[Rigid], unseen: impl Fn(usize) -> bool, points: impl ExactSizeIterator<Item = Vec3>) {
        let joints = centres.iter().copied().enumerate();
        let ends = self.ends.iter().map(|(joint, end)| (*joint, parts[*joint].point(end)));
        for (track, (joint, place)) in self.tracks.iter_mut().zip(joints.chain(ends)) {
            let state = if unseen(joint) { State::Filled } else { State::Observed };
            track.states.push(state);
            if state == State::Filled {
                track.sigma.push(None);
            }
            track.at.push(rounded(&place, STEP_MM));
        }
        let step = points.len().div_ceil(self.most_points.max(1)).max(1);
        let shown = points.step_by(step).take(self.most_points);
        let mut cloud: Vec<[i32; 3]> = shown.filter(|x| x.iter().all(|x| x.is_finite())).map(|x| rounded(&x, CLOUD_STEP_MM)).collect();
        // beside each other, so that differences are small
        cloud.sort_unstable_by_key(|[x, y, z]| (y >> 4, x >> 3, *z, *x, *y));
        self.cloud.push(cloud);
    }

    /// Puts the body on a page.
    pub fn show(self, page: &mut Page, rig: &Rig, rate_hz: f64, (first_frame, frame_step): (i64, i64)) {
        let bone = |&(a, b, length_cm): &(usize, usize, f64)| DescribedBone {
            label: format!("{}-{}", self.markers[a], self.markers[b]),
            a,
            b,
            length_mm: 10.0 * length_cm,
            spread_mm: 0.0,
        };
        page.take = Description {
            rate_hz,
            frames: self.cloud.len(),
            first_frame,
            frame_step,
            unit: rig.unit.symbol().to_owned(),
            up: Some(rig.up().to_string()),
            up_guessed: true,
            bones: self.bones.iter().map(bone).collect(),
            markers: self.markers,
        };
        let frames = (0..self.cloud.len() as u32).collect();
        page.positions = Positions { frames, tracks: self.tracks, raw: Vec::new(), cloud: self.cloud };
    }
}

/// The files of a rig, as the page names them.
pub fn files(rig: &Rig) -> Vec<(String, String)> {
    let first_up = |what: &str| what[..1].to_uppercase() + &what[1..];
    rig.files.iter().map(|(what, name, sha256)| (first_up(what), format!("{name}, SHA-256 {sha256}"))).collect()
}

/// Notes as the page has them.
pub fn notes(notes: &[formats::Note]) -> Vec<Note> {
    notes.iter().map(|note| Note { text: note.to_string(), matters: note.matters() }).collect()
}

/// Stretches that are told by frames' own numbers, counted from 0.
pub fn runs_of(stretches: &[Stretch], (first_frame, frame_step): (i64, i64)) -> impl Iterator<Item = (usize, usize)> {
    stretches.iter().map(move |stretch| {
        let start = ((stretch.first_frame - first_frame) / frame_step.max(1)).max(0) as usize;
        (start, start + stretch.frames)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_that_are_not_known_are_no_numbers() {
        let series = Series::new("x", 2, [1.234, f64::NAN, 0.5, 7.0, f64::INFINITY].into_iter());
        assert_eq!(series.values, [Some(1.23), None, Some(0.5), Some(7.0), None]);
        assert_eq!((series.largest(), series.smallest()), (Some((3, 7.0)), Some((2, 0.5))));
        assert_eq!(Series::new("x", 2, std::iter::empty()).largest(), None);
    }

    #[test]
    fn numbers_of_frames_become_places() {
        let stretches = [Stretch { first_frame: 7, last_frame: 7, frames: 1 }, Stretch { first_frame: 11, last_frame: 15, frames: 3 }];
        assert_eq!(runs_of(&stretches, (3, 2)).collect::<Vec<_>>(), [(2, 3), (4, 7)]);
    }
}
