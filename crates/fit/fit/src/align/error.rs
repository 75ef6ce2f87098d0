//! Errors of a call.

use weaver_splat::RasterError;

/// Photos that cannot be aligned as they are given. `photo` counts from 0.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum AlignError {
    /// The numbers of a photo or of its mask do not fit its camera's size.
    #[error("photo {photo}: expected {expected} numbers in its {what} of {width}x{height}, found {found}")]
    Size {
        /// Number of the photo.
        photo: usize,
        /// Photo or mask.
        what: &'static str,
        /// Width of the camera, pixels.
        width: usize,
        /// Height of the camera, pixels.
        height: usize,
        /// Numbers of that size.
        expected: usize,
        /// Numbers there are.
        found: usize,
    },
    /// A pixel is infinite or not a number.
    #[error("photo {photo}: expected finite colors, found {value} at row {row}, column {column}")]
    NotFinite {
        /// Number of the photo.
        photo: usize,
        /// From the top.
        row: usize,
        /// From the left.
        column: usize,
        /// The number.
        value: f64,
    },
    /// Nothing of a photo counts.
    #[error("photo {photo}: expected a mask that leaves something, found none")]
    Masked {
        /// Number of the photo.
        photo: usize,
    },
    /// A length by which steps are measured is not one.
    #[error("expected a positive length as the scene's unit, found {0}")]
    Unit(f64),
    /// The rasterizer refuses.
    #[error(transparent)]
    Raster(#[from] RasterError),
}
