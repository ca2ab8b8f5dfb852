//! What a repair did, for people, for scripts, and for the exit code.

mod json;
mod text;

use crate::bones;
use crate::explain::Part;
use crate::fills::Filled;
use crate::gaps::Open;
use crate::input::Opened;
use crate::repair::Request;
use crate::solve::{Bone, Gap, Stage};
use crate::suspects::SuspectReport;
use formats::{Note, Take};
use serde::Serialize;
use std::path::PathBuf;

pub use json::lines;

/// What happened to one gap.
#[derive(Clone, Debug, Serialize)]
pub struct GapReport {
    /// Counted from 1 over the take.
    pub gap: usize,
    /// Label of the marker.
    pub marker: String,
    /// Column of the marker, counted from 0: labels may occur twice.
    pub column: usize,
    /// First missing frame, the file's number.
    pub first_frame: i64,
    /// Last missing frame, the file's number.
    pub last_frame: i64,
    /// Number of frames.
    pub frames: usize,
    /// Why it stays open; absent if it was filled.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub open: Option<&'static str>,
    /// Largest predicted standard deviation in it, mm; absent if the method cannot say.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub worst_sigma_mm: Option<f64>,
    /// Why it was filled as it was, from methods that can say: one part for each stretch that was filled in its own way.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub explanation: Vec<Part>,
    #[serde(skip)]
    pub(crate) why: Option<Open>,
}

impl GapReport {
    /// One report per gap.
    pub fn all(gaps: &[Gap], decisions: &[Result<(), Open>], take: &Take, samples: &[Filled]) -> Vec<Self> {
        let mut worst = vec![f64::NAN; gaps.len()];
        for s in samples {
            worst[s.gap] = worst[s.gap].max(s.sigma_mm);
        }
        gaps.iter()
            .zip(decisions)
            .enumerate()
            .map(|(at, (gap, decision))| Self {
                gap: at + 1,
                marker: take.display_label(gap.marker),
                column: gap.marker,
                first_frame: take.frame_label(gap.start),
                last_frame: take.frame_label(gap.end - 1),
                frames: gap.frames(),
                open: decision.err().map(Open::word),
                worst_sigma_mm: worst[at].is_finite().then_some(worst[at]),
                explanation: Vec::new(),
                why: decision.err(),
            })
            .collect()
    }
}

/// How one model ended.
#[derive(Clone, Debug, Serialize)]
pub struct StageReport {
    /// The method.
    pub method: &'static str,
    /// Why it stopped.
    pub stop: &'static str,
    /// True if there was nothing left to do.
    #[serde(skip)]
    pub(crate) settled: bool,
    /// Rounds taken.
    pub iterations: u32,
    /// Last log-likelihood in nats, if the method has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub log_likelihood: Option<f64>,
    /// Root mean square distance between observed samples and model, mm, if the method has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rms_residual_mm: Option<f64>,
}

impl StageReport {
    /// From how it ended.
    pub fn new(Stage { method, outcome }: &Stage) -> Self {
        Self {
            method,
            stop: outcome.stop.word(),
            settled: outcome.stop.settled(),
            iterations: outcome.steps,
            log_likelihood: outcome.last.and_then(|p| p.log_likelihood),
            rms_residual_mm: outcome.last.and_then(|p| p.rms_residual_mm),
        }
    }
}

/// How far the bones are off in frames where one of their ends was filled.
#[derive(Clone, Debug, Serialize)]
pub struct BoneJudgement {
    /// Root mean square over all bones and such frames, mm.
    pub rms_mm: f64,
    /// The largest, mm.
    pub worst_mm: f64,
    /// Whose it is.
    pub worst_bone: String,
    /// The same root mean square over the frames in which both ends were measured, mm.
    pub measured_rms_mm: f64,
    /// What a method that promises exact lengths could not keep; absent for other methods.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unmet: Option<Unmet>,
}

/// Hard constraints that could not be met, because they contradict each other or what was seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Unmet {
    /// Number of bone lengths, frame by frame, that are off by more than [`Unmet::LEAST_MM`].
    pub lengths: usize,
    /// Number of frames in which one of them is.
    pub frames: usize,
}

impl Unmet {
    /// A length that is off by less than this counts as kept, in mm.
    pub const LEAST_MM: f64 = 0.01;
}

/// What a repair did.
#[derive(Clone, Debug)]
pub struct Report {
    /// The file that was read.
    pub input: PathBuf,
    /// SHA-256 of it, hexadecimal.
    pub input_sha256: String,
    /// The file that was written; `None` for a dry run.
    pub output: Option<PathBuf>,
    /// The log that was written.
    pub log: Option<PathBuf>,
    /// Why the log is not there although it was wanted.
    pub log_error: Option<String>,
    /// What the system said, if that is why.
    pub log_refused: Option<std::io::ErrorKind>,
    /// The table of filled samples.
    pub fills: Option<PathBuf>,
    /// The report to look at.
    pub page: Option<PathBuf>,
    /// Name of the input's format.
    pub format: &'static str,
    /// Frames per second.
    pub rate_hz: f64,
    /// Number of frames.
    pub frames: usize,
    /// Number of markers (model outputs not counted).
    pub markers: usize,
    /// Columns that are markers, and their labels.
    pub labels: Vec<(usize, String)>,
    /// Number of bones.
    pub bones: usize,
    /// True if the user stated them.
    pub bones_stated: bool,
    /// The method that was asked for.
    pub method: &'static str,
    /// How the models ended.
    pub stages: Vec<StageReport>,
    /// Samples that no body makes, dropped or not.
    pub suspects: Vec<SuspectReport>,
    /// What happened to each gap.
    pub gaps: Vec<GapReport>,
    /// The samples that were filled.
    pub samples: Vec<Filled>,
    /// Why gaps were filled as they were, before they are sorted by gap.
    pub parts: Vec<Part>,
    /// Bones in filled frames.
    pub bone_judgement: Option<BoneJudgement>,
    /// What was assumed, odd or lost.
    pub notes: Vec<Note>,
    /// True if nothing was to be solved or written.
    pub dry_run: bool,
}

impl Report {
    /// Before anything was solved.
    pub fn new(request: &Request, opened: &Opened, bones: &[Bone], bones_stated: bool) -> Self {
        let take = opened.document.take();
        Self {
            input: request.input.clone(),
            input_sha256: opened.sha256.clone(),
            output: None,
            log: None,
            log_error: None,
            log_refused: None,
            fills: request.fills.clone().filter(|_| !request.dry_run),
            page: request.page.clone().filter(|_| !request.dry_run),
            format: opened.format.info().name,
            rate_hz: take.rate_hz,
            frames: take.frames(),
            markers: take.markers.iter().filter(|m| m.role == formats::Role::Marker).count(),
            labels: (0..take.markers.len())
                .filter(|&column| take.markers[column].role == formats::Role::Marker)
                .map(|column| (column, take.display_label(column)))
                .collect(),
            bones: bones.len(),
            bones_stated,
            method: request.method.name(),
            stages: Vec::new(),
            suspects: Vec::new(),
            gaps: Vec::new(),
            samples: Vec::new(),
            parts: Vec::new(),
            bone_judgement: None,
            notes: Vec::new(),
            dry_run: request.dry_run,
        }
    }

    /// Measures the bones of the repaired take. `hard`: they were to keep their lengths.
    pub fn judge_bones(&mut self, all: &[Bone], take: &Take, hard: bool) {
        let (mut sum, mut count, mut worst) = (0.0, 0usize, (0.0f64, None));
        let (mut measured_sum, mut measured_count) = (0.0, 0usize);
        let mut unmet = Unmet::default();
        let mut broken = vec![false; take.frames()];
        for bone in all {
            for (frame, broken) in broken.iter_mut().enumerate() {
                let Some(length_mm) = bones::length_mm(take, bone, frame) else { continue };
                let off = (length_mm - bone.length_mm).abs();
                if bones::is_filled(take, bone, frame) {
                    sum += off * off;
                    count += 1;
                    if off > Unmet::LEAST_MM {
                        unmet.lengths += 1;
                        *broken = true;
                    }
                    if off > worst.0 {
                        worst = (off, Some(bone));
                    }
                } else {
                    measured_sum += off * off;
                    measured_count += 1;
                }
            }
        }
        unmet.frames = broken.iter().filter(|b| **b).count();
        self.bone_judgement = (count > 0).then(|| BoneJudgement {
            rms_mm: (sum / count as f64).sqrt(),
            worst_mm: worst.0,
            worst_bone: worst.1.map(|b| format!("{}-{}", take.display_label(b.a), take.display_label(b.b))).unwrap_or_default(),
            measured_rms_mm: (measured_sum / measured_count.max(1) as f64).sqrt(),
            unmet: hard.then_some(unmet),
        });
    }

    /// Hard bones that were not kept, if any.
    fn unmet(&self) -> Option<Unmet> {
        self.bone_judgement.as_ref().and_then(|judged| judged.unmet).filter(|unmet| unmet.lengths > 0)
    }

    fn open_gaps(&self) -> impl Iterator<Item = &GapReport> {
        self.gaps.iter().filter(|g| g.open.is_some())
    }

    /// Samples in all gaps.
    pub fn missing_samples(&self) -> usize {
        self.gaps.iter().map(|g| g.frames).sum()
    }

    /// 0 if every gap is filled and nothing was assumed or lost, else 3. (Errors have their own codes.)
    pub fn exit_code(&self) -> u8 {
        // models before the last one are only asked for advice
        let unsettled = self.stages.last().is_some_and(|s| !s.settled) || self.unmet().is_some();
        let matters = self.notes.iter().any(Note::matters);
        if self.open_gaps().next().is_some() || unsettled || matters || self.log_error.is_some() { 3 } else { 0 }
    }

    /// Name and value pairs for the log's metadata.
    pub fn results(&self) -> Vec<(String, String)> {
        let mut results = vec![
            ("gaps".to_owned(), self.gaps.len().to_string()),
            ("gaps_left_open".to_owned(), self.open_gaps().count().to_string()),
            ("samples_missing".to_owned(), self.missing_samples().to_string()),
            ("samples_filled".to_owned(), self.samples.len().to_string()),
        ];
        if let Some(judged) = &self.bone_judgement {
            results.push(("bone_rms_mm".to_owned(), format!("{:.3}", judged.rms_mm)));
            results.push(("bone_worst_mm".to_owned(), format!("{:.3}", judged.worst_mm)));
        }
        results
    }
}

/// A number and what it counts: `1 gap`, `2 gaps`.
pub fn count(number: usize, what: &str) -> String {
    format!("{number} {what}{}", if number == 1 { "" } else { "s" })
}

/// A rate without trailing zeros.
pub fn short(x: f64) -> String {
    let text = format!("{x:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}
