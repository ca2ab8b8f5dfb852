//! Names, addresses, and folders as places. Buckets are tested with servers, in `tests/cloud.rs`.
#![allow(clippy::unwrap_used)] // A test program: it fails by panicking.

use super::*;
use std::collections::BTreeMap;
use std::fs;

const TEXT: &str = "left, hidden for 40 frames";

fn place(folder: &Path) -> Place {
    Place::parse(folder.to_str().unwrap()).unwrap()
}

fn names(place: &Place) -> Vec<String> {
    let mut names = Vec::new();
    place
        .list(&mut |entry| {
            names.push(entry?.name);
            Ok(())
        })
        .unwrap();
    names.sort();
    names
}

#[test]
fn addresses_are_what_they_say() {
    for (text, folder) in [
        ("takes", Some("takes")),
        ("/data/a b", Some("/data/a b")),
        ("a://b", None),
        ("file:///data/a%20b%25", Some("/data/a b%")),
        ("file://localhost/data", Some("/data")),
        ("file:data", Some("file:data")),
        ("FILE:///data", Some("/data")),
        ("file://server/data", None),
        ("file:///data%2", None),
        ("file:///data%FF", None),
        ("file:///data%00", None),
        ("s3:/bucket", Some("s3:/bucket")),
        ("ftp://server/takes", None),
        ("", None),
    ] {
        let found = Place::parse(text);
        assert_eq!(found.as_ref().ok().and_then(Place::folder), folder.map(Path::new), "{text}: {found:?}");
        if let Ok(place) = found {
            assert_eq!((place.shown(), place.to_string().as_str()), (text, text));
        }
    }
}

#[test]
fn what_cannot_be_a_bucket_is_refused_without_telling_secrets() {
    for text in [
        "s3://",
        "s3:///prefix",
        "s3://b b/prefix",
        "s3://bucket/../other",
        "gs://bucket/a//b",
        "az://bucket/./a",
        "s3://KEY:hush@bucket/a",
        "s3://KEY:hu/sh@bucket/a",
        "https://me:hush@server/a",
    ] {
        let error = Place::parse(text).unwrap_err();
        assert_eq!(error.kind, Kind::Unsupported, "{error}");
        assert!(!error.to_string().contains("hush") && !error.to_string().contains("hu/sh"), "{error}");
    }
}

#[cfg(not(feature = "cloud"))]
#[test]
fn a_program_without_buckets_says_how_to_get_one_with_them() {
    for text in ["s3://bucket", "gs://bucket/a/b/", "az://container/a"] {
        let error = Place::parse(text).unwrap_err();
        assert!(error.kind == Kind::Unsupported && error.problem.contains("--features cloud"), "{error}");
    }
}

#[test]
fn no_name_leads_out_of_its_place() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("in")).unwrap();
    fs::write(folder.path().join("secret"), TEXT).unwrap();
    let from = folder.path().join("from");
    let place = place(&folder.path().join("in"));
    for name in ["../secret", "a/../../secret", "/etc/passwd", "", ".", "a/.", "a//b", "a/", "./a", "a\0b"] {
        fs::write(&from, TEXT).unwrap();
        let errors = [
            place.read(name, 99).unwrap_err(),
            place.fetch(name, &from).unwrap_err(),
            place.sha256(name).unwrap_err(),
            place.put(name, &from, Mode::Replace).unwrap_err(),
            place.write(name, b"", Mode::Replace).unwrap_err(),
            place.remove(name).unwrap_err(),
            place.exists(name).unwrap_err(),
            place.join(name).unwrap_err(),
        ];
        assert!(errors.iter().all(|error| error.kind == Kind::Unsupported), "{errors:?}");
        assert_eq!(fs::read_to_string(&from).unwrap(), TEXT);
    }
    assert_eq!(names(&place), [""; 0]);
    // these are names like any other
    for name in ["..a", "a..", "...", ".a/b", "~", "a\nb", "C3D (1)/x"] {
        assert!(place.write(name, TEXT.as_bytes(), Mode::Create).unwrap(), "{name}");
        assert_eq!(place.read(name, 99).unwrap().unwrap(), TEXT.as_bytes());
    }
}

#[test]
fn names_come_back_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let place = place(folder.path());
    let mut given = ["a b/Läufe #3 100%.c3d", "a b/%20.c3d", "日本/走る?*.c3d", "e\u{301}.c3d", "é.c3d", "\"quoted\" \\ [x].c3d"];
    given.sort_unstable();
    for name in given {
        assert!(place.write(name, name.as_bytes(), Mode::Create).unwrap());
    }
    assert_eq!(names(&place), given);
    for name in given {
        assert_eq!(place.read(name, 99).unwrap().unwrap(), name.as_bytes());
    }
    let within = place.join("a b").unwrap();
    assert_eq!(names(&within), ["%20.c3d", "Läufe #3 100%.c3d"]);
    assert_eq!(within.shown(), format!("{}/a b", place.shown()));
}

#[test]
fn what_is_written_is_read_and_what_is_not_there_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let place = place(&folder.path().join("made/as/needed"));
    let to = folder.path().join("to");
    let name = "a/b.c3d";
    assert_eq!(place.list(&mut |_| Ok(())).unwrap_err().kind, Kind::NotFound);
    for _ in 0..2 {
        assert_eq!((place.read(name, 9).unwrap(), place.sha256(name).unwrap(), place.exists(name).unwrap()), (None, None, false));
        fs::write(&to, "stays").unwrap();
        assert_eq!(place.fetch(name, &to).unwrap_err().kind, Kind::NotFound);
        assert_eq!(fs::read_to_string(&to).unwrap(), "stays");
        place.remove(name).unwrap();

        assert!(place.write(name, TEXT.as_bytes(), Mode::Replace).unwrap());
        assert_eq!(place.read(name, TEXT.len() as u64).unwrap().unwrap(), TEXT.as_bytes());
        let error = place.read(name, TEXT.len() as u64 - 1).unwrap_err();
        assert!(error.to_string().contains("has 26 bytes, and at most 25"), "{error}");
        assert_eq!(place.sha256(name).unwrap(), Some((crate::input::hex(&Sha256::digest(TEXT)), TEXT.len() as u64)));
        place.fetch(name, &to).unwrap();
        assert_eq!(fs::read_to_string(&to).unwrap(), TEXT);
        assert!(place.exists(name).unwrap());
        // a file is no folder, and a folder no file
        assert_eq!((place.exists("a").unwrap(), place.exists("a/b.c3d/c").unwrap()), (false, false));
        assert_eq!(place.read("a/b.c3d/c", 9).unwrap(), None);
        assert_eq!(place.write("a/b.c3d/c", b"", Mode::Create).unwrap_err().kind, Kind::Unsupported);
        assert_eq!(names(&place), [name]);
        place.remove(name).unwrap();
    }
    let own = folder.path().join("made/as/needed/own");
    fs::write(&own, TEXT).unwrap();
    place.fetch("own", &own).unwrap_err();
    assert_eq!(fs::read_to_string(&own).unwrap(), TEXT);
}

#[test]
fn what_is_created_is_created_once_and_what_is_replaced_is_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let (place, from) = (place(&folder.path().join("out")), folder.path().join("from"));
    for (mode, text, there) in
        [(Mode::Create, "1", true), (Mode::Create, "2", false), (Mode::Replace, "3", true), (Mode::Create, "4", false)]
    {
        fs::write(&from, text).unwrap();
        assert_eq!(place.put("a/put", &from, mode).unwrap(), there);
        assert_eq!(from.exists(), !there, "moved if it is there, left alone if not");
        assert_eq!(place.write("a/written", text.as_bytes(), mode).unwrap(), there);
    }
    for name in ["a/put", "a/written"] {
        assert_eq!(place.read(name, 9).unwrap().unwrap(), b"3");
    }
    place.probe().unwrap();
    assert_eq!(fs::read_dir(folder.path().join("out/a")).unwrap().count(), 2, "nothing hidden is left");
    assert_eq!(fs::read_dir(folder.path().join("out")).unwrap().count(), 1);
    assert_eq!(place.put("a/put", &folder.path().join("nothing"), Mode::Replace).unwrap_err().kind, Kind::NotFound);
}

#[test]
fn of_many_who_create_one_does() {
    let folder = tempfile::tempdir().unwrap();
    let place = place(folder.path());
    for round in 0..20 {
        let name = format!("{round}/x");
        let created = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..8)
                .map(|thread: u8| {
                    let (place, name, from) = (&place, &name, folder.path().join(format!(".{thread}.part")));
                    scope.spawn(move || {
                        if thread.is_multiple_of(2) {
                            return place.write(name, &[thread], Mode::Create).unwrap().then_some(thread);
                        }
                        fs::write(&from, [thread]).unwrap();
                        place.put(name, &from, Mode::Create).unwrap().then_some(thread)
                    })
                })
                .collect();
            threads.into_iter().filter_map(|thread| thread.join().unwrap()).collect::<Vec<_>>()
        });
        assert_eq!(created.len(), 1, "{created:?}");
        assert_eq!(place.read(&name, 9).unwrap().unwrap(), created);
    }
}

/// Two file systems, on a machine that has them.
#[cfg(target_os = "linux")]
#[test]
fn what_cannot_be_renamed_is_copied() {
    let (folder, Ok(elsewhere)) = (tempfile::tempdir().unwrap(), tempfile::tempdir_in("/dev/shm")) else { return };
    let (place, from) = (place(folder.path()), elsewhere.path().join("from"));
    for (mode, text, there) in [(Mode::Create, "1", true), (Mode::Create, "2", false), (Mode::Replace, "3", true)] {
        fs::write(&from, text).unwrap();
        assert_eq!(place.put("a/x", &from, mode).unwrap(), there);
        assert_eq!(from.exists(), !there);
    }
    assert_eq!(place.read("a/x", 9).unwrap().unwrap(), b"3");
    assert_eq!(names(&place), ["a/x"]);
    assert_eq!(fs::read_dir(folder.path().join("a")).unwrap().count(), 1);
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_called_full() {
    let error = match fs::write("/dev/full", TEXT) {
        Err(error) => StoreError::io("x", "written", &error),
        Ok(()) => return,
    };
    assert_eq!(error.kind, Kind::Full);
}

#[cfg(unix)]
#[test]
fn listing_tells_of_everything_and_goes_on() {
    use std::os::unix::ffi::OsStrExt;
    use std::os::unix::fs::symlink;
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir_all(at("a/b/c")).unwrap();
    for name in ["a/b/c/deep.c3d", "top.c3d", ".hidden", "a/.x.c3d.7f3.part"] {
        fs::write(at(name), name).unwrap();
    }
    symlink("../top.c3d", at("a/link.c3d")).unwrap();
    symlink("nowhere", at("a/dangling")).unwrap();
    symlink("..", at("a/up")).unwrap();
    let _socket = std::os::unix::net::UnixListener::bind(at("socket")).unwrap();
    let not_unicode = fs::write(at("a").join(std::ffi::OsStr::from_bytes(b"\xff.c3d")), "").is_ok();
    let (mut found, mut odd) = (BTreeMap::new(), Vec::new());
    place(folder.path())
        .list(&mut |entry| {
            match entry {
                Ok(entry) => {
                    assert!(entry.modified.is_some() && entry.version.is_none());
                    found.insert(entry.name, entry.bytes);
                }
                Err(error) => odd.push((error.place.rsplit('/').next().unwrap().to_owned(), error.kind)),
            }
            Ok(())
        })
        .unwrap();
    let files = [(".hidden", 7), ("a/b/c/deep.c3d", 14), ("a/link.c3d", 7), ("top.c3d", 7)];
    assert_eq!(found.iter().map(|(name, bytes)| (name.as_str(), *bytes)).collect::<Vec<_>>(), files);
    odd.sort_by(|a, b| a.0.cmp(&b.0));
    let mut expected = vec![("dangling", Kind::NotFound), ("socket", Kind::Unsupported), ("up", Kind::Unsupported)];
    if not_unicode {
        expected.push(("\u{fffd}.c3d", Kind::Unsupported));
    }
    assert_eq!(odd.iter().map(|(name, kind)| (name.as_str(), *kind)).collect::<Vec<_>>(), expected);
    // whoever has seen enough
    let mut seen = 0;
    let stop = StoreError { place: String::new(), kind: Kind::Other, problem: "enough".into() };
    let ended = place(folder.path()).list(&mut |_| {
        seen += 1;
        Err(stop.clone())
    });
    assert_eq!((ended, seen), (Err(stop), 1));
}
