//! Symbols of a block by adaptive models of order 0, in classes and Morton order.

use crate::error::{ImageError, invalid};
use crate::rounding::{CLASSES, Grid, LARGEST_RATIO, Symbols, angle_bits, class};
use weaver_codec::{AdaptiveModel, Coder, from_morton2, morton2};

/// Weights of the mean of the last three colors in the prediction of the next, in twentieths.
pub const WEIGHTS: [i64; 4] = [0, 7, 14, 20];
/// Bits of the longest numbers: of counts and colors, and of scales.
const LONG: usize = 32;
const SHORT: usize = 8;

/// Sorts symbols into the order of coding.
pub fn sort(symbols: &mut [Symbols]) {
    symbols.sort_by_key(|s| (class(s.scale), morton2(s.position), s.scale, s.ratio, s.angle, s.color));
}

/// A model of whole numbers: length in bits, the two bits behind the highest one, raw bits, sign.
struct Number {
    length: AdaptiveModel,
    top: Vec<AdaptiveModel>,
    sign: AdaptiveModel,
}

impl Number {
    fn new(longest: usize) -> Self {
        let top = (0..=longest).map(|_| AdaptiveModel::new(4)).collect();
        Self { length: AdaptiveModel::new(longest + 1), top, sign: AdaptiveModel::new(2) }
    }

    fn code(&mut self, coder: &mut impl Coder, value: u64) -> u64 {
        let length = self.length.code(coder, (u64::BITS - value.leading_zeros()) as usize) as u32;
        if length < 2 {
            return u64::from(length);
        }
        let below = length - 1;
        let modeled = below.min(2);
        let rest = below - modeled;
        let top = self.top[length as usize].code(coder, (value >> rest & ((1 << modeled) - 1)) as usize);
        let mut found = 1 << modeled | (top as u64 & ((1 << modeled) - 1));
        let mut left = rest;
        while left > 0 {
            let bits = left.min(32);
            left -= bits;
            let part = value >> left & ((1 << bits) - 1);
            found = found << bits | u64::from(coder.raw(bits, part as u32));
        }
        found
    }

    fn signed(&mut self, coder: &mut impl Coder, value: i64) -> i64 {
        let magnitude = self.code(coder, value.unsigned_abs()) as i64;
        match magnitude {
            0 => 0,
            _ if self.sign.code(coder, usize::from(value < 0)) == 1 => -magnitude,
            _ => magnitude,
        }
    }
}

/// Models of the symbols of a block.
pub struct Models {
    grid: Grid,
    counts: Number,
    positions: Number,
    scales: Number,
    ratios: Number,
    colors: [Number; 3],
    /// Indices into [`WEIGHTS`] of the predictions of colors.
    weights: [usize; 3],
}

impl Models {
    pub fn new(grid: Grid, weights: [usize; 3]) -> Self {
        Self {
            grid,
            counts: Number::new(LONG),
            positions: Number::new(SHORT),
            scales: Number::new(SHORT),
            ratios: Number::new(SHORT),
            colors: [(); 3].map(|()| Number::new(LONG)),
            weights,
        }
    }

    /// Codes all symbols, in order of classes and Morton codes; a decoder reads them from its stream.
    pub fn code(
        &mut self,
        coder: &mut impl Coder,
        given: &[Symbols],
        count: usize,
    ) -> Result<Vec<Symbols>, ImageError> {
        let mut out: Vec<Symbols> = Vec::with_capacity(count);
        for class_now in 0..CLASSES {
            let own = given.iter().filter(|s| class(s.scale) == class_now).count();
            let own = self.counts.code(coder, own as u64);
            if own > (count - out.len()) as u64 {
                return Err(invalid("Gaussians of a class", format!("at most {}", count - out.len()), own));
            }
            self.positions = Number::new(self.grid.morton_bits(class_now));
            self.scales = Number::new(SHORT);
            self.ratios = Number::new(SHORT);
            let first = out.len();
            let mut morton = 0_u64;
            for _ in 0..own {
                let symbols = given.get(out.len()).copied().unwrap_or_default();
                let step = self.positions.code(coder, morton2(symbols.position).wrapping_sub(morton));
                morton = morton.wrapping_add(step);
                let next = self.gaussian(coder, &symbols, &out[first..])?;
                out.push(Symbols { position: from_morton2(morton), ..next });
                if class(next.scale) != class_now || coder.exhausted() {
                    return Err(invalid("scale of a Gaussian", format!("one of class {class_now}"), next.scale));
                }
            }
        }
        if out.len() < count {
            return Err(invalid("Gaussians of all classes", count, out.len()));
        }
        Ok(out)
    }

    /// Codes a Gaussian without its position, after the others of its class.
    fn gaussian(&mut self, coder: &mut impl Coder, given: &Symbols, before: &[Symbols]) -> Result<Symbols, ImageError> {
        let scale = self.scales.signed(coder, given.scale);
        let ratio = self.ratios.code(coder, given.ratio as u64) as i64;
        if ratio > LARGEST_RATIO {
            return Err(invalid("ratio of scales", format!("at most {LARGEST_RATIO}"), ratio));
        }
        let angle = match angle_bits(ratio) {
            0 => 0,
            bits => coder.raw(bits, given.angle),
        };
        let last = &before[before.len().saturating_sub(3)..];
        let mut color = [0; 3];
        for (c, to) in color.iter_mut().enumerate() {
            let sum: i64 = last.iter().map(|s| s.color[c]).sum();
            let parts = 20 * last.len().max(1) as i64;
            // Rounded to the nearest, in whole numbers.
            let expected = (2 * WEIGHTS[self.weights[c]] * sum + parts).div_euclid(2 * parts);
            *to = expected + self.colors[c].signed(coder, given.color[c] - expected);
        }
        Ok(Symbols { scale, ratio, angle, position: given.position, color })
    }
}
