//! Where the samples lie: which of the file's contradictory claims to believe.
//!
//! A C3D says everything twice: points per frame, analog words per frame, float or integer, where the data begin, and up to four times how
//! many frames there are. Real files contradict themselves in each of these, but only one reading fits the size of the file:
//!
//! 1. Every combination of the claims about a frame is a *layout*, parameters before header.
//! 2. A layout *fits* if one of the claimed numbers of frames ends less than one block (the padding) before the end of the file.
//!    If another claim is larger, the padding must be zeros up to a whole block, because it could be the beginning of a frame.
//! 3. The first layout that fits is taken, one that fits to the last byte before one that needs padding; a claim that lost is noted.
//! 4. If none fits and the layouts are all alike, bytes behind the claimed frames are left alone, and missing frames are noted as long as
//!    the file ends between two frames. A file that ends inside a frame is cut off, and refused.
//! 5. If none fits and the layouts differ, nobody can know what the bytes mean, and the file is refused.

use super::NAME;
use super::parameters::{BLOCK, Parameters};
use super::processor::Processor;
use crate::{FormatError, Note, Notes, Place};

/// How numbers are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Storage {
    /// 32-bit floats in the file's unit.
    Float,
    /// 16-bit integers, to be multiplied by the scale.
    Integer,
}

impl Storage {
    /// Bytes of one number.
    pub fn bytes(self) -> usize {
        match self {
            Self::Float => 4,
            Self::Integer => 2,
        }
    }
}

/// Where the samples lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Layout {
    /// Who wrote them.
    pub processor: Processor,
    /// How.
    pub storage: Storage,
    /// Points per frame.
    pub points: usize,
    /// Bytes per frame, analog words included.
    pub frame_bytes: usize,
    /// First byte of the first frame.
    pub start: usize,
    /// Number of frames, all of which lie inside the file.
    pub frames: usize,
    /// Length of one integer step in the file's unit. Means nothing in a file of floats.
    pub scale: f64,
    /// Number of the first frame.
    pub first_frame: i64,
}

impl Layout {
    /// The length of a stored 1 in mm, where `mm` is the length of the file's unit.
    pub fn step_mm(&self, mm: f64) -> f64 {
        match self.storage {
            Storage::Float => mm,
            Storage::Integer => self.scale * mm,
        }
    }
}

/// One claim about the number of frames.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Claim {
    source: &'static str,
    frames: usize,
    /// A 16-bit count at its end: the real number may be larger.
    saturated: bool,
    /// A 16-bit count: the real number may be larger by a multiple of 65536.
    wraps: bool,
}

impl Claim {
    /// True if the claim and the number do not contradict each other.
    fn allows(&self, frames: usize) -> bool {
        self.frames == frames || self.saturated && frames > self.frames || self.wraps && frames > 0xffff && frames & 0xffff == self.frames
    }
}

/// What the size of the file says about a layout.
enum Fit {
    /// A claimed number of frames fills the file. `tight`: to the last byte, or up to zeros that complete the last block.
    Exact { frames: usize, tight: bool },
    /// The count is saturated, or every count is 0 although data follow: the file holds this many.
    Counted(usize),
    /// All claims are met, and more than padding follows.
    Room { frames: usize, left: usize },
    /// Fewer frames than claimed, but whole ones.
    Short(usize),
    /// The file ends inside a frame.
    Cut { whole: usize },
}

/// One way to read a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Candidate {
    points: usize,
    analog_words: usize,
    storage: Storage,
    start: usize,
}

impl Candidate {
    fn frame_bytes(&self) -> usize {
        (self.points * 4 + self.analog_words) * self.storage.bytes()
    }
}

impl std::fmt::Display for Candidate {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let storage = if self.storage == Storage::Float { "floats" } else { "integers" };
        write!(f, "{} points and {} analog words as {storage} from block {}", self.points, self.analog_words, self.start / BLOCK + 1)
    }
}

/// Whole numbers that a count can be; NaN, negative and absurd ones are none.
fn count(x: f64) -> Option<usize> {
    // 2^53: above it, floats skip whole numbers.
    (0.0..=9_007_199_254_740_992.0).contains(&x).then_some(x as usize)
}

fn push<T: PartialEq>(list: &mut Vec<T>, item: T) {
    if !list.contains(&item) {
        list.push(item);
    }
}

/// TRIAL:ACTUAL_*_FIELD: two words, the low one first; some writers use one word or a float.
fn field(p: &Parameters<'_>, name: &str) -> Option<usize> {
    let numbers = p.numbers("TRIAL", name, 2);
    let low = count(*numbers.first()?)?;
    let high = if p.is_float("TRIAL", name) { 0 } else { numbers.get(1).and_then(|&x| count(x)).unwrap_or(0) };
    Some(low + (high << 16))
}

/// First and last frame as TRIAL has them, if they make sense.
fn trial(p: &Parameters<'_>) -> Option<(usize, usize)> {
    let (first, last) = (field(p, "ACTUAL_START_FIELD")?, field(p, "ACTUAL_END_FIELD")?);
    (last >= first && last > 0).then_some((first, last))
}

/// All claims about the number of frames, the most trusted first.
fn claims(p: &Parameters<'_>) -> Vec<Claim> {
    let mut claims = Vec::new();
    let long = p.numbers("POINT", "LONG_FRAMES", 2);
    let long = match (p.is_float("POINT", "LONG_FRAMES"), long.as_slice()) {
        (false, [low, high]) => count(low + high * 65536.0),
        (_, [frames, ..]) => count(*frames),
        _ => None,
    };
    if let Some(frames) = long {
        claims.push(Claim { source: "POINT:LONG_FRAMES", frames, saturated: false, wraps: false });
    }
    if let Some(frames) = p.number("POINT", "FRAMES").and_then(count) {
        let word = !p.is_float("POINT", "FRAMES");
        claims.push(Claim { source: "POINT:FRAMES", frames, saturated: word && frames == 0xffff, wraps: word });
    }
    let (first, last) = (usize::from(p.header.first), usize::from(p.header.last));
    let frames = if last >= first { last - first + 1 } else { 0 };
    claims.push(Claim { source: "the header", frames, saturated: last == 0xffff, wraps: true });
    if let Some((first, last)) = trial(p) {
        claims.push(Claim { source: "TRIAL", frames: last - first + 1, saturated: false, wraps: false });
    }
    claims
}

/// Length of the file that a frame may lie in, without trailing frames of nothing but zeros if they are padding.
fn frames_before_padding(data: &[u8], frame_bytes: usize, everything: bool) -> usize {
    let mut frames = data.len() / frame_bytes;
    let padding_from = if everything { 0 } else { data.len().saturating_sub(BLOCK - 1) };
    while let Some(start) = frames.checked_sub(1).map(|last| last * frame_bytes) {
        let Some(frame) = data.get(start..start + frame_bytes) else { break };
        if start < padding_from || frame.iter().any(|&b| b != 0) {
            break;
        }
        frames -= 1;
    }
    frames
}

/// Holds the claims against the bytes from where the data begin to the end of the file.
fn fit(claims: &[Claim], data: &[u8], frame_bytes: usize, file_bytes: usize) -> Fit {
    let room = data.len() / frame_bytes;
    // What a writer adds to fill the last block.
    let padding = |rest: &[u8]| rest.is_empty() || file_bytes.is_multiple_of(BLOCK) && rest.len() < BLOCK && rest.iter().all(|&b| b == 0);
    let fills = |frames: usize| {
        let rest = data.get(frames.saturating_mul(frame_bytes)..).filter(|rest| frames > 0 && rest.len() < BLOCK);
        // Anything may be in the padding, but if someone claims another frame, it might be the beginning of that.
        let more = claims.iter().any(|c| c.frames > frames && !c.saturated);
        rest.is_some_and(|rest| !more || padding(rest))
    };
    // Of several claims that fill the file, a tight one; of several of these, the one that most others agree with; of equals, the most
    // trusted.
    let mut best: Option<(bool, usize, usize)> = None;
    for claim in claims {
        let unwrapped = if claim.wraps && room > 0xffff { (room & !0xffff) + claim.frames } else { claim.frames };
        for frames in [claim.frames, unwrapped, unwrapped.saturating_sub(0x1_0000)] {
            let votes = claims.iter().filter(|c| c.frames == frames && !c.saturated).count();
            let tight = data.get(frames.saturating_mul(frame_bytes)..).is_some_and(padding);
            if claim.allows(frames) && fills(frames) && best.is_none_or(|(t, most, _)| (tight, votes) > (t, most)) {
                best = Some((tight, votes, frames));
            }
        }
    }
    if let Some((tight, _, frames)) = best {
        return Fit::Exact { frames, tight };
    }
    let most = claims.iter().map(|c| c.frames).max().unwrap_or(0);
    if most > room {
        return if padding(data.get(room * frame_bytes..).unwrap_or(&[])) { Fit::Short(room) } else { Fit::Cut { whole: room } };
    }
    let unknown = most == 0 || claims.iter().any(|c| c.saturated) && claims.iter().all(|c| c.frames <= 0xffff);
    if unknown {
        let frames = frames_before_padding(data, frame_bytes, most == 0).max(most);
        let rest = data.get(frames * frame_bytes..).unwrap_or(&[]);
        return if rest.iter().all(|&b| b == 0) { Fit::Counted(frames) } else { Fit::Cut { whole: frames } };
    }
    Fit::Room { frames: most, left: data.len() - most * frame_bytes }
}

fn malformed(start: usize, text: String) -> FormatError {
    FormatError::malformed(NAME, Place::Byte { offset: start as u64, section: "points" }, text)
}

/// Every way to read a frame, the most trusted first, and what to note about the claims that disagree.
fn candidates(p: &Parameters<'_>) -> Result<Vec<Candidate>, FormatError> {
    let header = &p.header;
    let mut points = Vec::new();
    points.extend(p.number("POINT", "USED").and_then(count).filter(|&n| n <= 0xffff));
    push(&mut points, usize::from(header.points));

    let mut analog = vec![usize::from(header.analog_words)];
    if let Some(used) = p.number("ANALOG", "USED").and_then(count).filter(|&n| n <= 0xffff) {
        push(&mut analog, used * usize::from(header.analog_ratio.max(1)));
    }
    if let (2.., Some(used)) = (analog.len(), p.number("ANALOG", "USED").and_then(count)) {
        let rate = p.number("POINT", "RATE").filter(|&r| r > 0.0).unwrap_or(f64::from(header.rate));
        let ratio = p.number("ANALOG", "RATE").map(|r| (r / rate).round()).and_then(count).filter(|&r| r > 0 && r <= 0xffff);
        if let Some(ratio) = ratio {
            push(&mut analog, used * ratio);
        }
    }

    let mut storages = Vec::new();
    for scale in [p.number("POINT", "SCALE"), Some(f64::from(header.scale))].into_iter().flatten() {
        if scale < 0.0 {
            push(&mut storages, Storage::Float);
        } else if scale > 0.0 {
            push(&mut storages, Storage::Integer);
        }
    }
    if storages.is_empty() {
        return Err(FormatError::malformed(
            NAME,
            Place::Byte { offset: 12, section: "header" },
            "neither POINT:SCALE nor the header has a scale, so nothing says whether the points are floats or integers",
        ));
    }

    // Block 0 and 1 mean "not filled in".
    let mut starts = Vec::new();
    for block in [p.number("POINT", "DATA_START").and_then(count), Some(usize::from(header.data_block))].into_iter().flatten() {
        if (2..=0xffff).contains(&block) {
            push(&mut starts, (block - 1) * BLOCK);
        }
    }
    if starts.is_empty() {
        starts.push(p.end.div_ceil(BLOCK) * BLOCK);
    }

    let mut list = Vec::new();
    for &start in &starts {
        for &storage in &storages {
            for &points in &points {
                for &analog_words in &analog {
                    list.push(Candidate { points, analog_words, storage, start });
                }
            }
        }
    }
    Ok(list)
}

/// Chooses the layout.
///
/// # Errors
/// Malformed if the file ends inside a frame or before the first one, if nothing fits, or if there is no scale.
pub(super) fn choose(p: &Parameters<'_>, bytes: &[u8], notes: &Notes) -> Result<Layout, FormatError> {
    let claims = claims(p);
    let most = claims.iter().map(|c| c.frames).max().unwrap_or(0);
    let list = candidates(p)?;
    let mut chosen: Option<(Candidate, Fit)> = None;
    let mut alike = true;
    let mut starts_inside = false;
    for &candidate in &list {
        let frame_bytes = candidate.frame_bytes();
        if frame_bytes == 0 {
            // Neither points nor analog words (a file of rotations): nothing to measure the claims with.
            let frames = claims.iter().map(|c| c.frames).find(|&n| n <= 0xffff).unwrap_or(0);
            chosen.get_or_insert((candidate, Fit::Exact { frames, tight: false }));
            continue;
        }
        let Some(data) = bytes.get(candidate.start..) else { continue };
        starts_inside = true;
        let fit = fit(&claims, data, frame_bytes, bytes.len());
        if let Fit::Exact { tight, .. } = fit {
            if tight || !matches!(chosen, Some((_, Fit::Exact { .. }))) {
                chosen = Some((candidate, fit));
            }
            if tight {
                break;
            }
            continue;
        }
        match &chosen {
            None => chosen = Some((candidate, fit)),
            Some((first, _)) => {
                alike &= first.frame_bytes() == frame_bytes && first.start == candidate.start && first.storage == candidate.storage;
            }
        }
    }
    let Some((taken, fit)) = chosen.filter(|(c, _)| starts_inside || c.frame_bytes() == 0) else {
        let start = list.first().map_or(0, |c| c.start);
        return Err(malformed(
            bytes.len(),
            format!("the file ends here, its {most} frames should begin at byte {start:#x}: it is cut off; copy or export it again"),
        ));
    };
    if !alike && !matches!(fit, Fit::Exact { .. }) {
        return Err(malformed(
            taken.start,
            format!(
                "header and parameters contradict each other about a frame ({}), and {most} frames of none of these fit the {} bytes of data: \
                 the file is cut off or damaged",
                list.iter().map(ToString::to_string).collect::<Vec<_>>().join(", or "),
                bytes.len().saturating_sub(taken.start)
            ),
        ));
    }
    let frame_bytes = taken.frame_bytes();
    let frames = match fit {
        Fit::Exact { frames, .. } => {
            note_other_counts(&claims, frames, notes);
            frames
        }
        Fit::Counted(frames) => {
            if frames != most {
                notes.add(Note::FrameCount { claimed: most as u64, present: frames as u64 });
            }
            frames
        }
        Fit::Room { frames, left } => {
            note_other_counts(&claims, frames, notes);
            // The block of padding that some writers add even to a full block is no news.
            let rest = bytes.get(taken.start + frames * frame_bytes..).unwrap_or(&[]);
            if rest.iter().any(|&b| b != 0) && !p.has_group("ROTATION") {
                let text = format!("{left} bytes follow the {frames} frames that the file claims; they were left alone");
                notes.add(Note::Contradiction { text });
            }
            frames
        }
        Fit::Short(frames) if frames > 0 => {
            notes.add(Note::FrameCount { claimed: most as u64, present: frames as u64 });
            frames
        }
        Fit::Short(whole) | Fit::Cut { whole } => {
            return Err(malformed(
                taken.start + whole * frame_bytes,
                format!(
                    "the file ends in frame {} of {}, {} of its {frame_bytes} bytes are there: it is cut off; copy or export it again",
                    whole + 1,
                    if most > whole { most.to_string() } else { "an unknown number".to_owned() },
                    bytes.len().saturating_sub(taken.start + whole * frame_bytes),
                ),
            ));
        }
    };
    finish(p, taken, frames, notes, &list)
}

/// Notes the counts that lost against the size of the file.
fn note_other_counts(claims: &[Claim], frames: usize, notes: &Notes) {
    if let Some(more) = claims.iter().filter(|c| c.frames > frames && !c.saturated).map(|c| c.frames).max() {
        notes.add(Note::FrameCount { claimed: more as u64, present: frames as u64 });
        return;
    }
    for claim in claims.iter().filter(|c| !c.allows(frames)) {
        let text = format!("{} claims {} frames, the file holds {frames}", claim.source, claim.frames);
        notes.add(Note::Contradiction { text });
    }
}

/// Notes what the other claims said about a frame, and settles scale and first frame.
fn finish(p: &Parameters<'_>, taken: Candidate, frames: usize, notes: &Notes, list: &[Candidate]) -> Result<Layout, FormatError> {
    let contradiction = |text: String| notes.add(Note::Contradiction { text });
    let assumed = |text: String| notes.add(Note::Assumed { text });
    if let Some(other) = list.iter().find(|c| c.points != taken.points) {
        assumed(format!("the file claims both {} and {} points per frame; {0} fit its size", taken.points, other.points));
    }
    if let Some(other) = list.iter().find(|c| c.analog_words != taken.analog_words) {
        let words = taken.analog_words;
        assumed(format!("the file claims both {words} and {} analog words per frame; {words} fit its size", other.analog_words));
    }
    if let Some(parameter) = p.number("POINT", "DATA_START").and_then(count).filter(|&b| b != taken.start / BLOCK + 1) {
        contradiction(format!("POINT:DATA_START is block {parameter}, the data begin in block {}", taken.start / BLOCK + 1));
    }
    let header = usize::from(p.header.data_block);
    if header != taken.start / BLOCK + 1 {
        contradiction(format!("the header says that the data begin in block {header}, they begin in block {}", taken.start / BLOCK + 1));
    }
    let scale = scale(p, &taken, notes)?;
    let own = i64::from(p.header.first);
    let counted = usize::from(p.header.last).checked_sub(usize::from(p.header.first)).map_or(0, |n| n + 1);
    let first_frame = match trial(p) {
        // 65535 says "look elsewhere", and one frame from 65535 to 65535 is as many as there are
        Some((first, last)) if last - first + 1 == frames && (counted != frames || p.header.first == u16::MAX) => {
            i64::try_from(first).unwrap_or(own)
        }
        _ => own,
    };
    let frame_bytes = taken.frame_bytes();
    Ok(Layout {
        processor: p.processor,
        storage: taken.storage,
        points: taken.points,
        frame_bytes,
        start: taken.start,
        frames,
        scale,
        first_frame,
    })
}

/// The length of one integer step. Header and parameter are meant to be equal.
/// In the one real file where they differ and it matters, the header gives a person of human size and POINT:SCALE a dwarf.
fn scale(p: &Parameters<'_>, taken: &Candidate, notes: &Notes) -> Result<f64, FormatError> {
    let header = f64::from(p.header.scale);
    let parameter = p.number("POINT", "SCALE");
    let wanted = |x: &f64| if taken.storage == Storage::Float { *x < 0.0 } else { *x > 0.0 && x.is_finite() };
    let scale = [Some(header), parameter].into_iter().flatten().find(wanted);
    if let Some(parameter) = parameter.filter(|x| *x != header && (taken.storage == Storage::Integer || !wanted(x))) {
        let text = format!("POINT:SCALE is {parameter}, the scale in the header is {header}; took {}", scale.unwrap_or(header));
        notes.add(Note::Assumed { text });
    }
    scale.map(f64::abs).ok_or_else(|| {
        FormatError::malformed(NAME, Place::Byte { offset: 12, section: "header" }, format!("the scale of the points is {header}"))
    })
}
