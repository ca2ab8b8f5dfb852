//! `auto`: every gap chooses among experts by evidence from the take itself.

mod adjust;
mod alike;
mod ask;
mod blackout;
mod body;
mod dark;
mod ensemble;
mod experts;
mod features;
mod frame;
mod kriging;
mod ridge;
mod simulate;
mod stack;
mod tracks;

pub use adjust::Stiffness;
pub use tracks::LEAST_SEEN;

use super::{Estimate, Gap, Limits, Meter, Problem, Progress, SolveError, Solver};
use adjust::Adjustment;
use body::Body;
use dark::Blackout;
use ensemble::{Filling, Scene};
use rayon::prelude::*;
use simulate::Seen;
use tracks::{Pairs, Tracks};

/// Rounds of the model of the whole body.
const BODY_ROUNDS: u32 = 10;

/// The model of the whole body is judged only if limbs are this share of what is missing: that costs as much as learning it.
const LIMBS_SHARE: f64 = 0.2;

/// So many gaps of limbs get all experts, the longest ones.
const MOST_LIMBS: usize = 40;

/// What the method is made of; each can be left out to see what it is worth.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(clippy::struct_excessive_bools)] // each is an ingredient
pub struct Recipe {
    /// Sweeps over all gaps.
    pub sweeps: u32,
    /// Carry what regressions leave at the edges into the gap.
    pub kriging: bool,
    /// Combine experts; otherwise the best one alone.
    pub stacking: bool,
    /// Let the disagreement of experts raise the standard deviation.
    pub spread: bool,
    /// Experts that leave the others' company in the gap lose weight.
    pub consensus: bool,
    /// Experts that are not linear in their neighbours' places.
    pub bent: bool,
    /// Experts in other frames than that of the five best neighbours.
    pub frames: bool,
    /// More experts where a limb is missing.
    pub limbs: bool,
    /// The bones' adjustment.
    pub bones: bool,
    /// The model of the whole body is an expert where limbs are missing.
    pub body: bool,
    /// Other parts of the take lend to black-outs.
    pub analogs: bool,
    /// How stiff coefficients are.
    pub stiffness: f64,
}

impl Default for Recipe {
    fn default() -> Self {
        Self {
            sweeps: 3,
            kriging: true,
            stacking: true,
            consensus: true,
            spread: true,
            bent: true,
            frames: true,
            limbs: true,
            bones: true,
            body: true,
            analogs: true,
            stiffness: 5.0,
        }
    }
}

impl Recipe {
    /// Leaves an ingredient out.
    ///
    /// # Errors
    /// There is none of this name; the error names those that exist.
    pub fn leave_out(&mut self, name: &str) -> Result<(), &'static str> {
        let ingredient = match name {
            "kriging" => &mut self.kriging,
            "stacking" => &mut self.stacking,
            "consensus" => &mut self.consensus,
            "spread" => &mut self.spread,
            "bent" => &mut self.bent,
            "frames" => &mut self.frames,
            "limbs" => &mut self.limbs,
            "bones" => &mut self.bones,
            "body" => &mut self.body,
            "analogs" => &mut self.analogs,
            "third" => {
                self.sweeps = 2;
                return Ok(());
            }
            "sweeps" => {
                self.sweeps = 1;
                return Ok(());
            }
            _ => return Err("kriging, stacking, consensus, spread, bent, frames, limbs, bones, body, analogs, sweeps"),
        };
        *ingredient = false;
        Ok(())
    }
}

/// Why a gap was filled as it was.
#[derive(Clone, Debug, PartialEq)]
pub struct Explanation {
    /// The gap; its marker is a column of the problem.
    pub gap: Gap,
    /// Markers that were looked at, best first.
    pub neighbours: Vec<usize>,
    /// Experts with their share and their error on simulated gaps, mm.
    pub experts: Vec<(String, f64, f64)>,
    /// Number of simulated gaps.
    pub simulated: usize,
    /// Their length in frames.
    pub simulated_frames: usize,
    /// Predicted error, root mean square over the gap, mm; NaN if there was no evidence.
    pub predicted_mm: f64,
}

/// The solver: one step is one sweep over all gaps.
pub struct Auto<'a> {
    problem: &'a Problem,
    recipe: Recipe,
    tracks: Tracks,
    pairs: Pairs,
    seen: Vec<Seen>,
    /// Gaps outside black-outs; one that a black-out cuts counts twice.
    gaps: Vec<Gap>,
    /// The body of each marker.
    bodies: Vec<usize>,
    fillings: Vec<Option<Filling>>,
    /// Each body's black-outs.
    blackouts: Vec<Blackout>,
    /// For each body, which frames are dark.
    dark: Vec<Vec<bool>>,
    /// The body of each black-out.
    body_of: Vec<usize>,
    /// What fills black-outs, one filling for each marker.
    bridges: Vec<Vec<Filling>>,
    body: Body,
    long_limb: usize,
    adjustment: Adjustment,
    stiffness: Stiffness,
    sweep: u32,
    estimate: Estimate,
    meter: Option<&'a Meter>,
}

impl<'a> Auto<'a> {
    /// When the body's model, which comes first, has learned enough: it is one expert of many.
    pub fn body_limits<'l>(limits: &Limits<'l>) -> Limits<'l> {
        Limits { steps: limits.steps.min(BODY_ROUNDS), tolerance: limits.tolerance.max(1e-3), ..*limits }
    }

    /// Looks at the take; fills nothing yet.
    pub fn new(problem: &'a Problem, recipe: Recipe, stiffness: Stiffness) -> Self {
        let tracks = Tracks::new(problem);
        let mut pairs = Pairs::new(&tracks);
        let bodies = pairs.bodies(&tracks, &problem.prefixes);
        let seen = (0..problem.markers()).map(|i| Seen::new((0..problem.frames()).map(|t| problem.observed(t, i)))).collect();
        let (mut blackouts, mut dark, mut body_of) = (Vec::new(), Vec::new(), Vec::new());
        for body in 0..bodies.iter().max().map_or(0, |last| last + 1) {
            let markers: Vec<usize> = (0..problem.markers()).filter(|&i| bodies[i] == body && tracks.live(i)).collect();
            let own = dark::find(&tracks, &markers);
            let mut frames = vec![false; problem.frames()];
            for t in own.iter().flat_map(|b| b.start..b.end) {
                frames[t] = true;
            }
            body_of.extend(own.iter().map(|_| body));
            blackouts.extend(own);
            dark.push(frames);
        }
        let gaps: Vec<Gap> = tracks.gaps(|t, i| dark[bodies[i]][t]);
        let fillings = vec![None; gaps.len()];
        let adjustment = Adjustment::new(&tracks, &problem.bones, problem.rate_hz);
        let mut auto = Self {
            problem,
            recipe,
            tracks,
            pairs,
            seen,
            gaps,
            bodies,
            fillings,
            blackouts,
            dark,
            body_of,
            bridges: Vec::new(),
            body: Body::default(),
            long_limb: 0,
            adjustment,
            stiffness,
            sweep: 0,
            estimate: Estimate::open(problem.missing.len()),
            meter: None,
        };
        // limbs take many experts, so in a take that is mostly occluded only the longest gaps get them
        let mut limbs: Vec<usize> = auto.limbs().iter().map(Gap::frames).collect();
        limbs.sort_unstable_by(|a, b| b.cmp(a));
        auto.long_limb = limbs.get(MOST_LIMBS).map_or(0, |frames| frames + 1);
        auto
    }

    /// Counts the gaps of each sweep as they are filled.
    #[must_use]
    pub fn counting(self, meter: Option<&'a Meter>) -> Self {
        Self { meter, ..self }
    }

    /// Gaps whose rigid neighbours are missing, too.
    fn limbs(&self) -> Vec<Gap> {
        let scene = self.scene();
        self.gaps.iter().filter(|gap| scene.order(gap).1 >= ensemble::LIMB).copied().collect()
    }

    /// What is common to all gaps of a sweep.
    fn scene(&self) -> Scene<'_> {
        Scene {
            tracks: &self.tracks,
            pairs: &self.pairs,
            seen: &self.seen,
            scale: self.problem.rate_hz / 120.0,
            sweep: self.sweep,
            recipe: &self.recipe,
            long_limb: self.long_limb,
            problem: self.problem,
            body: &self.body,
        }
    }

    /// Asks the model of the whole body, of which `estimate` is what it makes of the gaps, and judges it where limbs are missing.
    /// `solver` makes it, `limits` are those it was learned within.
    #[must_use]
    pub fn with_body(
        mut self,
        estimate: &Estimate,
        limits: &Limits<'_>,
        solver: &dyn for<'p> Fn(&'p Problem) -> Box<dyn Solver + 'p>,
    ) -> Self {
        if self.recipe.body && self.recipe.limbs {
            let limbs = self.limbs();
            let (samples, all) = (limbs.iter().map(Gap::frames).sum::<usize>(), self.problem.missing.len());
            if (samples as f64) < LIMBS_SHARE * all as f64 {
                return self;
            }
            self.body = Body::new(self.problem, &self.bodies, estimate, &self.tracks, &self.seen, &limbs, limits, solver);
        }
        self
    }

    /// Why each gap was filled as it was.
    pub fn explanations(&self) -> Vec<Explanation> {
        let mut all: Vec<Explanation> = self.fillings.iter().flatten().map(|f| f.explanation.clone()).collect();
        for filling in self.bridges.iter().flatten() {
            // a marker may be seen in some frames of a black-out
            let gap = filling.explanation.gap;
            let mut start = gap.start;
            while start < gap.end {
                let end = (start..gap.end).find(|&t| self.tracks.seen(t, gap.marker)).unwrap_or(gap.end);
                if end > start {
                    let sigmas = &filling.sigma_mm[start - gap.start..end - gap.start];
                    let predicted_mm = (sigmas.iter().map(|s| s * s).sum::<f64>() / sigmas.len() as f64).sqrt();
                    all.push(Explanation { gap: Gap { start, end, ..gap }, predicted_mm, ..filling.explanation.clone() });
                }
                start = end + 1;
            }
        }
        all
    }

    /// Takes a filling over; what was seen stays.
    fn put(tracks: &mut Tracks, filling: &Filling) {
        let gap = filling.explanation.gap;
        for (t, (&place, &sigma)) in (gap.start..gap.end).zip(filling.places_mm.iter().zip(&filling.sigma_mm)) {
            if !tracks.seen(t, gap.marker) {
                tracks.put(t, gap.marker, place, sigma);
            }
        }
    }

    fn publish(&mut self) -> (f64, f64) {
        let (mut largest, mut sum) = (0.0f64, 0.0);
        for (k, &(t, i)) in self.problem.missing.iter().enumerate() {
            if !self.tracks.live(i) {
                continue;
            }
            let place = self.tracks.place(t, i);
            let moved = tracks::distance(place, self.estimate.positions_mm[k]);
            if moved.is_finite() {
                largest = largest.max(moved);
                sum += moved * moved;
            }
            self.estimate.positions_mm[k] = place;
            self.estimate.sigma_mm[k] = self.tracks.sigma(t, i);
        }
        (largest, (sum / self.problem.missing.len().max(1) as f64).sqrt())
    }
}

impl Solver for Auto<'_> {
    fn name(&self) -> &'static str {
        "auto"
    }

    fn step(&mut self) -> Result<Progress, SolveError> {
        let scale = self.problem.rate_hz / 120.0;
        let has_gaps: Vec<bool> = self.seen.iter().map(|s| s.frames.len() < s.len()).collect();
        let todo: Vec<usize> = (0..self.gaps.len())
            .filter(|&g| self.fillings[g].as_ref().is_none_or(|f: &Filling| f.neighbours.iter().any(|&j| has_gaps[j])))
            .collect();
        let meter = self.meter;
        let count = || meter.iter().for_each(|meter| meter.count());
        if let Some(meter) = meter {
            meter.begin(self.blackouts.len() + todo.len());
        }
        let bridges: Vec<Vec<Filling>> = self
            .blackouts
            .iter()
            .zip(&self.body_of)
            .map(|(blackout, &body)| blackout::fill(&self.tracks, blackout, &self.dark[body], scale, self.recipe.analogs))
            .inspect(|_| count())
            .collect();
        for filling in bridges.iter().flatten() {
            Self::put(&mut self.tracks, filling);
        }
        self.bridges = bridges;
        let scene = self.scene();
        let new: Vec<Filling> = todo.par_iter().map(|&g| scene.fill(&self.gaps[g])).inspect(|_| count()).collect();
        for (g, filling) in todo.into_iter().zip(new) {
            self.fillings[g] = Some(filling);
        }
        for filling in self.fillings.iter().flatten() {
            Self::put(&mut self.tracks, filling);
        }
        let likelihood: f64 = self.fillings.iter().flatten().chain(self.bridges.iter().flatten()).map(|f| f.likelihood.0).sum();
        self.sweep += 1;
        if self.recipe.bones || self.stiffness == Stiffness::Hard {
            // on the way bones that contradict each other must not decide what others learn from
            let stiffness = if self.sweep == self.recipe.sweeps { self.stiffness } else { Stiffness::Soft };
            self.adjustment.apply(&mut self.tracks, self.problem.rate_hz, stiffness);
        }
        let (largest_move_mm, rms_move_mm) = self.publish();
        Ok(Progress {
            log_likelihood: Some(likelihood),
            rms_residual_mm: None,
            largest_move_mm,
            rms_move_mm,
            done: self.sweep >= self.recipe.sweeps,
        })
    }

    fn counted(&self) -> bool {
        true
    }

    fn estimate(&self) -> &Estimate {
        &self.estimate
    }
}

#[cfg(test)]
mod tests {
    use super::tracks::tests::problem;
    use super::*;
    use crate::solve::Bone;

    const FRAMES: usize = 160;

    /// Ten markers that walk, wave and shake a little.
    fn place(t: usize, i: usize) -> [f64; 3] {
        let (s, own) = (t as f64 / 100.0, i as f64);
        let shake = |k: f64| 0.3 * (37.0 * own * own + 91.7 * k * t as f64).sin();
        [
            900.0 * s + 80.0 * own + 20.0 * (6.0 * s + own).sin() + shake(1.0),
            60.0 * (own * 1.7).sin() + shake(2.0),
            1000.0 + 150.0 * (own * 2.3).cos() + shake(3.0),
        ]
    }

    /// All is dark in frames 60 to 80, but for marker 9 and a glimpse of marker 8; there are other gaps, too, one of which runs into the dark.
    fn seen(t: usize, i: usize) -> bool {
        match (t, i) {
            (60..80, 8) => (66..70).contains(&t),
            (60..80, i) => i == 9,
            (50..60, 2) | (100..115, 2 | 3) | (110..130, 4) | (0..5, 5) | (150..160, 6) => false,
            _ => true,
        }
    }

    #[test]
    fn what_was_seen_stays_and_what_was_not_is_filled() {
        let mut problem = problem((FRAMES, 10), 100.0, place, seen);
        let bones = [(2, 3), (8, 7)].map(|(a, b)| {
            let lengths: Vec<f64> = (0..FRAMES).map(|t| tracks::distance(place(t, a), place(t, b))).collect();
            Bone { a, b, length_mm: lengths.iter().sum::<f64>() / FRAMES as f64, spread_mm: 15.0 }
        });
        problem.bones.extend(bones);
        for stiffness in [Stiffness::Soft, Stiffness::Hard] {
            let mut auto = Auto::new(&problem, Recipe::default(), stiffness);
            assert_eq!(auto.blackouts.iter().map(|b| (b.start, b.end)).collect::<Vec<_>>(), [(60, 80)]);
            let mut done = false;
            for sweep in 0..3 {
                assert!(!done, "it stops after {sweep} sweeps");
                done = auto.step().is_ok_and(|progress| progress.done);
            }
            assert!(done);
            for (t, i) in (0..FRAMES).flat_map(|t| (0..10).map(move |i| (t, i))).filter(|&(t, i)| seen(t, i)) {
                assert_eq!((auto.tracks.place(t, i), auto.tracks.sigma(t, i)), (place(t, i), 0.0), "marker {i} in frame {t}");
            }
            for (k, &(t, i)) in problem.missing.iter().enumerate() {
                let (x, sigma) = (auto.estimate.positions_mm[k], auto.estimate.sigma_mm[k]);
                assert!(sigma > 0.0 && sigma.is_finite(), "marker {i} in frame {t}: {sigma} mm");
                assert!(tracks::distance(x, place(t, i)) < 60.0, "marker {i} in frame {t} is at {x:?}, not at {:?}", place(t, i));
            }
            // each missing sample is explained once
            let mut explained: Vec<(usize, usize)> = Vec::new();
            for gap in auto.explanations().into_iter().map(|e| e.gap) {
                explained.extend((gap.start..gap.end).map(|t| (t, gap.marker)).filter(|&(t, i)| !seen(t, i)));
            }
            explained.sort_unstable();
            assert_eq!(explained, problem.missing);
        }
    }

    #[test]
    fn explanations_are_of_gaps() {
        let problem = problem((FRAMES, 10), 100.0, place, seen);
        let mut auto = Auto::new(&problem, Recipe::default(), Stiffness::Soft);
        assert!(auto.step().is_ok());
        for Gap { marker, start, end } in auto.explanations().into_iter().map(|e| e.gap) {
            assert!((start..end).all(|t| !seen(t, marker)), "marker {marker} was seen in {start}..{end}");
        }
    }

    #[test]
    fn ingredients_have_names() {
        let names = Recipe::default().leave_out("salt").expect_err("no such ingredient");
        for name in names.split(", ") {
            let mut recipe = Recipe::default();
            recipe.leave_out(name).expect("it is named");
            assert_ne!(recipe, Recipe::default(), "{name}");
        }
    }
}
