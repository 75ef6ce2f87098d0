//! Drawing and its backward pass.

use crate::chain::NUMBERS;
use crate::response::sum;
use crate::{RasterError, Sight, Surfels};
use std::time::Instant;
use weaver_kernels::{Real, parallel};
use weaver_splat::tiles::{BackwardPass, Blending, Grid, Region, TileSide, TileStats, Tiles};
use weaver_splat::{Cotangents, Images, Timings};

/// Images of surfels from V poses; weights are w = alpha T, with T the light that arrives.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RangeImages<T> {
    /// Sums w r of ranges, `[V, H, W]`, meters; the range is this divided by the opacity.
    pub range: Vec<T>,
    /// Sums w of weights, `[V, H, W]`.
    pub opacity: Vec<T>,
    /// Sums w n of normals in the frame of the camera, `[V, H, W, 3]`.
    pub normal: Vec<T>,
}

impl<T: Real> RangeImages<T> {
    /// The mean range of each pixel, `[V, H, W]`, meters: range / max(opacity, 1e-10).
    pub fn mean_range(&self) -> Vec<T> {
        let least = T::from_f64(1e-10);
        self.range.iter().zip(&self.opacity).map(|(range, a)| *range / a.max(least)).collect()
    }
}

/// Gradients that arrive at [`RangeImages`]; `None` means zero.
#[derive(Clone, Copy, Debug, Default)]
pub struct RangeCotangents<'a, T> {
    /// With respect to the sums of ranges, `[V, H, W]`.
    pub range: Option<&'a [T]>,
    /// With respect to the opacity, `[V, H, W]`.
    pub opacity: Option<&'a [T]>,
    /// With respect to the sums of normals, `[V, H, W, 3]`.
    pub normal: Option<&'a [T]>,
}

/// All memory of drawing and differentiating, kept from call to call.
#[derive(Debug)]
pub struct SurfelWorkspace<T> {
    tiles: Tiles<T>,
    /// Gradients `[N, 10]`, and the poses' gradients `[N, 6]` through one view.
    rows: Vec<f64>,
    poses: Vec<f64>,
    work: [u64; 2],
    timings: Timings,
}

impl<T: Real> Default for SurfelWorkspace<T> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T: Real> SurfelWorkspace<T> {
    /// Without memory yet.
    pub fn new() -> Self {
        Self { tiles: Tiles::new(), rows: Vec::new(), poses: Vec::new(), work: [0; 2], timings: Timings::default() }
    }

    /// Draws surfels front to back by the distance of their centers, into images of all poses.
    ///
    /// Left out are centers beyond the [`Limits`](crate::Limits), backs (n.c >= 0), rays with |n.d| < 1e-3, alphas
    /// below 1/255; a pixel ends before its light falls to 1e-4.
    ///
    /// # Errors
    ///
    /// More than 2^32 list entries.
    ///
    /// ```
    /// use weaver_geometry::Pose;
    /// use weaver_surfel::{Limits, RangeImages, Sight, SurfelCamera, Surfels, SurfelWorkspace};
    /// let mut surfels = Surfels::<f32>::default();
    /// // Half a meter wide, two meters ahead, turned so that its normal is -x.
    /// let turn = std::f32::consts::FRAC_1_SQRT_2;
    /// surfels.push([2.0, 0.0, 0.0], [turn, 0.0, -turn, 0.0], [-0.7, -0.7], 3.0);
    /// let camera = SurfelCamera::spherical([64, 16], [-0.4, 0.4]);
    /// let sight =
    ///     Sight { surfels: surfels.slices(), camera: &camera, poses: &[Pose::IDENTITY], limits: Limits::default() };
    /// let mut images = RangeImages::default();
    /// SurfelWorkspace::new().draw(&sight, &mut images)?;
    /// let ahead = 8 * 64 + 32;
    /// assert!((images.mean_range()[ahead] - 2.0).abs() < 0.01 && images.opacity[ahead] > 0.9);
    /// # Ok::<(), weaver_surfel::RasterError>(())
    /// ```
    #[inline(never)]
    pub fn draw(&mut self, sight: &Sight<'_, T>, images: &mut RangeImages<T>) -> Result<TileStats, RasterError> {
        let camera = sight.camera;
        let grid = Grid::new(Region::whole(camera.width, camera.height), TileSide::Sixteen);
        let start = Instant::now();
        let stats = self.tiles.project(grid, (sight.poses.len(), sight.surfels.len()), sight, sight)?;
        let projected = Instant::now();
        self.tiles.bin(None);
        let binned = Instant::now();
        let blending = blending(sight);
        self.work = self.tiles.blend(sight, &blending);
        let pixels = sight.poses.len() * camera.pixels();
        let RangeImages { range, opacity, normal } = images;
        [(&mut *range, 1), (&mut *opacity, 1), (&mut *normal, 3)]
            .into_iter()
            .for_each(|(image, channels)| image.resize(channels * pixels, T::ZERO));
        let images = Images { image: normal, alpha: opacity, depth: Some(range), features: None };
        self.tiles.images(&blending, |_| [T::ZERO; 3], images);
        self.timings =
            Timings { project: projected - start, bin: binned - projected, blend: binned.elapsed(), ..self.timings };
        Ok(stats)
    }

    /// Pairs of a surfel and a pixel that it adds to in the last drawing, and pairs that were visited.
    pub fn work(&self) -> [u64; 2] {
        self.work
    }

    /// Times of the parts of the last drawing and of the last backward pass.
    pub fn timings(&self) -> Timings {
        self.timings
    }

    /// Writes median range and distortion of the last drawing, `[V, H, W]` each.
    ///
    /// The median is the range of the last surfel that more than half of the light reaches, 0 without any; the
    /// distortion is the sum of w_i w_j (r_i - r_j)^2 over pairs.
    ///
    /// # Panics
    ///
    /// If a length does not fit the images.
    #[inline(never)]
    pub fn ranges(&mut self, sight: &Sight<'_, T>, median: &mut [T], distortion: &mut [T]) {
        self.tiles.ranges(sight, sight.limits.alpha_max, median, distortion);
    }

    /// Gradients of the last drawing with respect to the surfels, which replace the content of `gradients`, and to the
    /// poses.
    ///
    /// A pose has six numbers: for the motion T = (1 + \[w\]x) T + t of the camera's frame, the gradients with respect
    /// to t and w.
    ///
    /// # Panics
    ///
    /// If `poses` does not have one row for each pose.
    #[inline(never)]
    pub fn backward(
        &mut self,
        sight: &Sight<'_, T>,
        cotangents: &RangeCotangents<'_, T>,
        gradients: &mut Surfels<T>,
        mut poses: Option<&mut [[f64; 6]]>,
    ) {
        let start = Instant::now();
        let RangeCotangents { range, opacity, normal } = *cotangents;
        let cotangents = Cotangents { image: normal, alpha: opacity, depth: range, features: None };
        let pass = BackwardPass { blending: blending(sight), cotangents, statistics: false };
        self.tiles.backward(sight, &pass, |_| [T::ZERO; 3]);
        let (tiles, n) = (&self.tiles, sight.surfels.len());
        self.rows.clear();
        self.rows.resize(n * NUMBERS, 0.0);
        self.poses.resize(n * 6, 0.0);
        if let Some(poses) = &poses {
            assert_eq!(poses.len(), sight.poses.len(), "backward: one row for each pose");
        }
        for view in 0..sight.poses.len() {
            parallel::for_chunks2(&mut self.rows, 64 * NUMBERS, &mut self.poses, 64 * 6, |chunk, rows, poses| {
                for (i, (row, pose)) in rows.chunks_exact_mut(NUMBERS).zip(poses.chunks_exact_mut(6)).enumerate() {
                    let n = 64 * chunk + i;
                    let (sums, normal, _) = tiles.sums::<{ sum::COUNT }>(view, n);
                    if sums.iter().chain(&normal).all(|x| *x == T::ZERO) {
                        pose.fill(0.0);
                        continue;
                    }
                    let gradient = sight.gradient(view, n, &sums, normal);
                    row.iter_mut().zip(gradient.numbers).for_each(|(to, x)| *to += x);
                    pose.copy_from_slice(&gradient.pose);
                }
            });
            if let Some(poses) = &mut poses {
                let sum = |at: usize| self.poses.chunks_exact(6).map(|row| row[at]).sum();
                poses[view] = std::array::from_fn(sum);
            }
        }
        let Surfels { centers, quats, log_scales, opacity_logits } = gradients;
        let mut first = 0;
        for (column, numbers) in [(centers, 3), (quats, 4), (log_scales, 2), (opacity_logits, 1)] {
            column.clear();
            let parts = self.rows.chunks_exact(NUMBERS).flat_map(|row| &row[first..first + numbers]);
            column.extend(parts.map(|x| if x.is_finite() { T::from_f64(*x) } else { T::ZERO }));
            first += numbers;
        }
        self.timings.backward = start.elapsed();
    }

    /// Calls `visit(pixel, surfel, weight, transmittance)` for every surfel at every pixel that it adds to; tiles are
    /// visited in parallel.
    pub fn for_each_hit(&self, sight: &Sight<'_, T>, visit: impl Fn(usize, usize, T, T) + Sync) {
        self.tiles.for_each_hit(sight, sight.limits.alpha_max, visit);
    }
}

fn blending<T: Real>(sight: &Sight<'_, T>) -> Blending<'static, T> {
    Blending { alpha_max: sight.limits.alpha_max, depth: true, features: None }
}
