//! Memory that operations on the tape share from step to step.

use crate::error::RasterError;
use std::sync::{Arc, Mutex, PoisonError};

/// Free memory, and the first failure of its users.
#[derive(Debug)]
pub(crate) struct Shelf<S> {
    free: Arc<Mutex<Vec<S>>>,
    failure: Arc<Mutex<Option<RasterError>>>,
}

impl<S> Clone for Shelf<S> {
    fn clone(&self) -> Self {
        Self { free: self.free.clone(), failure: self.failure.clone() }
    }
}

impl<S> Default for Shelf<S> {
    fn default() -> Self {
        Self { free: Arc::default(), failure: Arc::default() }
    }
}

impl<S> Shelf<S> {
    /// Takes memory that is free, or new memory.
    pub fn take(&self, new: impl FnOnce() -> S) -> S {
        let free = self.free.lock().unwrap_or_else(PoisonError::into_inner).pop();
        free.unwrap_or_else(new)
    }

    /// Puts memory back that an operation held.
    pub fn put_back(&self, held: &mut Mutex<Option<S>>) {
        let held = held.get_mut().unwrap_or_else(PoisonError::into_inner).take();
        self.free.lock().unwrap_or_else(PoisonError::into_inner).extend(held);
    }

    /// Takes the first failure since the last call.
    pub fn failure(&self) -> Option<RasterError> {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Records a failure: the first is the cause, the rest follow from it.
    pub fn fail(&self, error: RasterError) {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
    }
}
