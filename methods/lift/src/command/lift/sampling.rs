//! Resampling from the pixels of a file to the pixels of a camera's image.

use weaver_geometry::glam::DVec2;
use weaver_geometry::{Camera, Undistortion};
use weaver_kernels::parallel;

/// Pixels of a parallel task.
const GRAIN: usize = 1024;

/// The undistorted camera of a photo, and the distortion of its lens.
#[derive(Clone, Copy, Debug)]
pub struct Lens {
    pub camera: Camera,
    pub distortion: Option<Undistortion>,
}

impl Lens {
    /// Place of pixel `pixel` of the camera's image in the photo, as parts of its sides.
    pub fn place(&self, pixel: usize) -> DVec2 {
        let Camera { width, height, .. } = self.camera;
        let center = DVec2::new((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
        self.distortion.map_or(center, |distortion| distortion.distorted(center))
            / DVec2::new(width as f64, height as f64)
    }

    /// The pixel, in a picture of the photo of this height and width, at the place of pixel `pixel` of the camera's
    /// image.
    pub fn nearest(&self, pixel: usize, [height, width]: [usize; 2]) -> usize {
        let size = DVec2::new(width as f64, height as f64);
        let at = (self.place(pixel) * size).clamp(DVec2::ZERO, size - 1.0);
        at.y as usize * width + at.x as usize
    }

    /// Pixels of the camera's image.
    pub fn pixels(&self) -> usize {
        self.camera.width * self.camera.height
    }
}

/// Bilinear samples of a file of another size, corners not aligned.
#[derive(Clone, Copy, Debug)]
pub struct Sampling {
    /// Height and width of the file.
    pub from: [usize; 2],
    pub lens: Lens,
}

impl Sampling {
    /// Samples `rows` `[height width, channels]` at the pixels of the camera's image: `out` `[pixels, channels]`.
    pub fn sample(&self, rows: &[f32], channels: usize, out: &mut [f32]) {
        parallel::for_chunks(out, GRAIN * channels, |chunk, out| {
            for (i, out) in out.chunks_exact_mut(channels).enumerate() {
                out.fill(0.0);
                for (at, weight) in self.taps(chunk * GRAIN + i).into_iter().filter(|(_, weight)| *weight > 0.0) {
                    let row = &rows[at * channels..][..channels];
                    out.iter_mut().zip(row).for_each(|(sum, x)| *sum += weight * x);
                }
            }
        });
    }

    /// The pixels of the file around a pixel of the camera's image, with their weights.
    fn taps(&self, pixel: usize) -> [(usize, f32); 4] {
        let [height, width] = self.from;
        let last = DVec2::new(width as f64 - 1.0, height as f64 - 1.0);
        let at = (self.lens.place(pixel) * (last + 1.0) - 0.5).clamp(DVec2::ZERO, last);
        let (low, part) = (at.floor(), (at - at.floor()).as_vec2());
        let [x, y] = [low.x as usize, low.y as usize];
        let (right, below) = ((x + 1).min(width - 1), (y + 1).min(height - 1));
        [
            (y * width + x, (1.0 - part.x) * (1.0 - part.y)),
            (y * width + right, part.x * (1.0 - part.y)),
            (below * width + x, (1.0 - part.x) * part.y),
            (below * width + right, part.x * part.y),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_geometry::{Distortion, Intrinsics, Pose};
    use weaver_kernels::resample::Resample;

    fn camera(width: usize, height: usize) -> Camera {
        let intrinsics = Intrinsics { fx: 40.0, fy: 40.0, cx: 0.5 * width as f64, cy: 0.5 * height as f64 };
        Camera { pose: Pose::IDENTITY, intrinsics, width, height }
    }

    #[test]
    fn samples_are_those_of_bilinear_resizing() {
        for (from, to) in [([7, 5], [12, 31]), ([20, 16], [9, 8]), ([6, 6], [6, 6]), ([1, 1], [3, 4])] {
            let plane: Vec<f32> = (0..from[0] * from[1]).map(|i| (i * i % 23) as f32).collect();
            let mut expected = vec![0.0; to[0] * to[1]];
            Resample::bilinear(from, to, false).forward(&plane, &mut expected);
            let lens = Lens { camera: camera(to[1], to[0]), distortion: None };
            let mut found = vec![0.0; lens.pixels()];
            Sampling { from, lens }.sample(&plane, 1, &mut found);
            assert!(found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-4), "{from:?} {to:?}");
        }
    }

    /// A place in a distorted photo is found at its undistorted pixel.
    #[test]
    fn distortion_is_undone() {
        let from = camera(64, 48);
        let lens = Undistortion::new(from, Distortion::radial(-0.2)).unwrap();
        // The photo's own coordinates as features.
        let rows: Vec<f32> = (0..64 * 48).flat_map(|i| [(i % 64) as f32 + 0.5, (i / 64) as f32 + 0.5]).collect();
        let mut found = vec![0.0; rows.len()];
        Sampling { from: [48, 64], lens: Lens { camera: lens.to, distortion: Some(lens) } }
            .sample(&rows, 2, &mut found);
        for (pixel, found) in found.chunks_exact(2).enumerate() {
            let center = DVec2::new((pixel % 64) as f64 + 0.5, (pixel / 64) as f64 + 0.5);
            let expected = lens.distorted(center).clamp(DVec2::splat(0.5), DVec2::new(63.5, 47.5));
            let apart = (f64::from(found[0]) - expected.x).hypot(f64::from(found[1]) - expected.y);
            assert!(apart < 1e-3, "{pixel}: {found:?} {expected}");
        }
        // The distortion is not negligible.
        assert!(lens.distorted(DVec2::new(18.5, 14.5)).distance(DVec2::new(18.5, 14.5)) > 0.5);
    }
}
