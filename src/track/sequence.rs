//! The clouds of a sequence: which files there are, and their content, read ahead by threads of their own.

use crate::compression;
use crate::input::{expand, plain, read};
use crate::repair::RepairError;
use crate::solve::ik::Vec3;
use crate::solve::track::{Cloud, vertex_normals};
use crate::staging;
use formats::rig::read_mesh;
use formats::{Note, Notes};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread::Scope;

/// Threads that read clouds.
const READERS: usize = 2;
/// Clouds that each of them has ready, at most.
const AHEAD: usize = 4;
/// Numbers of files have so many digits at most.
const MOST_DIGITS: usize = 9;
/// A sequence may have this many frames ...
const FRAMES_ALWAYS: u64 = 1000;
/// ... or so many times those that have files. With more, a number is a slip of the finger.
const FRAMES_TIMES: u64 = 10;

/// Names of files with a number in them, as `printf` writes them: `clouds/frame_%03d.off`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pattern {
    typed: String,
    folder: PathBuf,
    before: String,
    behind: String,
    /// The least number of digits, filled up with zeros.
    digits: usize,
}

impl Pattern {
    /// Reads a pattern as it is typed.
    ///
    /// # Errors
    /// Something else than one `%d` or `%03d` in the name of the file, and `%%` for a percent sign.
    pub fn parse(typed: &str) -> Result<Self, String> {
        let way_out = "write %d or %03d in place of the number, and %% for a percent sign";
        let cut = typed.rfind(['/', std::path::MAIN_SEPARATOR]).map_or(0, |at| at + 1);
        let (folder, name) = typed.split_at(cut);
        let mut pieces = vec![String::new()];
        let mut digits = 1;
        let mut rest = name;
        while let Some((text, behind)) = rest.split_once('%') {
            pieces.last_mut().into_iter().for_each(|piece| piece.push_str(text));
            if let Some(behind) = behind.strip_prefix('%') {
                pieces.last_mut().into_iter().for_each(|piece| piece.push('%'));
                rest = behind;
                continue;
            }
            let length = behind.bytes().take_while(u8::is_ascii_digit).count();
            let (width, behind) = behind.split_at(length);
            let known = width.is_empty() || width.starts_with('0');
            match (behind.strip_prefix('d'), width.parse::<usize>().unwrap_or(1)) {
                (Some(behind), width) if known && width <= MOST_DIGITS => {
                    digits = width.max(1);
                    rest = behind;
                    pieces.push(String::new());
                }
                _ => {
                    let next: String = behind.chars().take(1).collect();
                    return Err(format!("\"%{width}{next}\" is no number of a frame; {way_out}"));
                }
            }
        }
        pieces.last_mut().into_iter().for_each(|piece| piece.push_str(rest));
        match pieces.as_slice() {
            [before, behind] => {
                let folder = PathBuf::from(folder.replace("%%", "%"));
                Ok(Self { typed: typed.to_owned(), folder, before: before.clone(), behind: behind.clone(), digits })
            }
            [_] => Err(format!("the name says nowhere where the number of the frame stands; {way_out}, as in clouds/frame_%03d.off")),
            _ => Err("the name has more than one number; a file has the number of its frame and no other".to_owned()),
        }
    }

    /// As it was typed.
    pub fn typed(&self) -> &str {
        &self.typed
    }

    /// The file of a frame.
    pub fn path(&self, number: u32) -> PathBuf {
        self.folder.join(format!("{}{number:0digits$}{}", self.before, self.behind, digits = self.digits))
    }

    /// The number in the name of a file.
    fn number(&self, name: &str) -> Option<u32> {
        let text = name.strip_prefix(&self.before)?.strip_suffix(&self.behind)?;
        let plain = text.len() == self.digits || (text.len() > self.digits && !text.starts_with('0'));
        let whole = plain && text.len() <= MOST_DIGITS && text.bytes().all(|b| b.is_ascii_digit());
        whole.then(|| text.parse().ok()).flatten()
    }
}

/// The files of a sequence.
#[derive(Clone, Debug)]
pub struct Sequence {
    /// The number of the first frame.
    pub first: u32,
    /// That of the last one.
    pub last: u32,
    files: BTreeMap<u32, PathBuf>,
}

impl Sequence {
    /// Looks for the files of a sequence, from frame `first` to `last` if they are given.
    ///
    /// # Errors
    /// There are none, or those of `first` and `last` are not there.
    pub fn find(pattern: &Pattern, first: Option<u32>, last: Option<u32>) -> Result<Self, RepairError> {
        let stop = |path: &Path, problem: String| Err(RepairError::Io { path: path.to_owned(), problem });
        let folder = staging::folder(&pattern.path(0)).to_owned();
        let listed = match std::fs::read_dir(&folder) {
            Ok(listed) => listed,
            Err(error) => return stop(&folder, format!("cannot be read: {}", plain(&error))),
        };
        let mut files = BTreeMap::new();
        for entry in listed {
            let path = match entry {
                Ok(entry) => entry.path(),
                Err(error) => return stop(&folder, format!("cannot be read: {}", plain(&error))),
            };
            let Some(name) = path.file_name().and_then(|name| name.to_str()) else { continue };
            if let Some(number) = pattern.number(name) {
                files.insert(number, path);
            } else if compression::is_named(&path)
                && let Some(number) = compression::inner_name(Path::new(name)).to_str().and_then(|name| pattern.number(name))
            {
                files.entry(number).or_insert(path); // one that is not compressed comes first
            }
        }
        let typed = Path::new(pattern.typed());
        let (Some(&least), Some(&most)) = (files.keys().next(), files.keys().next_back()) else {
            return stop(typed, format!("no file has such a name, such as {}; nothing can be followed", pattern.path(0).display()));
        };
        for (option, number) in [("--first", first), ("--last", last)] {
            if let Some(number) = number.filter(|number| !files.contains_key(number)) {
                let problem = format!("{option} {number} names a frame without a file; there are files from {least} to {most}");
                return stop(typed, problem);
            }
        }
        let (first, last) = (first.unwrap_or(least), last.unwrap_or(most));
        if first > last {
            return stop(typed, format!("frame {last}, the last one, is before frame {first}, the first one"));
        }
        files.retain(|number, _| (first..=last).contains(number));
        let frames = u64::from(last - first) + 1;
        if frames > FRAMES_ALWAYS.max(FRAMES_TIMES * files.len() as u64) {
            let problem = format!(
                "the numbers go from {first} to {last}, but only {} of these frames have files; say --first and --last, or move away what does not \
                 belong to the sequence",
                files.len()
            );
            return stop(typed, problem);
        }
        Ok(Self { first, last, files })
    }

    /// Number of frames, with those that have no file.
    pub fn frames(&self) -> usize {
        (self.last - self.first) as usize + 1
    }

    /// The files that there are.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        self.files.values().map(PathBuf::as_path)
    }

    /// Reads the clouds on threads of their own, a few of them ahead of who takes them. Lengths are multiplied by `unit_cm`.
    pub fn read<'scope>(&'scope self, unit_cm: f64, scope: &'scope Scope<'scope, '_>) -> Clouds {
        let receivers = (0..READERS).map(|reader| {
            let (to, from) = sync_channel(AHEAD);
            scope.spawn(move || {
                for number in (self.first..=self.last).skip(reader).step_by(READERS) {
                    // whoever took them may have gone away, which ends the reading
                    if to.send(self.frame(number, unit_cm)).is_err() {
                        break;
                    }
                }
            });
            from
        });
        Clouds { receivers: receivers.collect(), next: 0 }
    }

    fn frame(&self, number: u32, unit_cm: f64) -> Result<Frame, RepairError> {
        let notes = Notes::new();
        let cloud = match self.files.get(&number) {
            Some(path) => Some(read_cloud(path, unit_cm, &notes)?),
            None => None,
        };
        Ok(Frame { number, cloud, notes: notes.take() })
    }

    /// Reads the first cloud that there is.
    ///
    /// # Errors
    /// It cannot be read, or is damaged.
    pub fn first_cloud(&self, unit_cm: f64) -> Result<Option<Frame>, RepairError> {
        self.files.keys().next().map(|&number| self.frame(number, unit_cm)).transpose()
    }

    /// True if the frame of this number has a file.
    pub fn has(&self, number: u32) -> bool {
        self.files.contains_key(&number)
    }
}

/// A frame of the sequence.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Its number, as in the name of the file.
    pub number: u32,
    /// Its cloud; `None` if there is no file.
    pub cloud: Option<Cloud>,
    /// What was assumed or found odd; the same of all clouds that are alike.
    pub notes: Vec<Note>,
}

/// Frames that are being read, in their order. Dropping it ends the reading.
#[derive(Debug)]
pub struct Clouds {
    receivers: Vec<Receiver<Result<Frame, RepairError>>>,
    next: usize,
}

impl Iterator for Clouds {
    type Item = Result<Frame, RepairError>;

    fn next(&mut self) -> Option<Self::Item> {
        let frame = self.receivers.get(self.next % READERS)?.recv().ok();
        self.next += 1;
        frame
    }
}

/// Reads a cloud. Without normals of its own it gets those of its faces; without faces as well it has none, which fit all.
fn read_cloud(path: &Path, unit_cm: f64, notes: &Notes) -> Result<Cloud, RepairError> {
    let bytes = expand(read(path)?, path)?;
    let said = Notes::new();
    let mesh = read_mesh(&bytes, &said).map_err(|error| RepairError::Format { path: path.to_owned(), error })?;
    for note in said.take() {
        notes.add(match note {
            Note::Contradiction { text } => Note::Contradiction { text: format!("clouds: {text}") },
            other => other,
        });
    }
    if mesh.normals.is_empty() && mesh.faces.is_empty() && !mesh.vertices.is_empty() {
        let text = "clouds have no normals: a point may belong to any part that is near, even to one whose surface faces away (--nthresh tests nothing)";
        notes.add(Note::Assumed { text: text.to_owned() });
    }
    let points: Vec<Vec3> = mesh.vertices.iter().map(|x| Vec3::from(*x) * unit_cm).collect();
    let normals = if mesh.normals.len() == points.len() {
        mesh.normals.iter().map(|x| Vec3::from(*x)).collect()
    } else {
        vertex_normals(&points, &mesh.faces)
    };
    Ok(Cloud { points, normals })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn names_have_numbers_as_printf_writes_them() {
        for (pattern, number, name) in [
            ("a_%03d.off", 7, "a_007.off"),
            ("a_%03d.off", 1234, "a_1234.off"),
            ("%d", 0, "0"),
            ("50%%_%d.off", 12, "50%_12.off"),
            ("folder/%02dx", 3, "folder/03x"),
        ] {
            let pattern = Pattern::parse(pattern).unwrap();
            let path = pattern.path(number);
            assert_eq!(path, Path::new(name));
            assert_eq!(pattern.number(path.file_name().unwrap().to_str().unwrap()), Some(number), "{name}");
        }
    }

    #[test]
    fn other_names_have_no_number() {
        let pattern = Pattern::parse("a_%03d.off").unwrap();
        for name in ["a_07.off", "a_0007.off", "a_.off", "a_+07.off", "b_007.off", "a_007.obj", "a_9999999999.off"] {
            assert_eq!(pattern.number(name), None, "{name}");
        }
    }

    #[test]
    fn what_is_no_pattern_is_refused_with_the_way_out() {
        for (typed, said) in [
            ("a.off", "as in clouds/frame_%03d.off"),
            ("a_%s.off", "\"%s\" is no number"),
            ("a_%3d.off", "\"%3d\" is no number"),
            ("a_%d_%d.off", "more than one number"),
            ("a_%", "\"%\" is no number"),
        ] {
            let error = Pattern::parse(typed).unwrap_err();
            assert!(error.contains(said), "{typed}: {error}");
        }
    }

    #[test]
    fn numbers_far_apart_are_a_slip_of_the_finger() {
        let folder = tempfile::tempdir().unwrap();
        for number in [0, 1, 2, 900_000] {
            std::fs::write(folder.path().join(format!("{number}.off")), "OFF\n0 0 0\n").unwrap();
        }
        let pattern = Pattern::parse(&format!("{}/%d.off", folder.path().display())).unwrap();
        let error = Sequence::find(&pattern, None, None).unwrap_err().to_string();
        assert!(error.contains("only 4 of these frames have files"), "{error}");
        assert_eq!(Sequence::find(&pattern, None, Some(2)).unwrap().frames(), 3);
        assert!(Sequence::find(&pattern, Some(3), None).is_err());
    }
}
