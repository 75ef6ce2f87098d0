//! Named arrays of numbers: safetensors, NPY, PyTorch checkpoints.

pub(crate) mod array;
pub(crate) mod npy;
pub(crate) mod npz;
pub mod safetensors;
pub(crate) mod torch;
