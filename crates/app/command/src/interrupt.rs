//! Ctrl-C: the first saves and ends, the second ends at once.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

/// A request to stop, passed from the signal handler to the running job.
#[derive(Debug, Default)]
pub struct Interrupt {
    requested: AtomicBool,
    watched: AtomicBool,
    /// The end that a stop waits for.
    awaited: OnceLock<&'static str>,
}

impl Interrupt {
    /// No stop is requested yet.
    pub const fn new() -> Self {
        Self { requested: AtomicBool::new(false), watched: AtomicBool::new(false), awaited: OnceLock::new() }
    }

    /// Requests a stop. False when the job does not watch for requests (it has nothing to save) or a stop was requested
    /// before.
    pub fn request(&self) -> bool {
        !self.requested.swap(true, Ordering::Relaxed) && self.watched.load(Ordering::Relaxed)
    }

    /// True if a stop was requested.
    pub fn is_requested(&self) -> bool {
        self.requested.load(Ordering::Relaxed)
    }

    /// The flag that a job promises to check from now on, after each `part` of its work, such as a step. A stop waits
    /// for the end of the current part, whose kind is [reported](Self::awaited).
    pub fn watch_after(&self, part: &'static str) -> &AtomicBool {
        let _ = self.awaited.set(part);
        self.watch()
    }

    /// The part of the work whose end a stop waits for; `None` of jobs that end at once.
    pub fn awaited(&self) -> Option<&'static str> {
        self.awaited.get().copied()
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

    /// A job whose parts take long says which end a stop waits for.
    ///
    /// Promise (files): Ctrl-C reports the work that it waits for.
    #[test]
    fn a_stop_says_what_it_waits_for() {
        let interrupt = Interrupt::new();
        assert_eq!(interrupt.awaited(), None);
        interrupt.watch_after("this step");
        assert!(interrupt.request());
        assert_eq!(interrupt.awaited(), Some("this step"));
    }
}
