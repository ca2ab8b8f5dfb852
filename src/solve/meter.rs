//! How far a step has come, for whoever waits.

use std::sync::atomic::{AtomicUsize, Ordering};

/// Counts pieces of work within a step. Solvers count, from any thread; what is counted changes no result.
#[derive(Debug, Default)]
pub struct Meter {
    done: AtomicUsize,
    all: AtomicUsize,
}

impl Meter {
    /// `all` pieces are to be done now; 0 if nobody knows how many.
    pub fn begin(&self, all: usize) {
        self.done.store(0, Ordering::Relaxed);
        self.all.store(all, Ordering::Relaxed);
    }

    /// One more is done.
    pub fn count(&self) {
        self.done.fetch_add(1, Ordering::Relaxed);
    }

    /// How many are done, of how many. Read while it is written, it may be a piece behind, but is never more than the whole.
    pub fn read(&self) -> (usize, usize) {
        let all = self.all.load(Ordering::Relaxed);
        (self.done.load(Ordering::Relaxed).min(all), all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_counts_to_the_whole_and_begins_anew() {
        let meter = Meter::default();
        assert_eq!(meter.read(), (0, 0));
        meter.begin(2);
        for read in [(1, 2), (2, 2), (2, 2)] {
            meter.count();
            assert_eq!(meter.read(), read);
        }
        meter.begin(5);
        assert_eq!(meter.read(), (0, 5));
    }
}
