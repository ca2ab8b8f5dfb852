//! What skeletons and limits have in common: a word at the beginning, a count, records of a name and numbers. And names that can be written.

use super::Skeleton;
use super::words::{Word, Words};
use crate::note::listed;
use crate::text::fresh::{Spelling, spelled};
use crate::text::scan::letters;
use crate::{FormatError, Note, Notes};
use std::collections::BTreeMap;

/// The longest name, in bytes.
const LONGEST_NAME: usize = 1000;

/// Names as all files of a rig can hold them.
pub(super) const NAMES: Spelling = Spelling {
    odd: |c| c.is_whitespace() || c.is_control() || c == '#',
    odd_are: "blanks, control characters or #",
    trimmed: false,
    empty: Some("joint_"),
    longest: 200, // more than anybody gives
    unique: true,
};

/// The word that stands for no parent.
pub(super) const NOBODY: &str = "NULL";

/// Joints by their names.
pub(super) type Names = BTreeMap<String, usize>;

/// The names of a skeleton.
pub(super) fn names(skeleton: &Skeleton) -> Names {
    skeleton.joints.iter().enumerate().map(|(at, joint)| (joint.name.clone(), at)).collect()
}

/// The names of a skeleton as they are written: without blanks, and no two the same.
pub(super) fn written(skeleton: &Skeleton) -> Vec<String> {
    let all: Vec<(usize, &str)> = skeleton.joints.iter().enumerate().map(|(at, joint)| (at, joint.name.as_str())).collect();
    spelled(&NAMES, &all, &[NOBODY.to_owned()], "names").labels
}

/// Reads the word at the beginning, and the number of records that the file claims to have.
pub(super) fn head(words: &mut Words<'_>, format: &'static str, first: &str, what: &str) -> Result<u64, FormatError> {
    let Some(word) = words.word() else { return Err(words.wrong(format!("the file is empty; expected {first} and the number of {what}"))) };
    if !word.text.eq_ignore_ascii_case(first.as_bytes()) {
        return Err(word.wrong(format, format!("\"{}\" found, expected {first} at the beginning of the file", word.shown())));
    }
    let Some(word) = words.word() else { return Err(words.wrong(format!("the file ends behind {first}; it was cut off"))) };
    let count = std::str::from_utf8(word.text).ok().and_then(|text| text.parse().ok());
    count.ok_or_else(|| word.wrong(format, format!("\"{}\" found, expected the number of {what} behind {first}", word.shown())))
}

/// Notes that the count of the head is wrong.
pub(super) fn note_count(notes: &Notes, first: &str, what: &str, claimed: u64, present: usize) {
    if claimed != present as u64 {
        let text = format!("{first} says {claimed} {what}, there are {present}; all that are there were read");
        notes.add(Note::Contradiction { text });
    }
}

/// A name of a joint.
pub(super) fn name(word: Word<'_>, format: &'static str) -> Result<String, FormatError> {
    if word.text.len() > LONGEST_NAME {
        return Err(word.wrong(format, format!("a name of {} bytes; the longest that is read has {LONGEST_NAME}", word.text.len())));
    }
    Ok(letters(word.text))
}

/// The numbers behind a name: up to the next name, or the next word that is no number.
/// Where a name looks like a number, it is one as long as there are less than `least`.
pub(super) fn numbers(words: &mut Words<'_>, names: &Names, least: usize) -> Vec<f64> {
    let mut found = Vec::new();
    loop {
        let mut ahead = words.clone();
        let Some(value) = ahead.word().and_then(|word| {
            let value = word.number()?;
            (found.len() < least || !names.contains_key(&letters(word.text))).then_some(value)
        }) else {
            return found;
        };
        found.push(value);
        *words = ahead;
    }
}

/// The joint whose record begins with this word.
pub(super) fn joint(word: Word<'_>, format: &'static str, names: &Names) -> Result<usize, FormatError> {
    let found = names.get(&letters(word.text)).copied();
    found.ok_or_else(|| {
        let text = if word.number().is_some() {
            format!("\"{}\" found, expected the name of a joint", word.shown())
        } else {
            let known: Vec<&String> = names.keys().collect();
            format!("\"{}\" is no joint of the skeleton, which has {}; correct the name", word.shown(), listed(&known))
        };
        word.wrong(format, text)
    })
}

/// `1 number`, `2 numbers`.
pub(super) fn how_many(count: usize) -> String {
    if count == 1 { "1 number".to_owned() } else { format!("{count} numbers") }
}

/// The first three of some numbers.
pub(super) fn triple(numbers: &[f64]) -> Option<[f64; 3]> {
    numbers.first_chunk().copied()
}
