//! `auto` against truth that it never saw: on the demonstration walk, and on bodies that are known because they were made up.

use crate::chance::Chance;
use formats::{Marker, Origin, Take, TakeBuilder};
use mocap_repair::bones;
use mocap_repair::demo::walk;
use mocap_repair::solve::auto::Explanation;
use mocap_repair::solve::{Gap, Limits, Method, Problem, Settings, Solved};
use nalgebra::{Rotation3, Vector3};
use std::ops::Range;

/// A take, what was hidden of it, and what a method made of that. Columns of the problem are those of the take.
struct Case<'a> {
    truth: &'a Take,
    problem: Problem,
    hidden: Vec<Gap>,
}

impl<'a> Case<'a> {
    /// Hides gaps of `truth`.
    fn new(truth: &'a Take, hidden: Vec<Gap>) -> Self {
        let mut take = TakeBuilder::from(truth.clone());
        for gap in &hidden {
            for t in gap.start..gap.end {
                take.hide(t, gap.marker);
            }
        }
        let take = take.build();
        let include = vec![true; take.markers.len()];
        let problem = Problem::new(&take, &include, &bones::find(&take, &include));
        assert_eq!(problem.markers(), take.markers.len(), "a marker is hidden from beginning to end");
        Self { truth, problem, hidden }
    }

    fn solve(&self, method: Method) -> Solved {
        let solved = method.solve(&self.problem, &Settings::default(), &Limits::default(), &mut ());
        assert!(solved.stages.iter().all(|stage| stage.outcome.error.is_none()), "{:?}", solved.stages);
        solved
    }

    /// Error and predicted standard deviation of each filled sample, mm.
    fn errors(&self, solved: &Solved) -> Vec<(f64, f64)> {
        let estimate = &solved.estimate;
        let one = |(k, &(t, i)): (usize, &(usize, usize))| {
            let (was, is) = (self.truth.position_mm(t, i).unwrap(), estimate.positions_mm[k]);
            ((Vector3::from(was) - Vector3::from(is)).norm(), estimate.sigma_mm[k])
        };
        self.problem.missing.iter().enumerate().map(one).collect()
    }

    /// Root mean square error, mm.
    fn error(&self, solved: &Solved) -> f64 {
        rms(self.errors(solved).into_iter().map(|e| e.0))
    }

    /// Root mean square of what is predicted for the samples of one marker, mm.
    fn predicted(&self, solved: &Solved, marker: usize) -> f64 {
        let own = self.problem.missing.iter().zip(&solved.estimate.sigma_mm).filter(|((_, i), _)| *i == marker);
        rms(own.map(|(_, sigma)| *sigma))
    }
}

fn rms(values: impl IntoIterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for x in values {
        sum += x * x;
        count += 1.0;
    }
    assert!(count > 0.0, "nothing to take the mean of");
    f64::sqrt(sum / count)
}

fn column(take: &Take, name: &str) -> usize {
    take.markers.iter().position(|marker| marker.name() == name).unwrap()
}

/// The markers of one leg and the pelvis: enough for a body, and quick.
const LEG: [&str; 12] = ["LFWT", "RFWT", "LBWT", "RBWT", "LTHI", "LKNE", "LSHN", "RTHI", "LANK", "LHEE", "LTOE", "LMT5"];

/// Some markers of a take, in their order.
fn some(take: &Take, names: &[&str]) -> Take {
    let columns: Vec<usize> = names.iter().map(|name| column(take, name)).collect();
    let markers = columns.iter().map(|&i| take.markers[i].clone()).collect();
    let mut part = TakeBuilder::new(markers, take.frames(), take.rate_hz).up(take.up);
    for t in 0..take.frames() {
        for (to, &from) in columns.iter().enumerate() {
            part.set(t, to, take.position_mm(t, from).unwrap(), Origin::Measured);
        }
    }
    part.build()
}

/// One gap after another, each of another marker, `frames` long and so many frames from one to the next.
fn in_turn(take: &Take, names: &[&str], frames: usize, from: usize, apart: usize) -> Vec<Gap> {
    let gap = |(k, name): (usize, &&str)| Gap { marker: column(take, name), start: from + apart * k, end: from + apart * k + frames };
    names.iter().enumerate().map(gap).collect()
}

/// Gaps of 3 to 30 frames of every marker, wherever chance puts them; the ends stay.
fn scattered(take: &Take, chance: &mut Chance, share: f64) -> Vec<Gap> {
    let mut gaps = Vec::new();
    for marker in 0..take.markers.len() {
        let mut t = 1.0;
        loop {
            let frames = chance.between(3.0, 30.0);
            t += chance.between(0.0, 2.0) * frames * (1.0 - share) / share;
            let (start, end) = (t as usize, (t + frames) as usize);
            if end + 1 >= take.frames() {
                break;
            }
            gaps.push(Gap { marker, start, end });
            t = (end + 2) as f64;
        }
    }
    gaps
}

const OTHERS: [Method; 4] = [Method::Linear, Method::Spline, Method::Lds, Method::BoleroSc];

/// `auto` is nearer to the truth than every other method, and its predicted errors are true.
#[track_caller]
fn best_and_calibrated(case: &Case) {
    let solved = case.solve(Method::Auto);
    let own = case.error(&solved);
    for other in OTHERS {
        let theirs = case.error(&case.solve(other));
        assert!(own < theirs, "{own} mm, {} {theirs} mm", other.name());
    }
    calibrated(&case.errors(&solved));
}

#[test]
fn single_gaps_are_filled_better_than_by_any_other_method() {
    let truth = walk(420, 120.0, 3);
    let names = ["LKNE", "RFIN", "C7", "RTOE", "LELB", "RSHN"];
    let case = Case::new(&truth, in_turn(&truth, &names, 40, 30, 60));
    best_and_calibrated(&case);
}

#[test]
fn scattered_gaps_are_filled_better_than_by_any_other_method() {
    let truth = walk(300, 120.0, 5);
    let case = Case::new(&truth, scattered(&truth, &mut Chance::new(2), 0.05));
    best_and_calibrated(&case);
}

/// What is predicted is as large as what happened, within a factor of 2.
#[track_caller]
fn calibrated(errors: &[(f64, f64)]) {
    let (happened, predicted) = (rms(errors.iter().map(|e| e.0)), rms(errors.iter().map(|e| e.1)));
    let within = errors.iter().filter(|(error, sigma)| *error <= 2.0 * sigma).count() as f64 / errors.len() as f64;
    assert!(happened < 2.0 * predicted && predicted < 2.0 * happened, "{happened} mm happened, {predicted} mm were predicted");
    assert!(within >= 0.85, "only {within} of the errors are within two standard deviations");
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let truth = some(&walk(200, 120.0, 1), &LEG);
    let mut hidden = scattered(&truth, &mut Chance::new(4), 0.08);
    // a black-out, and a limb with it
    hidden.retain(|gap| gap.end < 60);
    hidden.extend((0..12).map(|marker| Gap { marker, start: 70, end: 85 }));
    hidden.extend((5..9).map(|marker| Gap { marker, start: 110, end: 140 }));
    let case = Case::new(&truth, hidden);
    let [one, four] = [1, 4].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| case.solve(Method::Auto))
    });
    let bits = |solved: &Solved| -> Vec<u64> {
        let estimate = &solved.estimate;
        estimate.positions_mm.iter().flatten().chain(&estimate.sigma_mm).map(|x| x.to_bits()).collect()
    };
    assert!(bits(&one) == bits(&four), "one thread and four threads found different fills");
    // numbers that are not there are not equal to themselves, but their texts are
    assert_eq!(format!("{:?}", one.explanations), format!("{:?}", four.explanations));
}

/// Six markers that tumble as one: the others say exactly where the missing one is.
#[test]
fn a_rigid_body_is_filled_exactly() {
    let mut chance = Chance::new(6);
    let shape: Vec<Vector3<f64>> = (0..6).map(|_| Vector3::from_fn(|_, _| 150.0 * chance.normal())).collect();
    let mut truth = TakeBuilder::new((0..6).map(|i| Marker::new(format!("M{i}"))).collect(), 300, 120.0);
    for t in 0..300 {
        let s = t as f64 / 120.0;
        let turn = Rotation3::from_scaled_axis(Vector3::new(3.0 * s, 2.0 * (4.0 * s).sin(), 1.5 * (3.0 * s).cos()));
        let centre = Vector3::new(900.0 * s.sin(), 1200.0 * s, 1000.0 + 300.0 * (2.0 * s).cos());
        for (i, x) in shape.iter().enumerate() {
            truth.set(t, i, (turn * x + centre).into(), Origin::Measured);
        }
    }
    let truth = truth.build();
    let gap = |marker, range: Range<usize>| Gap { marker, start: range.start, end: range.end };
    let case = Case::new(&truth, vec![gap(1, 50..110), gap(4, 80..150), gap(2, 180..182), gap(0, 0..20), gap(5, 290..300)]);
    let solved = case.solve(Method::Auto);
    let worst = case.errors(&solved).iter().map(|e| e.0).fold(0.0, f64::max);
    assert!(worst < 0.01, "{worst} mm");
}

/// Markers of `part`, with labels of one subject, beside those of `other`, who walks elsewhere.
fn two(part: &Take, other: &Take) -> Take {
    let labels = |take: &Take, subject: &str| -> Vec<Marker> {
        take.markers.iter().map(|marker| Marker::new(format!("{subject}:{}", marker.name()))).collect()
    };
    let m = part.markers.len();
    let mut both = TakeBuilder::new([labels(part, "Ann"), labels(other, "Bo")].concat(), part.frames(), part.rate_hz);
    for t in 0..part.frames() {
        for i in 0..m {
            both.set(t, i, part.position_mm(t, i).unwrap(), Origin::Measured);
        }
        for i in 0..other.markers.len() {
            let [x, y, z] = other.position_mm(t, i).unwrap();
            both.set(t, m + i, [x + 3000.0, y - 2000.0, z], Origin::Measured);
        }
    }
    both.build()
}

#[test]
fn nobody_is_filled_from_somebody_else() {
    let truth = two(&some(&walk(160, 120.0, 1), &LEG), &some(&walk(160, 120.0, 2), &LEG));
    let mut hidden = in_turn(&truth, &["LKNE", "LTOE", "LBWT"], 25, 20, 40);
    // Bo's twin of each gap, and Ann out of sight
    hidden.extend(hidden.clone().iter().map(|gap| Gap { marker: gap.marker + 12, ..*gap }));
    hidden.extend((0..12).map(|marker| Gap { marker, start: 132, end: 145 }));
    let case = Case::new(&truth, hidden);
    let solved = case.solve(Method::Auto);
    assert_eq!(solved.explanations.len(), 6 + 12);
    for explanation in &solved.explanations {
        let bo = explanation.gap.marker >= 12;
        assert!(explanation.neighbours.iter().all(|&j| (j >= 12) == bo), "{explanation:?}");
    }
    let error = case.error(&solved);
    assert!(error < 15.0, "{error} mm");
}

#[test]
fn a_prop_of_its_own_mind_is_known_to_be_uncertain() {
    let body = some(&walk(240, 120.0, 4), &LEG);
    let (ball, knee) = (12, column(&body, "LKNE"));
    let mut chance = Chance::new(8);
    let waves: Vec<[f64; 3]> = (0..12).map(|_| [chance.between(0.5, 2.5), chance.between(0.0, 6.3), 150.0 * chance.normal()]).collect();
    let mut truth = TakeBuilder::new([body.markers.clone(), vec![Marker::new("BALL")]].concat(), body.frames(), body.rate_hz).up(body.up);
    for t in 0..body.frames() {
        for i in 0..ball {
            truth.set(t, i, body.position_mm(t, i).unwrap(), Origin::Measured);
        }
        let own = |axis: usize| {
            let wave = |w: &[f64; 3]| w[2] * (std::f64::consts::TAU * w[0] * t as f64 / 120.0 + w[1]).sin();
            waves[4 * axis..4 * axis + 4].iter().map(wave).sum::<f64>()
        };
        truth.set(t, ball, [0, 1, 2].map(own), Origin::Measured);
    }
    let truth = truth.build();
    let case = Case::new(&truth, vec![Gap { marker: knee, start: 60, end: 100 }, Gap { marker: ball, start: 150, end: 190 }]);
    let solved = case.solve(Method::Auto);
    let (of_ball, of_knee) = (case.predicted(&solved, ball), case.predicted(&solved, knee));
    assert!(of_ball > 3.0 * of_knee, "{of_ball} mm for the ball, {of_knee} mm for the knee");
    let errors: Vec<f64> = case.errors(&solved).iter().zip(&case.problem.missing).filter(|(_, m)| m.1 == ball).map(|(e, _)| e.0).collect();
    let happened = rms(errors);
    assert!(happened < 3.0 * of_ball, "{happened} mm happened, {of_ball} mm were predicted");
}

/// Root mean square errors of gaps of LKNE, LANK, LHEE and LKNE again, mm: of the take, and of one in which two markers swapped their labels in frames
/// 100 to 130. The first gap begins shortly before the swap and ends in it; LTHI and LSHN are the neighbours of LKNE.
fn swapped(settings: &Settings) -> [Vec<f64>; 2] {
    let truth = some(&walk(300, 120.0, 6), &LEG);
    let (a, b) = (column(&truth, "LTHI"), column(&truth, "LSHN"));
    let mut swapped = TakeBuilder::from(truth.clone());
    for t in 100..130 {
        swapped.set(t, a, truth.position_mm(t, b).unwrap(), Origin::Measured);
        swapped.set(t, b, truth.position_mm(t, a).unwrap(), Origin::Measured);
    }
    let mut gaps = in_turn(&truth, &["LANK", "LKNE", "LHEE", "LKNE"], 30, 30, 65);
    gaps.swap(0, 1);
    [&truth, &swapped.build()].map(|take| {
        let case = Case::new(take, gaps.clone());
        let solved = Method::Auto.solve(&case.problem, settings, &Limits::default(), &mut ());
        let errors = case.errors(&solved);
        let of = |gap: &Gap| {
            let own = errors.iter().zip(&case.problem.missing).filter(|(_, (t, i))| *i == gap.marker && (gap.start..gap.end).contains(t));
            rms(own.map(|(e, _)| e.0))
        };
        gaps.iter().map(of).collect()
    })
}

#[test]
fn swapped_labels_do_not_spoil_other_gaps() {
    let [clean, spoilt] = swapped(&Settings::default());
    for (clean, spoilt) in clean[1..].iter().zip(&spoilt[1..]) {
        assert!(*spoilt < 2.0 * clean + 2.0, "{spoilt} mm, {clean} mm without the swap");
    }
}

/// Bones help a little when all is well; they must not ruin a fill that experts had nearly right.
#[test]
fn bones_do_not_pull_a_fill_to_swapped_labels() {
    let mut settings = Settings::default();
    let [_, with] = swapped(&settings);
    settings.recipe.leave_out("bones").unwrap();
    let [_, without] = swapped(&settings);
    assert!(with[0] < 2.0 * without[0] + 2.0, "{} mm with bones, {} mm without", with[0], without[0]);
}

#[test]
fn the_rate_hardly_matters() {
    let errors = [30.0, 250.0, 1000.0].map(|rate_hz: f64| {
        let frames = |secs: f64| (secs * rate_hz).round() as usize;
        let truth = some(&walk(frames(4.0), rate_hz, 7), &LEG);
        let case = Case::new(&truth, in_turn(&truth, &["LKNE", "LTOE", "LHEE", "RFWT"], frames(0.4), frames(0.6), frames(0.8)));
        let solved = case.solve(Method::Auto);
        (case.error(&solved), case.predicted(&solved, column(&truth, "LKNE")))
    });
    for (error, _) in errors {
        assert!(error < 2.5 * errors[1].0 && errors[1].0 < 2.5 * error, "{errors:?}");
    }
}

#[test]
fn explanations_say_who_was_asked() {
    let truth = walk(200, 120.0, 9);
    let mut hidden = in_turn(&truth, &["LKNE", "RFIN", "C7"], 20, 20, 30);
    let limb = ["RTHI", "RKNE", "RSHN", "RANK"].map(|name| column(&truth, name));
    // one is back a little sooner than the others, but not soon enough to help
    hidden.extend(limb.map(|marker| Gap { marker, start: 130, end: if marker == limb[3] { 169 } else { 170 } }));
    hidden.push(Gap { marker: column(&truth, "CLAV"), start: 195, end: 200 });
    let case = Case::new(&truth, hidden);
    let solved = case.solve(Method::Auto);
    let mut explained: Vec<Gap> = solved.explanations.iter().map(|e| e.gap).collect();
    let mut hidden = case.hidden.clone();
    for gaps in [&mut explained, &mut hidden] {
        gaps.sort_by_key(|gap| (gap.marker, gap.start));
    }
    assert_eq!(explained, hidden);
    for Explanation { gap, neighbours, experts, simulated, simulated_frames, predicted_mm } in &solved.explanations {
        let shares: f64 = experts.iter().map(|(_, share, _)| share).sum();
        assert!((shares - 1.0).abs() < 1e-9 && experts.iter().all(|e| e.1 >= 0.0), "{gap:?}: {experts:?}");
        assert!(experts.windows(2).all(|w| w[0].1 >= w[1].1) && experts.iter().all(|e| !e.0.is_empty() && e.2 > 0.0), "{experts:?}");
        assert!(neighbours.len() >= 8 && !neighbours.contains(&gap.marker), "{gap:?}: {neighbours:?}");
        for &j in neighbours {
            let absent = (gap.start..gap.end).filter(|&t| !case.problem.observed(t, j)).count();
            assert!(10 * absent < 9 * gap.frames(), "{gap:?}: {j} is there in {} frames only", gap.frames() - absent);
        }
        assert!(*simulated >= 4 && *simulated_frames == gap.frames(), "{gap:?}: {simulated} of {simulated_frames}");
        // what is explained is what is published
        let own = case.problem.missing.iter().zip(&solved.estimate.sigma_mm);
        let sigma = rms(own.filter(|((t, i), _)| *i == gap.marker && (gap.start..gap.end).contains(t)).map(|(_, sigma)| *sigma));
        assert!((sigma - predicted_mm).abs() < 1e-9 * sigma, "{gap:?}: {sigma} and {predicted_mm}");
    }
}
