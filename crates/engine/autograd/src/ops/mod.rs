//! The built-in ops, one per file; most are methods of [`Var`](crate::Var).
//!
//! Shapes are checked when an op is applied: inputs that do not fit cause a panic with the model path, the name of the
//! op, and the shapes expected and found.

pub mod activations;
mod attention;
mod binary_cross_entropy;
mod checkpoint;
mod concat;
mod conv1d;
mod conv2d;
mod conv_transpose2d;
mod cross_entropy;
mod expand;
mod gather_rows;
mod gelu;
mod huber;
mod layer_norm;
mod linear;
mod log_softmax;
mod matmul;
mod normalize_rows;
mod permute;
pub mod pointwise_ops;
mod resample;
mod rms_norm;
mod rope2d;
mod scale_residual;
mod scatter_add_rows;
mod slice;
mod softmax;
mod straight_through;
mod strided;
mod sum;
mod sum_axis;
mod top_k;

pub use attention::attention;
pub use binary_cross_entropy::binary_cross_entropy;
pub use checkpoint::checkpoint;
pub use concat::concat;
pub use conv_transpose2d::conv_transpose2d;
pub use conv1d::conv1d;
pub use conv2d::conv2d;
pub use cross_entropy::cross_entropy;
pub use huber::{Huber, huber};
pub use linear::{Activation, linear};
pub use rope2d::RopeTable;
pub use scale_residual::scale_residual;
pub use slice::split;
pub use straight_through::straight_through;
pub use top_k::{mean_at_top_k, top_k_mean};
