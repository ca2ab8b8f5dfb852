//! One case: hide, fill with every method, compare.

use crate::cases::{Case, Kind};
use formats::{Take, TakeBuilder};
use mocap_repair::repair::neighbours;
use mocap_repair::solve::{Gap, Limits, Method, Problem, Settings, Stop};
use mocap_repair::{bones, fills, gaps};
use rayon::prelude::*;

/// The method that the paper builds upon and compares with.
pub const BASELINE: Method = Method::Lds;

/// A case with what every method made of it.
#[derive(Debug)]
pub struct Trial {
    /// What was hidden.
    pub case: Case,
    /// Label of the hidden marker; of several, all of them.
    pub markers: String,
    /// In the order in which the methods were named.
    pub fills: Vec<Fill>,
}

/// What one method made of a case.
#[derive(Debug)]
pub struct Fill {
    /// Which method.
    pub method: Method,
    /// Mean squared error over the hidden entries, mm² (Eq. 13).
    pub mse_mm2: f64,
    /// False if the limit of 100 steps came first.
    pub converged: bool,
    /// The take with its gaps filled. Kept for the worked examples only: all of them together are hundreds of megabytes.
    pub take: Option<Take>,
}

impl Trial {
    /// What `method` made of it, if it was asked.
    pub fn of(&self, method: Method) -> Option<&Fill> {
        self.fills.iter().find(|fill| fill.method == method)
    }
}

impl Fill {
    /// Eq. 13 in cm².
    pub fn mse_cm2(&self) -> f64 {
        self.mse_mm2 / 100.0
    }

    /// Root mean square of the 3-D error, mm: the sum of three coordinates under the root, not their mean.
    pub fn rmse_mm(&self) -> f64 {
        (3.0 * self.mse_mm2).sqrt()
    }
}

/// The name as the paper writes it: `BoLeRO-SC`, `LDS`.
pub fn title(method: Method) -> String {
    match method.name().split_once('-') {
        Some(("bolero", kind)) => format!("BoLeRO-{}", kind.to_uppercase()),
        _ => method.name().to_uppercase(),
    }
}

/// True for the methods that the paper proposes.
pub fn proposed(method: Method) -> bool {
    method.name().starts_with("bolero-")
}

/// Hides what the case says and fills it with each method. Every gap is filled, those at the take's ends too.
///
/// # Errors
/// A method broke down or left a gap open: a mean over the cases that went well would mean nothing.
pub fn attempt(case: &Case, truth: &Take, methods: &[Method]) -> Result<Trial, String> {
    let mut builder = TakeBuilder::from(truth.clone());
    for gap in &case.hidden {
        for frame in gap.start..gap.end {
            builder.hide(frame, gap.marker);
        }
    }
    let holed = builder.build();
    let everybody = neighbours(&holed);
    let problem = Problem::new(&holed, &everybody, &bones::find(&holed, &everybody));
    let found = gaps::gaps(&holed);
    let one = |&method: &Method| {
        let about = |problem: &str| format!("{} trial {} by {}: {problem}", case.motion, case.trial, method.name());
        let solved = method.solve(&problem, &Settings::default(), &Limits::default(), &mut ());
        let outcome = solved.outcome().ok_or_else(|| about("nothing was solved"))?;
        if outcome.stop == Stop::Failed {
            return Err(about(&outcome.error.as_ref().map_or_else(|| "failed".to_owned(), ToString::to_string)));
        }
        let mut take = holed.clone();
        let mut decisions = vec![Ok(()); found.len()];
        fills::fill(&mut take, &problem, &solved.estimate, &found, &mut decisions, None);
        let mse_mm2 = mse(truth, &take, &case.hidden).ok_or_else(|| about("a gap was left open"))?;
        Ok(Fill { method, mse_mm2, converged: outcome.stop == Stop::Converged, take: (case.kind == Kind::Paper).then_some(take) })
    };
    let fills = methods.par_iter().map(one).collect::<Vec<_>>().into_iter().collect::<Result<_, String>>()?;
    let markers: Vec<&str> = case.hidden.iter().filter_map(|gap| truth.markers.get(gap.marker)).map(formats::Marker::name).collect();
    Ok(Trial { markers: markers.join(", "), case: case.clone(), fills })
}

/// Eq. 13: the mean of the squared differences over all hidden entries, three of them to a sample, in mm².
/// `None` if nothing is hidden or a sample is missing on either side.
///
/// The paper measures in coordinates that turn and move with the body, which changes no distance: over whole samples the figure is the same.
fn mse(truth: &Take, filled: &Take, hidden: &[Gap]) -> Option<f64> {
    let mut sum = 0.0;
    let mut entries = 0;
    for gap in hidden {
        for frame in gap.start..gap.end {
            let (a, b) = (truth.position_mm(frame, gap.marker)?, filled.position_mm(frame, gap.marker)?);
            sum += a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
            entries += 3;
        }
    }
    (entries > 0).then(|| sum / f64::from(entries))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use formats::{Marker, Origin};

    fn take(rows: [[[f64; 3]; 2]; 2]) -> Take {
        let mut builder = TakeBuilder::new(vec![Marker::new("A"), Marker::new("B")], 2, 120.0);
        for (frame, row) in rows.into_iter().enumerate() {
            for (marker, position) in row.into_iter().enumerate() {
                builder.set(frame, marker, position, Origin::Measured);
            }
        }
        builder.build()
    }

    #[test]
    fn the_error_is_that_of_eq_13() {
        let truth = take([[[0.0; 3], [1.0; 3]], [[2.0; 3], [3.0; 3]]]);
        let filled = take([[[3.0, 4.0, 0.0], [9.0; 3]], [[2.0, 2.0, 1.0], [3.0; 3]]]);
        let both = [Gap { marker: 0, start: 0, end: 2 }];
        // marker B is not hidden, so what differs there does not count: (9 + 16 + 1) over six entries
        assert_eq!(mse(&truth, &filled, &both), Some(26.0 / 6.0));
        assert_eq!(mse(&truth, &filled, &[Gap { marker: 1, start: 1, end: 2 }]), Some(0.0));
        assert_eq!(mse(&truth, &filled, &[]), None);
        assert_eq!(mse(&truth, &filled, &[Gap { marker: 0, start: 1, end: 3 }]), None);
    }

    #[test]
    fn one_figure_in_two_units() {
        let fill = Fill { method: BASELINE, mse_mm2: 300.0, converged: true, take: None };
        assert_eq!((fill.mse_cm2(), fill.rmse_mm()), (3.0, 30.0));
    }

    #[test]
    fn methods_have_the_names_of_the_paper() {
        assert_eq!([Method::Lds, Method::BoleroSc].map(title), ["LDS", "BoLeRO-SC"]);
        assert_eq!([Method::Lds, Method::BoleroSc].map(proposed), [false, true]);
    }

    #[test]
    fn every_method_is_tried() {
        let truth = mocap_repair::demo::walk(120, 120.0, 1);
        let hidden = vec![Gap { marker: 3, start: 50, end: 70 }];
        let case = Case { motion: "walk".into(), kind: Kind::Single, trial: 0, hidden };
        let trial = attempt(&case, &truth, &Method::ALL).unwrap();
        assert_eq!(trial.fills.iter().map(|fill| fill.method).collect::<Vec<_>>(), Method::ALL);
        assert!(trial.fills.iter().all(|fill| fill.mse_mm2 > 0.0 && fill.rmse_mm() < 500.0), "{trial:?}");
        assert_eq!(trial.of(BASELINE).unwrap().method, BASELINE);
    }
}
