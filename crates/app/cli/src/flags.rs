//! Flags that several commands have.

mod cameras;
mod complete;
mod density;
mod estimate;
mod light;
mod refine;

pub use cameras::CameraChoice;
pub use complete::{CompleteFlag, IfComplete};
pub use density::DensityFlags;
pub use estimate::{ClipFlags, EstimateFlags, MASKED, MaskedFlag, MatchingFlags};
pub use light::LightFlags;
pub use refine::RefineFlags;

use clap::builder::TypedValueParser;
use weaver_command::number;

/// A parser of minutes, of a fit or of all of a reconstruction.
pub fn minutes() -> impl TypedValueParser<Value = f64> {
    number(0.05..=10_000.0, "expected a number from 0.05 to 10000")
}

/// A parser of levels of `lite` settings that a fit is made for, from 0, the finest.
pub fn level() -> impl TypedValueParser<Value = f64> {
    number(0.0..=3.0, "expected a number from 0 to 3")
}
