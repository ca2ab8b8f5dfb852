//! The document: as the report of a take is made, see `src/page/html.rs`.

use super::About;
use super::markers::{Markers, MarkersModel};
use super::takes::{Takes, TakesModel};
use crate::page::html::{document, escaped};
use crate::page::pack::{Packer, Stream, pack};
use serde::Serialize;

const SHELL: &str = include_str!("web/fleet.html");

const STYLES: &str = concat!(
    include_str!("../../page/web/style.css"),
    include_str!("../../page/web/head.css"),
    include_str!("web/fleet.css"),
    include_str!("web/table.css")
);

/// All of them share one scope.
const SCRIPT: &str = concat!(
    "(() => {\n\"use strict\";\n",
    include_str!("../../page/web/unpack.js"),
    include_str!("../../page/web/words.js"),
    include_str!("../../page/web/state.js"),
    include_str!("../../page/web/themes.js"),
    include_str!("web/data.js"),
    include_str!("web/say.js"),
    include_str!("web/head.js"),
    include_str!("web/look.js"),
    include_str!("web/columns.js"),
    include_str!("web/filter.js"),
    include_str!("web/table.js"),
    include_str!("web/details.js"),
    include_str!("web/histograms.js"),
    include_str!("web/scatter.js"),
    include_str!("web/markers.js"),
    include_str!("web/heat.js"),
    include_str!("web/origin.js"),
    include_str!("web/main.js"),
    "})();\n"
);

/// The document. `base` is the link to the output folder.
pub(super) fn page(about: &About, base: Option<&str>, takes: Takes, markers: Markers) -> String {
    #[derive(Serialize)]
    struct Model<'a> {
        about: &'a About,
        base: Option<&'a str>,
        takes: TakesModel,
        markers: MarkersModel,
        streams: Vec<Stream>,
    }
    let mut packer = Packer::default();
    let (takes, markers) = (takes.pack(&mut packer), markers.pack(&mut packer));
    let packed = packer.finish();
    let model = Model { about, base, takes, markers, streams: packed.streams };
    // plain structs of numbers and strings always serialise
    let model = pack(serde_json::to_string(&model).unwrap_or_default().as_bytes());
    document(SHELL, STYLES, &[SCRIPT], &[("title", &escaped(&about.name)), ("model", &model), ("numbers", &packed.base64)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_document_asks_nobody() {
        let text = page(&About::default(), None, Takes::default(), Markers::default());
        for what in ["src=\"", "href=\"http", "@import", "url(", "fetch(", "XMLHttpRequest", "WebSocket", "sendBeacon", "import(", "{{"] {
            assert!(!text.contains(what), "{what}");
        }
        // what ends a script inside a script would end it early
        assert!(!SCRIPT.contains("</script") && !SCRIPT.contains("<!--"));
        assert!(text.len() < 200_000, "{} bytes without a take", text.len());
    }
}
