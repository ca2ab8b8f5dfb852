//! Where takes are read from and outputs are written to: a folder, or a prefix in a bucket. One interface, which blocks.
//!
//! Everything in a place has a [name](Place): parts between `/`, as they are, never encoded.
//! A name cannot lead out of its place: one with `..`, an empty part or a leading `/` is refused.
//! What appears under a name appears whole or not at all.
//!
//! - `local`: folders
//! - `cloud`, `server`: buckets, with the feature `cloud`; what their servers say
//! - `error`: what can go wrong, and what can be done about it
//!
//! Which takes there are, and what outputs are called, is left to others.

#[cfg(feature = "cloud")]
mod cloud;
mod error;
mod local;
#[cfg(feature = "cloud")]
mod server;
#[cfg(test)]
mod tests;

pub use error::{Kind, StoreError};
use sha2::{Digest, Sha256};
use std::fmt;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// A folder, or a prefix in a bucket. Cheap to clone; all its clones, and the places within it, share their connections.
#[derive(Clone)]
pub struct Place {
    /// As it was typed, and the names that were joined to it.
    shown: String,
    kind: PlaceKind,
}

#[derive(Clone)]
enum PlaceKind {
    Folder(PathBuf),
    #[cfg(feature = "cloud")]
    Bucket(cloud::Bucket),
}

/// One file or object, as listed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Its name in the place, parts between `/`.
    pub name: String,
    /// Its size.
    pub bytes: u64,
    /// When it was written, if that is known.
    pub modified: Option<SystemTime>,
    /// What changes when its content does (the entity tag of an object). None for files.
    pub version: Option<String>,
}

/// What is to happen if there is something of that name already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// It stays. Of several that create at once, one does.
    Create,
    /// It goes, in one step.
    Replace,
}

/// Calls the same method of the folder or the bucket.
macro_rules! each {
    ($place:expr, $method:ident($($argument:expr),*)) => {
        match &$place.kind {
            PlaceKind::Folder(folder) => local::$method(folder, $($argument),*),
            #[cfg(feature = "cloud")]
            PlaceKind::Bucket(bucket) => bucket.$method(&$place.shown, $($argument),*),
        }
    };
}

impl Place {
    /// A path, `file:///folder`, `s3://bucket/prefix`, `gs://bucket/prefix` or `az://container/prefix`.
    /// Prefixes are taken as they are: `%20` in one means these three characters. Nothing is looked for yet, nobody is asked.
    ///
    /// # Errors
    /// It is none of that, or a bucket while the program was built without the feature `cloud`, or the environment says
    /// something about credentials that makes no sense.
    pub fn parse(text: &str) -> Result<Place, StoreError> {
        let refused = |kind, problem: String| Err(StoreError { place: without_credentials(text), kind, problem });
        let Some((scheme, rest)) = split_scheme(text) else {
            return if text.is_empty() {
                refused(Kind::Other, "an empty text names no place; . is the current folder".into())
            } else {
                Ok(Place { shown: text.to_owned(), kind: PlaceKind::Folder(text.into()) })
            };
        };
        match scheme.as_str() {
            "file" => {
                let path = rest.strip_prefix("localhost").filter(|path| path.starts_with('/')).unwrap_or(rest);
                match percent_decoded(path).filter(|path| path.starts_with('/') && !path.contains('\0')) {
                    Some(path) => Ok(Place { shown: text.to_owned(), kind: PlaceKind::Folder(folder_of_url(&path)) }),
                    None => refused(Kind::Unsupported, "cannot be understood; such an address is file:///folder, or give the path".into()),
                }
            }
            "s3" | "gs" | "az" => {
                let (bucket, prefix) = rest.split_once('/').unwrap_or((rest, ""));
                let prefix = prefix.trim_end_matches('/');
                if bucket.contains(['@', ':']) {
                    return refused(
                        Kind::Unsupported,
                        format!("credentials do not belong into an address, where others see them; {}", error::credentials(&scheme)),
                    );
                }
                if bucket.is_empty() || !bucket.bytes().all(|b| b.is_ascii_alphanumeric() || b"-._".contains(&b)) {
                    return refused(Kind::Unsupported, format!("names no bucket; such an address is {scheme}://BUCKET/PREFIX"));
                }
                if let Some(problem) = Some(prefix).filter(|prefix| !prefix.is_empty()).and_then(problem_of_name) {
                    return refused(Kind::Unsupported, format!("the prefix {problem}"));
                }
                Self::bucket(text, &scheme, bucket, prefix)
            }
            _ => refused(
                Kind::Unsupported,
                format!("{scheme}:// is no address that can be used; give a path, file://, s3://, gs:// or az://"),
            ),
        }
    }

    #[cfg(feature = "cloud")]
    fn bucket(text: &str, scheme: &str, bucket: &str, prefix: &str) -> Result<Place, StoreError> {
        let shown = text.trim_end_matches('/').to_owned();
        let bucket = cloud::Bucket::new(&shown, scheme, bucket, prefix)?;
        Ok(Place { shown, kind: PlaceKind::Bucket(bucket) })
    }

    #[cfg(not(feature = "cloud"))]
    fn bucket(text: &str, scheme: &str, _: &str, _: &str) -> Result<Place, StoreError> {
        Err(StoreError {
            place: text.to_owned(),
            kind: Kind::Unsupported,
            problem: format!(
                "this program was built without {scheme}:// and other buckets; build it with: cargo build --release --features cloud"
            ),
        })
    }

    /// As it was typed, without credentials.
    pub fn shown(&self) -> &str {
        &self.shown
    }

    /// The folder, if it is one.
    pub fn folder(&self) -> Option<&Path> {
        match &self.kind {
            PlaceKind::Folder(folder) => Some(folder),
            #[cfg(feature = "cloud")]
            PlaceKind::Bucket(_) => None,
        }
    }

    /// The place of that name within this one.
    ///
    /// # Errors
    /// The name would lead out of the place.
    pub fn join(&self, name: &str) -> Result<Place, StoreError> {
        self.check(name)?;
        let kind = match &self.kind {
            PlaceKind::Folder(folder) => PlaceKind::Folder(local::path(folder, name)),
            #[cfg(feature = "cloud")]
            PlaceKind::Bucket(bucket) => PlaceKind::Bucket(bucket.join(name)),
        };
        Ok(Place { shown: join(&self.shown, name), kind })
    }

    /// Tells of everything in the place, at any depth, one after the other and in no order that can be relied on.
    /// What is not there any more when its turn comes, and [what is still being written](Self::put), is left out.
    ///
    /// What cannot be listed is told as an error, and the listing goes on if `each` wants it to: a folder that may not be read, a name
    /// that is not Unicode, something that is neither file nor folder, a link to a folder (links to files are files).
    /// In buckets a single object whose name could not be used here, such as `a//b`, ends the listing with an error that names it.
    /// Objects by which consoles make folders are left out if something is in them.
    ///
    /// # Errors
    /// What `each` returned; or the place itself cannot be listed. A folder that is not there is an error, a prefix without objects is
    /// not: nobody can tell it from one that is not there.
    pub fn list(&self, each: &mut dyn FnMut(Result<Entry, StoreError>) -> Result<(), StoreError>) -> Result<(), StoreError> {
        each!(self, list(each))
    }

    /// The content of a file. None if it is not there.
    ///
    /// # Errors
    /// It cannot be read, or has more than `limit` bytes.
    pub fn read(&self, name: &str, limit: u64) -> Result<Option<Vec<u8>>, StoreError> {
        self.check(name)?;
        each!(self, read(name, limit))
    }

    /// Copies a file to a path of this machine, block by block. What was there is overwritten; what fails leaves nothing.
    ///
    /// # Errors
    /// It is not there, or it cannot be read, or it cannot be written.
    pub fn fetch(&self, name: &str, to: &Path) -> Result<(), StoreError> {
        self.check(name)?;
        each!(self, fetch(name, to))
    }

    /// The SHA-256 of a file in lower-case hexadecimal digits, and its size. None if it is not there.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn sha256(&self, name: &str) -> Result<Option<(String, u64)>, StoreError> {
        self.check(name)?;
        let (mut hasher, mut bytes) = (Sha256::new(), 0);
        let there = each!(
            self,
            blocks(name, &mut |block: &[u8]| {
                hasher.update(block);
                bytes += block.len() as u64;
                Ok(())
            })
        )?;
        Ok(there.then(|| (crate::input::hex(&hasher.finalize()), bytes)))
    }

    /// Moves a file of this machine to this place: if it comes to be there, `from` is gone. Folders are made as needed.
    /// True if it came to be there; false if it was to be created and something has that name.
    ///
    /// False does not say whose that is: where connections break, it may be what this very call wrote before it asked again.
    /// Compare what is there.
    ///
    /// In folders the file is renamed, or copied where renaming cannot reach.
    /// In buckets, up to 32 MiB go at once; more goes in parts. Creating in parts takes a second step: on S3 and Google a hidden object
    /// is written and copied within the bucket on the condition that nothing has the name; on Azure, and on S3 beyond 5 GiB, the name is
    /// looked for before the last step, so of two that write at the same moment the later wins.
    ///
    /// # Errors
    /// It cannot be read or written; `from` is still there.
    pub fn put(&self, name: &str, from: &Path, mode: Mode) -> Result<bool, StoreError> {
        self.check(name)?;
        each!(self, put(name, from, mode))
    }

    /// Writes a file. True and false are as for [`put`](Self::put).
    ///
    /// # Errors
    /// It cannot be written.
    pub fn write(&self, name: &str, bytes: &[u8], mode: Mode) -> Result<bool, StoreError> {
        self.check(name)?;
        each!(self, write(name, bytes, mode))
    }

    /// Removes a file. It is fine if it is not there. Folders stay.
    ///
    /// # Errors
    /// It is there and cannot be removed.
    pub fn remove(&self, name: &str) -> Result<(), StoreError> {
        self.check(name)?;
        each!(self, remove(name))
    }

    /// What [`list`](Self::list) would tell of one file. None if it is not there.
    ///
    /// # Errors
    /// It cannot be told.
    pub fn entry(&self, name: &str) -> Result<Option<Entry>, StoreError> {
        self.check(name)?;
        each!(self, entry(name))
    }

    /// True if there is a file of that name.
    ///
    /// # Errors
    /// It cannot be told.
    pub fn exists(&self, name: &str) -> Result<bool, StoreError> {
        self.check(name)?;
        self.entry(name).map(|entry| entry.is_some())
    }

    /// Makes sure that files can be written here, found again, not created twice, and removed, by doing so with one of a hidden name.
    /// Folders are made as needed.
    ///
    /// # Errors
    /// Something of that does not work, such as a server that ignores the condition under which it is to create.
    pub fn probe(&self) -> Result<(), StoreError> {
        let name = format!(".mocap-repair.{}.part", local::random_name());
        let created = self.write(&name, b"a", Mode::Create)?;
        let again = self.write(&name, b"b", Mode::Create);
        let found = self.read(&name, 1);
        self.remove(&name)?;
        let problem = match (created, again?, found?.as_deref()) {
            (true, false, Some(b"a")) => return Ok(()),
            (false, ..) => "a file of a new name was said to be there already",
            (_, true, _) => {
                "files that are there are overwritten where they should only be created; two runs could disturb each other here, use another \
                 folder or server"
            }
            (_, _, _) => "what was written is not what is read; use another folder or server",
        };
        Err(StoreError { place: self.shown.clone(), kind: Kind::Unsupported, problem: problem.into() })
    }

    fn check(&self, name: &str) -> Result<(), StoreError> {
        match problem_of_name(name) {
            None => Ok(()),
            Some(problem) => Err(StoreError {
                place: self.shown.clone(),
                kind: Kind::Unsupported,
                problem: format!("a name in it {problem}: {name:?}; rename it, no name may lead out of its place"),
            }),
        }
    }
}

impl fmt::Debug for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Place({:?})", self.shown)
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.shown)
    }
}

/// What is wrong with a name, if something is.
fn problem_of_name(name: &str) -> Option<&'static str> {
    if name.contains('\0') {
        return Some("has a zero byte");
    }
    name.split('/').find_map(|part| match part {
        "" => Some("has an empty part between its slashes"),
        "." | ".." => Some("has a part that is . or .."),
        // `\` and `C:` mean something on some systems and nothing on others
        _ if !cfg!(unix) && part.contains(['\\', ':']) => Some("has a backslash or a colon"),
        _ => None,
    })
}

/// True for files and objects that are still being written, or were left so by a kill.
fn is_unfinished(name: &str) -> bool {
    let last = name.rsplit('/').next().unwrap_or(name);
    last.starts_with('.') && last.strip_suffix(".part").is_some()
}

fn join(place: &str, name: &str) -> String {
    format!("{}/{name}", place.trim_end_matches('/'))
}

/// `s3` and `bucket/prefix` of `s3://bucket/prefix`.
fn split_scheme(text: &str) -> Option<(String, &str)> {
    let (scheme, rest) = text.split_once("://")?;
    let plain = scheme.bytes().all(|b| b.is_ascii_alphanumeric() || b"+-.".contains(&b));
    (plain && scheme.starts_with(|c: char| c.is_ascii_alphabetic())).then(|| (scheme.to_ascii_lowercase(), rest))
}

/// An address without what stands before an `@` in the part that names the server.
fn without_credentials(text: &str) -> String {
    let Some((scheme, rest)) = text.split_once("://") else { return text.to_owned() };
    let end = rest.find('/').unwrap_or(rest.len());
    // a secret may contain a slash itself: then nothing before the last @ is shown
    let start = rest[..end].rfind('@').or_else(|| rest[..end].contains(':').then(|| rest.rfind('@')).flatten()).map_or(0, |at| at + 1);
    format!("{scheme}://{}", &rest[start..])
}

fn percent_decoded(text: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let Some((&first, tail)) = rest.split_first() {
        if first == b'%' {
            let digits = std::str::from_utf8(tail.get(..2)?).ok().filter(|digits| digits.bytes().all(|b| b.is_ascii_hexdigit()))?;
            bytes.push(u8::from_str_radix(digits, 16).ok()?);
            rest = &tail[2..];
        } else {
            bytes.push(first);
            rest = tail;
        }
    }
    String::from_utf8(bytes).ok()
}

/// `/C:/folder` is how `C:/folder` is written in an address.
fn folder_of_url(path: &str) -> PathBuf {
    let drive = path.as_bytes().get(2) == Some(&b':');
    if cfg!(windows) && drive { path[1..].into() } else { path.into() }
}
