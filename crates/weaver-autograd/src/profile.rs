//! Where the time and the memory of a step go.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Time spent in one kind of work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OpTime {
    /// The op's name, or that of the part given to [`Tape::timed`](crate::Tape::timed).
    pub name: &'static str,
    /// Calls forward.
    pub calls: u64,
    /// Time forward.
    pub forward: Duration,
    /// Time backward.
    pub backward: Duration,
}

/// The times of everything that ran while profiling was on, in the order of first calls.
#[derive(Clone, Debug, Default)]
pub(crate) struct Profile {
    times: Vec<OpTime>,
}

impl Profile {
    fn entry(&mut self, name: &'static str) -> &mut OpTime {
        let at = self.times.iter().position(|t| t.name == name).unwrap_or_else(|| {
            self.times.push(OpTime { name, calls: 0, forward: Duration::ZERO, backward: Duration::ZERO });
            self.times.len() - 1
        });
        &mut self.times[at]
    }

    pub(crate) fn forward(&mut self, name: &'static str, time: Duration) {
        let entry = self.entry(name);
        entry.calls += 1;
        entry.forward += time;
    }

    pub(crate) fn backward(&mut self, name: &'static str, time: Duration) {
        self.entry(name).backward += time;
    }

    pub(crate) fn into_times(self) -> Vec<OpTime> {
        self.times
    }
}

/// What an event of a trace is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// An op forward.
    Forward,
    /// An op forward once more, on the way back through a [`checkpoint`](crate::ops::checkpoint), whose event lasts longer.
    Again,
    /// An op backward.
    Backward,
    /// Something given to [`Tape::timed`](crate::Tape::timed), which may hold ops.
    Part,
}

/// One op as it ran.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TraceEvent {
    /// The op's name, or that of the part.
    pub name: &'static str,
    /// Where in the model it was applied.
    pub path: String,
    /// Which way.
    pub phase: Phase,
    /// When it began, since tracing was started.
    pub start: Duration,
    /// How long it took.
    pub duration: Duration,
}

/// Every op that ran while tracing was on, in order.
#[derive(Debug)]
pub(crate) struct Trace {
    started: Instant,
    pub(crate) events: Vec<TraceEvent>,
}

impl Trace {
    pub(crate) fn new() -> Self {
        Self { started: Instant::now(), events: Vec::new() }
    }

    pub(crate) fn add(&mut self, name: &'static str, path: &str, phase: Phase, began: Instant, duration: Duration) {
        let start = began.saturating_duration_since(self.started);
        self.events.push(TraceEvent { name, path: path.to_string(), phase, start, duration });
    }
}

/// A trace that a tape shares with the tapes inside its ops; off at first.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tracer(Arc<Mutex<Option<Trace>>>);

impl Tracer {
    /// Starts a trace, or forgets it.
    pub(crate) fn set(&self, on: bool) {
        *self.trace() = on.then(Trace::new);
    }

    /// The trace, while it is on.
    pub(crate) fn trace(&self) -> MutexGuard<'_, Option<Trace>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The memory that one kind of op holds from its forward pass until the tape is reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OpMemory {
    /// The op's name; `leaves and constants` for what no op made.
    pub name: &'static str,
    /// How many of them are on the tape.
    pub count: usize,
    /// Bytes of their outputs and of what they saved for the way back.
    pub bytes: usize,
}
