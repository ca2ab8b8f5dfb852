//! The story of one take, from file to file. Read [`repair`] first.

use crate::bones::{self, BonesError};
use crate::gaps::{Open, Policy, gaps};
use crate::input::{Opened, Reading, hex, open, read};
use crate::log::{About, Closing, LogError, McapLog};
use crate::missing::MissingError;
use crate::output::{self, Names, Written, original_name, unwritable};
use crate::report::{GapReport, Report, StageReport};
use crate::solve::auto::Stiffness;
use crate::solve::lds::{EStep, Hidden, Init};
use crate::solve::{Bone, Limits, Method, Observer, Outcome, Problem, Settings, Solved, Stop};
use crate::suspects::{self, SuspectReport, Treatment};
use crate::verify::Broken;
use crate::{compression, fills, staging};
use formats::{DetectError, FormatError, Role, Take};
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// What is wanted.
#[derive(Clone, Debug)]
#[allow(clippy::struct_excessive_bools)] // each is a switch of its own
pub struct Request {
    /// The take to read. Never written, except that `in_place` puts the repaired file under its name.
    pub input: PathBuf,
    /// The file to write; not used with `dry_run`.
    pub output: PathBuf,
    /// Replace the input by the repaired take, and keep the input as `<name>.orig`.
    pub in_place: bool,
    /// The log to write, if any.
    pub log: Option<PathBuf>,
    /// The table of filled samples to write, if any.
    pub fills: Option<PathBuf>,
    /// A file of bones that overrules those found.
    pub bones: Option<PathBuf>,
    /// Replace files that exist.
    pub force: bool,
    /// Read, decide and report, but solve and write nothing.
    pub dry_run: bool,
    /// Write computing times into the log.
    pub timings: bool,
    /// How to fill.
    pub method: Method,
    /// Settings of the method.
    pub settings: Settings,
    /// The most EM iterations.
    pub iterations: u32,
    /// Relative change of the log-likelihood that counts as none.
    pub tolerance: f64,
    /// Seed of the random numbers, for methods that draw some.
    pub seed: u64,
    /// Which gaps are filled.
    pub policy: Policy,
    /// Patterns of the markers whose gaps are filled; all if empty.
    pub markers: Vec<String>,
    /// What the user states about the file.
    pub reading: Reading,
    /// What becomes of suspect samples.
    pub outliers: Treatment,
}

/// Why a take could not be repaired. Every text begins with the file it is about.
#[derive(Debug, thiserror::Error)]
pub enum RepairError {
    /// A file could not be read or written.
    #[error("{path}: {problem}", path = .path.display())]
    Io {
        /// Which.
        path: PathBuf,
        /// What was found, what was expected, the way out.
        problem: String,
    },
    /// The format is not known.
    #[error("{path}: {error}", path = .path.display())]
    Detect {
        /// Which file.
        path: PathBuf,
        /// Why.
        error: DetectError,
    },
    /// The content is not right, or cannot be written.
    #[error("{path}: {error}", path = .path.display())]
    Format {
        /// Which file.
        path: PathBuf,
        /// Why.
        error: FormatError,
    },
    /// The bones cannot be used.
    #[error("{path}: {error}", path = .path.display())]
    Bones {
        /// Which file.
        path: PathBuf,
        /// Why.
        error: BonesError,
    },
    /// The samples stated to be missing cannot be found.
    #[error("{path}: {error}", path = .path.display())]
    Missing {
        /// The take.
        path: PathBuf,
        /// Why.
        error: MissingError,
    },
    /// A take is to be turned, and nobody says from where.
    #[error("{path}: does not say which axis points up, so it cannot be turned; say it with --from-up", path = .path.display())]
    NoUp {
        /// The take.
        path: PathBuf,
    },
    /// A pattern fits no marker.
    #[error("{path}: --markers {pattern} fits no marker; the take has {labels}", path = .path.display())]
    NoSuchMarker {
        /// The take.
        path: PathBuf,
        /// The pattern.
        pattern: String,
        /// What the take has.
        labels: String,
    },
    /// The written file is not what it should be.
    #[error("{path}: {error}", path = .path.display())]
    Verify {
        /// The output.
        path: PathBuf,
        /// What differs.
        error: Broken,
    },
    /// The solver broke down.
    #[error("{path}: {method} failed: {problem}; try --method spline, or fewer hidden dimensions with --hidden", path = .path.display())]
    Solve {
        /// The take.
        path: PathBuf,
        /// Which method.
        method: &'static str,
        /// What broke.
        problem: String,
    },
    /// Somebody stopped it.
    #[error("{path}: interrupted, nothing was written", path = .path.display())]
    Interrupted {
        /// The take.
        path: PathBuf,
    },
}

/// Repairs one take: the main job.
///
/// # Errors
/// Whatever keeps the output from being written whole; then no file was written at all.
pub fn repair(request: &Request, watch: &mut dyn Observer, interrupt: &AtomicBool) -> Result<Report, RepairError> {
    if !request.dry_run {
        request.names().check()?;
    }
    let opened = open(&request.input, &request.reading)?;
    let Searched { opened, evidence, bones, suspects } = search(request, opened)?;
    let before = opened.document.take();
    let found = gaps(before);
    let asked_for = asked_for(request, before)?;
    let mut decisions: Vec<Result<(), Open>> = found.iter().map(|gap| request.policy.decide(gap, before, asked_for[gap.marker])).collect();
    let mut report = Report::new(request, &opened, &bones, request.bones.is_some());
    report.suspects = suspects;
    if request.dry_run {
        report.gaps = GapReport::all(&found, &decisions, before, &[]);
    } else {
        let mut repaired = before.clone();
        let problem = Problem::new(&evidence, &neighbours(before), &bones);
        let mut log = start_log(request, &opened, &bones, &mut report);
        if decisions.iter().any(Result::is_ok) && problem.markers() > 0 {
            let limits =
                Limits { steps: request.iterations, tolerance: request.tolerance, interrupt: Some(interrupt), ..Limits::default() };
            let solved = request.method.solve(&problem, &request.settings, &limits, &mut (&mut log, watch));
            if interrupt.load(Ordering::Relaxed) {
                return Err(RepairError::Interrupted { path: request.input.clone() });
            }
            accept(request, &solved)?;
            report.stages = solved.stages.iter().map(StageReport::new).collect();
            let estimate = &solved.estimate;
            report.samples = fills::fill(&mut repaired, &problem, estimate, &found, &mut decisions, request.policy.max_sigma_mm);
            repaired.filled_by = Some(request.method.name().to_owned());
            report.explain(&problem, &solved.explanations, before);
        } else {
            for decision in decisions.iter_mut().filter(|d| d.is_ok()) {
                *decision = Err(Open::Unsolved);
            }
        }
        report.gaps = GapReport::all(&found, &decisions, before, &report.samples);
        report.attach_explanations(&found);
        drop(problem); // as large as the take, and of no more use
        return write_out(request, opened, repaired, &bones, log, report);
    }
    report.notes = opened.notes.take();
    Ok(report)
}

/// A solver that broke down is an error; one that merely ran out of steps is not.
fn accept(request: &Request, solved: &Solved) -> Result<(), RepairError> {
    match solved.outcome() {
        Some(Outcome { stop: Stop::Failed, error, .. }) => Err(RepairError::Solve {
            path: request.input.clone(),
            method: request.method.name(),
            problem: error.as_ref().map_or_else(|| "no reason given".to_owned(), ToString::to_string),
        }),
        _ => Ok(()),
    }
}

/// Columns that take part in solving, and between which bones are looked for: all markers.
pub fn neighbours(take: &Take) -> Vec<bool> {
    take.markers.iter().map(|m| m.role == Role::Marker).collect()
}

/// A take after the search for samples that no body makes.
struct Searched {
    opened: Opened,
    /// What fills are made from: the take, without what is ignored.
    evidence: Take,
    /// The bones of that.
    bones: Vec<Bone>,
    suspects: Vec<SuspectReport>,
}

/// Looks for samples that no body makes, and opens the take again without them if they are to be dropped.
fn search(request: &Request, opened: Opened) -> Result<Searched, RepairError> {
    let take = opened.document.take();
    let bones = chosen_bones(request, take)?;
    let found = suspects::find(take, &bones);
    let samples = suspects::samples(&found, take);
    let suspects = SuspectReport::all(&found, take, request.outliers);
    if found.is_empty() || request.outliers == Treatment::Told {
        let evidence = take.clone();
        return Ok(Searched { opened, evidence, bones, suspects });
    }
    if request.outliers == Treatment::Ignored {
        let evidence = take.without(&samples);
        let bones = chosen_bones(request, &evidence)?;
        return Ok(Searched { opened, evidence, bones, suspects });
    }
    let sha256 = opened.sha256;
    drop(opened.document); // there must be room for it once only
    let opened = open(&request.input, &Reading { dropped: samples, ..request.reading.clone() })?;
    if opened.sha256 != sha256 {
        let problem = "was changed by someone else while it was read; nothing was written, run it again".to_owned();
        return Err(RepairError::Io { path: request.input.clone(), problem });
    }
    let evidence = opened.document.take().clone();
    let bones = chosen_bones(request, &evidence)?;
    Ok(Searched { opened, evidence, bones, suspects })
}

/// The bones: those that the user stated, else those that are found.
fn chosen_bones(request: &Request, take: &Take) -> Result<Vec<Bone>, RepairError> {
    let Some(path) = &request.bones else {
        return Ok(bones::find(take, &neighbours(take)));
    };
    let wrong = |error| RepairError::Bones { path: path.clone(), error };
    let stated = bones::parse(&read(path)?).map_err(wrong)?;
    bones::resolve(&stated, take).map_err(wrong)
}

/// For each column, whether its gaps may be filled.
fn asked_for(request: &Request, take: &Take) -> Result<Vec<bool>, RepairError> {
    let mut asked = vec![request.markers.is_empty(); take.markers.len()];
    for pattern in &request.markers {
        let mut fits = false;
        for (column, marker) in take.markers.iter().enumerate() {
            if marker.role == Role::Marker && (matches(pattern, &marker.label) || matches(pattern, marker.name())) {
                asked[column] = true;
                fits = true;
            }
        }
        if !fits {
            let labels = (0..take.markers.len()).map(|m| take.display_label(m)).collect::<Vec<_>>().join(", ");
            return Err(RepairError::NoSuchMarker { path: request.input.clone(), pattern: pattern.clone(), labels });
        }
    }
    Ok(asked)
}

/// True if `pattern`, in which `*` stands for any text and `?` for one character, fits the whole of `text`.
pub(crate) fn matches(pattern: &str, text: &str) -> bool {
    let (pattern, text): (Vec<char>, Vec<char>) = (pattern.chars().collect(), text.chars().collect());
    let (mut p, mut t) = (0, 0);
    let mut star: Option<(usize, usize)> = None;
    while t < text.len() {
        match pattern.get(p) {
            Some('*') => {
                star = Some((p, t));
                p += 1;
            }
            Some(&c) if c == '?' || c == text[t] => {
                p += 1;
                t += 1;
            }
            _ => match star {
                // let the last star swallow one character more
                Some((at, from)) => {
                    star = Some((at, from + 1));
                    p = at + 1;
                    t = from + 1;
                }
                None => return false,
            },
        }
    }
    pattern[p..].iter().all(|&c| c == '*')
}

/// Begins the log. That the log cannot be written does not keep the take from being repaired: it is reported.
fn start_log(request: &Request, opened: &Opened, bones: &[Bone], report: &mut Report) -> Option<McapLog> {
    let path = request.log.as_ref()?;
    let take = opened.document.take();
    let about = About {
        source_name: request.input.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default(),
        source_sha256: opened.sha256.clone(),
        rate_hz: take.rate_hz,
        first_frame: take.first_frame,
        frames: take.frames(),
        markers: take.markers.len(),
        bones: bones.len(),
        seed: request.seed,
        method: request.method.name().to_owned(),
        options: request.options(),
        timings: request.timings,
    };
    match McapLog::create(path, about) {
        Ok(log) => Some(log),
        Err(error) => {
            report.log_failed(path, &error);
            None
        }
    }
}

/// Writes the output, proves it, and puts everything in place: the table and the log first, the output last.
fn write_out(
    request: &Request,
    opened: Opened,
    mut repaired: Take,
    bones: &[Bone],
    log: Option<McapLog>,
    mut report: Report,
) -> Result<Report, RepairError> {
    let target = &request.output;
    let way = output::way(&request.input, opened.format, target);
    // what replaces a compressed file is compressed, whatever its name
    let compressed = compression::is_named(target) || (request.in_place && opened.compressed);
    let Written { file, notes, sha256, elsewhere } = output::write(way, opened, &repaired, compressed, target)?;
    if let Some(written) = elsewhere {
        repaired = fills::as_written(&mut report.samples, repaired, &written);
    }
    report.judge_bones(bones, &repaired, request.hard());

    // From here on everything is written; what remains are names.
    let mut placed = staging::Placed::default();
    if let Some(path) = &request.fills {
        let mut table = staging::beside(path).map_err(|e| unwritable(path, &e))?;
        fills::write(&report.samples, &repaired, request.method, &mut table).map_err(|e| unwritable(path, &e))?;
        placed.keep(path).and_then(|()| staging::publish(table, path)).map_err(|e| unwritable(path, &e))?;
    }
    if let (Some(log), Some(path)) = (log, &request.log) {
        let closing = Closing { results: report.results(), attachments: report.attachments() };
        placed.keep(path).map_err(|e| unwritable(path, &e))?;
        match log.finish(&closing) {
            Ok(_) => report.log = Some(path.clone()),
            Err(error) => report.log_failed(path, &error),
        }
    }
    if request.in_place {
        // whoever may not read the original may not read the repaired take either
        let same = std::fs::metadata(&request.input).and_then(|input| file.as_file().set_permissions(input.permissions()));
        same.map_err(|e| unwritable(target, &e))?;
        let kept = original_name(&request.input);
        keep_original(&request.input, &kept, &sha256)?;
        placed.added(&kept);
    }
    staging::publish(file, target).map_err(|e| unwritable(target, &e))?;
    placed.done();
    report.output = Some(target.clone());
    report.notes = notes.take();
    Ok(report)
}

/// Copies the input to `kept`, whole or not at all, and only if it still is what was read.
fn keep_original(input: &Path, kept: &Path, sha256: &str) -> Result<(), RepairError> {
    let copied = staging::beside(kept).and_then(|file| {
        std::fs::copy(input, file.path())?;
        file.as_file().sync_all()?;
        Ok((hex(&Sha256::digest(std::fs::read(file.path())?)), file))
    });
    let (copied_sha256, file) = copied.map_err(|e| unwritable(kept, &e))?;
    if copied_sha256 != sha256 {
        let problem = "was changed by someone else while it was repaired; nothing was replaced, run it again".to_owned();
        return Err(RepairError::Io { path: input.to_owned(), problem });
    }
    file.persist_noclobber(kept).map_err(|e| unwritable(kept, &e.error))?;
    Ok(())
}

impl Request {
    /// The files to write.
    fn names(&self) -> Names<'_> {
        let beside = self.log.as_deref().into_iter().chain(self.fills.as_deref()).collect();
        Names { input: &self.input, output: &self.output, beside, in_place: self.in_place, force: self.force }
    }

    /// True if bones are to keep their lengths exactly.
    pub fn hard(&self) -> bool {
        self.method == Method::BoleroHc || (self.method == Method::Auto && self.settings.stiffness == Stiffness::Hard)
    }

    /// The options that shape the result, by name, for the records.
    pub fn options(&self) -> Vec<(String, String)> {
        let mut options = vec![
            (
                "hidden".to_owned(),
                match self.settings.hidden {
                    Hidden::Count(count) => count.to_string(),
                    Hidden::Energy(share) => format!("energy {share}"),
                },
            ),
            ("lambda".to_owned(), self.settings.lambda.map_or_else(|| "spread".to_owned(), |l| l.to_string())),
            ("e_step".to_owned(), if self.settings.e_step == EStep::Imputing { "imputing" } else { "exact" }.to_owned()),
            ("start".to_owned(), format!("{:?}", self.settings.start).to_lowercase()),
            (
                "init".to_owned(),
                match self.settings.init {
                    Init::Components => "pca".to_owned(),
                    Init::Random(seed) => format!("random {seed}"),
                },
            ),
            ("noise".to_owned(), format!("{:?}", self.settings.noise).to_lowercase()),
            ("step".to_owned(), format!("{:?}", self.settings.step).to_lowercase()),
            ("constant_term".to_owned(), self.settings.constant.to_string()),
            ("iterations".to_owned(), self.iterations.to_string()),
            ("tolerance".to_owned(), self.tolerance.to_string()),
            ("extrapolate".to_owned(), self.policy.extrapolate.to_string()),
            ("bones".to_owned(), format!("{:?}", self.settings.stiffness).to_lowercase()),
            ("max_sigma".to_owned(), self.policy.max_sigma_mm.map_or_else(|| "none".to_owned(), |s| s.to_string())),
            ("max_gap".to_owned(), self.policy.max_gap.map_or_else(|| "none".to_owned(), |g| g.to_string())),
        ];
        if !self.markers.is_empty() {
            options.push(("markers".to_owned(), self.markers.join(",")));
        }
        match self.outliers {
            Treatment::Told => {}
            Treatment::Ignored => options.push(("outliers".to_owned(), "ignored".to_owned())),
            Treatment::Dropped => options.push(("outliers".to_owned(), "dropped".to_owned())),
        }
        options
    }
}

impl Report {
    fn log_failed(&mut self, path: &Path, error: &LogError) {
        self.log_error = Some(format!("{}: {error}", path.display()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_fit_whole_labels() {
        for (pattern, text, fits) in [
            ("LKNE", "LKNE", true),
            ("LKNE", "LKNEE", false),
            ("L*", "LKNE", true),
            ("*:L?NE", "s:LKNE", true),
            ("*K*E*", "LKNE", true),
            ("?", "", false),
            ("*", "", true),
            ("*a*b", "aab", true),
            ("*a*b", "aba", false),
        ] {
            assert_eq!(matches(pattern, text), fits, "{pattern} {text}");
        }
    }
}
