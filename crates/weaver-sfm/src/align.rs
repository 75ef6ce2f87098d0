//! Keypoints moved to where photos agree about what is around them.

use crate::bundle::{Bundle, Observation};
use crate::photo::Photo;
use weaver_geometry::glam::{DMat2, DVec2, DVec3};
use weaver_geometry::Camera;
use weaver_kernels::parallel;

/// Samples from the middle of a patch to its side, and of the whole patch.
const REACH: i32 = 5;
const SIDE: usize = 2 * REACH as usize + 1;
const SAMPLES: usize = SIDE * SIDE;
/// Numbers of a warp: where the middle is, and how offsets are mapped.
const NUMBERS: usize = 6;
/// Steps of an alignment, and the movement below which it ends, samples.
const STEPS: usize = 12;
const STILL: f64 = 0.003;

type Patch = [f64; SAMPLES];

/// Offsets of the samples.
fn grid() -> [DVec2; SAMPLES] {
    std::array::from_fn(|i| {
        DVec2::new((i % SIDE) as f64 - f64::from(REACH), (i / SIDE) as f64 - f64::from(REACH))
    })
}

/// What surrounds a pixel, by bilinear interpolation; `None` where it reaches out of the photo.
fn sampled(photo: &Photo<'_>, at: DVec2, warp: DMat2, grid: &[DVec2; SAMPLES]) -> Option<Patch> {
    let [height, width] = photo.size;
    let mut patch = [0.0; SAMPLES];
    for (value, offset) in patch.iter_mut().zip(grid) {
        let p = at + warp * *offset - DVec2::splat(0.5);
        if !(p.x >= 0.0 && p.y >= 0.0 && p.x < (width - 1) as f64 && p.y < (height - 1) as f64) {
            return None;
        }
        let (x, y) = (p.x as usize, p.y as usize);
        let (fx, fy) = (p.x - x as f64, p.y - y as f64);
        let row = |y: usize| {
            let v = &photo.gray[y * width + x..][..2];
            f64::from(v[0]) * (1.0 - fx) + f64::from(v[1]) * fx
        };
        *value = row(y) * (1.0 - fy) + row(y + 1) * fy;
    }
    Some(patch)
}

/// Less its mean; and its length then.
fn centered(patch: &mut Patch) -> f64 {
    let mean = patch.iter().sum::<f64>() / SAMPLES as f64;
    patch.iter_mut().for_each(|v| *v -= mean);
    patch.iter().map(|v| v * v).sum::<f64>().sqrt()
}

/// A patch that others are aligned with.
struct Template {
    patch: Patch,
    length: f64,
    slopes: Vec<[f64; NUMBERS]>,
    inverse: [[f64; NUMBERS]; NUMBERS],
}

impl Template {
    fn new(photo: &Photo<'_>, at: DVec2, warp: DMat2, grid: &[DVec2; SAMPLES]) -> Option<Self> {
        let mut patch = sampled(photo, at, warp, grid)?;
        let length = centered(&mut patch);
        if length < crate::knob("FLAT", 0.02) * (SAMPLES as f64).sqrt() {
            return None;
        }
        let shifted = |by: DVec2| sampled(photo, at + warp * by, warp, grid);
        let h = 0.5;
        let (right, left) = (shifted(DVec2::X * h)?, shifted(-DVec2::X * h)?);
        let (below, above) = (shifted(DVec2::Y * h)?, shifted(-DVec2::Y * h)?);
        let mut slopes: Vec<[f64; NUMBERS]> = (0..SAMPLES)
            .map(|i| {
                let (gx, gy, o) = (right[i] - left[i], below[i] - above[i], grid[i] / f64::from(REACH));
                [gx, gy, gx * o.x, gx * o.y, gy * o.x, gy * o.y]
            })
            .collect();
        // Brightness and contrast are another photo's own.
        for k in 0..NUMBERS {
            let mean = slopes.iter().map(|s| s[k]).sum::<f64>() / SAMPLES as f64;
            let along = slopes.iter().zip(&patch).map(|(s, v)| s[k] * v).sum::<f64>() / (length * length);
            slopes.iter_mut().zip(&patch).for_each(|(s, v)| s[k] -= mean + along * v);
        }
        let mut matrix = [[0.0; NUMBERS]; NUMBERS];
        for s in &slopes {
            for a in 0..NUMBERS {
                for b in 0..NUMBERS {
                    matrix[a][b] += s[a] * s[b];
                }
            }
        }
        let noise = crate::knob("NOISE", 0.02f64).powi(2);
        for (k, row) in matrix.iter_mut().enumerate() {
            row[k] += noise / if k < 2 { 1.0 } else { crate::knob("BEND", 1.0).powi(2) };
        }
        Some(Self { patch, length, slopes, inverse: inverted(matrix)? })
    }

    /// Where a photo shows the same, from where it is taken to be; and how alike both are.
    fn aligned(&self, photo: &Photo<'_>, mut at: DVec2, mut warp: DMat2, grid: &[DVec2; SAMPLES]) -> Option<(DVec2, f64)> {
        let mut alike = 0.0;
        for _ in 0..STEPS {
            let mut patch = sampled(photo, at, warp, grid)?;
            let length = centered(&mut patch);
            if length <= 0.0 {
                return None;
            }
            let gain = self.length / length;
            alike = patch.iter().zip(&self.patch).map(|(a, b)| a * b).sum::<f64>() / (length * self.length);
            let mut right = [0.0; NUMBERS];
            for ((a, b), s) in patch.iter().zip(&self.patch).zip(&self.slopes) {
                let off = gain * a - b;
                (0..NUMBERS).for_each(|k| right[k] += off * s[k]);
            }
            let step: [f64; NUMBERS] =
                std::array::from_fn(|a| (0..NUMBERS).map(|b| self.inverse[a][b] * right[b]).sum());
            let r = f64::from(REACH);
            let bend = DMat2::from_cols(DVec2::new(1.0 + step[2] / r, step[4] / r), DVec2::new(step[3] / r, 1.0 + step[5] / r));
            warp *= bend.inverse();
            let by = DVec2::new(step[0], step[1]);
            at -= warp * by;
            if by.length() < STILL {
                break;
            }
        }
        at.is_finite().then_some((at, alike))
    }
}

fn inverted(mut m: [[f64; NUMBERS]; NUMBERS]) -> Option<[[f64; NUMBERS]; NUMBERS]> {
    let mut inverse: [[f64; NUMBERS]; NUMBERS] = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(i == j)));
    for k in 0..NUMBERS {
        let pivot = m[k][k];
        if pivot <= 1e-12 {
            return None;
        }
        for j in 0..NUMBERS {
            m[k][j] /= pivot;
            inverse[k][j] /= pivot;
        }
        for i in (0..NUMBERS).filter(|i| *i != k) {
            let by = m[i][k];
            for j in 0..NUMBERS {
                m[i][j] -= by * m[k][j];
                inverse[i][j] -= by * inverse[k][j];
            }
        }
    }
    Some(inverse)
}

/// How offsets in the plane through a point, across a direction, are seen by a camera.
fn seen(camera: &Camera, point: DVec3, [u, v]: [DVec3; 2]) -> DMat2 {
    let p = camera.pose.apply(point);
    let k = &camera.intrinsics;
    let slope = |d: DVec3| {
        let d = camera.pose.rotation * d;
        DVec2::new(k.fx * (d.x - p.x / p.z * d.z), k.fy * (d.y - p.y / p.z * d.z)) / p.z
    };
    DMat2::from_cols(slope(u), slope(v))
}

impl Bundle {
    pub(crate) fn align(&mut self, photos: &[&Photo<'_>]) {
        let grid = grid();
        let cameras: Vec<Camera> = (0..self.cameras.len()).map(|i| self.camera(i)).collect();
        let points = &self.points;
        self.observations.sort_by_key(|o| o.point);
        let mut runs: Vec<&mut [Observation]> = self.observations.chunk_by_mut(|a, b| a.point == b.point).collect();
        let sharp = crate::knob("SHARP", 0.5);
        let least = crate::knob("ALIKE", 0.8);
        let far = crate::knob("MOVES", 1.5);
        parallel::for_chunks(&mut runs, 16, |_, runs| {
            for run in runs {
                let point = points[run[0].point];
                let to = |o: &Observation| (cameras[o.camera].pose.center() - point).normalize_or_zero();
                let normal = run.iter().map(to).sum::<DVec3>().normalize_or_zero();
                if normal == DVec3::ZERO { continue; }
                let (u, v) = normal.any_orthonormal_pair();
                let best = (0..run.len()).max_by(|a, b| to(&run[*a]).dot(normal).total_cmp(&to(&run[*b]).dot(normal))).unwrap();
                let from = run[best];
                let plane = seen(&cameras[from.camera], point, [u, v]);
                if plane.determinant().abs() < 1e-12 { continue; }
                let step = from.deviation.clamp(1.0, crate::knob("STEP", 1.5));
                let warp = DMat2::from_diagonal(DVec2::splat(step));
                let Some(template) = Template::new(photos[from.camera], from.pixel, warp, &grid) else { continue };
                let mut any = false;
                for (i, o) in run.iter_mut().enumerate() {
                    if i == best { continue; }
                    let across = seen(&cameras[o.camera], point, [u, v]) * plane.inverse() * warp;
                    if let Some((at, alike)) = template.aligned(photos[o.camera], o.pixel, across, &grid) {
                        if alike > least && at.distance(o.pixel) < far * o.deviation {
                            o.pixel = at;
                            o.deviation *= sharp;
                            any = true;
                        }
                    }
                }
                if any { run[best].deviation *= sharp; }
            }
        });
    }
}
