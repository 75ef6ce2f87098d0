//! A fit at one ratio: its quality, and the speed of its parts.

use crate::command::results::{Judged, Method};
use crate::{Canvas, Gaussians, ImageError, Picture, Tiled, Window, decode, decode_region, fit};
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

/// Sides of the timed region.
const REGION: usize = 64;
/// Repetitions of a timing; the fastest counts.
const RUNS: usize = 5;
/// Floating-point operations of a step for each pair of a Gaussian and a block of 16 pixels: 25 products and sums of
/// vectors, fused or not.
const BLOCK_OPERATIONS: f64 = 25.0 * 16.0 * 2.0;

/// A fit at one ratio.
pub struct Measured {
    pub ratio: f64,
    pub judged: Judged,
    /// Milliseconds of the fit for each step, of a step of the last Gaussians, and of such a step at the processor's
    /// peak.
    pub steps: [f64; 3],
    /// Milliseconds of decoding and drawing a megapixel.
    pub decoding: f64,
    /// Microseconds of decoding and drawing a region.
    pub region: f64,
}

/// The fastest of several runs, seconds.
fn fastest(mut body: impl FnMut() -> Result<(), ImageError>) -> Result<f64, ImageError> {
    let mut least = f64::INFINITY;
    for _ in 0..RUNS {
        let begin = Instant::now();
        body()?;
        least = least.min(begin.elapsed().as_secs_f64());
    }
    Ok(least)
}

/// Fits a picture, and times the fit, a step, and drawing from the file.
pub fn measure(picture: &Picture, path: &Path, method: &Method, gflops: f64) -> Result<Measured, ImageError> {
    let (width, height) = (picture.width(), picture.height());
    let begin = Instant::now();
    let settings = method.settings(method.count(picture));
    let fitted = fit(picture, &settings, &mut |_| ControlFlow::Continue(()))?;
    let each = begin.elapsed().as_secs_f64() * 1e3 / method.steps as f64;
    let judged = Judged::new(path, picture, &fitted)?;
    let target = Tiled::new(picture.colors(), width, height)?;
    let (mut canvas, mut gradient) = (Canvas::new(), Gaussians::default());
    let last = fastest(|| {
        canvas.place(&fitted.gaussians, Window::whole(width, height), fitted.cut)?;
        canvas.squared_error(&fitted.gaussians, &target, &mut gradient).map(drop)
    })?;
    let floor = canvas.blocks() as f64 * BLOCK_OPERATIONS / (gflops * 1e6);
    let bytes = &judged.bytes;
    let whole = fastest(|| decode(bytes)?.fitted.draw(width, height).map(drop))?;
    let side = |length: usize| REGION.min(length);
    let window = Window {
        x: (width - side(width)) / 2,
        y: (height - side(height)) / 2,
        width: side(width),
        height: side(height),
    };
    let part = fastest(|| {
        let mut read = |range: std::ops::Range<u64>| Ok(bytes[range.start as usize..range.end as usize].to_vec());
        decode_region(bytes.len() as u64, &mut read, window)?.fitted.draw_window(window).map(drop)
    })?;
    Ok(Measured {
        ratio: method.ratio.unwrap_or(0.0),
        steps: [each, last * 1e3, floor],
        decoding: whole * 1e9 / picture.pixels() as f64,
        region: part * 1e6,
        judged,
    })
}
