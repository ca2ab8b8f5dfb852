//! The model of the whole body as one more expert where a limb is missing.
//!
//! What it says about the gaps is known from the stage before. How far that may be off is found by hiding simulated gaps of whole limbs, all at once,
//! and learning the model anew without them: a model that has seen what it is judged on would praise itself.

use super::simulate::{Seen, Simulation};
use super::tracks::Tracks;
use crate::solve::{Estimate, Gap, Limits, Meter, Observer, Problem, Solver, Step, run};

/// No more than this share of what was seen is hidden for the sake of judgement.
const MOST_HIDDEN: f64 = 0.15;

/// A marker that is missing in this share of a gap is hidden with it.
const WITH_IT: f64 = 0.5;

/// Fewer simulated gaps than this say nothing.
const LEAST_GAPS: usize = 2;

/// What the model of the whole body says, and where it can be judged.
#[derive(Debug, Default)]
pub struct Body {
    /// Of the gaps.
    estimate: Estimate,
    /// Samples that were hidden, (frame, marker), ascending.
    hidden: Vec<(usize, usize)>,
    /// What the model said about them, having been learned without them, mm.
    said: Vec<[f64; 3]>,
}

impl Body {
    /// `bodies` are those of the markers; `limbs` are gaps whose rigid neighbours are missing, too; `solver` makes the model for a problem.
    #[allow(clippy::too_many_arguments)] // what it judges, and what it judges by
    pub fn new(
        problem: &Problem,
        bodies: &[usize],
        estimate: &Estimate,
        tracks: &Tracks,
        seen: &[Seen],
        limbs: &[Gap],
        limits: &Limits<'_>,
        solver: &dyn for<'p> Fn(&'p Problem) -> Box<dyn Solver + 'p>,
    ) -> Self {
        let most = MOST_HIDDEN * seen.iter().map(|s| s.frames.len()).sum::<usize>() as f64;
        let mut hidden: Vec<(usize, usize)> = Vec::new();
        for gap in limbs {
            let with_it: Vec<usize> = (0..tracks.markers)
                .filter(|&j| bodies[j] == bodies[gap.marker] && tracks.missing_share(j, gap.start, gap.end) >= WITH_IT)
                .collect();
            let simulation = Simulation::new(&seen[gap.marker], gap.frames());
            let starts = apart(&simulation);
            if starts.len() < LEAST_GAPS {
                continue;
            }
            let own = starts.iter().flat_map(|&s| s..s + simulation.frames);
            let samples = own.flat_map(|t| with_it.iter().map(move |&j| (t, j))).filter(|&(t, j)| tracks.seen(t, j));
            let mut more = hidden.clone();
            more.extend(samples);
            more.sort_unstable();
            more.dedup();
            if more.len() as f64 <= most {
                hidden = more;
            }
        }
        let mut body = Self { estimate: estimate.clone(), hidden, said: Vec::new() };
        if !body.hidden.is_empty() {
            let judged = problem.hiding(&body.hidden);
            let mut model = solver(&judged);
            if let Some(meter) = limits.meter {
                meter.begin(limits.steps as usize);
            }
            run(model.as_mut(), &judged, 0, limits, &mut limits.meter.map(Rounds));
            let places = &model.estimate().positions_mm;
            body.said =
                body.hidden.iter().map(|sample| judged.missing.binary_search(sample).map_or([f64::NAN; 3], |k| places[k])).collect();
        }
        body
    }

    /// What the model says about a gap, frame by frame, mm; none if it does not say it all.
    pub fn prediction(&self, problem: &Problem, gap: &Gap) -> Option<Vec<[f64; 3]>> {
        (gap.start..gap.end)
            .map(|t| {
                let k = problem.missing.binary_search(&(t, gap.marker)).ok()?;
                self.estimate.positions_mm.get(k).copied().filter(|x| x[0].is_finite())
            })
            .collect()
    }

    /// What it said about a sample that was hidden from it, mm.
    pub fn said(&self, t: usize, marker: usize) -> Option<[f64; 3]> {
        let k = self.hidden.binary_search(&(t, marker)).ok()?;
        self.said.get(k).copied().filter(|x| x[0].is_finite())
    }
}

/// Counts the rounds of a model that nobody else watches.
struct Rounds<'a>(&'a Meter);

impl Observer for Rounds<'_> {
    fn stepped(&mut self, _step: &Step<'_>) {
        self.0.count();
    }
}

/// Simulated gaps that leave half their length between them, one from each block at most.
fn apart(simulation: &Simulation) -> Vec<usize> {
    let mut chosen: Vec<usize> = Vec::new();
    for block in &simulation.blocks {
        let start = block.starts[block.starts.len() / 2];
        if chosen.last().is_none_or(|&last| start >= last + simulation.frames + simulation.frames / 2) {
            chosen.push(start);
        }
    }
    chosen
}
