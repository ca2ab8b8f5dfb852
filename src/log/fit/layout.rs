//! How the log of a motion that was solved for is best looked at.

use super::channels::Channel;
use crate::fit::MarkerReport;
use crate::log::layout::{NAME, cloud, curve, framed, pair, plot, seen_from_the_side, titled};
use crate::log::mcap::{Attachment, Up};
use serde_json::{Value, json};

/// The most curves in one plot: more cannot be told apart. The worst markers have them.
const MOST_CURVES: usize = 16;

/// The attachment. `sides`: where joints were, by axis, m; `markers` in the order of the messages.
pub(super) fn attachment(up: Up, sides: [Vec<f64>; 3], markers: &[MarkerReport]) -> Attachment {
    let bytes = serde_json::to_vec_pretty(&layout(up, sides, markers)).unwrap_or_default(); // a `Value` always becomes text
    Attachment { name: NAME.to_owned(), media_type: "application/json".to_owned(), bytes }
}

fn layout(up: Up, sides: [Vec<f64>; 3], markers: &[MarkerReport]) -> Value {
    let topics = json!({
        Channel::Seen.name(): cloud(8),
        Channel::Expected.name(): cloud(5),
        Channel::Model.name(): cloud(2),
        Channel::Skeleton.name(): { "visible": true },
    });
    let of = |channel: Channel, field: &str| curve(&format!("{}.{field}", channel.name()), field);
    let mut worst: Vec<usize> = (0..markers.len()).filter(|&at| markers[at].rms_cm.is_finite()).collect();
    worst.sort_by(|&a, &b| markers[b].rms_cm.total_cmp(&markers[a].rms_cm));
    let path = |at: usize| format!("{}.markers[{at}].residual_cm", Channel::Frames.name());
    let residuals: Vec<Value> = worst.iter().take(MOST_CURVES).map(|&at| curve(&path(at), &markers[at].label)).collect();
    let panels = [
        ("3D!body", titled("Markers, model and skeleton", seen_from_the_side(up, framed(up, sides), &topics))),
        ("Plot!rounds", titled("Distance of markers from their places after each round, cm", plot(None, &[of(Channel::Rounds, "rms_cm")]))),
        (
            "Plot!frames",
            titled("Distance of markers in each frame, cm", plot(None, &["rms_cm", "worst_cm"].map(|field| of(Channel::Frames, field)))),
        ),
        ("Plot!count", titled("Markers that were seen", plot(None, &[of(Channel::Frames, "marker_count")]))),
        ("Plot!residuals", titled("Distance of the worst markers, cm", plot(None, &residuals))),
        ("RosOut!log", titled("Log", json!({ "topicToRender": Channel::Log.name(), "searchTerms": [], "minLogLevel": 1 }))),
    ];
    let left = pair("column", 75, &json!("3D!body"), &json!("RosOut!log"));
    let frames = pair("column", 50, &json!("Plot!frames"), &json!("Plot!residuals"));
    let rest = pair("column", 50, &json!("Plot!count"), &json!("Plot!rounds"));
    json!({
        "configById": panels.into_iter().map(|(id, panel)| (id.to_owned(), panel)).collect::<serde_json::Map<_, _>>(),
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": { "speed": 1 },
        "layout": pair("row", 50, &left, &pair("column", 60, &frames, &rest)),
    })
}
