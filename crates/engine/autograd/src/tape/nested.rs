//! Tapes inside ops: the ops on them appear in the trace of the outer tape, below its model path.

use super::Tape;
use crate::Pool;
use crate::profile::Tracer;
use weaver_kernels::Real;

/// Settings that a tape inside an op takes over from the outer tape.
#[derive(Debug)]
pub(crate) struct Surroundings {
    tracer: Tracer,
    path: String,
}

impl<T: Real> Tape<T> {
    /// The state that tapes inside an op inherit from this tape at the current model path.
    pub(crate) fn surroundings(&self) -> Surroundings {
        Surroundings { tracer: self.tracer.clone(), path: self.record.borrow().path().to_string() }
    }

    /// An empty tape inside an op; `again` states that it recomputes an earlier forward pass.
    pub(crate) fn nested(around: &Surroundings, pool: Pool, again: bool) -> Self {
        let mut tape = Self::with_pool(pool);
        tape.tracer = around.tracer.clone();
        tape.again = again;
        tape.record.get_mut().path.push_str(&around.path);
        tape
    }
}
