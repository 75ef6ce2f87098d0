//! Named arrays of numbers: safetensors, NPY, PyTorch checkpoints.

pub(crate) mod array;
pub(crate) mod npy;
pub mod safetensors;
pub(crate) mod torch;
