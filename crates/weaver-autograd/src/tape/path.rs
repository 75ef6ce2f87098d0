//! The model path: where in the model an op is applied, for messages and profiles.

use super::{Record, Tape};
use crate::{Shape, ShapeError};
use std::fmt::{Display, Write};
use weaver_kernels::Real;

/// Keeps a path in force; see [`Tape::scope`] and [`Tape::scope_at`].
#[derive(Debug)]
pub struct Scope<'t, T: Real> {
    tape: &'t Tape<T>,
    /// Where the text of paths ended before, and where its last path began.
    before: [usize; 2],
}

impl<T: Real> Drop for Scope<'_, T> {
    fn drop(&mut self) {
        let [end, start] = self.before;
        let record = &mut *self.tape.record.borrow_mut();
        if let Some(watcher) = record.watcher.as_ref().filter(|_| record.path_start == start) {
            watcher(record.path());
        }
        record.path.truncate(end);
        record.path_start = start;
    }
}

impl<T: Real> Record<T> {
    /// The model path in force.
    pub(super) fn path(&self) -> &str {
        &self.path[self.path_start..]
    }
}

impl<T: Real> Tape<T> {
    /// Appends `name` to the model path until the guard is dropped: `encoder`, then `encoder.block`, ...
    pub fn scope(&self, name: impl Display) -> Scope<'_, T> {
        let record = &mut *self.record.borrow_mut();
        let before = [record.path.len(), record.path_start];
        let dot = if record.path().is_empty() { "" } else { "." };
        write!(record.path, "{dot}{name}").expect("writing to a string cannot fail");
        Scope { tape: self, before }
    }

    /// Calls `watcher` with the model path whenever a [`scope`](Tape::scope) ends: how far a long forward pass is. It must not
    /// use the tape.
    pub fn watch(&self, watcher: impl Fn(&str) + Send + 'static) {
        self.record.borrow_mut().watcher = Some(Box::new(watcher));
    }

    /// Puts `path` in place of the model path until the guard is dropped: for layers, which know their full names. An empty one
    /// changes nothing.
    pub fn scope_at(&self, path: &str) -> Scope<'_, T> {
        let record = &mut *self.record.borrow_mut();
        let before = [record.path.len(), record.path_start];
        if !path.is_empty() {
            record.path_start = record.path.len();
            record.path.push_str(path);
        }
        Scope { tape: self, before }
    }

    /// Panics with the message of a [`ShapeError`] unless a condition holds: for functions made of several ops, which check the
    /// shapes of their arguments themselves.
    #[track_caller]
    pub fn ensure_shapes(&self, holds: bool, op: &'static str, expected: impl Display, found: &[Shape]) {
        if !holds {
            panic!("{}", self.located(ShapeError::expected(expected.to_string()), op, found));
        }
    }

    /// The error with the op, the model path and the shapes found.
    pub(super) fn located(&self, mut error: ShapeError, op: &'static str, found: &[Shape]) -> ShapeError {
        error.op = op;
        error.path = self.record.borrow().path().to_string();
        if error.found.is_empty() {
            error.found = found.iter().map(|s| format!("{s}")).collect::<Vec<_>>().join(", ");
        }
        error
    }
}
