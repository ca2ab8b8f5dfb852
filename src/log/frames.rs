//! What the log tells of every frame: marker states, bone lengths, clouds and skeleton.

use super::channels::{Channel, tick_ns, timestamp};
use super::names::{self, unique};
use super::schema::foxglove::PointCloud;
use super::schema::marker_states::State;
use super::schema::{BoneLengths, MarkerStates, bone_lengths, marker_states};
use super::{cloud, skeleton};
use crate::bones::distance;
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
    pub labels: &'a [String],
    pub samples: &'a [Sample],
    /// For each column of the take, its place among the shown markers.
    pub place_of: &'a [Option<usize>],
}

/// One marker in one frame.
#[derive(Clone, Copy)]
pub(super) struct Sample {
    /// Position, mm, if it is known.
    pub position_mm: Option<[f64; 3]>,
    pub state: State,
    /// Predicted standard deviation, mm: 0 if it was observed, NaN if it is missing or the method cannot say.
    pub sigma_mm: f64,
}

impl Look<'_> {
    /// The two ends of a bone, if both are shown.
    pub fn ends(&self, bone: &Bone) -> Option<[usize; 2]> {
        Some([(*self.place_of.get(bone.a)?)?, (*self.place_of.get(bone.b)?)?])
    }
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
    samples: Vec<Sample>,
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
            samples: Vec::with_capacity(self.columns.len()),
        }
    }

    /// The messages of a frame, in the order in which they are written.
    pub fn encode(&self, frame: usize, scratch: &mut Scratch) -> Vec<(Channel, Vec<u8>)> {
        let Shown { raw, repaired, bones, .. } = self.shown;
        let take = repaired.unwrap_or(raw);
        let time = timestamp(tick_ns(frame as u32, self.rate_hz));
        let in_space = self.in_space(frame);
        let before = in_space.then(|| {
            self.look_at(raw, frame, &mut scratch.samples);
            cloud::put(&mut scratch.cloud, time, &scratch.samples, true);
            (Channel::Raw, scratch.cloud.encode_to_vec())
        });
        self.look_at(take, frame, &mut scratch.samples);
        for &(column, sigma_mm) in &self.filled[self.starts[frame]..self.starts[frame + 1]] {
            if let Some(place) = self.place_of[column] {
                scratch.samples[place].sigma_mm = sigma_mm;
            }
        }
        let look = Look { labels: &self.labels, samples: &scratch.samples, place_of: &self.place_of };
        scratch.lengths.timestamp = Some(time);
        scratch.lengths.frame = number(take, frame);
        put_lengths(&mut scratch.lengths, &look, bones);
        scratch.states.timestamp = Some(time);
        scratch.states.frame = number(take, frame);
        put_states(&mut scratch.states, look.samples);
        let mut messages =
            vec![(Channel::BoneLengths, scratch.lengths.encode_to_vec()), (Channel::MarkerState, scratch.states.encode_to_vec())];
        messages.extend(before);
        if in_space && repaired.is_some() {
            cloud::put(&mut scratch.cloud, time, look.samples, false);
            messages.push((Channel::Repaired, scratch.cloud.encode_to_vec()));
        }
        if in_space {
            messages.push((Channel::Skeleton, skeleton::scene(time, &look, bones).encode_to_vec()));
        }
        messages
    }

    /// What is known of the shown markers in a frame.
    fn look_at(&self, take: &Take, frame: usize, samples: &mut Vec<Sample>) {
        samples.clear();
        samples.extend(self.columns.iter().map(|&column| {
            let (state, sigma_mm) = match take.origin(frame, column) {
                Origin::Missing => (State::Missing, f64::NAN),
                Origin::Repaired => (State::Filled, f64::NAN),
                Origin::Measured | Origin::Derived => (State::Observed, 0.0),
            };
            Sample { position_mm: take.position_mm(frame, column), state, sigma_mm }
        }));
    }
}

fn put_lengths(lengths: &mut BoneLengths, look: &Look<'_>, bones: &[Bone]) {
    for (bone, told) in bones.iter().zip(&mut lengths.bones) {
        let [a, b] = look.ends(bone).map_or([None; 2], |ends| ends.map(|place| Some(&look.samples[place])));
        let place = |sample: Option<&Sample>| sample.and_then(|s| s.position_mm);
        told.value = match (place(a), place(b)) {
            (Some(a), Some(b)) => distance(a, b),
            _ => f64::NAN,
        };
        told.error_mm = told.value - bone.length_mm;
        told.filled = [a, b].into_iter().flatten().any(|sample| sample.state == State::Filled);
    }
}

fn put_states(states: &mut MarkerStates, samples: &[Sample]) {
    states.filled_count = 0;
    states.missing_count = 0;
    for (sample, told) in samples.iter().zip(&mut states.markers) {
        states.missing_count += u32::from(sample.state == State::Missing);
        states.filled_count += u32::from(sample.state == State::Filled);
        told.value = sample.state.into();
        told.sigma_mm = sample.sigma_mm;
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
