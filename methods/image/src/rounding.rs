//! Numbers of Gaussians as symbols of a file, and back.

use crate::gaussians::Gaussians;
use std::f64::consts::PI;

/// Steps of the base-2 logarithms of the smaller scale and of the ratio of both.
const SCALE_STEP: f64 = 0.35;
/// The smaller scale of symbol 0, pixels.
const SCALE: f64 = 0.5;
/// Classes by the smaller scale: a further one for each doubling.
pub const CLASSES: usize = 8;
/// Steps of positions in pixels and of luma in the first class; the former grow and the latter fall by a root of two
/// with each class.
const POSITION_STEP: f64 = 0.35;
const LUMA_STEP: f64 = 0.035 * std::f64::consts::SQRT_2;
/// Ratio of the steps of chroma and luma.
const CHROMA: f64 = 2.0;
/// Largest symbol of scales and their ratios.
const LARGEST_SCALE: f64 = 100.0;
pub const LARGEST_RATIO: i64 = 40;

/// The symbols of a Gaussian.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Symbols {
    /// Smaller scale.
    pub scale: i64,
    /// Ratio of the scales, 0 for a circle.
    pub ratio: i64,
    /// Angle of the larger axis.
    pub angle: u32,
    /// Position.
    pub position: [u32; 2],
    /// Y, Co, Cg.
    pub color: [i64; 3],
}

/// The grid of the symbols of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    /// Columns and rows of the picture.
    pub size: [usize; 2],
}

/// The class of a smaller scale.
pub fn class(scale: i64) -> usize {
    ((scale as f64 * SCALE_STEP).floor().max(0.0) as usize).min(CLASSES - 1)
}

/// Bits of an angle: the power of two nearest to 4 + 10 (r - 1/r); none for a circle.
pub fn angle_bits(ratio: i64) -> u32 {
    if ratio == 0 {
        return 0;
    }
    let ratio = (ratio as f64 * SCALE_STEP).exp2();
    (4.0 + 10.0 * (ratio - 1.0 / ratio)).log2().round() as u32
}

fn position_step(class: usize) -> f64 {
    POSITION_STEP * (0.5 * class as f64).exp2()
}

fn color_step(class: usize, channel: usize) -> f64 {
    let luma = LUMA_STEP * (-0.5 * class as f64).exp2();
    if channel == 0 { luma } else { CHROMA * luma }
}

impl Grid {
    /// Margin for centers beyond the picture in pixels, a quarter of the longer side.
    fn margin(&self) -> f64 {
        (self.size[0].max(self.size[1]) as f64 / 4.0).ceil()
    }

    /// The largest symbol of a position.
    pub fn last(&self, class: usize, axis: usize) -> u32 {
        ((self.size[axis] as f64 + 2.0 * self.margin()) / position_step(class)).floor() as u32
    }

    /// Bits of the longest Morton code of a position.
    pub fn morton_bits(&self, class: usize) -> usize {
        let last = self.last(class, 0).max(self.last(class, 1));
        2 * (u32::BITS - last.leading_zeros()) as usize
    }

    /// The symbols nearest to a Gaussian.
    pub fn symbols(&self, gaussians: &Gaussians<f32>, i: usize) -> Symbols {
        let [s1, s2] = [gaussians.scales[2 * i], gaussians.scales[2 * i + 1]].map(f64::from);
        let (small, large) = (s1.min(s2), s1.max(s2));
        let scale = ((small / SCALE).log2() / SCALE_STEP).round().clamp(-LARGEST_SCALE, LARGEST_SCALE) as i64;
        let ratio = (((large / small).log2() / SCALE_STEP).round() as i64).min(LARGEST_RATIO);
        let axis = f64::from(gaussians.angles[i]) + if s1 >= s2 { 0.0 } else { 0.5 * PI };
        let angles = 1_u32 << angle_bits(ratio);
        let angle = ((axis / PI).rem_euclid(1.0) * f64::from(angles)).round() as u32 % angles;
        let class = class(scale);
        let position = [0, 1].map(|axis| {
            let x = (f64::from(gaussians.centers[2 * i + axis]) + self.margin()) / position_step(class);
            (x.round().max(0.0) as u32).min(self.last(class, axis))
        });
        let color = color_symbols(class, &gaussians.colors[3 * i..3 * i + 3]);
        Symbols { scale, ratio, angle, position, color }
    }

    /// The center of symbols.
    pub fn center(&self, symbols: &Symbols) -> [f64; 2] {
        symbols.position.map(|x| f64::from(x) * position_step(class(symbols.scale)) - self.margin())
    }

    /// Writes the Gaussian of these symbols: shape, position, color, as selected by `parts`.
    pub fn write(&self, symbols: &Symbols, to: &mut Gaussians<f32>, i: usize, parts: Parts) {
        let class = class(symbols.scale);
        if parts.shape {
            let small = SCALE * (symbols.scale as f64 * SCALE_STEP).exp2();
            let large = small * (symbols.ratio as f64 * SCALE_STEP).exp2();
            to.scales[2 * i..2 * i + 2].copy_from_slice(&[large as f32, small as f32]);
            let angles = f64::from(1_u32 << angle_bits(symbols.ratio));
            to.angles[i] = (PI * f64::from(symbols.angle) / angles) as f32;
        }
        if parts.position {
            to.centers[2 * i..2 * i + 2].copy_from_slice(&self.center(symbols).map(|x| x as f32));
        }
        if parts.color {
            let [y, co, cg]: [f64; 3] = std::array::from_fn(|c| symbols.color[c] as f64 * color_step(class, c));
            let rgb = [y + co - cg, y + cg, y - co - cg].map(|x| x as f32);
            to.colors[3 * i..3 * i + 3].copy_from_slice(&rgb);
        }
    }

    /// Rounds parts of a Gaussian to the grid.
    pub fn round(&self, gaussians: &mut Gaussians<f32>, i: usize, parts: Parts) {
        let symbols = self.symbols(gaussians, i);
        self.write(&symbols, gaussians, i, parts);
    }
}

fn color_symbols(class: usize, rgb: &[f32]) -> [i64; 3] {
    let [r, g, b] = [0, 1, 2].map(|c| f64::from(rgb[c]));
    let turned = [0.25 * r + 0.5 * g + 0.25 * b, 0.5 * (r - b), 0.5 * g - 0.25 * (r + b)];
    std::array::from_fn(|c| (turned[c] / color_step(class, c)).round().clamp(-1e6, 1e6) as i64)
}

/// Parts of a Gaussian.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Parts {
    pub shape: bool,
    pub position: bool,
    pub color: bool,
}
