//! Takes on Ray: each a core task, which runs one process of this program on whichever machine of the cluster has room.
//!
//! A driver in Python, which is part of this program, speaks with Ray. It is told of takes and tells of their ends, as JSON Lines;
//! what is tried again, put aside or written down is decided here, as for any engine.

use super::{Allowed, Attempt, Engine, set_apart};
use crate::batch::BatchError;
use crate::batch::job::{Job, TakeResult};
use crate::batch::ledger::How;
use crate::input::{hash_file, plain};
use crate::report::lines;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{RecvTimeoutError, Sender, SyncSender, channel, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// What the driver is called while it is read.
const SCRIPT: &str = "ray_driver.py";

const DRIVER: &str = include_str!("ray_driver.py");

/// How long Ray may take to start, or to be reached.
const START: Duration = Duration::from_secs(180);

/// How long it may take to end.
const END: Duration = Duration::from_secs(30);

/// Takes that are handed to Ray for each of its cores, so that none waits for its next one.
const AHEAD: usize = 2;

/// ... but at least so many where a cluster may grow.
const LEAST_AHEAD: usize = 256;

/// What is wanted of Ray.
#[derive(Clone, Debug)]
pub struct Wish {
    /// The interpreter that has Ray.
    pub python: PathBuf,
    /// This program.
    pub program: PathBuf,
    /// A cluster that is there; a local one is started if absent.
    pub address: Option<String>,
    /// Cores of a local one, or takes at a time.
    pub jobs: Option<usize>,
    /// The most memory that a take may take, bytes.
    pub memory_bytes: Option<u64>,
}

/// Ray, as its driver shows it.
pub struct Ray {
    slots: usize,
    memory_bytes: Option<u64>,
    driver: Mutex<Child>,
    say: Mutex<Option<ChildStdin>>,
    waiting: Arc<Mutex<Waiting>>,
    script: tempfile::TempDir,
}

#[derive(Default)]
struct Waiting {
    next: u64,
    jobs: BTreeMap<u64, SyncSender<Attempt>>,
    /// Why nothing comes any more.
    gone: Option<String>,
}

#[derive(Serialize)]
#[serde(tag = "message_type", rename_all = "snake_case")]
enum Told<'a> {
    Start { program: &'a Path, program_sha256: String, address: Option<&'a str>, cpus: Option<usize>, temp: Option<&'a Path> },
    Job { id: u64, job: &'a Job, timeout_secs: Option<f64>, memory_bytes: u64, cpus: usize, alone: bool },
    Stop,
}

#[derive(Deserialize)]
#[serde(tag = "message_type", rename_all = "snake_case")]
enum Says {
    Ready {
        cpus: f64,
    },
    Error {
        kind: String,
        text: String,
    },
    Cpus {},
    Ended {
        id: u64,
        ended: How,
        code: Option<i32>,
        signal: Option<i32>,
        result: Option<serde_json::Value>,
        #[serde(default)]
        stderr: String,
        #[serde(default)]
        elapsed_secs: f64,
    },
}

fn held<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Ray {
    /// Starts the driver, and waits until it has a cluster.
    ///
    /// # Errors
    /// There is no Python, no Ray in it, or no cluster at the address. The text says the way out.
    pub fn start(wish: &Wish) -> Result<Self, BatchError> {
        let io = |what: &str, e: &std::io::Error| BatchError { text: format!("{what}: {}", plain(e)), again: false };
        let script =
            tempfile::Builder::new().prefix("mocap-repair-ray-").tempdir().map_err(|e| io("a temporary folder cannot be made", &e))?;
        let path = script.path().join(SCRIPT);
        std::fs::write(&path, DRIVER).map_err(|e| io(&path.display().to_string(), &e))?;
        let python = wish.python.display().to_string();
        let mut command = Command::new(&wish.python);
        command.arg("-u").arg(&path).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        set_apart(&mut command);
        let mut driver = command.spawn().map_err(|e| BatchError {
            text: format!(
                "{python}: cannot be started: {}; --engine ray needs Python 3.9 or newer with Ray (pip install ray); name it with --python",
                plain(&e)
            ),
            again: false,
        })?;
        let (heard, hear) = channel();
        let waiting = Arc::new(Mutex::new(Waiting::default()));
        let told = Arc::new(Mutex::new(String::new()));
        if let Some(stderr) = driver.stderr.take() {
            let told = Arc::clone(&told);
            std::thread::spawn(move || keep_end(stderr, &told));
        }
        if let Some(stdout) = driver.stdout.take() {
            let (waiting, told) = (Arc::clone(&waiting), Arc::clone(&told));
            std::thread::spawn(move || listen(BufReader::new(stdout), &waiting, &heard, &told));
        }
        let say = Mutex::new(driver.stdin.take());
        let mut ray = Self { slots: 1, memory_bytes: wish.memory_bytes, driver: Mutex::new(driver), say, waiting, script };
        let (program_sha256, _) = hash_file(&wish.program).map_err(|e| io(&wish.program.display().to_string(), &e))?;
        let start = Told::Start { program: &wish.program, program_sha256, address: wish.address.as_deref(), cpus: wish.jobs, temp: None };
        // a driver that is gone already says why
        let _ = ray.tell(&start);
        match hear.recv_timeout(START) {
            Ok(Ok(cpus)) => {
                // it was read; whoever is killed leaves nothing
                let _ = std::fs::remove_file(ray.script.path().join(SCRIPT));
                let _ = std::fs::remove_dir(ray.script.path());
                let ahead = AHEAD * (cpus as usize).max(1);
                ray.slots = match (wish.jobs, &wish.address) {
                    // on somebody's cluster it is a limit; a local one has as many cores
                    (Some(jobs), Some(_)) => jobs,
                    (Some(jobs), None) => AHEAD * jobs,
                    (None, Some(_)) => ahead.max(LEAST_AHEAD),
                    (None, None) => ahead,
                };
                Ok(ray)
            }
            Ok(Err(text)) => Err(BatchError { text, again: false }),
            Err(RecvTimeoutError::Timeout) => {
                Err(BatchError::again(format!("{python}: Ray was not there after {} s; try again, or look at ray status", START.as_secs())))
            }
            Err(RecvTimeoutError::Disconnected) => {
                let why = held(&ray.waiting).gone.clone().unwrap_or_default();
                Err(BatchError { text: format!("{python}: the driver of Ray ended at once: {why}"), again: false })
            }
        }
    }

    fn tell(&self, what: &Told<'_>) -> std::io::Result<()> {
        match held(&self.say).as_mut() {
            Some(stdin) => stdin.write_all(lines(std::slice::from_ref(what)).as_bytes()).and_then(|()| stdin.flush()),
            None => Err(std::io::ErrorKind::BrokenPipe.into()),
        }
    }

    fn gone(&self) -> BatchError {
        let why = held(&self.waiting).gone.clone().unwrap_or_else(|| "no reason given".to_owned());
        BatchError::again(format!("the driver of Ray is gone: {why}; the same command goes on where this one ended"))
    }
}

/// Hands ends of takes to those who wait for them. `ready` hears once how many cores there are, or why there are none.
fn listen(stdout: impl BufRead, waiting: &Mutex<Waiting>, ready: &Sender<Result<f64, String>>, told: &Mutex<String>) {
    let mut refused = None;
    for line in stdout.lines().map_while(Result::ok) {
        match serde_json::from_str::<Says>(&line) {
            Ok(Says::Ready { cpus }) => {
                let _ = ready.send(Ok(cpus));
            }
            Ok(Says::Error { kind, text }) => {
                refused = Some(if kind == "driver" { format!("the driver of Ray failed: {text}") } else { text });
            }
            Ok(Says::Ended { id, ended, code, signal, result, stderr, elapsed_secs }) => {
                let elapsed = Duration::try_from_secs_f64(elapsed_secs).unwrap_or_default();
                // what cannot be read is as good as nothing, and counts as no orderly end
                let result: Option<TakeResult> = result.and_then(|result| serde_json::from_value(result).ok());
                let attempt = Attempt { ended, code, signal, result, told: stderr, elapsed };
                if let Some(job) = held(waiting).jobs.remove(&id) {
                    let _ = job.send(attempt); // whoever waited has given up
                }
            }
            Ok(Says::Cpus {}) | Err(_) => {}
        }
    }
    // give what it says last the time to arrive
    std::thread::sleep(Duration::from_millis(100));
    let why = refused.unwrap_or_else(|| {
        let told = held(told).trim().to_owned();
        if told.is_empty() { "it was ended from outside".to_owned() } else { told }
    });
    let mut waiting = held(waiting);
    waiting.gone = Some(why.clone());
    waiting.jobs.clear();
    let _ = ready.send(Err(why));
}

/// Keeps the end of what is written to standard error.
fn keep_end(stderr: impl std::io::Read, told: &Mutex<String>) {
    for line in BufReader::new(stderr).lines().map_while(Result::ok) {
        let mut told = held(told);
        told.push_str(&line);
        told.push('\n');
        if told.len() > 8192 {
            let mut cut = told.len() - 4096;
            while !told.is_char_boundary(cut) {
                cut += 1;
            }
            told.drain(..cut);
        }
    }
}

impl Engine for Ray {
    fn name(&self) -> &'static str {
        "ray"
    }

    fn slots(&self) -> usize {
        self.slots
    }

    fn run(&self, mut job: Job, allowed: Allowed, _say: &(dyn Fn(&str) + Sync)) -> Result<Attempt, BatchError> {
        job.memory_bytes = self.memory_bytes;
        let (done, wait) = sync_channel(1);
        let id = {
            let mut waiting = held(&self.waiting);
            if waiting.gone.is_some() {
                drop(waiting);
                return Err(self.gone());
            }
            waiting.next += 1;
            let id = waiting.next;
            waiting.jobs.insert(id, done);
            id
        };
        let told = Told::Job {
            id,
            job: &job,
            timeout_secs: allowed.timeout.map(|most| most.as_secs_f64()),
            memory_bytes: allowed.memory_bytes,
            cpus: 1,
            alone: allowed.alone,
        };
        // a driver that is gone closes the channel
        let _ = self.tell(&told);
        wait.recv().map_err(|_| self.gone())
    }

    fn abandon(&self) {
        let _ = self.tell(&Told::Stop);
        held(&self.say).take();
    }
}

impl Drop for Ray {
    fn drop(&mut self) {
        self.abandon();
        let mut driver = held(&self.driver);
        let began = Instant::now();
        while began.elapsed() < END {
            match driver.try_wait() {
                Ok(None) => std::thread::sleep(Duration::from_millis(20)),
                _ => return,
            }
        }
        let _ = driver.kill();
        let _ = driver.wait();
    }
}
