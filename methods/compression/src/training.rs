//! Encoding in steps.

use crate::CompressionError;
use std::fmt::{self, Debug, Formatter};
use weaver_io::safetensors::Tensors;

/// The encoding of a scene in steps, which can be interrupted and resumed.
///
/// A step has five stages: tasks due before it, such as pruning; drawing a view; the loss and its gradients; tasks on
/// these; the optimizer. A new training with the restored [state](Self::state) of another after `n` steps ends with the
/// same bytes.
pub trait Training: Debug {
    /// Finished steps, and steps of the whole.
    fn steps(&self) -> [usize; 2];

    /// Does the next step, and returns its loss.
    ///
    /// # Errors
    /// When a view cannot be drawn, or the loss is NaN or infinite.
    fn step(&mut self) -> Result<f64, CompressionError>;

    /// Everything for resuming.
    fn state(&self) -> Tensors;

    /// Restores a state.
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

/// A method without training: all of it is done in [`finish`](Training::finish).
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
