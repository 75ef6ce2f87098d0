//! Ctrl-C: once to save and end, twice to end at once.

use std::sync::atomic::{AtomicBool, Ordering};

/// A wish to stop, between whoever hears the signal and the job at work.
#[derive(Debug, Default)]
pub struct Interrupt {
    wanted: AtomicBool,
    heeded: AtomicBool,
}

impl Interrupt {
    /// Nobody wants anything yet.
    pub const fn new() -> Self {
        Self { wanted: AtomicBool::new(false), heeded: AtomicBool::new(false) }
    }

    /// Asks the job to stop. False when it will not do so by itself: it has nothing to save, or was asked before.
    pub fn request(&self) -> bool {
        !self.wanted.swap(true, Ordering::Relaxed) && self.heeded.load(Ordering::Relaxed)
    }

    /// Promises to look at the flag from now on.
    pub(crate) fn heed(&self) -> &AtomicBool {
        self.heeded.store(true, Ordering::Relaxed);
        &self.wanted
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_job_that_looks_is_asked_and_only_once() {
        assert!(!Interrupt::new().request());
        let interrupt = Interrupt::new();
        let flag = interrupt.heed();
        assert!(!flag.load(Ordering::Relaxed));
        assert!(interrupt.request() && flag.load(Ordering::Relaxed));
        assert!(!interrupt.request());
    }
}
