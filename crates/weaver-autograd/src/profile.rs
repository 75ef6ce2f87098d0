//! Where the time of a step goes.

use std::time::Duration;

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
