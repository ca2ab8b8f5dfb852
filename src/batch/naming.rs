//! Names of outputs: those of the inputs, unless two of them would be one on some file system.
//!
//! `Walk.c3d` and `walk.c3d` are two files on one machine and one on another, and so are an `ü` of one character and one of two.
//! The second of such takes gets a name of its own, made from its path, so that it does not depend on who runs it.

use crate::input::hex;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;

use super::sidecar;

/// What may be written beside an output: added to its name.
pub const BESIDE: [&str; 4] = ["mcap", "html", "fills.csv", sidecar::EXTENSION];

/// The longest name of a file that is kept, in bytes: file systems allow 255, and longer ones are made from it.
const LONGEST_NAME: usize = 200;

/// The name of something that is written beside an output.
pub fn beside(output: &str, extension: &str) -> String {
    format!("{output}.{extension}")
}

/// The names that were given away.
#[derive(Debug, Default)]
pub struct Names {
    /// By how file systems that do not tell cases apart see them: whose it is.
    taken: BTreeMap<String, String>,
}

impl Names {
    /// The name for the output of the take `path`: the same, or one of its own if that is taken or too long.
    /// The same path gets the same name again.
    pub fn claim(&mut self, path: &str) -> String {
        let mut name = shortened(path);
        let mut round = 0;
        while !self.is_free(&name, path) {
            name = marked(path, round);
            round += 1;
        }
        self.reserve(&name, path);
        name
    }

    /// Gives the name `output` to the take `path`, as it was before.
    pub fn reserve(&mut self, output: &str, path: &str) {
        for name in all(output) {
            self.taken.insert(name, path.to_owned());
        }
    }

    fn is_free(&self, output: &str, path: &str) -> bool {
        all(output).all(|name| self.taken.get(&name).is_none_or(|owner| owner == path))
    }
}

/// An output and all that may be written beside it, as file systems see them that do not tell cases apart.
fn all(output: &str) -> impl Iterator<Item = String> {
    std::iter::once(folded(output)).chain(BESIDE.into_iter().map(|extension| folded(&beside(output, extension))))
}

/// What names have in common that some file system takes for one: letters in lower case, accents behind their letters,
/// and no dots or blanks at the end of a name.
fn folded(name: &str) -> String {
    use unicode_normalization::UnicodeNormalization;
    let lower: String = name.nfd().collect::<String>().to_lowercase().nfd().collect();
    lower.split('/').map(|part| part.trim_end_matches(['.', ' '])).collect::<Vec<_>>().join("/")
}

/// Folder with `/`, stem, and everything from the first dot of the last two (`.c3d`, `.c3d.zst`).
fn parts(path: &str) -> (&str, &str, &str) {
    let (folder, name) = path.rsplit_once('/').map_or(("", path), |(folder, name)| (&path[..=folder.len()], name));
    let end = name.to_ascii_lowercase().strip_suffix(".zst").map_or(name.len(), str::len);
    let dot = name.get(..end).and_then(|inner| inner.rfind('.')).filter(|dot| *dot > 0).unwrap_or(end);
    (folder, &name[..dot], &name[dot..])
}

/// The path, if its name is short enough to write others beside it.
fn shortened(path: &str) -> String {
    let (_, stem, extension) = parts(path);
    if stem.len() + extension.len() <= LONGEST_NAME { path.to_owned() } else { marked(path, 0) }
}

/// A name that only this path has: `A/walk~1f2e3d4c.c3d`.
fn marked(path: &str, round: usize) -> String {
    let (folder, stem, extension) = parts(path);
    let digest = hex(&Sha256::digest(path));
    let mark = digest.get(..8 + 4 * round).unwrap_or(&digest);
    let room = LONGEST_NAME.saturating_sub(extension.len() + mark.len() + 1);
    let mut end = stem.len().min(room);
    while !stem.is_char_boundary(end) {
        end -= 1;
    }
    format!("{folder}{}~{mark}{extension}", &stem[..end])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_kept_unless_they_collide() {
        let mut names = Names::default();
        assert_eq!(names.claim("A/walk.c3d"), "A/walk.c3d");
        assert_eq!(names.claim("A/walk.c3d"), "A/walk.c3d", "the same take");
        assert_eq!(names.claim("B/walk.c3d"), "B/walk.c3d");
        assert_eq!(names.claim("A/walk.csv"), "A/walk.csv", "another format");
        let other = names.claim("A/Walk.c3d");
        assert!(other.starts_with("A/Walk~") && other.len() == "A/Walk~12345678.c3d".len(), "{other}");
        assert!(names.claim("a/walk.C3D").starts_with("a/walk~"), "folders count");
        assert!(names.claim("A/walk.c3d.fills.csv").contains('~'), "what may be written beside another");
    }

    #[test]
    fn accents_and_ends_collide() {
        let mut names = Names::default();
        assert_eq!(names.claim("m\u{fc}ller.c3d"), "m\u{fc}ller.c3d");
        assert!(names.claim("mu\u{308}ller.c3d").contains('~'));
        assert!(names.claim("M\u{dc}LLER.c3d").contains('~'));
        assert_eq!(names.claim("d/x.c3d"), "d/x.c3d");
        assert!(names.claim("d./x.c3d").contains('~'));
    }

    #[test]
    fn long_names_are_cut_between_characters() {
        let mut names = Names::default();
        let long = format!("A/{}.c3d.zst", "ü".repeat(120));
        let name = names.claim(&long);
        assert!(name.len() <= LONGEST_NAME + 2 && name.ends_with(".c3d.zst") && name.starts_with("A/üü"), "{name}");
        assert_eq!(names.claim(&long), name);
    }

    #[test]
    fn a_name_does_not_depend_on_what_came_between() {
        let (mut one, mut other) = (Names::default(), Names::default());
        one.claim("x.c3d");
        let first = one.claim("X.c3d");
        other.claim("x.c3d");
        other.claim("y.c3d");
        assert_eq!(other.claim("X.c3d"), first);
    }

    #[test]
    fn paths_have_parts() {
        assert_eq!(parts("A/b.c/walk.c3d.zst"), ("A/b.c/", "walk", ".c3d.zst"));
        assert_eq!(parts("walk"), ("", "walk", ""));
        assert_eq!(parts(".c3d"), ("", ".c3d", ""));
        assert_eq!(parts("a.b.c3d"), ("", "a.b", ".c3d"));
    }
}
