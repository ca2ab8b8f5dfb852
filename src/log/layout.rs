//! A layout for Foxglove and Lichtblick: how the log of this take is best looked at.
//!
//! Both viewers read the same JSON. Elements of lists are named by their places, since labels may hold anything, and get their labels as titles.
//! X and y of a curve must belong to different topics, hence the two topics of each iteration.

use super::channels::Channel;
use super::mcap::{About, Attachment};
use super::metadata::Stage;
use super::names::{self, unique};
use super::{FRAME_ID, ROOM_ID, Shown, Up, axes, frames};
use crate::bones;
use formats::Origin;
use serde_json::{Value, json};

/// Name of the attachment.
pub const NAME: &str = "layout.json";

/// The most curves in one plot: more cannot be told apart.
const MOST_CURVES: usize = 16;

/// The most markers whose states are shown.
const MOST_STATES: usize = 40;

/// The attachment.
pub(super) fn attachment(about: &About, shown: &Shown<'_>, stages: &[Stage]) -> Attachment {
    let bytes = serde_json::to_vec_pretty(&layout(about, shown, stages)).unwrap_or_default(); // a `Value` always becomes text
    Attachment { name: NAME.to_owned(), media_type: "application/json".to_owned(), bytes }
}

fn layout(about: &About, shown: &Shown<'_>, stages: &[Stage]) -> Value {
    let worst = worst_bones(shown);
    let iterations = format!("{}.iteration_of_log", Channel::Likelihood.topic());
    let mut panels = vec![
        ("3D!take".to_owned(), space(about, shown)),
        (
            "Plot!residuals".to_owned(),
            titled("Bone residuals in filled frames, mm", plot(Some(&iterations), &of_bones(Channel::BoneResiduals, "value", &worst))),
        ),
        (
            "Plot!lengths".to_owned(),
            titled("Bone lengths minus their means, mm", plot(None, &of_bones(Channel::BoneLengths, "error_mm", &worst))),
        ),
        ("StateTransitions!markers".to_owned(), titled("Markers: observed, filled, missing", states(shown))),
        ("RosOut!log".to_owned(), titled("Log", json!({ "topicToRender": Channel::Log.topic(), "searchTerms": [], "minLogLevel": 1 }))),
        (
            "RawMessages!likelihood".to_owned(),
            titled("Iteration", json!({ "topicPath": Channel::Likelihood.topic(), "diffEnabled": false })),
        ),
    ];
    // likelihoods of different models cannot be compared, and a plot has one x, so each model has a plot of its own
    let likelihoods = likelihoods(stages);
    let side_by_side = likelihoods.iter().rev().fold(Value::Null, |rest, (id, _)| match rest {
        Value::Null => json!(id),
        rest => pair("row", 50, &json!(id), &rest),
    });
    panels.extend(likelihoods);
    let left = pair("column", 62, &json!("3D!take"), &json!("StateTransitions!markers"));
    let below = pair("row", 70, &json!("RosOut!log"), &json!("RawMessages!likelihood"));
    let curves = pair("column", 50, &side_by_side, &json!("Plot!residuals"));
    let right = pair("column", 55, &curves, &pair("column", 55, &json!("Plot!lengths"), &below));
    json!({
        "configById": panels.into_iter().collect::<serde_json::Map<_, _>>(),
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": { "speed": 1 },
        "layout": pair("row", 50, &left, &right),
    })
}

/// Two parts of the window, the first of which takes `percent` of it.
pub(super) fn pair(direction: &str, percent: u32, first: &Value, second: &Value) -> Value {
    json!({ "direction": direction, "splitPercentage": percent, "first": first, "second": second })
}

/// Each viewer looks for a panel's title under a name of its own.
pub(super) fn titled(title: &str, mut config: Value) -> Value {
    config["foxglovePanelTitle"] = json!(title);
    config["lichtblickPanelTitle"] = json!(title);
    config
}

/// Clouds and skeleton of a take.
fn space(about: &About, shown: &Shown<'_>) -> Value {
    let topics =
        json!({ Channel::Raw.topic(): cloud(5), Channel::Repaired.topic(): cloud(7), Channel::Skeleton.topic(): { "visible": true } });
    titled("Take", seen_from_the_side(about.up, extent(about, shown), &topics))
}

/// How a cloud is drawn. Where no field is named, viewers choose a field and a mode of their own.
pub(super) fn cloud(size: u32) -> Value {
    json!({ "visible": true, "colorMode": "rgba-fields", "colorField": "red", "pointShape": "circle", "pointSize": size })
}

/// A view of these topics from the side, with everything in view. `extent`: centre and largest size, in metres.
pub(super) fn seen_from_the_side(up: Up, (centre, size): ([f64; 3], f64), topics: &Value) -> Value {
    let frame = if axes::transform(up).is_some() { ROOM_ID } else { FRAME_ID };
    json!({
        "cameraState": {
            "perspective": true, "distance": (size * 1.6).max(2.0), "phi": 70, "thetaOffset": 45, "targetOffset": centre,
            "target": [0, 0, 0], "targetOrientation": [0, 0, 0, 1], "fovy": 45, "near": 0.01, "far": 5000
        },
        "followMode": "follow-none",
        "followTf": frame,
        "scene": { "transforms": { "visible": false, "labelSize": 0 } },
        "topics": topics,
        "layers": { "grid": {
            "layerId": "foxglove.Grid", "instanceId": "grid", "label": "Floor", "visible": true, "order": 1, "size": 10, "divisions": 20,
            "lineWidth": 1, "color": "#80808080", "position": [0, 0, 0], "rotation": [0, 0, 0],
            "frameId": frame
        } },
    })
}

/// Centre of the take in the room and its largest size, in metres.
fn extent(about: &About, shown: &Shown<'_>) -> ([f64; 3], f64) {
    let take = shown.repaired.unwrap_or(shown.raw);
    let stride = take.frames().div_ceil(300).max(1);
    let columns = frames::columns(take);
    let mut sides: [Vec<f64>; 3] = Default::default();
    for frame in (0..take.frames()).step_by(stride) {
        for &column in &columns {
            for (side, x) in sides.iter_mut().zip(take.position_mm(frame, column).into_iter().flatten()) {
                side.push(x * 1e-3);
            }
        }
    }
    framed(about.up, sides)
}

/// Centre of places in the room and their largest size, from the coordinates of each axis in metres.
pub(super) fn framed(up: Up, mut sides: [Vec<f64>; 3]) -> ([f64; 3], f64) {
    // a ghost in a corner of the room must not push the body out of the picture
    let (mut centre, mut size) = ([0.0; 3], 0.0f64);
    for (middle, side) in centre.iter_mut().zip(&mut sides) {
        side.sort_by(f64::total_cmp);
        let at = |share: f64| side.get((share * side.len().saturating_sub(1) as f64) as usize).copied().unwrap_or(0.0);
        *middle = f64::midpoint(at(0.02), at(0.98));
        size = size.max(at(0.98) - at(0.02));
    }
    let room = match up.direction() {
        Some(up) => axes::in_room(up, centre),
        None => centre,
    };
    (room.map(|x| (x * 1000.0).round() / 1000.0), (size * 1000.0).round() / 1000.0)
}

pub(super) fn plot(x_path: Option<&str>, curves: &[Value]) -> Value {
    let mut config = json!({
        "paths": curves, "showLegend": curves.len() > 1, "legendDisplay": "left", "showPlotValuesInLegend": false, "showXAxisLabels": true,
        "showYAxisLabels": true, "isSynced": x_path.is_none(), "xAxisVal": if x_path.is_some() { "custom" } else { "timestamp" },
        "sidebarDimension": 150
    });
    if let Some(path) = x_path {
        config["xAxisPath"] = json!({ "value": path, "enabled": true });
    }
    config
}

pub(super) fn curve(path: &str, label: &str) -> Value {
    json!({ "value": path, "enabled": true, "timestampMethod": "receiveTime", "label": label })
}

/// One plot for each model with a likelihood; one that stays empty if there is none.
fn likelihoods(stages: &[Stage]) -> Vec<(String, Value)> {
    let (y, x) = (Channel::Likelihood.topic(), Channel::BoneResiduals.topic());
    let with: Vec<&Stage> = stages.iter().filter(|stage| stage.likelihood).collect();
    let alone = with.len() < 2;
    let panel = |number: usize, title: &str, filter: &str, label: &str| {
        let curve = curve(&format!("{y}{filter}.log_likelihood"), label);
        (format!("Plot!likelihood{number}"), titled(title, plot(Some(&format!("{x}{filter}.iteration")), &[curve])))
    };
    if with.is_empty() {
        return vec![panel(0, "Log-likelihood: the method has none", "", "no likelihood")];
    }
    with.iter()
        .enumerate()
        .map(|(at, stage)| {
            let filter = if alone { String::new() } else { format!("{{stage=={}}}", stage.number) };
            panel(at, &format!("Log-likelihood of {}, each iteration", stage.method), &filter, stage.method)
        })
        .collect()
}

/// One curve of `field` on `channel` for each of these bones.
fn of_bones(channel: Channel, field: &str, bones: &[(usize, String)]) -> Vec<Value> {
    bones.iter().map(|(bone, label)| curve(&format!("{}.bones[{bone}].{field}", channel.topic()), label)).collect()
}

/// The bones that are farthest from their lengths in filled frames, worst first; if nothing was filled, those that vary most. With their labels.
fn worst_bones(shown: &Shown<'_>) -> Vec<(usize, String)> {
    let take = shown.repaired.unwrap_or(shown.raw);
    let mut order: Vec<(f64, usize)> = shown
        .bones
        .iter()
        .enumerate()
        .map(|(at, bone)| {
            let off = (0..take.frames())
                .filter(|&frame| bones::is_filled(take, bone, frame))
                .filter_map(|frame| Some((bones::length_mm(take, bone, frame)? - bone.length_mm).abs()))
                .fold(-1.0, f64::max);
            // below all that were filled
            (if off < 0.0 { bone.spread_mm - 1e9 } else { off }, at)
        })
        .collect();
    order.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    order.truncate(MOST_CURVES);
    let labels = names::bones(shown.raw, shown.bones);
    order.into_iter().map(|(_, at)| (at, labels[at].clone())).collect()
}

/// The markers that were filled or are missing, most frames first; a take without gaps shows its first markers.
fn states(shown: &Shown<'_>) -> Value {
    let take = shown.repaired.unwrap_or(shown.raw);
    let columns = frames::columns(take);
    let labels = unique(columns.iter().map(|&column| take.display_label(column)));
    let touched =
        |column: usize| (0..take.frames()).filter(|&f| matches!(take.origin(f, column), Origin::Repaired | Origin::Missing)).count();
    let mut order: Vec<(usize, usize)> = columns.iter().enumerate().map(|(place, &column)| (touched(column), place)).collect();
    if order.iter().any(|(frames, _)| *frames > 0) {
        order.retain(|(frames, _)| *frames > 0);
    }
    order.sort_by_key(|&(frames, place)| (std::cmp::Reverse(frames), place));
    order.truncate(MOST_STATES);
    let paths: Vec<Value> = order
        .into_iter()
        .map(|(_, place)| curve(&format!("{}.markers[{place}].value", Channel::MarkerState.topic()), &labels[place]))
        .collect();
    json!({ "paths": paths, "isSynced": true })
}
