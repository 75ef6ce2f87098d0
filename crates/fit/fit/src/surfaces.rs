//! Losses of surfaces in a step: known depth, and normals of Gaussians that agree with the depth that they make.

use crate::FitError;
use crate::population::Population;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use weaver_geometry::{Camera, Intrinsics};
use weaver_kernels::Real;
use weaver_kernels::parallel::for_chunks;
use weaver_losses::{Relief, depth_loss, normal_loss};
use weaver_scene::{Features, Photo};
use weaver_splat::{expected_depth, expected_depth_backward};

/// Gaussians of a task.
const GRAIN: usize = 1 << 12;
/// Numbers of a normal.
const CHANNELS: usize = 3;

/// Losses of surfaces beside the photos' own. Both are off at 0; else steps are not taken on a device.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Surfaces {
    /// Weight of the loss of known depth ([`depth_loss`]) at the beginning of the run.
    pub depth: f64,
    /// Weight of the disagreement of normals and depth ([`normal_loss`]) at the beginning of the run; a Gaussian's
    /// normal is its shortest axis. Photos that keep a lens of their own have none.
    pub normals: f64,
    /// Part of the run before which normals do not count: the first Gaussians are round.
    pub normals_from: f64,
    /// Weights at the end, as a factor; in between their logarithm is linear.
    pub end: f64,
    /// Difference of the logarithms of depth from which on a pixel counts less.
    pub off: f64,
}

impl Default for Surfaces {
    fn default() -> Self {
        Self::OFF
    }
}

impl Surfaces {
    /// Losses for a scene that becomes a mesh: depth counts.
    pub const FOR_MESHES: Self = Self { depth: 1.0, ..Self::OFF };
    const OFF: Self = Self { depth: 0.0, normals: 0.0, normals_from: 0.2, end: 0.1, off: 0.02 };

    /// True if one of the losses counts at some time.
    pub fn count(&self) -> bool {
        self.depth > 0.0 || self.normals > 0.0
    }

    /// The weights of depth and normals at a part of the run.
    fn at(&self, fraction: f64) -> [f64; 2] {
        let falling = self.end.powf(fraction);
        [self.depth * falling, if fraction < self.normals_from { 0.0 } else { self.normals * falling }]
    }
}

/// Depth of a photo that is known beforehand, from a file or by [stereo](https://docs.rs/weaver-stereo).
#[derive(Clone, Debug, PartialEq)]
pub struct KnownDepth {
    /// Height and width, of the photo or smaller by one factor, about.
    pub size: [usize; 2],
    /// Depth along the optical axis, world units, `[H, W]`; not known where it is not a positive number.
    pub depth: Vec<f32>,
}

impl KnownDepth {
    /// Checks that there is a number for each pixel, and as many pixels across and down as the photo's shape asks for.
    pub(crate) fn check(&self, photo: &Photo) -> Result<(), FitError> {
        let ([height, width], [of_height, of_width]) = (self.size, photo.size());
        let factor = of_width as f64 / width.max(1) as f64;
        let fits = (height as f64 * factor - of_height as f64).abs() <= 1.0 + factor;
        if fits && height * width > 0 && height * width == self.depth.len() {
            return Ok(());
        }
        Err(FitError::Photo {
            name: photo.name.clone(),
            expected: format!("depth of the shape of {of_width}x{of_height} pixels"),
            found: format!("{width}x{height} of {} numbers", self.depth.len()),
        })
    }

    /// The nearest numbers for a picture of another size.
    fn resized(&self, [height, width]: [usize; 2], to: &mut Vec<f32>) {
        let [rows, columns] = self.size;
        to.clear();
        to.extend((0..height).flat_map(|y| {
            let row = &self.depth[((2 * y + 1) * rows / (2 * height)) * columns..][..columns];
            (0..width).map(move |x| row[(2 * x + 1) * columns / (2 * width)])
        }));
    }
}

/// Losses that count at a step, with room for their gradients.
#[derive(Debug, Default)]
pub(crate) struct SurfaceBuffers {
    weights: [f64; 2],
    /// Normals of the Gaussians, `[N, 3]`, in the camera's axes and toward it.
    normals: Vec<f32>,
    of_normals: Vec<f32>,
    /// The picture of the normals, `[H, W, 3]`.
    picture: Vec<f32>,
    of_picture: Vec<f32>,
    expected: Vec<f32>,
    known: Vec<f32>,
    /// Derivatives by expected depth, of each loss.
    of_expected: [Vec<f32>; 2],
    of_depth: Vec<f32>,
    of_alpha: Vec<f32>,
}

/// A view as it was drawn, `[H, W]`.
pub(crate) struct DrawnDepth<'a> {
    pub depth: &'a [f32],
    pub alpha: &'a [f32],
    pub camera: &'a Camera,
}

impl SurfaceBuffers {
    /// Makes ready for a view of a photo; `is_known` says whether its depth is. Returns whether any loss counts.
    pub fn begin(&mut self, settings: &Surfaces, fraction: f64, is_known: bool, photo: &Photo) -> bool {
        let [depth, normals] = settings.at(fraction);
        self.weights = [if is_known { depth } else { 0.0 }, if photo.lens.is_some() { 0.0 } else { normals }];
        self.weights != [0.0; 2]
    }

    /// The Gaussians' normals as features to blend, and room for their picture, where they count.
    pub fn drawn_normals(
        &mut self,
        facing: &Facing<'_>,
        [height, width]: [usize; 2],
    ) -> (Option<Features<'_, f32>>, Option<&mut [f32]>) {
        let Self { weights: [_, weight], normals, picture, .. } = self;
        if *weight == 0.0 {
            return (None, None);
        }
        picture.resize(CHANNELS * height * width, 0.0);
        normals.resize(facing.scales.len(), 0.0);
        for_chunks(normals, CHANNELS * GRAIN, |chunk, normals| {
            for (i, normal) in normals.chunks_exact_mut(CHANNELS).enumerate() {
                normal.copy_from_slice(&facing.normal(chunk * GRAIN + i));
            }
        });
        (Some(Features { values: normals, channels: CHANNELS }), Some(picture))
    }

    /// The weighted losses of a view; the buffers then hold their gradients.
    pub fn compare(&mut self, drawn: &DrawnDepth<'_>, known: Option<&KnownDepth>, off: f64) -> f64 {
        let DrawnDepth { depth, alpha, camera } = drawn;
        let size = [camera.height, camera.width];
        let pixels = depth.len();
        self.expected.resize(pixels, 0.0);
        expected_depth(depth, alpha, &mut self.expected);
        let [of_known, of_normals] = &mut self.of_expected;
        [&mut *of_known, &mut *of_normals].into_iter().for_each(|of| of.resize(pixels, 0.0));
        let [depth_weight, normal_weight] = self.weights;
        let mut loss = 0.0;
        of_known.fill(0.0);
        if let Some(known) = known.filter(|_| depth_weight > 0.0) {
            known.resized(size, &mut self.known);
            loss += depth_weight * depth_loss(&self.expected, &self.known, off, of_known);
            of_known.iter_mut().for_each(|d| *d *= depth_weight as f32);
        }
        if normal_weight > 0.0 {
            self.of_picture.resize(self.picture.len(), 0.0);
            let Intrinsics { fx, fy, cx, cy } = camera.intrinsics;
            let relief =
                Relief { depth: &self.expected, alpha, normals: &self.picture, size, intrinsics: [fx, fy, cx, cy] };
            loss += normal_weight * normal_loss(&relief, of_normals, &mut self.of_picture);
            self.of_picture.iter_mut().for_each(|d| *d *= normal_weight as f32);
            of_known.iter_mut().zip(of_normals).for_each(|(d, n)| *d += normal_weight as f32 * *n);
        }
        [&mut self.of_depth, &mut self.of_alpha].into_iter().for_each(|of| {
            of.clear();
            of.resize(pixels, 0.0);
        });
        expected_depth_backward(depth, alpha, of_known, &mut self.of_depth, &mut self.of_alpha);
        loss
    }

    /// The normals as they were drawn, gradients with respect to the pictures, and room for the normals' gradient.
    pub fn surface(&mut self) -> Surface<'_> {
        let Self { weights: [depth, normal], normals, of_normals, of_picture, of_depth, of_alpha, .. } = self;
        let (counts, has_normals) = (*depth > 0.0 || *normal > 0.0, *normal > 0.0);
        of_normals.resize(normals.len(), 0.0);
        Surface {
            normals: has_normals.then_some(Features { values: normals, channels: CHANNELS }),
            of_normals: has_normals.then_some(of_normals),
            of_picture: has_normals.then_some(of_picture),
            of_depth: counts.then_some(of_depth),
            of_alpha: counts.then_some(of_alpha),
        }
    }

    /// Adds the gradient with respect to quaternions.
    pub fn pull_back(&self, facing: &Facing<'_>, quats: &mut [f32]) {
        if self.weights[1] == 0.0 {
            return;
        }
        for_chunks(quats, 4 * GRAIN, |chunk, quats| {
            for (i, quat) in quats.chunks_exact_mut(4).enumerate() {
                let n = chunk * GRAIN + i;
                let of_normal = [0, 1, 2].map(|c| self.of_normals[CHANNELS * n + c]);
                if of_normal != [0.0; 3] {
                    quat.iter_mut().zip(facing.pull_back(n, of_normal)).for_each(|(to, d)| *to += d);
                }
            }
        });
    }
}

/// The surface of a view on its way back: none where it does not count.
pub(crate) struct Surface<'a> {
    pub normals: Option<Features<'a, f32>>,
    pub of_normals: Option<&'a mut [f32]>,
    pub of_picture: Option<&'a [f32]>,
    pub of_depth: Option<&'a [f32]>,
    pub of_alpha: Option<&'a [f32]>,
}

/// Normals of Gaussians in a camera's axes, turned toward it.
pub(crate) struct Facing<'a> {
    means: &'a [f32],
    quats: &'a [f32],
    scales: &'a [f32],
    /// Rows of the rotation into the camera's axes, and the camera's place.
    rotation: [[f32; 3]; 3],
    center: [f32; 3],
}

impl<'a> Facing<'a> {
    pub fn new(population: &'a Population, scales: &'a [f32], camera: &Camera) -> Self {
        let rows = camera.pose.rotation.transpose();
        Self {
            means: &population.means.values,
            quats: &population.quats.values,
            scales,
            rotation: [rows.x_axis, rows.y_axis, rows.z_axis].map(|row| row.as_vec3().to_array()),
            center: camera.pose.center().as_vec3().to_array(),
        }
    }

    /// The quaternion of Gaussian `n`, its shortest axis, and 1 or -1 as that points toward the camera or away.
    fn axis(&self, n: usize) -> ([f32; 4], usize, f32) {
        let scales = &self.scales[3 * n..][..3];
        let axis = (0..3).min_by(|a, b| scales[*a].total_cmp(&scales[*b])).unwrap_or(0);
        let quat = [0, 1, 2, 3].map(|i| self.quats[4 * n + i]);
        let normal = column(quat, axis);
        let away: f32 = (0..3).map(|c| normal[c] * (self.means[3 * n + c] - self.center[c])).sum();
        (quat, axis, if away > 0.0 { -1.0 } else { 1.0 })
    }

    fn normal(&self, n: usize) -> [f32; 3] {
        let (quat, axis, sign) = self.axis(n);
        let normal = column(quat, axis);
        self.rotation.map(|row| sign * (row[0] * normal[0] + row[1] * normal[1] + row[2] * normal[2]))
    }

    /// The gradient with respect to the quaternion of Gaussian `n`.
    fn pull_back(&self, n: usize, of_normal: [f32; 3]) -> [f32; 4] {
        let (quat, axis, sign) = self.axis(n);
        let of_world = [0, 1, 2].map(|c| sign * (0..3).map(|r| self.rotation[r][c] * of_normal[r]).sum::<f32>());
        column_backward(quat, axis, of_world)
    }
}

/// The unit quaternion of one of any length, and 1 over that.
fn unit<T: Real>(quat: [T; 4]) -> ([T; 4], T) {
    let length = (quat[0] * quat[0] + quat[1] * quat[1] + quat[2] * quat[2] + quat[3] * quat[3]).sqrt();
    let inverse = if length > T::ZERO { T::ONE / length } else { T::ZERO };
    (quat.map(|x| x * inverse), inverse)
}

/// A column of the rotation matrix of a quaternion wxyz of any length.
fn column<T: Real>(quat: [T; 4], axis: usize) -> [T; 3] {
    let ([w, x, y, z], _) = unit(quat);
    let (one, two) = (T::ONE, T::from_f64(2.0));
    match axis {
        0 => [one - two * (y * y + z * z), two * (x * y + w * z), two * (x * z - w * y)],
        1 => [two * (x * y - w * z), one - two * (x * x + z * z), two * (y * z + w * x)],
        _ => [two * (x * z + w * y), two * (y * z - w * x), one - two * (x * x + y * y)],
    }
}

/// Backward of [`column`]: the gradient with respect to the quaternion.
fn column_backward<T: Real>(quat: [T; 4], axis: usize, [a, b, c]: [T; 3]) -> [T; 4] {
    let (q, inverse) = unit(quat);
    let [w, x, y, z] = q;
    let two = T::from_f64(2.0);
    let half = match axis {
        0 => [b * z - c * y, b * y + c * z, b * x - c * w - two * a * y, b * w + c * x - two * a * z],
        1 => [c * x - a * z, a * y + c * w - two * b * x, a * x + c * z, c * y - a * w - two * b * z],
        _ => [a * y - b * x, a * z - b * w - two * c * x, a * w + b * z - two * c * y, a * x + b * y],
    };
    let along = half[0] * w + half[1] * x + half[2] * y + half[3] * z;
    [0, 1, 2, 3].map(|i| two * inverse * (half[i] - q[i] * along))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 4))]

        /// Promise (fits): finite differences confirm the gradients of Gaussians' normals, for quaternions of any
        /// length.
        #[test]
        fn gradients_of_normals(quat: [f64; 4], of: [f64; 3], axis in 0_usize..3) {
            const STEP: f64 = 1e-6;
            let (quat, of) = (quat.map(|x| 0.3 + x.sin()), of.map(f64::sin));
            prop_assume!(quat.iter().map(|x| x * x).sum::<f64>() > 0.1);
            let value = |quat: [f64; 4]| column(quat, axis).iter().zip(of).map(|(x, d)| x * d).sum::<f64>();
            let found = column_backward(quat, axis, of);
            for i in 0..4 {
                let moved = |by: f64| {
                    let mut quat = quat;
                    quat[i] += by;
                    value(quat)
                };
                let expected = (moved(STEP) - moved(-STEP)) / (2.0 * STEP);
                prop_assert!((found[i] - expected).abs() < 1e-6, "{i}: {} against {expected}", found[i]);
            }
        }
    }
}
