//! Resizing with the filters of Pillow, on 8-bit values.
//!
//! Separable, horizontal pass first; each pass rounds to 8 bits, with filter weights in fixed point, so that
//! results equal those of Pillow (`Image.resize(size, LANCZOS, box=...)`), which prepares most training data. Pillow 13 makes
//! the vertical pass first where it shrinks the height more than the width, so that other values are clamped; we do not.

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

    /// Resizes the whole image with a cubic filter (Keys, a = -0.5), widened when shrinking: Pillow's `BICUBIC`, the default of
    /// its `resize`.
    pub fn resize_bicubic(&self, width: usize, height: usize) -> Self {
        self.resample(width, height, [0.0, 0.0, self.width as f64, self.height as f64], BICUBIC)
    }

    /// Resizes the whole image by averaging the pixels whose centers lie in the area that each new pixel covers: Pillow's `BOX`.
    pub fn resize_area(&self, width: usize, height: usize) -> Self {
        self.resample(width, height, [0.0, 0.0, self.width as f64, self.height as f64], AREA)
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
const AREA: Filter = Filter(box_filter, 0.5);

/// The part `[x0, y0, x1, y1]` of an image that is read row by row, `[from_width, 3]`, from the top; returns `[height, width, 3]`.
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
    for (y, to) in (first..end).zip(wide.chunks_exact_mut(width.max(1) * 3)) {
        row(y, &mut from);
        for (tap, pixel) in columns.iter().zip(to.chunks_exact_mut(3)) {
            for (c, value) in pixel.iter_mut().enumerate() {
                *value = tap.apply(|i| from[i * 3 + c]);
            }
        }
    }
    let mut out = vec![0; width * height * 3];
    for (tap, to) in rows.iter().zip(out.chunks_exact_mut(width.max(1) * 3)) {
        for (x, value) in to.iter_mut().enumerate() {
            *value = tap.apply(|i| wide[(i - first) * width * 3 + x]);
        }
    }
    out
}

/// The source samples of one output sample: from `first` on, with fixed-point weights.
struct Tap {
    first: usize,
    weights: Vec<i32>,
}

impl Tap {
    fn apply(&self, sample: impl Fn(usize) -> u8) -> u8 {
        let mut sum = 1 << (FRACTION - 1);
        for (i, &w) in self.weights.iter().enumerate() {
            sum += i32::from(sample(self.first + i)) * w;
        }
        (sum >> FRACTION).clamp(0, 255) as u8
    }
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
        let weights = (first..end).map(|i| (weight(i) / total * one).round() as i32).collect();
        Tap { first, weights }
    };
    (0..out).map(tap).collect()
}

fn box_filter(x: f64) -> f64 {
    // Half open, so that a source pixel on the border of two outputs counts once.
    if x > -0.5 && x <= 0.5 { 1.0 } else { 0.0 }
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
