//! From what experts say to one fill: their weights, and how far the fill may be off.

use super::Explanation;
use super::ensemble::{Case, Filling, Scene};
use super::experts::Base;
use super::simulate::Simulation;
use crate::solve::kernel::dot;
use nalgebra::{DMatrix, DVector};

/// What an expert says about the gap, and how it did on simulated ones.
pub struct Expert {
    /// Its name.
    pub name: &'static str,
    /// Its frame.
    pub base: Base,
    /// 0: nothing is carried in from the edges; else by that process.
    pub carry: usize,
    /// 3 × frames, mm.
    pub prediction: DMatrix<f64>,
    /// 3 × judged samples, mm.
    pub errors: DMatrix<f64>,
    /// Variance from the noise of what it looks at, mm².
    pub doubt: f64,
    /// Mean square error with that, mm².
    pub score: f64,
    /// How many errors those are.
    pub total: f64,
    /// For each judged sample, true if the error is known; it is 0 if not.
    pub known: Vec<bool>,
}

impl Expert {
    fn label(&self) -> String {
        let carry = ["", "+8", "+16", "+32", "+48"][self.carry.min(4)];
        match self.base {
            Base::Nearest(0) => format!("{}{carry}", self.name),
            Base::Nearest(count) => format!("{}@{count}{carry}", self.name),
            Base::Trunk => format!("{}@trunk{carry}", self.name),
        }
    }
}

impl Scene<'_> {
    /// From the combination to positions and standard deviations.
    pub(super) fn finish(
        &self,
        case: &Case,
        order: &[usize],
        experts: &[Expert],
        shares: &[(usize, f64)],
        simulation: &Simulation,
        positions: &[usize],
    ) -> Filling {
        let (length, p) = (case.inside.len(), positions.len());
        let prediction = mix(shares, experts, |e| &e.prediction);
        let errors = mixed_errors(shares, experts);
        let doubt: f64 = shares.iter().map(|&(e, share)| share * experts[e].doubt).sum();
        // at each position: error of the combination, and how far experts are apart, over the simulated gaps
        let mut count = vec![0.0; p];
        let (mut square, mut apart) = (vec![0.0; p], vec![0.0; p]);
        for (n, w) in case.weight.iter().enumerate() {
            let at = n % p;
            count[at] += w;
            square[at] += squares(errors.column(n).as_slice());
            for &(e, share) in shares.iter().filter(|&&(e, _)| experts[e].known[n]) {
                apart[at] += share * (experts[e].errors.column(n) - errors.column(n)).norm_squared();
            }
        }
        let at_position: Vec<f64> = (0..p).map(|k| (square[k] / f64::max(count[k], 1.0) + doubt).sqrt()).collect();
        let apart: Vec<f64> = (0..p).map(|k| (apart[k] / f64::max(count[k], 1.0)).sqrt()).collect();
        let knots: Vec<f64> = positions.iter().map(|&x| x as f64).collect();
        let mut sigma_mm = Vec::with_capacity(length);
        for k in 0..length {
            let at = (k as f64 + 0.5) / length as f64 * simulation.frames as f64 - 0.5;
            let now = prediction.column(k);
            let spread: f64 = shares.iter().map(|&(e, share)| share * (experts[e].prediction.column(k) - now).norm_squared()).sum();
            let usual = interpolate(&knots, &apart, at).max(0.05);
            let strange = if self.recipe.spread { (spread.sqrt() / usual).max(1.0) } else { 1.0 };
            sigma_mm.push(case.pessimism * interpolate(&knots, &at_position, at) * strange + 0.05);
        }
        let mut likelihood = (0.0, 0);
        for (n, _) in case.weight.iter().enumerate().filter(|(_, w)| **w > 0.0) {
            let variance = (at_position[n % p] + 0.05).powi(2) / 3.0;
            likelihood.0 -= 1.5 * (std::f64::consts::TAU * variance).ln() + 0.5 * squares(errors.column(n).as_slice()) / variance;
            likelihood.1 += 1;
        }
        let predicted_mm = (sigma_mm.iter().map(|s| s * s).sum::<f64>() / length as f64).sqrt();
        let mut named: Vec<(String, f64, f64)> =
            shares.iter().filter(|s| s.1 > 0.0).map(|&(e, share)| (experts[e].label(), share, experts[e].score.sqrt())).collect();
        named.sort_by(|a, b| b.1.total_cmp(&a.1));
        let explanation = Explanation {
            gap: *case.gap,
            neighbours: order.to_vec(),
            experts: named,
            simulated: simulation.count(),
            simulated_frames: simulation.frames,
            predicted_mm,
        };
        let places_mm = prediction.column_iter().map(|x| [x[0], x[1], x[2]]).collect();
        Filling { places_mm, sigma_mm, likelihood, neighbours: order.to_vec(), explanation }
    }
}

/// Squared length of three columns that belong together.
pub fn squares(e: &[f64]) -> f64 {
    e.iter().map(|x| x * x).sum()
}

/// The weighed sum of what experts say.
fn mix<'e>(shares: &[(usize, f64)], experts: &'e [Expert], what: impl Fn(&'e Expert) -> &'e DMatrix<f64>) -> DMatrix<f64> {
    let mut sum = DMatrix::zeros(3, what(&experts[0]).ncols());
    for &(e, share) in shares {
        crate::solve::kernel::axpy(sum.as_mut_slice(), share, what(&experts[e]).as_slice());
    }
    sum
}

/// The error of the weighed mean; where an expert's error is not known, that of the mean of the others.
fn mixed_errors(shares: &[(usize, f64)], experts: &[Expert]) -> DMatrix<f64> {
    let mut errors = mix(shares, experts, |e| &e.errors);
    for (n, mut column) in errors.column_iter_mut().enumerate() {
        let silent: f64 = shares.iter().filter(|&&(e, _)| !experts[e].known[n]).map(|s| s.1).sum();
        if silent > 0.0 && silent < 1.0 {
            column /= 1.0 - silent;
        }
    }
    errors
}

/// The best mean of the best experts, by the covariance of their errors, shrunk strongly towards equal shares.
/// Of each regression only the best way to carry counts: the others would say the same again.
///
/// With `consensus`, experts that depart from the mean in the gap more than they did in simulated gaps lose what they gained: they extrapolate.
pub fn combine(experts: &[Expert], case: &Case, most: usize, consensus: bool) -> Vec<(usize, f64)> {
    let mut penalties = vec![0.0; experts.len()];
    let mut shares = weigh(experts, &penalties, most);
    if consensus {
        let prediction = mix(&shares, experts, |e| &e.prediction);
        let errors = mixed_errors(&shares, experts);
        let apart = |a: &DMatrix<f64>, b: &DMatrix<f64>| a.as_slice().iter().zip(b.as_slice()).map(|(x, y)| (x - y) * (x - y)).sum::<f64>();
        for (penalty, expert) in penalties.iter_mut().zip(experts) {
            let here = apart(&expert.prediction, &prediction) / case.inside.len() as f64;
            let own = expert.errors.column_iter().zip(errors.column_iter()).zip(&expert.known).filter(|(_, known)| **known);
            let there = own.map(|((e, mean), _)| (e - mean).norm_squared()).sum::<f64>() / expert.total;
            *penalty = (here - there).max(0.0);
        }
        shares = weigh(experts, &penalties, most);
    }
    shares
}

fn weigh(experts: &[Expert], penalties: &[f64], most: usize) -> Vec<(usize, f64)> {
    let mut best: Vec<usize> = (0..experts.len()).collect();
    let score = |e: usize| experts[e].score + penalties[e];
    best.sort_by(|&a, &b| score(a).total_cmp(&score(b)).then(a.cmp(&b)));
    let mut taken: Vec<(&str, Base)> = Vec::new();
    best.retain(|&e| {
        let key = (experts[e].name, experts[e].base);
        let new = !taken.contains(&key);
        if new {
            taken.push(key);
        }
        new
    });
    best.truncate(most);
    let m = best.len();
    let mut covariance = DMatrix::zeros(m, m);
    for a in 0..m {
        for b in 0..=a {
            let both = experts[best[a]].total.min(experts[best[b]].total);
            let value = dot(experts[best[a]].errors.as_slice(), experts[best[b]].errors.as_slice()) / both;
            covariance[(a, b)] = value;
            covariance[(b, a)] = value;
        }
        covariance[(a, a)] += experts[best[a]].doubt + penalties[best[a]];
    }
    // its own variance, or what all have in common: among equals the shares are nearly equal, but one that is far better than the others gets nearly all
    let common = covariance.trace() / m as f64;
    for k in 0..m {
        covariance[(k, k)] += covariance[(k, k)].min(common) + 1e-6;
    }
    let ones = DVector::from_element(m, 1.0);
    let mut shares: Vec<f64> = covariance.cholesky().map_or(vec![1.0; m], |c| c.solve(&ones).iter().map(|x| x.max(0.0)).collect());
    let sum: f64 = shares.iter().sum();
    for s in &mut shares {
        *s /= sum;
    }
    best.into_iter().zip(shares).collect()
}

/// Straight lines through `(knots, values)`, held outside.
pub fn interpolate(knots: &[f64], values: &[f64], at: f64) -> f64 {
    let next = knots.partition_point(|&k| k < at);
    match (next.checked_sub(1), knots.get(next)) {
        (Some(before), Some(_)) => {
            let share = (at - knots[before]) / (knots[next] - knots[before]);
            values[before] + share * (values[next] - values[before])
        }
        (Some(before), None) => values[before],
        (None, _) => values.first().copied().unwrap_or(f64::NAN),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Random, Stream};
    use crate::solve::Gap;

    const JUDGED: usize = 60;
    const GAP: Gap = Gap { marker: 0, start: 10, end: 20 };

    /// What `combine` reads of a case is how long its gap is.
    fn case() -> Case<'static> {
        Case {
            gap: &GAP,
            learn: Vec::new(),
            inside: (GAP.start..GAP.end).collect(),
            edges: Vec::new(),
            judged: (0..JUDGED).collect(),
            beside: Vec::new(),
            starts: Vec::new(),
            hidden: Vec::new(),
            weight: vec![1.0; JUDGED],
            carries: Vec::new(),
            curves: Vec::new(),
            stride: 1,
            noise: Vec::new(),
            pessimism: 1.0,
        }
    }

    /// An expert that is off by `size` mm in each coordinate of simulated gaps, and says `said` about the gap.
    fn expert(name: &'static str, random: &mut Random, size: f64, said: f64) -> Expert {
        let errors = DMatrix::from_fn(3, JUDGED, |_, _| size * random.between(-1.0, 1.0));
        let total = JUDGED as f64;
        let score = squares(errors.as_slice()) / total;
        let prediction = DMatrix::from_element(3, GAP.frames(), said);
        Expert { name, base: Base::Trunk, carry: 0, prediction, errors, doubt: 0.0, score, total, known: vec![true; JUDGED] }
    }

    fn share(shares: &[(usize, f64)], expert: usize) -> f64 {
        assert!((shares.iter().map(|s| s.1).sum::<f64>() - 1.0).abs() < 1e-12 && shares.iter().all(|s| s.1 >= 0.0), "{shares:?}");
        shares.iter().find(|s| s.0 == expert).map_or(0.0, |s| s.1)
    }

    #[test]
    fn who_did_better_has_more_to_say_and_who_leaves_the_others_less() {
        let mut random = Random::new(2, Stream::Start);
        let mut experts: Vec<Expert> =
            [("a", 2.0), ("b", 2.0), ("c", 2.0), ("d", 9.0)].map(|(name, size)| expert(name, &mut random, size, 100.0)).into();
        for consensus in [false, true] {
            let shares = combine(&experts, &case(), 32, consensus);
            assert!(share(&shares, 3) < 0.5 * share(&shares, 0), "{shares:?}");
            assert!(share(&shares, 0) < 1.5 * share(&shares, 1) && share(&shares, 1) < 1.5 * share(&shares, 0), "{shares:?}");
        }
        // in the gap c is 30 mm away from the others, and it never was in simulated ones
        experts[2].prediction.fill(130.0);
        let [alone, together] = [false, true].map(|consensus| share(&combine(&experts, &case(), 32, consensus), 2));
        assert!(together < 0.5 * alone, "{alone} without and {together} with the consensus");
    }

    #[test]
    fn of_one_regression_only_the_best_carry_counts() {
        let mut random = Random::new(3, Stream::Start);
        let mut experts: Vec<Expert> = [4.0, 1.0, 2.0].map(|size| expert("same", &mut random, size, 0.0)).into();
        experts.push(expert("other", &mut random, 3.0, 0.0));
        for (carry, expert) in experts.iter_mut().enumerate().take(3) {
            expert.carry = carry;
        }
        let mut who: Vec<usize> = combine(&experts, &case(), 32, true).into_iter().map(|s| s.0).collect();
        who.sort_unstable();
        assert_eq!(who, [1, 3]);
        assert_eq!(combine(&experts, &case(), 1, true), [(1, 1.0)]);
        assert_eq!(experts[1].label(), "same@trunk+8");
    }

    /// Where an expert was not judged, the error of the mean is that of the others' mean.
    #[test]
    fn silence_is_no_praise() {
        let mut random = Random::new(4, Stream::Start);
        let mut experts: Vec<Expert> = ["a", "b", "silent"].map(|name| expert(name, &mut random, 5.0, 0.0)).into();
        for n in 0..JUDGED / 2 {
            experts[2].known[n] = false;
            experts[2].errors.column_mut(n).fill(0.0);
        }
        let found = mixed_errors(&[(0, 0.2), (1, 0.3), (2, 0.5)], &experts);
        for n in 0..JUDGED {
            let at = |e: usize| experts[e].errors.column(n);
            let expected = if n < JUDGED / 2 { at(0) * 0.4 + at(1) * 0.6 } else { at(0) * 0.2 + at(1) * 0.3 + at(2) * 0.5 };
            assert!((found.column(n) - expected).amax() < 1e-12, "sample {n}");
        }
    }

    #[test]
    fn lines_are_held_outside_their_knots() {
        let at = |t: f64| interpolate(&[1.0, 3.0, 4.0], &[10.0, 20.0, 0.0], t);
        assert_eq!([0.0, 1.0, 2.0, 3.0, 3.5, 4.0, 9.0].map(at), [10.0, 10.0, 15.0, 20.0, 10.0, 0.0, 0.0]);
    }
}
