//! What the log tells of every frame: marker states, bone lengths, clouds and skeleton.

use super::channels::{Channel, tick_ns, timestamp};
use super::names::{self, unique};
use super::schema::foxglove::PointCloud;
use super::schema::{BoneLengths, MarkerStates, bone_lengths, marker_states};
use super::{cloud, skeleton};
use crate::fills::Filled;
use crate::solve::Bone;
use formats::{Origin, Role, Take};
use prost::Message;

/// A take before and after its repair, as the log shows it.
#[derive(Clone, Copy, Debug)]
pub struct Shown<'a> {
    /// As it was read.
    pub raw: &'a Take,
    /// As it was written; absent if it was not.
    pub repaired: Option<&'a Take>,
    /// Its bones, between columns of the take.
    pub bones: &'a [Bone],
    /// What was filled.
    pub samples: &'a [Filled],
    /// The most frames per second on the topics that are drawn in space; all if absent.
    pub log_rate_hz: Option<f64>,
}

/// What the parts of one frame are made from. Lists are by place among the shown markers.
pub(super) struct Look<'a> {
    pub frame: usize,
    /// Columns of the take.
    pub columns: &'a [usize],
    pub labels: &'a [String],
    /// Predicted standard deviation of what was filled in this frame, mm; NaN elsewhere.
    pub sigma_mm: &'a [f64],
}

/// Makes the messages of each frame.
pub(super) struct Frames<'a> {
    shown: Shown<'a>,
    rate_hz: f64,
    /// Columns of the take that are markers: model outputs are not shown.
    columns: Vec<usize>,
    labels: Vec<String>,
    bone_labels: Vec<String>,
    /// For each column, its place among `columns`.
    place_of: Vec<Option<usize>>,
    /// Filled samples, frame by frame, and where each frame begins.
    filled: Vec<(usize, f64)>,
    starts: Vec<usize>,
}

/// Messages that are written again and again, with their names in them.
pub(super) struct Scratch {
    lengths: BoneLengths,
    states: MarkerStates,
    cloud: PointCloud,
    sigma_mm: Vec<f64>,
}

impl<'a> Frames<'a> {
    pub fn new(shown: Shown<'a>, rate_hz: f64) -> Self {
        let take = shown.raw;
        let columns = columns(take);
        let mut place_of = vec![None; take.markers.len()];
        for (place, &column) in columns.iter().enumerate() {
            place_of[column] = Some(place);
        }
        let mut starts = vec![0; take.frames() + 1];
        for s in shown.samples {
            starts[s.frame + 1] += 1;
        }
        for frame in 0..take.frames() {
            starts[frame + 1] += starts[frame];
        }
        let mut next = starts.clone();
        let mut filled = vec![(0, 0.0); shown.samples.len()];
        for s in shown.samples {
            filled[next[s.frame]] = (s.marker, s.sigma_mm);
            next[s.frame] += 1;
        }
        Self {
            rate_hz,
            labels: unique(columns.iter().map(|&column| take.display_label(column))),
            bone_labels: names::bones(take, shown.bones),
            columns,
            place_of,
            filled,
            starts,
            shown,
        }
    }

    /// Number of frames.
    pub fn count(&self) -> usize {
        self.shown.raw.frames()
    }

    /// True if the frame is shown in space.
    pub fn in_space(&self, frame: usize) -> bool {
        let Some(log_rate_hz) = self.shown.log_rate_hz.filter(|hz| *hz < self.rate_hz) else { return true };
        let period = |frame: usize| (frame as f64 * log_rate_hz / self.rate_hz).floor();
        frame == 0 || period(frame) > period(frame - 1)
    }

    pub fn scratch(&self) -> Scratch {
        let bone = |label: &String| bone_lengths::Bone { label: label.clone(), ..Default::default() };
        let marker = |label: &String| marker_states::Marker { label: label.clone(), ..Default::default() };
        Scratch {
            lengths: BoneLengths { bones: self.bone_labels.iter().map(bone).collect(), ..Default::default() },
            states: MarkerStates { markers: self.labels.iter().map(marker).collect(), ..Default::default() },
            cloud: cloud::empty(),
            sigma_mm: vec![f64::NAN; self.columns.len()],
        }
    }

    /// The messages of a frame, in the order in which they are written.
    pub fn encode(&self, frame: usize, scratch: &mut Scratch) -> Vec<(Channel, Vec<u8>)> {
        let Shown { raw, repaired, bones, .. } = self.shown;
        let take = repaired.unwrap_or(raw);
        let time = timestamp(tick_ns(frame as u32, self.rate_hz));
        scratch.sigma_mm.fill(f64::NAN);
        for &(column, sigma_mm) in &self.filled[self.starts[frame]..self.starts[frame + 1]] {
            if let Some(place) = self.place_of[column] {
                scratch.sigma_mm[place] = sigma_mm;
            }
        }
        let look = Look { frame, columns: &self.columns, labels: &self.labels, sigma_mm: &scratch.sigma_mm };
        self.put_lengths(&mut scratch.lengths, time, take, frame);
        put_states(&mut scratch.states, time, take, &look);
        let mut messages =
            vec![(Channel::BoneLengths, scratch.lengths.encode_to_vec()), (Channel::MarkerState, scratch.states.encode_to_vec())];
        if self.in_space(frame) {
            cloud::put(&mut scratch.cloud, time, raw, &look, true);
            messages.push((Channel::Raw, scratch.cloud.encode_to_vec()));
            if let Some(repaired) = repaired {
                cloud::put(&mut scratch.cloud, time, repaired, &look, false);
                messages.push((Channel::Repaired, scratch.cloud.encode_to_vec()));
            }
            messages.push((Channel::Skeleton, skeleton::scene(time, take, &look, bones).encode_to_vec()));
        }
        messages
    }

    fn put_lengths(&self, lengths: &mut BoneLengths, time: prost_types::Timestamp, take: &Take, frame: usize) {
        lengths.timestamp = Some(time);
        lengths.frame = number(take, frame);
        for (bone, told) in self.shown.bones.iter().zip(&mut lengths.bones) {
            told.value = match (take.position_mm(frame, bone.a), take.position_mm(frame, bone.b)) {
                (Some(a), Some(b)) => (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt(),
                _ => f64::NAN,
            };
            told.error_mm = told.value - bone.length_mm;
            told.filled = [bone.a, bone.b].iter().any(|&end| take.origin(frame, end) == Origin::Repaired);
        }
    }
}

/// The columns of a take that are shown: its markers, without model outputs.
pub(crate) fn columns(take: &Take) -> Vec<usize> {
    (0..take.markers.len()).filter(|&column| take.markers[column].role == Role::Marker).collect()
}

/// The file's own number of a frame, as far as it fits.
fn number(take: &Take, frame: usize) -> i32 {
    let label = take.frame_label(frame);
    i32::try_from(label).unwrap_or(if label < 0 { i32::MIN } else { i32::MAX })
}

fn put_states(states: &mut MarkerStates, time: prost_types::Timestamp, take: &Take, look: &Look<'_>) {
    states.timestamp = Some(time);
    states.frame = number(take, look.frame);
    states.filled_count = 0;
    states.missing_count = 0;
    for ((&column, &sigma_mm), told) in look.columns.iter().zip(look.sigma_mm).zip(&mut states.markers) {
        let (state, sigma_mm) = match take.origin(look.frame, column) {
            Origin::Missing => (marker_states::State::Missing, f64::NAN),
            Origin::Repaired => (marker_states::State::Filled, sigma_mm),
            Origin::Measured | Origin::Derived => (marker_states::State::Observed, 0.0),
        };
        states.missing_count += u32::from(state == marker_states::State::Missing);
        states.filled_count += u32::from(state == marker_states::State::Filled);
        told.value = state.into();
        told.sigma_mm = sigma_mm;
    }
}
