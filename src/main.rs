//! The command `mocap-repair`: parse, run, exit code.

use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

/// The filter makes and drops small matrices by the million.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

static INTERRUPTED: AtomicBool = AtomicBool::new(false);

fn main() -> ExitCode {
    ExitCode::from(mocap_repair::cli::main(&INTERRUPTED, heed))
}

/// To be called by work that ends in an orderly way when [`INTERRUPTED`] says so; anything else ends where it is.
fn heed() {
    // The first interrupt ends the work in an orderly way, the second one at once. Without the handler an interrupt ends it at once,
    // which harms nothing either: nothing has its final name before it is whole.
    let _ = ctrlc::set_handler(|| {
        if INTERRUPTED.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    });
}
