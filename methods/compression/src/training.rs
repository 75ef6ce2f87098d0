//! Encoding in steps.

use crate::CompressionError;
use std::fmt::{self, Debug, Formatter};
use weaver_io::safetensors::Tensors;

/// A scene on its way to bytes, in steps that can be stopped and gone on with.
///
/// A step has five stages: tasks that are due before it, such as pruning; drawing a view; the loss and its gradients;
/// tasks that see these; the optimizer. A training at its beginning that is given the [state](Self::state) of another
/// after `n` steps goes on to the same bytes as that one.
pub trait Training: Debug {
    /// Steps done, and steps of the whole.
    fn steps(&self) -> [usize; 2];

    /// Does the next step, and returns its loss.
    ///
    /// # Errors
    /// When a view cannot be drawn, or the loss is no number any more.
    fn step(&mut self) -> Result<f64, CompressionError>;

    /// Everything needed to go on.
    fn state(&self) -> Tensors;

    /// Goes to where a state was taken.
    ///
    /// # Errors
    /// When the state is of another training.
    fn restore(&mut self, state: &Tensors) -> Result<(), CompressionError>;

    /// The bytes of the trained scene.
    ///
    /// # Errors
    /// When it cannot be encoded.
    fn finish(self: Box<Self>) -> Result<Vec<u8>, CompressionError>;
}

/// A method that trains nothing: all of it is done in the end.
pub(crate) struct Untrained<F>(pub(crate) F);

impl<F> Debug for Untrained<F> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str("Untrained")
    }
}

impl<F: FnOnce() -> Result<Vec<u8>, CompressionError>> Training for Untrained<F> {
    fn steps(&self) -> [usize; 2] {
        [0, 0]
    }

    fn step(&mut self) -> Result<f64, CompressionError> {
        Ok(0.0)
    }

    fn state(&self) -> Tensors {
        Tensors::default()
    }

    fn restore(&mut self, _: &Tensors) -> Result<(), CompressionError> {
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<Vec<u8>, CompressionError> {
        self.0()
    }
}
