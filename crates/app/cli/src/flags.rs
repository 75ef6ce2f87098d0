//! Flags that several commands have.

mod cameras;
mod complete;
mod density;
mod hold_out;
mod level;
mod light;
mod masks;
mod matching;
mod minutes;
mod placing;
mod projection;
mod refine;

pub use cameras::CameraChoice;
pub use complete::{CompleteFlag, IfComplete};
pub use density::DensityFlags;
pub use hold_out::hold_out;
pub use level::level;
pub use light::LightFlags;
pub use masks::{LENSES, MASKED, MaskFlags, MaskedFlag};
pub use matching::{ClipFlags, MatchingFlags};
pub use minutes::minutes;
pub use placing::PlacingFlags;
pub use projection::{Projection, projection};
pub use refine::RefineFlags;
