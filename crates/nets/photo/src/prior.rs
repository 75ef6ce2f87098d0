//! The input of the network: photos, depth of their comparison, neighbors' colors there, rays.

use crate::comparison::{Comparison, FAR};
use crate::filled::{Filled, filled};
use weaver_geometry::glam::DVec2;
use weaver_geometry::{Camera, Pose};
use weaver_inference::Photos;
use weaver_kernels::parallel;

/// Channels of the input: colors 3, log depth and confidence of comparison 2, of two neighbors colors 3, difference 1
/// and visibility 1, tangents of the ray 2.
pub const CHANNELS: usize = 17;
/// Sides of the input are multiples of this.
pub const PATCH: usize = 16;
/// Photos whose colors are shown to each photo.
const NEIGHBORS: usize = 2;
/// Channels of a neighbor.
const OF_NEIGHBOR: usize = 5;
/// Every so many pixels, both ways, overlap is counted.
const SPARSE: usize = 4;
/// A point is hidden from another photo whose own depth is smaller by more than this part.
const HIDDEN: f64 = 0.05;

/// Depth of comparison of V photos of H x W pixels, filled everywhere, and the network's input made of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Prior {
    /// Log of depth over the scale `[V, H, W]`: where nothing was found, continued smoothly.
    pub log_depth: Vec<f32>,
    /// 1 where comparison found the depth, less the farther from such places `[V, H, W]` ([`Filled`]).
    pub confidence: Vec<f32>,
    /// The cameras, in units of the scale.
    pub cameras: Vec<Camera>,
    /// The median depth that comparison found, in the units of the given cameras.
    pub scale: f64,
    /// The input `[V, CHANNELS, H', W']`; photos are continued by reflection to multiples of [`PATCH`].
    pub input: Vec<f32>,
    /// Height H and width W of the photos.
    pub size: [usize; 2],
}

/// The least size of at least `n` pixels that the network takes.
pub fn padded(n: usize) -> usize {
    n.next_multiple_of(PATCH)
}

/// The pixel below n that a reflection at the last one gives; positions beyond that repeat to and fro.
fn reflected(at: usize, n: usize) -> usize {
    let period = (2 * n - 2).max(1);
    let at = at % period;
    if at < n { at } else { period - at }
}

impl Prior {
    /// The input for photos with cameras and a comparison of them. Nothing of it carries a gradient.
    ///
    /// Where comparison found nothing at all, the scale is 1.
    ///
    /// # Panics
    /// Unless there are as many cameras as photos and a depth for each pixel.
    pub fn new(photos: Photos<'_>, cameras: &[Camera], comparison: &Comparison) -> Self {
        let size = [photos.height, photos.width];
        let pixels = photos.height * photos.width;
        assert_eq!(photos.views(), cameras.len(), "as many cameras as photos");
        assert_eq!(comparison.depth.len(), cameras.len() * pixels, "a depth for each pixel");
        let scale = comparison.median().unwrap_or(1.0);
        let logs: Vec<f32> = comparison.depth.iter().map(|z| (z / scale).clamp(1.0 / FAR, FAR).ln()).collect();
        let known: Vec<bool> = comparison.depth.iter().map(|z| *z > 0.0).collect();
        let Filled { values: log_depth, confidence } = filled(&logs, &known, size, 0.0);
        let unit = 1.0 / f64::from(scale);
        let cameras: Vec<Camera> =
            cameras.iter().map(|camera| Camera { pose: camera.pose.scaled(unit), ..*camera }).collect();
        let mut prior = Self { log_depth, confidence, cameras, scale: scale.into(), input: Vec::new(), size };
        prior.input = prior.channels(photos);
        prior
    }

    /// Number of photos V.
    pub fn views(&self) -> usize {
        self.cameras.len()
    }

    /// Depth of a view in units of the scale `[H, W]`.
    fn log_depth_of(&self, view: usize) -> &[f32] {
        let pixels = self.size[0] * self.size[1];
        &self.log_depth[view * pixels..][..pixels]
    }

    fn channels(&self, photos: Photos<'_>) -> Vec<f32> {
        let [height, width] = self.size;
        let [rows, columns] = self.size.map(padded);
        let pixels = height * width;
        let mut input = vec![0.0; self.views() * CHANNELS * rows * columns];
        parallel::for_chunks(&mut input, CHANNELS * rows * columns, |view, padded| {
            let mut own = vec![0.0; CHANNELS * pixels];
            own[..3 * pixels].copy_from_slice(&photos.planes[3 * view * pixels..][..3 * pixels]);
            own[3 * pixels..4 * pixels].copy_from_slice(self.log_depth_of(view));
            own[4 * pixels..5 * pixels].copy_from_slice(&self.confidence[view * pixels..][..pixels]);
            let neighbors = self.neighbors(view);
            for (slot, other) in own[5 * pixels..].chunks_mut(OF_NEIGHBOR * pixels).zip(neighbors) {
                self.show(photos, view, other, slot);
            }
            let k = &self.cameras[view].intrinsics;
            for at in 0..pixels {
                let ray = k.unproject(DVec2::new((at % width) as f64 + 0.5, (at / width) as f64 + 0.5), 1.0);
                own[(CHANNELS - 2) * pixels + at] = ray.x as f32;
                own[(CHANNELS - 1) * pixels + at] = ray.y as f32;
            }
            for (i, x) in padded.iter_mut().enumerate() {
                let (row, column) = (i / columns % rows, i % columns);
                *x = own[i / (rows * columns) * pixels + reflected(row, height) * width + reflected(column, width)];
            }
        });
        input
    }

    /// The photos that see most of what a photo sees, the best first, ties by index.
    fn neighbors(&self, view: usize) -> Vec<usize> {
        let [height, width] = self.size;
        let log_depth = self.log_depth_of(view);
        let overlap = |other: usize| {
            let there = Transfer::new(&self.cameras[view], &self.cameras[other]);
            let places =
                (0..height).step_by(SPARSE).flat_map(|y| (0..width).step_by(SPARSE).map(move |x| y * width + x));
            places.filter(|at| there.pixel(*at, log_depth[*at]).is_some_and(|seen| seen.inside)).count()
        };
        let mut others: Vec<(usize, usize)> =
            (0..self.views()).filter(|other| *other != view).map(|other| (overlap(other), other)).collect();
        others.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
        others.into_iter().take(NEIGHBORS).map(|(_, other)| other).collect()
    }

    /// The channels `[5, H, W]` of a neighbor: its colors at the pixels' points, the difference, and 1 where it sees
    /// them.
    fn show(&self, photos: Photos<'_>, view: usize, other: usize, out: &mut [f32]) {
        let pixels = self.size[0] * self.size[1];
        let [own, theirs] = [view, other].map(|v| &photos.planes[3 * v * pixels..][..3 * pixels]);
        let there = Transfer::new(&self.cameras[view], &self.cameras[other]);
        let (log_depth, their_depth) = (self.log_depth_of(view), self.log_depth_of(other));
        for at in 0..pixels {
            let Some(seen) = there.pixel(at, log_depth[at]).filter(|seen| seen.inside) else { continue };
            let mut difference = 0.0;
            for c in 0..3 {
                let color = seen.sample(&theirs[c * pixels..][..pixels]);
                out[c * pixels + at] = color;
                difference += (color - own[c * pixels + at]).abs() / 3.0;
            }
            out[3 * pixels + at] = difference;
            let hidden = seen.depth.ln() > f64::from(seen.sample(their_depth)) + HIDDEN;
            out[4 * pixels + at] = if hidden { 0.0 } else { 1.0 };
        }
    }
}

/// From the pixels of one photo to those of another of the same size.
pub(crate) struct Transfer<'a> {
    from: &'a Camera,
    to: &'a Camera,
    between: Pose,
}

/// Where another photo shows a point.
pub(crate) struct Seen {
    /// Pixels from the left and upper border.
    pixel: DVec2,
    size: [usize; 2],
    /// Depth along the other's optical axis.
    pub depth: f64,
    /// True within the photo.
    pub inside: bool,
}

impl<'a> Transfer<'a> {
    pub fn new(from: &'a Camera, to: &'a Camera) -> Self {
        Self { from, to, between: to.pose.relative_to(&from.pose) }
    }

    /// Where the point of a pixel at a depth, given by its logarithm, is shown; `None` behind the other camera.
    pub fn pixel(&self, at: usize, log_depth: f32) -> Option<Seen> {
        let (width, height) = (self.from.width, self.from.height);
        let center = DVec2::new((at % width) as f64 + 0.5, (at / width) as f64 + 0.5);
        let local = self.between.apply(self.from.intrinsics.unproject(center, f64::from(log_depth).exp()));
        if local.z <= 0.0 {
            return None;
        }
        let pixel = self.to.intrinsics.project(local);
        let inside = (0.0..width as f64).contains(&pixel.x) && (0.0..height as f64).contains(&pixel.y);
        Some(Seen { pixel, size: [height, width], depth: local.z, inside })
    }
}

impl Seen {
    /// The pixel's index.
    pub fn index(&self) -> usize {
        self.pixel.y as usize * self.size[1] + self.pixel.x as usize
    }

    /// A map `[H, W]` there, interpolated between the centers of pixels.
    pub fn sample(&self, map: &[f32]) -> f32 {
        let split = |x: f64, length: usize| {
            let x = (x - 0.5).clamp(0.0, (length - 1) as f64);
            let low = (x as usize).min(length.saturating_sub(2));
            (low, (low + 1).min(length - 1), (x - low as f64) as f32)
        };
        let [height, width] = self.size;
        let ((left, right, fx), (top, bottom, fy)) = (split(self.pixel.x, width), split(self.pixel.y, height));
        let row = |y: usize| map[y * width + left] * (1.0 - fx) + map[y * width + right] * fx;
        row(top) * (1.0 - fy) + row(bottom) * fy
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reflection_does_not_repeat_the_border() {
        assert_eq!([0, 1, 2, 3, 4, 5, 6].map(|at| reflected(at, 3)), [0, 1, 2, 1, 0, 1, 2]);
        assert_eq!([0, 1, 15].map(|at| reflected(at, 1)), [0, 0, 0]);
    }
}
