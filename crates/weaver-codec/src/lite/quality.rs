//! Settings: how finely each kind of number is stored.

/// How finely each kind of number is stored, and how that follows what a Gaussian can show.
///
/// ```
/// use weaver_codec::lite::Quality;
///
/// assert!(Quality::SETTINGS[0].sh_step < Quality::SETTINGS[3].sh_step);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// Side of a voxel over the reference scale of the scene.
    pub position: f64,
    /// Step of log scales.
    pub scale_step: f64,
    /// Steps of opacities in `[0, 1]`.
    pub opacity_levels: u32,
    /// Step of the imaginary parts of unit quaternions.
    pub rotation_step: f64,
    /// Step of the harmonics of degree 0.
    pub dc_step: f64,
    /// Step of further harmonics.
    pub sh_step: f64,
    /// Offset of the rounding of further harmonics towards zero.
    pub dead_zone: f64,
    /// Power of what a Gaussian can show by which its steps shrink: 0 for equal steps, 1 for equal errors of pictures.
    pub adaptation: f64,
    /// The same for rotations, where thinness counts as well.
    pub rotation_adaptation: f64,
}

impl Quality {
    /// Four settings, the finest first.
    pub const SETTINGS: [Self; 4] = [
        Self::row(0.02, 1.0 / 16.0, 255, 1.4 / 1023.0, 0.02, 1.0 / 32.0, 0.0),
        Self::row(0.08, 1.0 / 8.0, 255, 1.4 / 255.0, 0.05, 1.0 / 16.0, 0.1),
        Self::row(0.16, 1.0 / 6.0, 63, 1.4 / 127.0, 0.1, 1.0 / 8.0, 0.15),
        Self::row(0.32, 1.0 / 4.0, 31, 1.4 / 63.0, 0.15, 1.0 / 5.0, 0.2),
    ];

    const fn row(
        position: f64,
        scale_step: f64,
        opacity_levels: u32,
        rotation_step: f64,
        dc_step: f64,
        sh_step: f64,
        dead_zone: f64,
    ) -> Self {
        Self {
            position,
            scale_step,
            opacity_levels,
            rotation_step,
            dc_step,
            sh_step,
            dead_zone,
            adaptation: 0.0,
            rotation_adaptation: 0.0,
        }
    }
}
