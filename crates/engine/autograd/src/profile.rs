//! Profiles of the time and the memory of a step.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// The total time of one kind of op, or of one timed part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OpTime {
    /// The name of the op, or of the part given to [`Tape::timed`](crate::Tape::timed).
    pub name: &'static str,
    /// Number of forward calls.
    pub calls: u64,
    /// Time of the forward calls.
    pub forward: Duration,
    /// Time of the backward calls.
    pub backward: Duration,
}

/// The times of all ops and parts that ran while profiling was on, in the order of their first calls.
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

/// The kind of an event in a trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// The forward call of an op.
    Forward,
    /// A forward call repeated during the backward pass of a [`checkpoint`](crate::ops::checkpoint), whose event
    /// contains it.
    Recompute,
    /// The backward call of an op.
    Backward,
    /// A part given to [`Tape::timed`](crate::Tape::timed), which may contain ops.
    Part,
}

/// One event of a trace: a call of an op, or a timed part.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TraceEvent {
    /// The name of the op or part.
    pub name: &'static str,
    /// The model path at which it ran.
    pub path: String,
    /// The kind of event.
    pub phase: Phase,
    /// The time of its start, since tracing was switched on.
    pub start: Duration,
    /// Its duration.
    pub duration: Duration,
}

/// All events since tracing was switched on, in order.
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

/// A trace that a tape shares with the tapes inside its ops. It is off at first.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tracer(Arc<Mutex<Option<Trace>>>);

impl Tracer {
    /// Starts a new trace, or discards it.
    pub(crate) fn set(&self, on: bool) {
        *self.trace() = on.then(Trace::new);
    }

    /// The trace, while it is on.
    pub(crate) fn trace(&self) -> MutexGuard<'_, Option<Trace>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The memory that all ops of one kind hold between the forward pass and the reset of the tape.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OpMemory {
    /// The name of the op; `leaves and constants` for tensors that no op computed.
    pub name: &'static str,
    /// Number of such ops on the tape.
    pub count: usize,
    /// Bytes of their outputs and of the state that they saved for the backward pass.
    pub bytes: usize,
}
