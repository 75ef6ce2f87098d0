//! Photos keep their lens, or lose its distortion.

use serde::{Deserialize, Serialize};

/// Treatment of photos whose lens bends straight lines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Lenses {
    /// Photos of at least 120 degrees keep their lens; of others the distortion is undone.
    Auto,
    /// Photos keep their lens: nothing of them is lost, and scenes are drawn through it.
    Keep,
    /// Distortion is undone: a photo then shows what a pinhole sees, at most about 145 degrees.
    #[default]
    Undistort,
}

impl From<bool> for Lenses {
    /// Undone, or kept.
    fn from(undistort: bool) -> Self {
        if undistort { Self::Undistort } else { Self::Keep }
    }
}
