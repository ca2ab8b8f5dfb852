//! Links from a page to files elsewhere on the same disk.

use std::path::{Component, Path};

/// The link from the folder `from` to the folder `to`, with a `/` at its end; nothing at all if they are the same.
/// `None` if one of them is not there, or if no way leads from one to the other.
pub(super) fn between(from: &Path, to: &Path) -> Option<String> {
    let (from, to) = (from.canonicalize().ok()?, to.canonicalize().ok()?);
    let (from, to): (Vec<Component>, Vec<Component>) = (from.components().collect(), to.components().collect());
    let shared = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    // on Windows another drive is another beginning
    if shared == 0 {
        return None;
    }
    let mut link = "../".repeat(from.len() - shared);
    for folder in &to[shared..] {
        link.push_str(&encoded(&folder.as_os_str().to_string_lossy()));
        link.push('/');
    }
    Some(link)
}

/// A name within a link: everything but letters, digits and `-._~` as `%` and its bytes (RFC 3986, section 2).
pub(super) fn encoded(name: &str) -> String {
    let mut out = String::with_capacity(name.len());
    for byte in name.bytes() {
        if byte.is_ascii_alphanumeric() || b"-._~".contains(&byte) {
            out.push(char::from(byte));
        } else {
            let _ = std::fmt::Write::write_fmt(&mut out, format_args!("%{byte:02X}")); // a String takes everything
        }
    }
    out
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn names_that_mean_something_in_links() {
        for (name, link) in [
            ("walk.c3d", "walk.c3d"),
            ("a b", "a%20b"),
            ("50%", "50%25"),
            ("#1?x=y&z", "%231%3Fx%3Dy%26z"),
            ("Übung", "%C3%9Cbung"),
            ("javascript:alert(1)", "javascript%3Aalert%281%29"),
            ("\"'<>\\", "%22%27%3C%3E%5C"),
        ] {
            assert_eq!(encoded(name), link);
        }
    }

    #[test]
    fn the_way_from_the_page_to_the_takes() {
        let root = tempfile::tempdir().unwrap();
        let folder = |name: &str| {
            let path = root.path().join(name);
            std::fs::create_dir_all(&path).unwrap();
            path
        };
        let (out, deep, beside) = (folder("out #1"), folder("out #1/reports/x"), folder("other"));
        assert_eq!(between(&out, &out), Some(String::new()));
        assert_eq!(between(&deep, &out).as_deref(), Some("../../"));
        assert_eq!(between(&beside, &out).as_deref(), Some("../out%20%231/"));
        assert_eq!(between(root.path(), &out).as_deref(), Some("out%20%231/"));
        assert_eq!(between(&out, &root.path().join("nowhere")), None);
    }
}
