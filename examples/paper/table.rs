//! The figures as Markdown.

use crate::example::{Example, mean};
use crate::trial::{BASELINE, Fill, Trial, proposed};
use formats::Take;
use mocap_repair::solve::Method;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// All tables: the trials by motion, overall, against the baseline, and the worked examples.
pub fn tables(trials: &[Trial], examples: &[Example<'_>], takes: &BTreeMap<String, Take>, methods: &[Method]) -> String {
    let mut parts = Vec::new();
    if !trials.is_empty() {
        parts.push(by_motion(trials, takes, methods));
        parts.push(overall(trials, methods));
        if methods.contains(&BASELINE) && methods.iter().any(|&method| proposed(method)) {
            parts.push(against_baseline(trials, methods));
        }
    }
    parts.extend(examples.iter().map(worked));
    parts.join("\n")
}

/// Eq. 13, as in Fig. 4a.
fn by_motion(trials: &[Trial], takes: &BTreeMap<String, Take>, methods: &[Method]) -> String {
    let mut text = "### Mean squared error by motion\n\n".to_owned();
    text.push_str("Eq. 13 in cm², averaged over the trials of a motion; the least of each row is bold.\n\n");
    row(&mut text, ["motion".to_owned(), "frames".to_owned(), "trials".to_owned()].into_iter().chain(names(methods)));
    row(&mut text, ["---".to_owned()].into_iter().chain(vec!["---:".to_owned(); methods.len() + 2]));
    for (motion, of_motion) in motions(trials) {
        let frames = takes.get(motion).map_or(0, Take::frames);
        let means: Vec<Option<f64>> = methods.iter().map(|&method| average(&of_motion, method)).collect();
        row(&mut text, [motion.to_owned(), frames.to_string(), of_motion.len().to_string()].into_iter().chain(best(&means, figure)));
    }
    let everything: Vec<&Trial> = trials.iter().collect();
    let means: Vec<Option<f64>> = methods.iter().map(|&method| average(&everything, method)).collect();
    row(&mut text, ["all".to_owned(), String::new(), trials.len().to_string()].into_iter().chain(best(&means, figure)));
    text
}

fn overall(trials: &[Trial], methods: &[Method]) -> String {
    let mut text = "### RMSE over all trials\n\n".to_owned();
    let _ = writeln!(text, "Root mean square of the 3-D error in mm, over {} trials.\n", trials.len());
    text.push_str("| method | median | mean | worst | converged within 100 rounds |\n| --- | ---: | ---: | ---: | ---: |\n");
    for &method in methods {
        let fills: Vec<&Fill> = trials.iter().filter_map(|trial| trial.of(method)).collect();
        let errors: Vec<f64> = fills.iter().map(|fill| fill.rmse_mm()).collect();
        let figures = [median(&errors), mean(errors.iter().copied()), errors.iter().copied().reduce(f64::max)];
        let figures = figures.map(|x| x.map_or_else(String::new, |x| format!("{x:.1}")));
        let converged = fills.iter().filter(|fill| fill.converged).count();
        row(&mut text, [format!("`{}`", method.name())].into_iter().chain(figures).chain([converged.to_string()]));
    }
    text
}

/// What Fig. 4b and 4c show, in figures.
fn against_baseline(trials: &[Trial], methods: &[Method]) -> String {
    let baseline = BASELINE.name();
    let mut text = format!("### Against `{baseline}`\n\n");
    let _ = writeln!(text, "An improvement is the mean squared error of `{baseline}` divided by that of the method, trial by trial.");
    text.push_str("The last column divides averages over a motion's trials instead, which is what the bars of Fig. 4a show.\n\n");
    let _ = writeln!(text, "| method | trials at or below `{baseline}` | median improvement | largest | largest of a motion |");
    text.push_str("| --- | ---: | ---: | ---: | ---: |\n");
    let mut lost = String::new();
    for &method in methods.iter().filter(|&&method| proposed(method)) {
        let pairs: Vec<(&Trial, &Fill, &Fill)> = trials.iter().filter_map(|t| Some((t, t.of(BASELINE)?, t.of(method)?))).collect();
        let factors: Vec<f64> = pairs.iter().map(|(_, before, after)| before.mse_mm2 / after.mse_mm2).collect();
        let won = pairs.iter().filter(|(_, before, after)| wins(before, after)).count();
        let of_motions = motions(trials)
            .into_iter()
            .filter_map(|(motion, of_motion)| Some((motion, average(&of_motion, BASELINE)? / average(&of_motion, method)?)));
        let largest = of_motions.reduce(|most, next| if next.1 > most.1 { next } else { most });
        row(
            &mut text,
            [
                format!("`{}`", method.name()),
                format!("{won} of {}", pairs.len()),
                median(&factors).map_or_else(String::new, |x| format!("{} times", figure(x))),
                factors.iter().copied().reduce(f64::max).map_or_else(String::new, |x| format!("{} times", figure(x))),
                largest.map_or_else(String::new, |(motion, x)| format!("{} times ({})", figure(x), motion)),
            ],
        );
        for (trial, before, after) in pairs.iter().filter(|(_, before, after)| !wins(before, after)) {
            row(
                &mut lost,
                [
                    format!("`{}`", method.name()),
                    trial.case.motion.clone(),
                    trial.case.trial.to_string(),
                    trial.markers.clone(),
                    spans(trial),
                    figure(before.mse_cm2()),
                    figure(after.mse_cm2()),
                    format!("{:.3}", after.mse_mm2 / before.mse_mm2),
                ],
            );
        }
    }
    if !lost.is_empty() {
        text.push_str("\nTrials lost, mean squared errors in cm² (frames counted from 1):\n\n");
        let _ = writeln!(text, "| method | motion | trial | marker | frames | mse of `{baseline}` | mse of the method | ratio |");
        text.push_str("| --- | --- | ---: | --- | --- | ---: | ---: | ---: |\n");
        text.push_str(&lost);
    }
    text
}

fn worked(example: &Example<'_>) -> String {
    let mut text = format!("### {}: {} hidden in frames {}\n\n", example.trial.case.motion, example.trial.markers, spans(example.trial));
    text.push_str("RMSE of the 3-D error, and how far each bone is from its mean length outside the gap (mean absolute deviation within it), both in mm.\n\n");
    let bones = example.bones.iter().map(|bone| format!("{} ({:.0} mm)", bone.name, bone.length_mm));
    row(&mut text, ["method".to_owned(), "RMSE".to_owned()].into_iter().chain(bones));
    row(&mut text, ["---".to_owned()].into_iter().chain(vec!["---:".to_owned(); example.bones.len() + 1]));
    for (fill, take) in example.takes() {
        let name = fill.map_or_else(|| "(the original)".to_owned(), |fill| format!("`{}`", fill.method.name()));
        let rmse = fill.map_or_else(String::new, |fill| format!("{:.1}", fill.rmse_mm()));
        let off = example.bones.iter().map(|bone| example.deviation_mm(bone, take).map_or_else(String::new, |x| format!("{x:.1}")));
        row(&mut text, [name, rmse].into_iter().chain(off));
    }
    text
}

/// At or below the baseline.
pub fn wins(baseline: &Fill, method: &Fill) -> bool {
    method.mse_mm2 <= baseline.mse_mm2
}

/// The trials of each motion, both in the order of the list.
fn motions(trials: &[Trial]) -> Vec<(&str, Vec<&Trial>)> {
    let mut found: Vec<(&str, Vec<&Trial>)> = Vec::new();
    for trial in trials {
        match found.iter_mut().find(|(motion, _)| *motion == trial.case.motion) {
            Some((_, of_motion)) => of_motion.push(trial),
            None => found.push((&trial.case.motion, vec![trial])),
        }
    }
    found
}

/// Mean of Eq. 13 over trials, cm².
fn average(trials: &[&Trial], method: Method) -> Option<f64> {
    mean(trials.iter().filter_map(|trial| trial.of(method)).map(Fill::mse_cm2))
}

/// The hidden frames, counted from 1 as in the paper; gaps with the same frames are named once.
fn spans(trial: &Trial) -> String {
    let mut spans: Vec<String> = trial.case.hidden.iter().map(|gap| format!("{}–{}", gap.start + 1, gap.end)).collect();
    spans.dedup();
    spans.join(", ")
}

fn names(methods: &[Method]) -> impl Iterator<Item = String> {
    methods.iter().map(|method| format!("`{}`", method.name()))
}

fn row(text: &mut String, cells: impl IntoIterator<Item = String>) {
    let cells: Vec<String> = cells.into_iter().collect();
    // Writing to a string cannot fail.
    let _ = writeln!(text, "| {} |", cells.join(" | "));
}

/// Written with `write`, the least of them bold.
fn best(values: &[Option<f64>], write: impl Fn(f64) -> String) -> Vec<String> {
    let least = values.iter().flatten().copied().reduce(f64::min);
    let cell = |value: &Option<f64>| match value {
        Some(x) if Some(*x) == least && values.len() > 1 => format!("**{}**", write(*x)),
        Some(x) => write(*x),
        None => String::new(),
    };
    values.iter().map(cell).collect()
}

/// Three digits that count, and no more than five decimals.
fn figure(x: f64) -> String {
    let decimals = if x > 0.0 { (2.0 - x.log10().floor()).clamp(0.0, 5.0) as usize } else { 0 };
    format!("{x:.decimals$}")
}

fn median(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let (low, high) = (sorted.get(sorted.len().saturating_sub(1) / 2)?, sorted.get(sorted.len() / 2)?);
    Some(f64::midpoint(*low, *high))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cases::{Case, Kind};
    use mocap_repair::demo::walk;
    use mocap_repair::solve::Gap;

    fn trial(motion: &str, trial: usize, lds_mm2: f64, sc_mm2: f64) -> Trial {
        let hidden = vec![Gap { marker: 0, start: 24, end: 90 }, Gap { marker: 1, start: 24, end: 90 }];
        let fill = |method, mse_mm2| Fill { method, mse_mm2, converged: true, take: None };
        let fills = vec![fill(Method::Lds, lds_mm2), fill(Method::BoleroSc, sc_mm2)];
        Trial { case: Case { motion: motion.into(), kind: Kind::Single, trial, hidden }, markers: "RKNE".into(), fills }
    }

    #[test]
    fn figures_have_three_digits() {
        for (x, text) in [
            (1234.4, "1234"),
            (123.4, "123"),
            (12.34, "12.3"),
            (1.0, "1.00"),
            (0.1239, "0.124"),
            (0.01239, "0.0124"),
            (1.239e-6, "0.00000"),
            (0.0, "0"),
        ] {
            assert_eq!(figure(x), text);
        }
    }

    #[test]
    fn medians() {
        assert_eq!([median(&[]), median(&[3.0]), median(&[3.0, 1.0]), median(&[9.0, 1.0, 2.0])], [None, Some(3.0), Some(2.0), Some(2.0)]);
    }

    #[test]
    fn wins_and_losses_are_counted() {
        let trials = [trial("80_10", 0, 800.0, 100.0), trial("80_10", 1, 200.0, 200.0), trial("1_1", 0, 100.0, 400.0)];
        let text = against_baseline(&trials, &[Method::Lds, Method::BoleroSc]);
        assert!(text.contains("| `bolero-sc` | 2 of 3 | 1.00 times | 8.00 times | 3.33 times (80_10) |"), "{text}");
        assert!(text.ends_with("| ---: |\n| `bolero-sc` | 1_1 | 0 | RKNE | 25–90 | 1.00 | 4.00 | 4.000 |\n"), "{text}");
    }

    #[test]
    fn the_least_error_of_a_motion_is_bold() {
        let trials = [trial("1_1", 0, 800.0, 100.0), trial("1_1", 1, 200.0, 200.0)];
        let text = by_motion(&trials, &BTreeMap::from([("1_1".to_owned(), walk(145, 120.0, 1))]), &[Method::Lds, Method::BoleroSc]);
        assert!(text.ends_with("| 1_1 | 145 | 2 | 5.00 | **1.50** |\n| all |  | 2 | 5.00 | **1.50** |\n"), "{text}");
    }
}
