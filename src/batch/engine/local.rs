//! Takes on this machine: each in a process of its own, as many at once as there are cores, and no more than memory has room for.

use super::{Allowed, Attempt, Engine, set_apart};
use crate::batch::BatchError;
use crate::batch::job::{Job, Said};
use crate::batch::ledger::How;
use crate::input::plain;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How often it is looked whether a take has had its time.
const TICK: Duration = Duration::from_millis(50);

/// How much of the end of standard error is kept, in bytes.
const KEPT: u64 = 4096;

/// This machine.
pub struct Local {
    program: PathBuf,
    slots: usize,
    cores: usize,
    memory: Memory,
    abandoned: AtomicBool,
    /// Takes that run when nothing more is handed out.
    left: AtomicUsize,
}

impl Local {
    /// `program`: what repairs a take. `memory_bytes`: what all takes together may take.
    pub fn new(program: PathBuf, slots: usize, memory_bytes: u64) -> Self {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let memory = Memory { all: memory_bytes, taken: Mutex::new(Taken::default()), freed: Condvar::new() };
        Self { program, slots: slots.max(1), cores, memory, abandoned: AtomicBool::new(false), left: AtomicUsize::new(usize::MAX) }
    }

    fn start(&self, job: &Job, stderr: &std::fs::File) -> std::io::Result<Child> {
        let mut command = Command::new(&self.program);
        command.args(["batch", "take"]).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(stderr.try_clone()?);
        set_apart(&mut command);
        let mut child = command.spawn()?;
        let line = crate::report::lines(std::slice::from_ref(job));
        if let Some(stdin) = &mut child.stdin {
            // a process that is gone already tells why by how it ended
            let _ = stdin.write_all(line.as_bytes()).and_then(|()| stdin.flush());
        }
        Ok(child)
    }
}

impl Engine for Local {
    fn name(&self) -> &'static str {
        "local"
    }

    fn slots(&self) -> usize {
        self.slots
    }

    fn run(&self, mut job: Job, allowed: Allowed, say: &(dyn Fn(&str) + Sync)) -> Result<Attempt, BatchError> {
        // what a take may take is what is held for it, so that all together never take more than there is
        let even = self.memory.all / self.slots as u64;
        let share = if allowed.alone { self.memory.all } else { allowed.memory_bytes.max(even).min(self.memory.all) };
        let Some(held) = self.memory.take(share, || say("waiting for memory")) else {
            let (ended, told) = (How::Lost, "the run ended before its turn came".to_owned());
            return Ok(Attempt { ended, code: None, signal: None, result: None, told, elapsed: Duration::ZERO });
        };
        let together = if allowed.alone { 1 } else { self.slots.min(self.left.load(Ordering::Relaxed)).max(1) };
        job.threads = (self.cores / together).max(1);
        job.memory_bytes = Some(share);
        let began = Instant::now();
        let mut stderr = tempfile::tempfile().map_err(|e| BatchError::again(format!("a temporary file cannot be made: {}", plain(&e))))?;
        let failed = |e: std::io::Error| BatchError::again(format!("{}: cannot be started: {}", self.program.display(), plain(&e)));
        let mut child = self.start(&job, &stderr).map_err(failed)?;
        let (said, hear) = sync_channel(64);
        let stdout = child.stdout.take();
        let mut result = None;
        let mut ended = How::Exit;
        let status: std::io::Result<ExitStatus> = std::thread::scope(|scope| {
            scope.spawn(move || {
                for line in stdout.into_iter().flat_map(|out| BufReader::new(out).lines()).map_while(Result::ok) {
                    if let Ok(line) = serde_json::from_str::<Said>(&line)
                        && said.send(line).is_err()
                    {
                        break;
                    }
                }
            });
            let hear = hear; // goes before the other thread is waited for, which may be about to say something
            loop {
                let closed = match hear.recv_timeout(TICK) {
                    Ok(Said::Phase { text }) => {
                        say(&text);
                        false
                    }
                    Ok(Said::Result(said)) => {
                        result = Some(said);
                        false
                    }
                    Err(RecvTimeoutError::Timeout) => false,
                    Err(RecvTimeoutError::Disconnected) => true,
                };
                let late = allowed.timeout.is_some_and(|most| began.elapsed() > most);
                if late || self.abandoned.load(Ordering::Relaxed) {
                    ended = if late { How::Timeout } else { How::Lost };
                    child.kill()?;
                    return child.wait();
                }
                if closed {
                    if let Some(status) = child.try_wait()? {
                        return Ok(status);
                    }
                    std::thread::sleep(Duration::from_millis(1));
                }
            }
        });
        drop(held);
        let status = status.map_err(|e| BatchError::again(format!("a take cannot be waited for: {}", plain(&e))))?;
        let told = end_of(&mut stderr).unwrap_or_default();
        let signal = signal(status);
        if ended == How::Exit && signal.is_some() {
            // Rust ends so if the system gives no memory
            ended = if told.contains("memory allocation of") { How::Memory } else { How::Signal };
        }
        Ok(Attempt { ended, code: status.code(), signal, result, told, elapsed: began.elapsed() })
    }

    fn wind_down(&self) {
        self.memory.taken.lock().unwrap_or_else(PoisonError::into_inner).closed = true;
        self.memory.freed.notify_all();
    }

    fn abandon(&self) {
        self.abandoned.store(true, Ordering::Relaxed);
        self.wind_down();
    }

    fn last_ones(&self, running: usize) {
        self.left.store(running.max(1), Ordering::Relaxed);
    }
}

#[cfg(unix)]
fn signal(status: ExitStatus) -> Option<i32> {
    std::os::unix::process::ExitStatusExt::signal(&status)
}

#[cfg(not(unix))]
fn signal(_: ExitStatus) -> Option<i32> {
    None
}

fn end_of(file: &mut std::fs::File) -> std::io::Result<String> {
    let length = file.seek(SeekFrom::End(0))?;
    file.seek(SeekFrom::Start(length.saturating_sub(KEPT)))?;
    let mut bytes = Vec::new();
    file.take(KEPT).read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).trim().to_owned())
}

/// Memory that takes share. Those that want more than there is run alone.
struct Memory {
    all: u64,
    taken: Mutex<Taken>,
    freed: Condvar,
}

#[derive(Default)]
struct Taken {
    bytes: u64,
    /// Somebody large waits: nobody else gets in before.
    queue: u64,
    served: u64,
    /// Nobody gets in any more.
    closed: bool,
}

struct Held<'a>(&'a Memory, u64);

impl Memory {
    /// First come, first served, so that large takes do not wait for ever. `None` if the run ended before.
    fn take(&self, bytes: u64, waiting: impl FnOnce()) -> Option<Held<'_>> {
        let mut taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        let ticket = taken.queue;
        taken.queue += 1;
        let fits = |taken: &Taken| taken.served == ticket && (taken.bytes == 0 || taken.bytes + bytes <= self.all);
        if !fits(&taken) {
            waiting();
        }
        let mut taken = self.freed.wait_while(taken, |taken| !taken.closed && !fits(taken)).unwrap_or_else(PoisonError::into_inner);
        if taken.closed {
            return None;
        }
        taken.bytes += bytes;
        taken.served += 1;
        self.freed.notify_all();
        Some(Held(self, bytes))
    }
}

impl Drop for Held<'_> {
    fn drop(&mut self) {
        self.0.taken.lock().unwrap_or_else(PoisonError::into_inner).bytes -= self.1;
        self.0.freed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn memory_is_shared_and_large_takes_run_alone() {
        let memory = Memory { all: 100, taken: Mutex::default(), freed: Condvar::new() };
        let (most, now) = (AtomicUsize::new(0), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            for bytes in [60, 30, 100, 40, 500, 50, 50] {
                let (memory, most, now) = (&memory, &most, &now);
                scope.spawn(move || {
                    let _held = memory.take(bytes, || {}).unwrap();
                    let together = now.fetch_add(bytes as usize, Ordering::SeqCst) + bytes as usize;
                    most.fetch_max(if together > 100 && together != bytes as usize { together } else { 0 }, Ordering::SeqCst);
                    std::thread::sleep(Duration::from_millis(5));
                    now.fetch_sub(bytes as usize, Ordering::SeqCst);
                });
            }
        });
        assert_eq!(most.load(Ordering::SeqCst), 0, "more than there is");
        assert_eq!(memory.taken.lock().unwrap().bytes, 0);
    }
}
