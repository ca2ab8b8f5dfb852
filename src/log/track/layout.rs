//! How the log of a tracked sequence is best looked at.

use super::channels::Channel;
use crate::log::layout::{NAME, cloud, curve, framed, pair, plot, seen_from_the_side, titled};
use crate::log::mcap::{Attachment, Up};
use serde_json::{Value, json};

/// The most curves in one plot: more cannot be told apart.
const MOST_CURVES: usize = 16;

/// The attachment. `sides`: where joints were, by axis, m; `parts`: those with a surface, in the order of the messages.
pub(super) fn attachment(up: Up, sides: [Vec<f64>; 3], parts: &[usize], names: &[&str]) -> Attachment {
    let bytes = serde_json::to_vec_pretty(&layout(up, sides, parts, names)).unwrap_or_default(); // a `Value` always becomes text
    Attachment { name: NAME.to_owned(), media_type: "application/json".to_owned(), bytes }
}

fn layout(up: Up, sides: [Vec<f64>; 3], parts: &[usize], names: &[&str]) -> Value {
    let topics = json!({
        Channel::Cloud.name(): cloud(4),
        Channel::Model.name(): cloud(3),
        Channel::Skeleton.name(): { "visible": true },
    });
    // within a frame all of them go up or down, so where they end has a curve of its own
    let of_rounds = |field: &str| {
        let path = |channel: Channel| format!("{}.{field}", channel.name());
        plot(None, &[curve(&path(Channel::Rounds), "rounds"), curve(&path(Channel::Frames), "last round")])
    };
    let of_parts = |field: &str, most: usize| -> Vec<Value> {
        let path = |at: usize| format!("{}.parts[{at}].{field}", Channel::Frames.name());
        parts.iter().take(most).enumerate().map(|(at, &part)| curve(&path(at), names[part])).collect()
    };
    let panels = [
        ("3D!body", titled("Cloud, model and skeleton", seen_from_the_side(up, framed(up, sides), &topics))),
        ("StateTransitions!lost", titled("Parts that are lost", json!({ "paths": of_parts("lost", usize::MAX), "isSynced": true }))),
        ("Plot!likelihood", titled("Log-likelihood of each round", of_rounds("log_likelihood"))),
        ("Plot!sigma", titled("Standard deviation of each round, cm", of_rounds("sigma_cm"))),
        ("Plot!inliers", titled("Share of points that belong to the body, each round", of_rounds("inliers"))),
        ("Plot!coverage", titled("Covered share of each part", plot(None, &of_parts("coverage", MOST_CURVES)))),
        ("Plot!residuals", titled("Distance of points from each part, cm", plot(None, &of_parts("residual_cm", MOST_CURVES)))),
        ("RosOut!log", titled("Log", json!({ "topicToRender": Channel::Log.name(), "searchTerms": [], "minLogLevel": 1 }))),
    ];
    let left = pair("column", 70, &json!("3D!body"), &pair("row", 60, &json!("StateTransitions!lost"), &json!("RosOut!log")));
    let rounds = pair("column", 50, &json!("Plot!likelihood"), &pair("row", 50, &json!("Plot!sigma"), &json!("Plot!inliers")));
    let frames = pair("column", 50, &json!("Plot!coverage"), &json!("Plot!residuals"));
    json!({
        "configById": panels.into_iter().map(|(id, panel)| (id.to_owned(), panel)).collect::<serde_json::Map<_, _>>(),
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": { "speed": 1 },
        "layout": pair("row", 50, &left, &pair("column", 50, &rounds, &frames)),
    })
}
