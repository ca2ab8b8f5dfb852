//! The file itself: one document that asks nobody for anything.
//!
//! All that comes from the take is deflated and in base 64, so that no label can end a script or begin one;
//! the browser puts it on the page as text. Only the file's name stands in the document, escaped.

use super::Page;
use super::pack::{base64, pack};
use serde::Serialize;
use sha2::{Digest, Sha256};

const SHELL: &str = include_str!("web/page.html");

const STYLES: &str = concat!(
    include_str!("vendor/uplot.min.css"),
    "\n",
    include_str!("web/style.css"),
    include_str!("web/head.css"),
    include_str!("web/parts.css"),
    include_str!("web/plots.css")
);

/// The libraries, then our own files, which share one scope.
const SCRIPTS: [&str; 3] = [
    include_str!("vendor/uplot.min.js"),
    include_str!("vendor/ogl.min.js"),
    concat!(
        "(() => {\n\"use strict\";\n",
        include_str!("web/unpack.js"),
        include_str!("web/data.js"),
        include_str!("web/words.js"),
        include_str!("web/state.js"),
        include_str!("web/themes.js"),
        include_str!("web/charts.js"),
        include_str!("web/head.js"),
        include_str!("web/camera.js"),
        include_str!("web/figure.js"),
        include_str!("web/webgl.js"),
        include_str!("web/flat.js"),
        include_str!("web/player.js"),
        include_str!("web/map.js"),
        include_str!("web/gaps.js"),
        include_str!("web/tracks.js"),
        include_str!("web/bones.js"),
        include_str!("web/em.js"),
        include_str!("web/followed.js"),
        include_str!("web/parts.js"),
        include_str!("web/origin.js"),
        include_str!("web/main.js"),
        "})();\n"
    ),
];

/// What the page is built with, besides what the browser brings.
const LIBRARIES: [Library; 2] = [
    Library {
        name: "uPlot",
        version: "1.6.32",
        licence: "MIT",
        what: "charts",
        home: "github.com/leeoniya/uPlot",
        text: include_str!("vendor/uplot.LICENSE"),
    },
    Library {
        name: "OGL",
        version: "1.0.11",
        licence: "Unlicense",
        what: "the 3-D view",
        home: "github.com/oframe/ogl",
        text: include_str!("vendor/ogl.LICENSE"),
    },
];

#[derive(Serialize)]
struct Library {
    name: &'static str,
    version: &'static str,
    licence: &'static str,
    what: &'static str,
    home: &'static str,
    text: &'static str,
}

/// The document.
pub(super) fn write(page: &Page) -> String {
    #[derive(Serialize)]
    struct Model<'a> {
        #[serde(flatten)]
        page: &'a Page,
        streams: Vec<super::pack::Stream>,
        libraries: &'static [Library],
        position_step_mm: f64,
        sigma_step_mm: f64,
        cloud_step_mm: f64,
    }
    let packed = page.positions.pack();
    let model = Model {
        page,
        streams: packed.streams,
        libraries: &LIBRARIES,
        position_step_mm: super::positions::STEP_MM,
        sigma_step_mm: super::positions::SIGMA_STEP_MM,
        cloud_step_mm: super::of_body::CLOUD_STEP_MM,
    };
    // plain structs of numbers and strings always serialise
    let model = pack(serde_json::to_string(&model).unwrap_or_default().as_bytes());
    document(SHELL, STYLES, &SCRIPTS, &[("title", &escaped(&page.source_name)), ("model", &model), ("positions", &packed.base64)])
}

/// A document of its shell, with the policy that allows these scripts and styles and nothing else. In the shell `{{name}}` is a place,
/// for what stands in `places`, or for `styles`, `scripts` and `policy`.
pub(crate) fn document(shell: &str, styles: &str, scripts: &[&str], places: &[(&str, &str)]) -> String {
    let elements: String = scripts.iter().map(|script| ["<script>", script, "</script>\n"].concat()).collect();
    let policy = format!(
        "default-src 'none'; script-src {}; style-src {}; img-src data:; base-uri 'none'; form-action 'none'",
        scripts.iter().map(|script| hash(script)).collect::<Vec<_>>().join(" "),
        hash(styles)
    );
    let places = [&[("policy", policy.as_str()), ("styles", styles), ("scripts", &elements)], places].concat();
    let mut out = String::with_capacity(shell.len() + places.iter().map(|(_, text)| text.len()).sum::<usize>());
    // what is put in is not looked through for further places
    for piece in shell.split("{{") {
        let (place, rest) = piece.split_once("}}").unwrap_or(("", piece));
        out.push_str(places.iter().find(|(name, _)| *name == place).map_or("", |(_, text)| text));
        out.push_str(rest);
    }
    out
}

/// How a policy names an inline script or style.
fn hash(text: &str) -> String {
    format!("'sha256-{}'", base64(&Sha256::digest(text)))
}

/// Text for an element.
pub(crate) fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in formats::printable(text).chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::super::Note;
    use super::*;
    use crate::log::Description;

    #[test]
    fn nothing_of_the_take_is_code() {
        let evil = "</script><img src=x onerror=alert(1)><!--\u{2028}\"'&";
        let mut page = Page { source_name: evil.to_owned(), ..Page::default() };
        let plain = Page { source_name: "a.c3d".to_owned(), ..Page::default() }.write();
        page.take = Description { markers: vec![evil.to_owned()], ..Description::default() };
        page.notes = vec![Note { text: evil.to_owned(), matters: true }];
        let text = page.write();
        for what in ["<script", "</script", "<!--", "<img"] {
            assert_eq!(text.matches(what).count(), plain.matches(what).count(), "{what}");
        }
        assert!(!text.contains(evil) && text.contains("&lt;/script&gt;"));
    }

    #[test]
    fn the_document_asks_nobody() {
        let text = Page::default().write();
        for what in ["src=\"", "href=\"http", "@import", "url(", "fetch(", "XMLHttpRequest", "WebSocket", "sendBeacon", "import(", "{{"] {
            assert!(!text.contains(what), "{what}");
        }
        assert_eq!(text, Page::default().write());
        // what ends a script inside a script would end it early
        assert!(SCRIPTS.iter().all(|script| !script.contains("</script") && !script.contains("<!--")));
        assert!(text.len() < 400_000, "{} bytes without a take", text.len());
    }

    #[test]
    fn libraries_are_those_in_the_tree() {
        let lock = include_str!("vendor/package-lock.json");
        for library in &LIBRARIES {
            let package = format!("\"node_modules/{}\": {{\n      \"version\": \"{}\"", library.name.to_lowercase(), library.version);
            assert!(lock.contains(&package), "{package}");
        }
    }
}
