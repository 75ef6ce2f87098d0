//! Bounds of the numbers of Gaussians.

use crate::gaussians::{Gaussians, LEAST_SCALE};
use crate::picture::Picture;
use crate::state::FitState;

/// The range of scales, and the values of a reset Gaussian.
#[derive(Debug)]
pub struct Bounds {
    largest: f32,
    middle: [f32; 2],
    pixels: f32,
}

impl Bounds {
    pub fn new(picture: &Picture) -> Self {
        let largest = (0.25 * picture.width.max(picture.height) as f32).max(2.0 * LEAST_SCALE);
        let middle = [picture.width, picture.height].map(|side| 0.5 * side as f32);
        Self { largest, middle, pixels: picture.pixels() as f32 }
    }

    /// Clamps scales. The published scale is an absolute value.
    pub fn apply(&self, gaussians: &mut Gaussians<f32>) {
        gaussians.scales.iter_mut().for_each(|s| *s = s.abs().clamp(LEAST_SCALE, self.largest));
    }

    /// Resets Gaussians with a NaN or an infinity, and counts them.
    pub fn restore(&self, state: &mut FitState) {
        let count = state.gaussians.len();
        for i in 0..count {
            let gaussians = &mut state.gaussians;
            let lists = [
                &gaussians.centers[2 * i..2 * i + 2],
                &gaussians.scales[2 * i..2 * i + 2],
                &gaussians.angles[i..=i],
                &gaussians.colors[3 * i..3 * i + 3],
            ];
            if lists.into_iter().flatten().all(|x| x.is_finite()) {
                continue;
            }
            gaussians.centers[2 * i..2 * i + 2].copy_from_slice(&self.middle);
            gaussians.scales[2 * i..2 * i + 2].fill(0.4 * (self.pixels / count as f32).sqrt());
            gaussians.angles[i] = 0.0;
            gaussians.colors[3 * i..3 * i + 3].fill(0.0);
            state.forget(i);
            state.reset += 1;
        }
    }
}
