//! Settings: how finely each kind of number is stored.

/// Precision of each kind of number, and its dependence on a Gaussian's visibility.
///
/// The visibility of a Gaussian is its opacity times the root of the product of its two largest scales. Colors and
/// rotations of those that show little are stored in larger steps, by up to twelve times, of those that show much in
/// smaller ones.
///
/// ```
/// use weaver_codec::lite::Quality;
///
/// assert_eq!(Quality::level(2.0), Quality::SETTINGS[2]);
/// assert!(Quality::level(0.5).sh_step > Quality::level(0.0).sh_step);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// Side of a voxel over the geometric mean of all scales.
    pub position: f64,
    /// Step of log scales.
    pub scale_step: f64,
    /// Steps of opacities in `[0, 1]`, 1 to 4095.
    pub opacity_levels: u32,
    /// Step of the imaginary parts of unit quaternions.
    pub rotation_step: f64,
    /// Step of harmonics of degree 0.
    pub dc_step: f64,
    /// Step of further harmonics.
    pub sh_step: f64,
    /// Offset of the rounding of further harmonics towards zero, in `[0, ½)`.
    pub dead_zone: f64,
    /// Power of a Gaussian's visibility by which steps of colors shrink: 0 for equal steps, 1 for equal errors in
    /// pictures where no Gaussian hides another.
    pub adaptation: f64,
    /// The same for rotations, where thinness counts as well.
    pub rotation_adaptation: f64,
}

impl Quality {
    /// Four settings, the finest first.
    pub const SETTINGS: [Self; 4] = [
        Self {
            position: 0.025,
            scale_step: 0.03,
            opacity_levels: 255,
            rotation_step: 0.005,
            dc_step: 0.025,
            sh_step: 0.03,
            dead_zone: 0.05,
            adaptation: 0.55,
            rotation_adaptation: 0.55,
        },
        Self {
            position: 0.065,
            scale_step: 0.09,
            opacity_levels: 127,
            rotation_step: 0.0125,
            dc_step: 0.07,
            sh_step: 0.064,
            dead_zone: 0.1,
            adaptation: 0.55,
            rotation_adaptation: 0.55,
        },
        Self {
            position: 0.14,
            scale_step: 0.18,
            opacity_levels: 63,
            rotation_step: 0.022,
            dc_step: 0.13,
            sh_step: 0.13,
            dead_zone: 0.15,
            adaptation: 0.55,
            rotation_adaptation: 0.55,
        },
        Self {
            position: 0.28,
            scale_step: 0.3,
            opacity_levels: 31,
            rotation_step: 0.035,
            dc_step: 0.22,
            sh_step: 0.22,
            dead_zone: 0.2,
            adaptation: 0.55,
            rotation_adaptation: 0.55,
        },
    ];

    /// One number for all of them: 0 is the finest setting, 3 the coarsest; in between steps are interpolated
    /// geometrically.
    ///
    /// Numbers outside are clamped; NaN is 0.
    pub fn level(level: f64) -> Self {
        let level = if level.is_nan() { 0.0 } else { level.clamp(0.0, 3.0) };
        let below = (level as usize).min(2);
        let (a, b, share) = (Self::SETTINGS[below], Self::SETTINGS[below + 1], level - below as f64);
        if share == 0.0 || share == 1.0 {
            return if share == 0.0 { a } else { b };
        }
        let mix = |of: fn(&Self) -> f64| of(&a) * (of(&b) / of(&a)).powf(share);
        Self {
            position: mix(|q| q.position),
            scale_step: mix(|q| q.scale_step),
            opacity_levels: mix(|q| f64::from(q.opacity_levels)).round() as u32,
            rotation_step: mix(|q| q.rotation_step),
            dc_step: mix(|q| q.dc_step),
            sh_step: mix(|q| q.sh_step),
            dead_zone: mix(|q| q.dead_zone),
            adaptation: mix(|q| q.adaptation),
            rotation_adaptation: mix(|q| q.rotation_adaptation),
        }
    }
}

impl Default for Quality {
    /// The second setting.
    fn default() -> Self {
        Self::SETTINGS[1]
    }
}
