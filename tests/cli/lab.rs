//! A folder to run the program in, and what is looked at afterwards.

use formats::{Notes, Origin, Stated, Take};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;
use tempfile::TempDir;

/// The program under test.
pub const PROGRAM: &str = env!("CARGO_BIN_EXE_mocap-repair");

/// How many frames the takes of a [`Lab`] have.
pub const FRAMES: usize = 150;

/// All files of a folder, hidden ones included, by name. Folders within have names that end in `/` and no content.
pub type Listing = BTreeMap<String, Vec<u8>>;

/// A folder that is deleted afterwards. The program runs in it, so names need no folder.
pub struct Lab {
    folder: TempDir,
}

/// What a run left behind besides files.
#[derive(Debug)]
pub struct Ran {
    /// Exit code; -1 if a signal ended it.
    pub code: i32,
    pub out: String,
    pub err: String,
}

impl Ran {
    /// Asserts the exit code, and that nothing went to standard error.
    #[track_caller]
    pub fn with_code(self, code: i32) -> Self {
        assert_eq!((self.code, self.err.as_str()), (code, ""), "{}", self.out);
        self
    }

    /// What was told, with sentences in one piece that were wrapped.
    pub fn sentences(&self) -> String {
        self.out.replace("\n             ", " ")
    }

    /// The lines of `--json`.
    #[track_caller]
    pub fn messages(&self) -> Vec<serde_json::Value> {
        self.out.lines().map(|line| serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {line}"))).collect()
    }
}

impl Lab {
    /// An empty folder.
    pub fn empty() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    /// A folder with the four files of a short demonstration take.
    pub fn new() -> Self {
        static DEMO: OnceLock<Listing> = OnceLock::new();
        let files = DEMO.get_or_init(|| {
            let lab = Self::empty();
            lab.run(&["demo", "-o", ".", "--frames", &FRAMES.to_string()]).with_code(0);
            lab.listing()
        });
        let lab = Self::empty();
        for (name, bytes) in files {
            lab.write(name, bytes);
        }
        lab
    }

    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder().join(name)
    }

    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), bytes).unwrap();
    }

    #[track_caller]
    pub fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    #[track_caller]
    pub fn text(&self, name: &str) -> String {
        String::from_utf8(self.read(name)).unwrap()
    }

    /// The program with these arguments, ready to run: nothing to read, and both outputs to be collected.
    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(PROGRAM);
        command.args(arguments).current_dir(self.folder()).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    pub fn run(&self, arguments: &[&str]) -> Ran {
        let output = self.command(arguments).output().unwrap();
        Ran {
            code: output.status.code().unwrap_or(-1),
            out: String::from_utf8(output.stdout).unwrap(),
            err: String::from_utf8(output.stderr).unwrap(),
        }
    }

    /// Names of everything that is in the folder; for use while somebody works in it.
    pub fn listing_names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.folder()).unwrap();
        entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok()).collect()
    }

    /// Everything that is in the folder.
    pub fn listing(&self) -> Listing {
        std::fs::read_dir(self.folder())
            .unwrap()
            .map(|entry| {
                let path = entry.unwrap().path();
                let name = path.file_name().unwrap().to_str().unwrap().to_owned();
                if path.is_dir() { (name + "/", Vec::new()) } else { (name, std::fs::read(&path).unwrap()) }
            })
            .collect()
    }

    /// Names of everything that is in the folder now and was not in `before`. What was there must still be the same.
    #[track_caller]
    pub fn new_since(&self, before: &Listing) -> Vec<String> {
        let now = self.listing();
        for (name, bytes) in before {
            assert!(now.get(name) == Some(bytes), "{name} was changed or is gone");
        }
        now.into_keys().filter(|name| !before.contains_key(name)).collect()
    }

    /// Deletes files of the folder.
    pub fn remove(&self, names: &[String]) {
        for name in names {
            std::fs::remove_file(self.path(name)).unwrap();
        }
    }

    /// Opens a take of the folder.
    #[track_caller]
    pub fn take(&self, name: &str) -> Take {
        let format = formats::by_extension(name.rsplit('.').next().unwrap()).unwrap();
        let document = format.open(self.read(name), &Stated::default(), &Notes::new()).unwrap_or_else(|e| panic!("{name}: {e}"));
        document.take().clone()
    }

    /// What a report to look at shows: base 64, deflated, JSON.
    pub fn page(&self, name: &str) -> serde_json::Value {
        let html = self.text(name);
        let (_, model) = html.split_once("<script type=\"text/plain\" id=\"model\">").unwrap();
        let (mut bytes, mut bits, mut held) = (Vec::new(), 0_u32, 0);
        for digit in model.split('<').next().unwrap().bytes().filter(|&digit| digit != b'=') {
            let value = match digit {
                b'A'..=b'Z' => digit - b'A',
                b'a'..=b'z' => digit - b'a' + 26,
                b'0'..=b'9' => digit - b'0' + 52,
                _ => 62 + u8::from(digit == b'/'),
            };
            (bits, held) = ((bits << 6 | u32::from(value)) & 0xffff, held + 6);
            if held >= 8 {
                held -= 8;
                bytes.push((bits >> held) as u8);
            }
        }
        serde_json::from_slice(&miniz_oxide::inflate::decompress_to_vec_zlib(&bytes).unwrap()).unwrap()
    }

    /// The metadata record of a log of the folder.
    #[track_caller]
    pub fn log_metadata(&self, name: &str) -> BTreeMap<String, String> {
        let bytes = self.read(name);
        let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
        mcap::read::metadata(&bytes, &summary.metadata_indexes[0]).unwrap().metadata
    }

    /// Writes a take to the folder, in the format of its extension.
    pub fn create(&self, name: &str, take: &Take) {
        let format = formats::by_extension(name.rsplit('.').next().unwrap()).unwrap();
        let mut bytes = Vec::new();
        format.create(take, &mut bytes, &Notes::new()).unwrap();
        self.write(name, bytes);
    }
}

/// All missing samples as (frame, marker).
pub fn missing(take: &Take) -> Vec<(usize, usize)> {
    let cells = (0..take.frames()).flat_map(|frame| (0..take.markers.len()).map(move |marker| (frame, marker)));
    cells.filter(|&(frame, marker)| take.origin(frame, marker) == Origin::Missing).collect()
}

/// The column of a marker.
pub fn column(take: &Take, label: &str) -> usize {
    take.markers.iter().position(|marker| marker.label == label).unwrap()
}

/// The number of cells of 16 bytes (a point of a C3D with floats) in which two files differ. `None` if they differ before `from`, or in length.
pub fn changed_points(a: &[u8], b: &[u8], from: usize) -> Option<usize> {
    let comparable = a.len() == b.len() && a[..from] == b[..from];
    comparable.then(|| a[from..].chunks(16).zip(b[from..].chunks(16)).filter(|(a, b)| a != b).count())
}

/// Where the points of a C3D begin: word 9 of the header counts blocks of 512 bytes, from 1.
pub fn points_start(c3d: &[u8]) -> usize {
    (usize::from(u16::from_le_bytes([c3d[16], c3d[17]])) - 1) * 512
}

/// A C3D of the demonstration with the fourth word of every point set to `word`.
pub fn with_fourth_words(c3d: &[u8], word: f32) -> Vec<u8> {
    let mut patched = c3d.to_vec();
    let (markers, start) = (usize::from(u16::from_le_bytes([c3d[2], c3d[3]])), points_start(c3d));
    for point in 0..markers * FRAMES {
        let at = start + 16 * point + 12;
        patched[at..at + 4].copy_from_slice(&word.to_le_bytes());
    }
    patched
}
