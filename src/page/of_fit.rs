//! The page of a motion that was solved for from markers.

use super::of_body::{Figure, Followed, Series, Tile, events, files, notes, runs_of};
use super::{Note, Page};
use crate::fit::{Fitted, Report};
use crate::log::FitAbout;
use crate::report::{count, short};
use crate::rig::Rig;
use crate::solve::ik::Posed;

/// The most names in a tile or a note.
const MOST_NAMES: usize = 6;

impl Page {
    /// The page of a motion. `about` is what its log would know.
    pub fn of_fit(rig: &Rig, report: &Report, fitted: &Fitted<'_>, about: FitAbout) -> Self {
        let mut page = Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            source_name: about.source_name,
            source_sha256: about.source_sha256,
            options: about.options.into_iter().collect(),
            notes: said(report),
            ..Self::default()
        };
        let frames = fitted.frames();
        let numbers = (fitted.take.first_frame, fitted.take.frame_step);
        // for each joint, in which frames nothing tells of it
        let mut unseen = vec![vec![false; frames]; rig.body.tree.joints()];
        for (name, unseen) in rig.names().zip(&mut unseen) {
            let alone = report.unseen.iter().filter(|one| one.joint == name).flat_map(|one| runs_of(&one.when, numbers));
            for (start, end) in alone.chain(runs_of(&report.predicted, numbers)) {
                unseen[start..end.min(frames)].fill(true);
            }
            if report.unobserved.iter().any(|joint| joint == name) {
                unseen.fill(true);
            }
        }
        let mut figure = Figure::new(rig, frames);
        let mut posed = Posed::new(&rig.body.tree);
        for (frame, pose) in fitted.solution.poses.iter().enumerate() {
            posed.set(&rig.body.tree, pose);
            let points: Vec<_> = fitted.seen.frame(frame).map(|(_, x, _)| *x).collect();
            figure.push(&posed.centres, &posed.parts, |joint| unseen[joint][frame], points.into_iter());
        }
        figure.show(&mut page, rig, report.rate_hz, numbers);
        page.followed = Some(followed(rig, report, fitted, numbers));
        page
    }
}

/// Some names.
fn listed(names: &[String]) -> String {
    let more = names.len().saturating_sub(MOST_NAMES);
    let shown = names[..names.len() - more].join(", ");
    if more > 0 { format!("{shown} and {more} more") } else { shown }
}

/// What the report says besides its numbers.
fn said(report: &Report) -> Vec<Note> {
    let mut all = notes(&report.notes);
    let mut say = |text: String, matters: bool| all.push(Note { text, matters });
    if !report.absent.is_empty() {
        say(format!("markers of the map that the take does not have: {}", listed(&report.absent)), true);
    }
    let strange: Vec<String> = report.strange().into_iter().map(|marker| marker.label.clone()).collect();
    if !strange.is_empty() {
        say(format!("far from where the map has them: {}: labels swapped, or another vertex?", listed(&strange)), true);
    }
    if !report.unobserved.is_empty() {
        say(format!("no marker tells how these joints turn: {}", listed(&report.unobserved)), true);
    }
    if let Some(error) = &report.log_error {
        say(format!("there is no log: {error}"), true);
    }
    if !report.unused.is_empty() {
        say(format!("markers that are not used: {}", listed(&report.unused)), false);
    }
    if let Some((from, to)) = report.turned {
        say(format!("the take has {from} up and the body has {to} up, so the take was turned"), false);
    }
    all
}

fn followed(rig: &Rig, report: &Report, fitted: &Fitted<'_>, numbers: (i64, i64)) -> Followed {
    let mut happened: Vec<_> = events("predicted", None, "no marker", runs_of(&report.predicted, numbers)).collect();
    for unseen in &report.unseen {
        let joint = rig.names().position(|joint| joint == unseen.joint);
        happened.extend(events("unseen", joint, &unseen.joint, runs_of(&unseen.when, numbers)));
    }
    happened.sort();
    let frames = fitted.frames();
    let over = |value: fn(&Fitted<'_>, usize) -> f64| (0..frames).map(move |frame| value(fitted, frame));
    let curves = vec![
        Series::new("Distance of markers from their places, cm (root mean square)", 4, over(|fitted, frame| fitted.summed(frame).1)),
        Series::new("The largest of them, cm", 4, over(|fitted, frame| fitted.summed(frame).2.map_or(f64::NAN, |(_, worst)| worst))),
        Series::new("Markers that were seen and count", 0, over(|fitted, frame| fitted.summed(frame).0 as f64)),
    ];
    let predicted: usize = report.predicted.iter().map(|stretch| stretch.frames).sum();
    let at = |kind: &str| happened.iter().find(|event| event.kind == kind).map(|event| event.start);
    let known = |x: Option<f64>| x.filter(|x| x.is_finite()).map_or("–".to_owned(), |x| format!("{x:.2}"));
    let far = curves[1].largest();
    let joints: Vec<String> = report.unseen.iter().map(|unseen| unseen.joint.clone()).collect();
    let tiles = vec![
        Tile {
            title: "Markers used",
            value: report.used().to_string(),
            about: format!("of {}", report.used() + report.unused.len()),
            ..Tile::default()
        },
        Tile {
            title: "Distance from places",
            value: known(Some(report.rms_cm)),
            unit: "cm",
            about: report.worst().map_or(String::new(), |worst| format!("root mean square; {} {:.2}", worst.label, worst.rms_cm)),
            ..Tile::default()
        },
        Tile {
            title: "Worst distance",
            value: known(far.map(|(_, worst)| worst)),
            unit: "cm",
            about: far.and_then(|(frame, _)| Some((frame, fitted.summed(frame).2?.0))).map_or(String::new(), |(frame, marker)| {
                format!("{}, frame {}", fitted.worn.markers[marker].1, fitted.take.frame_label(frame))
            }),
            frame: far.map(|(frame, _)| frame),
            ..Tile::default()
        },
        Tile {
            title: "Predicted",
            value: predicted.to_string(),
            about: if predicted > 0 { "frames without any marker" } else { "every frame has markers" }.to_owned(),
            frame: at("predicted"),
            warn: predicted > 0,
            ..Tile::default()
        },
        Tile {
            title: "Joints unseen for a while",
            value: joints.len().to_string(),
            about: listed(&joints),
            frame: at("unseen"),
            ..Tile::default()
        },
        Tile {
            title: "Joints never seen",
            value: report.unobserved.len().to_string(),
            about: listed(&report.unobserved),
            warn: !report.unobserved.is_empty(),
            ..Tile::default()
        },
    ];
    Followed {
        files: files(rig),
        facts: vec![
            count(report.used(), "marker"),
            format!("{} with {} degrees of freedom", count(report.joints, "joint"), report.freedom),
            format!("{} at {} Hz", count(frames, "frame"), short(report.rate_hz)),
            format!("{:.1} s", frames as f64 / report.rate_hz),
        ],
        tiles,
        events: happened,
        uneventful: "Every frame has markers, and every joint that has markers was seen in all of them.",
        curves,
        by_part: None,
        legend: ["seen", "not seen", "markers"],
    }
}
