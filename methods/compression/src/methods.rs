//! The methods, a file each.

mod c3dgs;
mod controls;
mod format;
mod hac_lite;
mod light_gaussian;
mod lite;
mod meson_gs;
mod pruning;
mod speedy_splat;

pub use c3dgs::C3dgs;
pub use controls::{Half, Zstd};
pub use format::Format;
pub use hac_lite::HacLite;
pub use light_gaussian::LightGaussian;
pub use lite::Lite;
pub use meson_gs::MesonGs;
pub use speedy_splat::SpeedySplat;
