//! The meaning of a Gaussian's raw numbers: its offset from the pixel's point, its size and its color.

/// Decoding of raw parameters to a Gaussian.
///
/// In both parametrizations, opacity = sigmoid(raw), rotation = raw quaternion / (its norm + 1e-8), and spherical
/// harmonics of degree l > 0 are raw times 0.1 / 4^l, in world axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Parametrization {
    /// As published: lengths in world units, and colors from the network alone.
    ///
    /// mean = point + `offset_reach` tanh(raw); scale = min(`scale_multiplier` softplus(raw), `scale_max`).
    Published {
        /// Longest offset along each axis, in world units.
        offset_reach: f64,
        /// Scale per unit of softplus, in world units.
        scale_multiplier: f64,
        /// Largest scale, in world units.
        scale_max: f64,
    },
    /// Lengths in footprints; a pixel's footprint is its width at its depth, depth / fx in world units.
    ///
    /// mean = point + `offset_reach` footprint tanh(raw); scale = `scale` footprint exp(clamp(raw, -3, 3)) / sqrt(local
    /// count), so that a Gaussian starts as large as its share of the image; 1 is added to the raw quaternion's w and
    /// the pixel's own color to the degree-0 harmonic, so that it starts unrotated and in the right color.
    Footprint {
        /// Longest offset along each axis, in footprints.
        offset_reach: f64,
        /// Scale of a raw 0 at one Gaussian per pixel, in footprints.
        scale: f64,
    },
    /// Lengths in the extents of the patch of surface that a Gaussian stands for, and axes along it.
    ///
    /// mean = point + R (`offset_reach` extents tanh(raw)); scale = `scale` extents exp(clamp(raw, -3, 3)); rotation =
    /// R times the raw quaternion with 1 added to its w, normalized; the patch's mean color is added to the degree-0
    /// harmonic. So a Gaussian starts flat on its patch, as large as that and in its color; the only one of a single
    /// pixel starts as a ball, as under [`Footprint`](Self::Footprint). See [`PatchOf`](crate::PatchOf).
    Patch {
        /// Longest offset along each axis, in extents.
        offset_reach: f64,
        /// Scale of a raw 0, in extents.
        scale: f64,
    },
}

impl Parametrization {
    /// The published parametrization with the published constants: 0.005, 0.001 and 0.4 world units.
    pub fn published() -> Self {
        Self::Published { offset_reach: 0.005, scale_multiplier: 0.001, scale_max: 0.4 }
    }

    /// The footprint parametrization with the constants that measured best: offsets up to 2 footprints, scale 0.7.
    pub fn footprint() -> Self {
        Self::Footprint { offset_reach: 2.0, scale: 0.7 }
    }

    /// The patch parametrization with the constants of [`footprint`](Self::footprint), so that weights can go from one
    /// to the other: offsets up to 2 extents, scale 0.7.
    pub fn patch() -> Self {
        Self::Patch { offset_reach: 2.0, scale: 0.7 }
    }

    /// True if this parametrization needs the pixels' footprints and colors.
    pub fn is_relative(self) -> bool {
        !matches!(self, Self::Published { .. })
    }
}

/// Numbers in a network row before the spherical harmonics: opacity 1, scale 3, quaternion 4.
pub(crate) const BEFORE_HARMONICS: usize = 1 + 3 + 4;

/// Coefficients K = (degree + 1)^2 per color channel.
pub(crate) fn harmonics(degree: usize) -> usize {
    (degree + 1) * (degree + 1)
}

/// The number of raw numbers of one Gaussian: offset 3, opacity 1, scale 3, quaternion 4 (xyzw), harmonics 3 K
/// (color-major).
pub fn slot_width(sh_degree: usize) -> usize {
    3 + BEFORE_HARMONICS + 3 * harmonics(sh_degree)
}
