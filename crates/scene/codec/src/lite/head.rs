//! The parameters that a decoder reads before the symbols.

use super::quality::Quality;
use crate::error::CodecError;
use crate::exact::exp;
use crate::octree::DEEPEST;
use std::sync::LazyLock;

/// Largest magnitude of a symbol, which leaves room for differences.
pub(super) const LARGEST: i32 = 1 << 22;

/// Parts of a unit in which steps and logarithms are stored.
pub(super) const UNIT: f64 = 65_536.0;

/// The version of models and symbols, at the end of a head. The first one had none there.
const VERSION: u8 = 3;

/// Bytes of a head.
const BYTES: usize = 12 + 4 + 1 + 10 * 4 + 1;

/// Grid, steps, and the dependence of steps on a Gaussian's visibility.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Head {
    /// Corner of the grid, and side of a voxel.
    pub(super) origin: [f32; 3],
    pub(super) cell: f32,
    /// Bits of a coordinate.
    pub(super) depth: u8,
    /// Steps, in parts of 2^16.
    pub(super) scale_step: u32,
    pub(super) opacity_levels: u32,
    pub(super) rotation_step: u32,
    pub(super) dc_step: u32,
    pub(super) sh_step: u32,
    /// Powers, in parts of 2^16.
    pub(super) adaptation: u32,
    pub(super) rotation_adaptation: u32,
    /// Logarithm of the visibility at which a Gaussian has the steps above, in parts of 2^16.
    pub(super) reference: i32,
    /// Means of the largest log scales and of opacities, as symbols.
    pub(super) scale_mean: i32,
    pub(super) opacity_mean: i32,
}

impl Head {
    pub(super) fn new(quality: &Quality) -> Self {
        let parts = |x: f64| ((x * UNIT).round() as u32).max(1);
        Self {
            origin: [0.0; 3],
            cell: 1.0,
            depth: 0,
            scale_step: parts(quality.scale_step),
            opacity_levels: quality.opacity_levels,
            rotation_step: parts(quality.rotation_step),
            dc_step: parts(quality.dc_step),
            sh_step: parts(quality.sh_step),
            adaptation: (quality.adaptation * UNIT).round() as u32,
            rotation_adaptation: (quality.rotation_adaptation * UNIT).round() as u32,
            reference: 0,
            scale_mean: 0,
            opacity_mean: 0,
        }
    }

    /// Logarithm of a Gaussian's visibility against the reference, opacity times the root of its largest area, in parts
    /// of 2^16.
    pub(super) fn shows(&self, scales: [i32; 3], opacity: i32, ln_opacity: &[i64]) -> i64 {
        let area = i64::from(scales[0]) + i64::from(scales[1]);
        area * i64::from(self.scale_step) / 2 + ln_opacity[opacity as usize] - i64::from(self.reference)
    }

    /// Factor of steps, smaller where more is to be seen.
    fn factor(&self, shows: i64, power: u32) -> f64 {
        let exponent = -(shows.clamp(-1 << 30, 1 << 30) * i64::from(power)) >> (32 - 6);
        FACTORS[(exponent.clamp(FINEST, COARSEST) - FINEST) as usize]
    }

    /// Steps of one Gaussian by the symbols that come first.
    pub(super) fn steps(&self, scales: [i32; 3], shows: i64) -> Steps {
        let factor = self.factor(shows, self.adaptation);
        // A rotation moves the difference of two scales: thin Gaussians show it more.
        let thin = i64::from(scales[0]).saturating_sub(i64::from(scales[2])) * i64::from(self.scale_step);
        let thin = thin.min((2.0 * UNIT) as i64) - UNIT as i64;
        let rotation = f64::from(self.rotation_step) / UNIT;
        Steps { rotation: rotation * self.factor(shows + thin, self.rotation_adaptation), factor }
    }

    pub(super) fn write(&self) -> Vec<u8> {
        let floats = [self.origin[0], self.origin[1], self.origin[2], self.cell];
        let mut out: Vec<u8> = floats.iter().flat_map(|x| x.to_le_bytes()).collect();
        out.push(self.depth);
        let steps = [self.scale_step, self.opacity_levels, self.rotation_step, self.dc_step, self.sh_step];
        out.extend(steps.iter().chain(&[self.adaptation, self.rotation_adaptation]).flat_map(|x| x.to_le_bytes()));
        out.extend([self.reference, self.scale_mean, self.opacity_mean].iter().flat_map(|x| x.to_le_bytes()));
        out.push(VERSION);
        out
    }

    pub(super) fn read(bytes: &[u8]) -> Result<Self, CodecError> {
        let version = if bytes.len() == BYTES - 1 { 1 } else { bytes.last().copied().unwrap_or(VERSION) };
        if version != VERSION {
            return Err(CodecError::Version { expected: VERSION, found: version });
        }
        if bytes.len() != BYTES {
            return Err(CodecError::invalid("stream head", format!("{BYTES} bytes"), bytes.len()));
        }
        let word = |at: usize| [bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]];
        let float = |i: usize| f32::from_le_bytes(word(4 * i));
        let number = |i: usize| u32::from_le_bytes(word(17 + 4 * i));
        let signed = |i: usize| i32::from_le_bytes(word(17 + 4 * i));
        let head = Self {
            origin: [float(0), float(1), float(2)],
            cell: float(3),
            depth: bytes[16],
            scale_step: number(0),
            opacity_levels: number(1),
            rotation_step: number(2),
            dc_step: number(3),
            sh_step: number(4),
            adaptation: number(5),
            rotation_adaptation: number(6),
            reference: signed(7),
            scale_mean: signed(8),
            opacity_mean: signed(9),
        };
        head.check()?;
        Ok(head)
    }

    fn check(&self) -> Result<(), CodecError> {
        let grid = self.origin.iter().chain([&self.cell]).all(|x| x.is_finite()) && self.cell >= 0.0;
        if !grid {
            let found = format!("{:?} and {}", self.origin, self.cell);
            return Err(CodecError::invalid("stream head, grid", "a finite corner and side", found));
        }
        if u32::from(self.depth) > DEEPEST {
            return Err(CodecError::invalid("stream head, bits of a coordinate", "up to 21", self.depth));
        }
        if !(1..=MOST_LEVELS).contains(&self.opacity_levels) {
            return Err(CodecError::invalid("stream head, opacities", "1 to 4095 steps", self.opacity_levels));
        }
        let means = self.scale_mean.unsigned_abs() <= LARGEST as u32
            && (0..=self.opacity_levels as i32).contains(&self.opacity_mean);
        if !means {
            let found = format!("{} and {}", self.scale_mean, self.opacity_mean);
            return Err(CodecError::invalid("stream head, means", "symbols of a scale and an opacity", found));
        }
        Ok(())
    }
}

/// Steps of one Gaussian.
#[derive(Clone, Copy, Debug)]
pub(super) struct Steps {
    pub(super) rotation: f64,
    /// Of the steps of colors.
    pub(super) factor: f64,
}

/// Logarithms of the least and the largest factor of steps, in parts of 64.
const FINEST: i64 = -96;
const COARSEST: i64 = 160;

/// All factors of steps.
static FACTORS: LazyLock<[f64; (COARSEST - FINEST + 1) as usize]> =
    LazyLock::new(|| std::array::from_fn(|i| exp((i as i64 + FINEST) as f64 / 64.0)));

/// Steps of opacities at most.
pub(super) const MOST_LEVELS: u32 = 4095;
