//! Tables that are not ours, told apart so that they are refused by name instead of misread.

use super::NAME;
use crate::text::scan::first_lines;
use crate::{FormatError, Place};

/// A table that we do not read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Foreign {
    /// What it seems to be.
    seems: &'static str,
    /// The way out.
    instead: &'static str,
    /// True if it is read under another name.
    elsewhere: bool,
}

impl Foreign {
    /// The error that refuses the file.
    pub fn refuse(self) -> FormatError {
        let but = if self.elsewhere { "which is another format" } else { "which is not read" };
        FormatError::unsupported(NAME, Place::Whole, format!("this seems to be {}, {but}; {}", self.seems, self.instead))
    }
}

/// Names the flavour of a table that is none of ours, from its beginning.
pub(super) fn recognise(bytes: &[u8]) -> Option<Foreign> {
    let foreign = |seems, instead| Some(Foreign { seems, instead, elsewhere: false });

    if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") {
        return foreign("text in UTF-16", "save it as UTF-8 (\"CSV UTF-8\" in Excel)");
    }
    let lines = first_lines(bytes, 1);
    let elsewhere = |seems, instead| Some(Foreign { seems, instead, elsewhere: true });
    match lines.first().and_then(|cells| cells.first()).map_or("", String::as_str) {
        "PathFileType" => return elsewhere("an OpenSim TRC file", "name it .trc"),
        "NO_OF_FRAMES" | "FILE_VERSION" => return elsewhere("a TSV export of Qualisys Track Manager", "name it .tsv"),
        "HIERARCHY" => return foreign("a BVH file", "name it .bvh"),
        _ => {}
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flavours_by_name() {
        for (text, expected) in [
            ("PathFileType\t4\t(X/Y/Z)\tx.trc\n", Some("TRC")),
            ("NO_OF_FRAMES\t3\nNO_OF_CAMERAS\t8\n", Some("Qualisys")),
            ("A-x,A-y,A-z\n1,2,3\n", None),
            ("frame,marker,x,y,z\n1,X,3,4,5\n", None),
            ("", None),
        ] {
            let found = recognise(text.as_bytes()).map(|f| f.refuse().to_string());
            assert_eq!(found.is_some(), expected.is_some(), "{text}");
            assert!(found.unwrap_or_default().contains(expected.unwrap_or_default()), "{text}");
        }
        assert!(recognise(b"\xff\xfea\0").is_some());
    }
}
