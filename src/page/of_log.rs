//! The page of a repair of which only the log is left.

use super::curves::{Curve, Iteration, micrometres};
use super::positions::{State, rounded, rounded_sigma};
use super::{Page, Track, told};
use crate::log::schema::marker_states;
use crate::log::{DESCRIPTION, Description, LogReadError, Told, replay};
use crate::output::{Names, unwritable};
use crate::repair::RepairError;
use crate::staging;
use std::collections::BTreeMap;
use std::path::Path;

/// No file counts its frames beyond this, and a browser not much farther.
const LAST_FRAME: u64 = 1 << 48;

/// Writes the page of a log into a file.
///
/// # Errors
/// The log is none, or the file cannot be written.
pub fn report_of_log(log: &Path, output: &Path, force: bool) -> Result<(), RepairError> {
    Names { input: log, output, reads: vec![], beside: vec![], in_place: false, force }.check_beside()?;
    let page = Page::of_log(log).map_err(|error| RepairError::Log { path: log.to_owned(), error })?;
    page.stage(output).and_then(|file| staging::publish(file, output)).map_err(|e| unwritable(output, &e))
}

/// What was read so far.
#[derive(Default)]
struct Gathered {
    page: Page,
    /// Frames whose states were told.
    frames: u32,
    /// Known markers of the frame at hand as they were read, until it is clear what they became.
    raw: Vec<Option<[i32; 3]>>,
    description: Option<Description>,
    report: Option<String>,
    metadata: BTreeMap<String, String>,
}

impl Page {
    /// The page of a log. It is the same as that of the repair itself, except that positions are missing where the log was thinned.
    /// The log of a repair that came to nothing gives a page that says so.
    ///
    /// # Errors
    /// The file cannot be read, is no whole log, or not the log of a repair.
    pub fn of_log(path: &Path) -> Result<Self, LogReadError> {
        let mut gathered = Gathered::default();
        replay(path, &mut |told| gathered.hear(told))?;
        gathered.finish()
    }
}

impl Gathered {
    /// Takes in what the log tells.
    fn hear(&mut self, told: Told) -> Result<(), String> {
        match told {
            Told::Likelihood(step) => {
                let iteration = Iteration {
                    log_likelihood: step.log_likelihood,
                    rms_residual_mm: Some(step.rms_residual_mm).filter(|x| x.is_finite()),
                    largest_move_mm: step.largest_move_mm,
                    bones_um: Vec::new(),
                };
                match self.page.curves.last_mut() {
                    Some(curve) if curve.stage == step.stage => curve.iterations.push(iteration),
                    _ => self.page.curves.push(Curve { stage: step.stage, method: step.method, iterations: vec![iteration] }),
                }
            }
            Told::BoneResiduals(step) => {
                if self.page.curve_bones.is_empty() {
                    self.page.curve_bones = step.bones.iter().map(|bone| bone.label.clone()).collect();
                }
                if let Some(iteration) = self.page.curves.last_mut().and_then(|curve| curve.iterations.last_mut()) {
                    iteration.bones_um = step.bones.iter().map(|bone| micrometres(bone.value)).collect();
                }
            }
            Told::MarkerStates(states) => {
                self.flush();
                let tracks = &mut self.page.positions.tracks;
                if self.frames == 0 {
                    tracks.resize_with(states.markers.len(), Track::default);
                }
                if tracks.len() != states.markers.len() {
                    return Err(format!("frame {} has {} markers, the first one {}", self.frames, states.markers.len(), tracks.len()));
                }
                for (track, marker) in tracks.iter_mut().zip(&states.markers) {
                    let state = match marker.value() {
                        marker_states::State::Observed => State::Observed,
                        marker_states::State::Filled => State::Filled,
                        marker_states::State::Missing => State::Missing,
                    };
                    track.states.push(state);
                    if state == State::Filled {
                        track.sigma.push(rounded_sigma(marker.sigma_mm));
                    }
                }
                self.frames += 1;
            }
            Told::Raw(points) => self.raw = self.places(&points)?,
            Told::Repaired(points) => {
                let (places, raw) = (self.places(&points)?, std::mem::take(&mut self.raw));
                self.put(&places, &raw);
            }
            Told::Attachment(name, bytes) if name == DESCRIPTION => {
                let take: Description = serde_json::from_slice(&bytes).map_err(|e| format!("its {name}: {e}"))?;
                if !(take.rate_hz.is_finite() && take.rate_hz > 0.0) || take.first_frame.unsigned_abs() > LAST_FRAME {
                    return Err(format!("its {name} speaks of a rate or of frames that no take can have"));
                }
                self.description = Some(take);
            }
            Told::Attachment(name, bytes) if name == "report.jsonl" => {
                self.report = Some(String::from_utf8(bytes).map_err(|_| format!("its {name} is not text"))?);
            }
            Told::Attachment(..) => {}
            Told::Metadata(metadata) => self.metadata = metadata,
        }
        Ok(())
    }

    /// For every marker, where it is.
    fn places(&self, points: &[crate::log::Point]) -> Result<Vec<Option<[i32; 3]>>, String> {
        let mut places = vec![None; self.page.positions.tracks.len()];
        for point in points {
            let place =
                places.get_mut(point.marker).ok_or_else(|| format!("a point belongs to marker {}, which is not there", point.marker))?;
            *place = Some(rounded(point.metres));
        }
        Ok(places)
    }

    /// Adds the positions of the frame at hand.
    fn put(&mut self, places: &[Option<[i32; 3]>], raw: &[Option<[i32; 3]>]) {
        let positions = &mut self.page.positions;
        let index = positions.frames.len() as u32;
        positions.frames.push(self.frames.saturating_sub(1));
        for (marker, (track, place)) in positions.tracks.iter_mut().zip(places).enumerate() {
            track.at.push(place.unwrap_or_default());
            let before = raw.get(marker).copied().flatten();
            if let Some(before) = before.filter(|_| before != *place) {
                positions.raw.push((marker as u32, index, before));
            }
        }
    }

    /// Where nothing was written, a frame is as it was read.
    fn flush(&mut self) {
        let raw = std::mem::take(&mut self.raw);
        if !raw.is_empty() {
            self.put(&raw, &[]);
        }
    }

    /// The page, once everything was told.
    fn finish(mut self) -> Result<Page, LogReadError> {
        self.flush();
        let Self { mut page, frames, description, report, mut metadata, .. } = self;
        if let Some(command) = metadata.remove("command") {
            return Err(LogReadError::OfCommand(format!("mocap-repair {command}")));
        }
        let missing = |what: &str| LogReadError::NotOurs(what.to_owned());
        page.take = description.ok_or_else(|| missing(&format!("attachment called {DESCRIPTION}")))?;
        let Description { frames: told, markers, bones, .. } = &page.take;
        let contradicts = *told != frames as usize
            || markers.len() != page.positions.tracks.len()
            || bones.iter().any(|bone| bone.a.max(bone.b) >= markers.len());
        if contradicts && frames > 0 {
            return Err(LogReadError::Broken(format!("its {DESCRIPTION} speaks of another take than its messages")));
        }
        page.positions.raw.sort_by_key(|&(marker, index, _)| (marker, index));
        page.options = metadata.iter().filter_map(|(k, v)| Some((k.strip_prefix("option.")?.to_owned(), v.clone()))).collect();
        let mut take = |key: &str| metadata.remove(key).ok_or_else(|| missing(&format!("{key} in its metadata")));
        page.version = take("version")?;
        page.source_name = take("source_name")?;
        page.source_sha256 = take("source_sha256")?;
        page.method = take("method")?;
        page.seed = take("seed")?;
        let ended = take("ended")?;
        let report = match report {
            Some(report) => told::parse(&report).map_err(|e| LogReadError::Broken(format!("its report.jsonl: {e}")))?,
            None => page.unfinished(&ended),
        };
        page.tell(report).map_err(LogReadError::Broken)?;
        Ok(page)
    }
}
