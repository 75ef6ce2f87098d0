//! Resizing with the filters of Pillow, on 8-bit values.
//!
//! Separable, horizontal pass first; each pass rounds to 8 bits, with filter weights in fixed point, so that results
//! equal Pillow's (`Image.resize(size, LANCZOS, box=...)`), which prepares most training data. Pillow 13 makes the
//! vertical pass first where it shrinks the height more than the width, so that other values are clamped; we do not.

use crate::{Bitmap, Image};
use std::f64::consts::PI;

/// Bits after the point: 8 bits of value, 2 of head-room for the filter's negative lobes, in 32.
const FRACTION: u32 = 32 - 8 - 2;

impl Image {
    /// Resizes the part `[x0, y0, x1, y1]` (pixels, may be fractional) to `width` x `height` with a
    /// Lanczos filter of three lobes, widened when shrinking so that nothing aliases.
    ///
    /// The filter reads past the box, but not past the image, where the remaining weights are normalized.
    ///
    /// # Panics
    /// When the box is empty or extends beyond the image.
    pub fn resize(&self, width: usize, height: usize, part: [f64; 4]) -> Self {
        self.resample(width, height, part, LANCZOS)
    }

    /// Resizes the whole image with a cubic filter (Keys, a = -0.5), widened when shrinking: Pillow's `BICUBIC`, the
    /// default of its `resize`.
    pub fn resize_bicubic(&self, width: usize, height: usize) -> Self {
        self.resample(width, height, [0.0, 0.0, self.width as f64, self.height as f64], BICUBIC)
    }

    fn resample(&self, width: usize, height: usize, part: [f64; 4], filter: Filter) -> Self {
        Bitmap { width: self.width, height: self.height, pixels: self.to_bytes() }
            .resample(width, height, part, filter)
            .to_image()
    }
}

impl Bitmap {
    /// Resizes the whole image as [`Image::resize`] does.
    ///
    /// # Panics
    /// When it has no pixels.
    pub fn resize(&self, width: usize, height: usize) -> Self {
        self.resample(width, height, [0.0, 0.0, self.width as f64, self.height as f64], LANCZOS)
    }

    fn resample(&self, width: usize, height: usize, part: [f64; 4], filter: Filter) -> Self {
        let length = 3 * self.width;
        let row = |y: usize, row: &mut [u8]| row.copy_from_slice(&self.pixels[y * length..(y + 1) * length]);
        Self { width, height, pixels: resample((self.width, self.height), row, [width, height], part, filter) }
    }
}

/// A filter, and how far it reaches.
#[derive(Clone, Copy)]
pub(crate) struct Filter(fn(f64) -> f64, f64);

pub(crate) const LANCZOS: Filter = Filter(lanczos3, 3.0);
pub(crate) const BICUBIC: Filter = Filter(bicubic, 2.0);

/// The part `[x0, y0, x1, y1]` of an image that is read row by row, `[from_width, 3]`, from the top; returns `[height,
/// width, 3]`.
///
/// # Panics
/// When the part is empty or extends beyond the image.
pub(crate) fn resample(
    (from_width, from_height): (usize, usize),
    row: impl Fn(usize, &mut [u8]),
    [width, height]: [usize; 2],
    [x0, y0, x1, y1]: [f64; 4],
    filter: Filter,
) -> Vec<u8> {
    assert!(
        0.0 <= x0 && x0 < x1 && x1 <= from_width as f64 && 0.0 <= y0 && y0 < y1 && y1 <= from_height as f64,
        "box [{x0}, {y0}, {x1}, {y1}] sticks out of {from_width}x{from_height} or is empty"
    );
    let columns = taps(from_width, x0, x1, width, filter);
    let rows = taps(from_height, y0, y1, height, filter);
    // Rows that nothing is made of are not read.
    let first = rows.first().map_or(0, |tap| tap.first);
    let end = rows.last().map_or(0, |tap| tap.first + tap.weights.len());

    let mut wide = vec![0; width * (end - first) * 3];
    let mut from = vec![0; from_width * 3];
    // A row with its channels apart, and zeros behind it for the last of the chunks.
    let mut apart = [(); 3].map(|()| vec![0i16; from_width + CHUNK]);
    for (y, to) in (first..end).zip(wide.chunks_exact_mut(width.max(1) * 3)) {
        row(y, &mut from);
        let [red, green, blue] = &mut apart;
        let values = red.iter_mut().zip(green).zip(blue);
        for (((red, green), blue), pixel) in values.zip(from.as_chunks::<3>().0) {
            [*red, *green, *blue] = pixel.map(i16::from);
        }
        for (tap, pixel) in columns.iter().zip(to.as_chunks_mut::<3>().0) {
            *pixel = std::array::from_fn(|c| tap.apply(&apart[c]));
        }
    }
    let mut out = vec![0; width * height * 3];
    let mut sums = vec![0; width * 3];
    for (tap, to) in rows.iter().zip(out.chunks_exact_mut(width.max(1) * 3)) {
        sums.fill(HALF);
        let beside = wide[(tap.first - first) * width * 3..].chunks_exact(width.max(1) * 3);
        for (weight, beside) in tap.weights.iter().zip(beside) {
            sums.iter_mut().zip(beside).for_each(|(sum, value)| *sum += weight * i32::from(*value));
        }
        to.iter_mut().zip(&sums).for_each(|(value, sum)| *value = rounded(*sum));
    }
    out
}

/// Half of the last bit that is kept.
const HALF: i32 = 1 << (FRACTION - 1);
/// Samples that are weighted at a time.
const CHUNK: usize = 16;
/// Bits of the lower part of a weight.
const LOW: u32 = 14;

/// The source samples of one output sample: from `first` on, with fixed-point weights.
struct Tap {
    first: usize,
    weights: Vec<i32>,
    /// The same in two parts of 16 bits, `high * 2^LOW + low`, with zeros up to a whole chunk: processors multiply such
    /// numbers in pairs.
    high: Vec<[i16; CHUNK]>,
    low: Vec<[i16; CHUNK]>,
}

impl Tap {
    fn new(first: usize, weights: Vec<i32>) -> Self {
        let parts = |part: fn(i32) -> i16| {
            let chunk = |chunk: &[i32]| std::array::from_fn(|i| part(chunk.get(i).copied().unwrap_or(0)));
            weights.chunks(CHUNK).map(chunk).collect()
        };
        let (high, low) = (parts(|weight| (weight >> LOW) as i16), parts(|weight| (weight & ((1 << LOW) - 1)) as i16));
        Self { first, weights, high, low }
    }

    /// The weighted sum of samples; `samples` holds a chunk more than the weighted ones.
    fn apply(&self, samples: &[i16]) -> u8 {
        let samples = &samples[self.first..];
        // Modulo 2^32, where the whole sum fits even if its parts overflow.
        let sum = product(samples, &self.low).wrapping_add(product(samples, &self.high) << LOW);
        rounded(HALF.wrapping_add(sum))
    }
}

/// The sum of the products of samples with the weights of whole chunks. By itself it becomes instructions that multiply
/// in pairs, within a larger function it does not.
#[inline(never)]
fn product(samples: &[i16], weights: &[[i16; CHUNK]]) -> i32 {
    let mut sum = 0i32;
    for (samples, weights) in samples.as_chunks::<CHUNK>().0.iter().zip(weights) {
        let products = samples.iter().zip(weights).map(|(a, b)| i32::from(*a) * i32::from(*b));
        sum = sum.wrapping_add(products.fold(0, i32::wrapping_add));
    }
    sum
}

fn rounded(sum: i32) -> u8 {
    (sum >> FRACTION).clamp(0, 255) as u8
}

fn taps(size: usize, from: f64, to: f64, out: usize, Filter(filter, support): Filter) -> Vec<Tap> {
    let scale = (to - from) / out as f64;
    let stretch = scale.max(1.0);
    let reach = support * stretch;
    let tap = |o: usize| {
        let center = from + (o as f64 + 0.5) * scale;
        let first = (center - reach + 0.5).max(0.0) as usize;
        let end = ((center + reach + 0.5) as usize).min(size);
        let weight = |i: usize| filter((i as f64 + 0.5 - center) / stretch);
        let total: f64 = (first..end).map(weight).sum();
        let one = f64::from(1 << FRACTION);
        Tap::new(first, (first..end).map(|i| (weight(i) / total * one).round() as i32).collect())
    };
    (0..out).map(tap).collect()
}

fn bicubic(x: f64) -> f64 {
    const A: f64 = -0.5;
    match x.abs() {
        x if x < 1.0 => ((A + 2.0) * x - (A + 3.0)) * x * x + 1.0,
        x if x < 2.0 => (((x - 5.0) * x + 8.0) * x - 4.0) * A,
        _ => 0.0,
    }
}

fn lanczos3(x: f64) -> f64 {
    if (-3.0..3.0).contains(&x) { sinc(x) * sinc(x / 3.0) } else { 0.0 }
}

fn sinc(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { (PI * x).sin() / (PI * x) }
}
