//! The model path: where in the model an op is applied, for messages and profiles.

use super::{Record, Tape};
use crate::{Shape, ShapeError};
use std::fmt::{Display, Write};
use weaver_kernels::Real;

/// Keeps a path in force until it is dropped, by a panic, too.
pub(super) struct PathGuard<'t, T: Real> {
    tape: &'t Tape<T>,
    /// Where the text of paths ended before, and where its last path began.
    before: [usize; 2],
}

impl<T: Real> Drop for PathGuard<'_, T> {
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
    /// Appends `name` to the model path until the guard is dropped.
    pub(super) fn append_path(&self, name: impl Display) -> PathGuard<'_, T> {
        let record = &mut *self.record.borrow_mut();
        let before = [record.path.len(), record.path_start];
        let dot = if record.path().is_empty() { "" } else { "." };
        write!(record.path, "{dot}{name}").expect("writing to a string cannot fail");
        PathGuard { tape: self, before }
    }

    /// Puts `path` in place of the model path until the guard is dropped; an empty one changes nothing.
    pub(super) fn replace_path(&self, path: &str) -> PathGuard<'_, T> {
        let record = &mut *self.record.borrow_mut();
        let before = [record.path.len(), record.path_start];
        if !path.is_empty() {
            record.path_start = record.path.len();
            record.path.push_str(path);
        }
        PathGuard { tape: self, before }
    }

    /// Calls `watcher` with the model path whenever a [`part`](Tape::part) ends: how far a long forward pass is. It
    /// must not use the tape.
    pub fn watch(&self, watcher: impl Fn(&str) + Send + 'static) {
        self.record.borrow_mut().watcher = Some(Box::new(watcher));
    }

    /// Panics with the message of a [`ShapeError`] unless a condition holds: for functions made of several ops, which
    /// check the shapes of their arguments themselves.
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
