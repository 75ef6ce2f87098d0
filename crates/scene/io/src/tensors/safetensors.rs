//! Safetensors files: read whole ([`Tensors`]), mapped into memory and read in place ([`Mapped`]), written whole
//! ([`Tensors::write`]) or one tensor after another ([`write_weights`]).

mod header_fault;
mod mapped;
mod owned;
mod streamed;

pub use mapped::{Array, Mapped, Slice, Storage};
pub use owned::{Element, Tensor, TensorData, Tensors};
pub use streamed::{Planned, write_weights};
