//! The page of a body that was followed through clouds.

use super::of_body::{Figure, Followed, Series, Tile, events, files, notes, runs_of};
use super::{Note, Page};
use crate::report::{count, short};
use crate::rig::Rig;
use crate::runs::runs;
use crate::solve::track::{Round, Tracked, Way};
use crate::track::{Given, Report, Seen};
use serde::Serialize;

/// The most names in a tile.
const MOST_NAMES: usize = 3;

/// How the parts of a body were followed, and how every frame came about.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ByPart {
    /// The joints that move a part with a surface, as places in [`Description::markers`](crate::log::Description::markers).
    pub markers: Vec<usize>,
    /// For each of them, frame by frame, how much of its surface has points beside it, in percent; `None` without a cloud.
    pub coverage: Vec<Vec<Option<f64>>>,
    /// The same for the distance of its points from it, cm (root mean square); `None` if it has none.
    pub residual_cm: Vec<Vec<Option<f64>>>,
    /// For every frame its rounds of EM: log-likelihood in nats, standard deviation in cm, share of points that belong to the body.
    pub rounds: Vec<Vec<[Option<f64>; 3]>>,
}

/// A number with so many decimals.
fn rounded(x: f64, decimals: i32) -> Option<f64> {
    let unit = 10.0_f64.powi(decimals);
    x.is_finite().then(|| (x * unit).round() / unit)
}

/// What is kept of a sequence for its page while it is followed.
#[derive(Debug)]
pub struct TrackFigure {
    figure: Figure,
    rounds: Vec<Vec<[Option<f64>; 3]>>,
}

impl TrackFigure {
    /// Of a sequence of so many frames.
    pub fn new(rig: &Rig, frames: usize) -> Self {
        Self { figure: Figure::new(rig, frames), rounds: Vec::with_capacity(frames) }
    }

    /// Keeps the next frame.
    pub fn push(&mut self, tracked: &Tracked) {
        let predicted = tracked.way == Way::Predicted;
        let points = tracked.cloud.as_ref().map(|cloud| cloud.points.as_slice()).unwrap_or_default();
        let unseen = |joint: usize| predicted || tracked.lost.get(joint) == Some(&true);
        self.figure.push(&tracked.centres, &tracked.parts, unseen, points.iter().copied());
        let round = |round: &Round| [rounded(round.log_likelihood, 1), rounded(round.sigma_cm, 3), rounded(round.inliers, 3)];
        self.rounds.push(tracked.rounds.iter().map(round).collect());
    }
}

impl Page {
    /// The page of a sequence. `options` are by name, `source_name` is without folders.
    pub fn of_track(
        figure: TrackFigure,
        rig: &Rig,
        report: &Report,
        frames: &[Seen],
        source_name: &str,
        options: Vec<(String, String)>,
    ) -> Self {
        let mut page = Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            source_name: source_name.to_owned(),
            method: report.method.to_owned(),
            options: options.into_iter().collect(),
            notes: notes(&report.notes),
            ..Self::default()
        };
        if let Some(error) = &report.log_error {
            page.notes.push(Note { text: format!("there is no log: {error}"), matters: true });
        }
        let first = frames.first().map_or(0, |seen| i64::from(seen.number));
        let TrackFigure { figure, rounds } = figure;
        figure.show(&mut page, rig, report.rate_hz, (first, 1));
        let by_part = Some(by_part(rig, frames, rounds));
        page.followed = Some(Followed { by_part, ..followed(rig, report, frames, first) });
        page
    }
}

fn by_part(rig: &Rig, frames: &[Seen], rounds: Vec<Vec<[Option<f64>; 3]>>) -> ByPart {
    let markers = rig.with_surface();
    let each = |value: &dyn Fn(&Seen, usize) -> Option<f64>| {
        markers.iter().map(|&part| frames.iter().map(|seen| value(seen, part)).collect()).collect()
    };
    ByPart {
        coverage: each(&|seen, part| rounded(100.0 * seen.coverage[part], 0)),
        residual_cm: each(&|seen, part| rounded(seen.residuals_cm[part], 2)),
        rounds,
        markers,
    }
}

fn followed(rig: &Rig, report: &Report, frames: &[Seen], first: i64) -> Followed {
    let when = |holds: &dyn Fn(&Seen) -> bool| runs(frames.len(), |at| holds(&frames[at]));
    let mut happened: Vec<_> = events("predicted", None, "no file", when(&|seen| seen.given == Given::Missing)).collect();
    happened.extend(events("predicted", None, "no points", when(&|seen| seen.given == Given::Empty)));
    happened.extend(events("searched", None, "limbs that were lost", when(&|seen| seen.way == Way::Searched)));
    let joint = |name: &str| rig.names().position(|joint| joint == name);
    for lost in &report.lost {
        happened.extend(events("lost", joint(&lost.part), &lost.part, runs_of(&lost.when, (first, 1))));
    }
    happened.sort();

    let covered = |seen: &Seen| {
        let known = || seen.coverage.iter().filter(|x| x.is_finite());
        if seen.given == Given::Cloud { known().sum::<f64>() / known().count() as f64 } else { f64::NAN }
    };
    let curves = vec![
        Series::new("Log-likelihood of the last round, nats", 1, frames.iter().map(|seen| seen.log_likelihood)),
        Series::new("Standard deviation of the last round, cm", 4, frames.iter().map(|seen| seen.sigma_cm)),
        Series::new("Share of points that belong to the body", 4, frames.iter().map(|seen| seen.inliers)),
        Series::new("Distance of points from the body, cm (root mean square)", 4, frames.iter().map(|seen| seen.residual_cm)),
        Series::new("Covered share of the surface, mean over parts", 4, frames.iter().map(covered)),
    ];

    let total = |kind: &str| happened.iter().filter(|event| event.kind == kind).map(|event| event.frames).sum::<usize>();
    let at = |kind: &str| happened.iter().find(|event| event.kind == kind).map(|event| event.start);
    let (predicted, searched) = (total("predicted"), total("searched"));
    let number = |at: usize| frames.get(at).map_or(0, |seen| seen.number);
    let (far, few) = (curves[3].largest(), curves[2].smallest());
    let known = |x: f64, text: String| if x.is_finite() { text } else { "–".to_owned() };
    let mut names: Vec<&str> = report.lost.iter().map(|lost| lost.part.as_str()).take(MOST_NAMES).collect();
    if report.lost.len() > MOST_NAMES {
        names.push("…");
    }
    let tiles = vec![
        Tile {
            title: "Followed",
            value: (frames.len() - predicted).to_string(),
            about: format!("of {}", count(frames.len(), "frame")),
            ..Tile::default()
        },
        Tile {
            title: "Predicted",
            value: predicted.to_string(),
            about: if predicted > 0 { "frames without a cloud" } else { "every frame has a cloud" }.to_owned(),
            frame: at("predicted"),
            warn: predicted > 0,
            ..Tile::default()
        },
        Tile {
            title: "Searched",
            value: searched.to_string(),
            about: if searched > 0 { "frames after a search for limbs" } else { "no limb was searched" }.to_owned(),
            frame: at("searched"),
            ..Tile::default()
        },
        Tile {
            title: "Parts lost",
            value: report.lost.len().to_string(),
            about: if names.is_empty() { "no part of the body was lost".to_owned() } else { names.join(", ") },
            frame: at("lost"),
            warn: !names.is_empty(),
            ..Tile::default()
        },
        Tile {
            title: "Distance from the body",
            value: known(report.residual_cm, format!("{:.2}", report.residual_cm)),
            unit: "cm",
            about: far.map_or(String::new(), |(at, worst)| format!("mean; {worst:.2} in frame {}", number(at))),
            frame: far.map(|(at, _)| at),
            ..Tile::default()
        },
        Tile {
            title: "Points of the body",
            value: known(report.inliers, format!("{:.0}", 100.0 * report.inliers)),
            unit: "%",
            about: few.map_or(String::new(), |(at, least)| format!("mean; {:.0} in frame {}", 100.0 * least, number(at))),
            frame: few.map(|(at, _)| at),
            ..Tile::default()
        },
    ];
    let facts = vec![
        format!("{} with {} degrees of freedom", count(report.joints, "joint"), report.freedom),
        format!("{} at {} Hz", count(frames.len(), "frame"), short(report.rate_hz)),
        format!("{:.1} s", frames.len() as f64 / report.rate_hz),
        format!("followed by {}", report.method),
    ];
    Followed {
        files: files(rig),
        facts,
        tiles,
        events: happened,
        uneventful: "Every frame has a cloud, and no part of the body was lost.",
        curves,
        by_part: None,
        legend: ["followed", "lost or predicted", "measured points"],
    }
}
