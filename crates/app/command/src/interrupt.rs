//! Ctrl-C: the first saves and ends, the second ends at once.

use std::sync::atomic::{AtomicBool, Ordering};

/// A request to stop, passed from the signal handler to the running job.
#[derive(Debug, Default)]
pub struct Interrupt {
    requested: AtomicBool,
    watched: AtomicBool,
}

impl Interrupt {
    /// No stop is requested yet.
    pub const fn new() -> Self {
        Self { requested: AtomicBool::new(false), watched: AtomicBool::new(false) }
    }

    /// Asks the job to stop. False when the job does not watch for requests (it has nothing to save) or was asked before.
    pub fn request(&self) -> bool {
        !self.requested.swap(true, Ordering::Relaxed) && self.watched.load(Ordering::Relaxed)
    }

    /// True if a stop was requested.
    pub fn is_requested(&self) -> bool {
        self.requested.load(Ordering::Relaxed)
    }

    /// The flag that a job promises to check from now on.
    pub fn watch(&self) -> &AtomicBool {
        self.watched.store(true, Ordering::Relaxed);
        &self.requested
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_job_that_looks_is_asked_and_only_once() {
        assert!(!Interrupt::new().request());
        let interrupt = Interrupt::new();
        let flag = interrupt.watch();
        assert!(!flag.load(Ordering::Relaxed));
        assert!(interrupt.request() && flag.load(Ordering::Relaxed));
        assert!(!interrupt.request());
    }
}
