//! Cameras that are refined with the scene.

use crate::settings::Poses;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_geometry::lens::LensCamera;
use weaver_geometry::{Pose, se3};
use weaver_kernels::dense;
use weaver_kernels::parallel;

/// Numbers of a camera: a twist's, translation, then rotation.
pub(crate) const TWIST: usize = 6;
/// Rows of pixels of a task.
const GRAIN: usize = 8;
/// Difference of colors below which a pixel counts by the square, above by the absolute value.
const SMALL: f64 = 0.05;
/// Slope of the colors, per pixel, that damps every pixel: without visible slopes, cameras stay.
const LEAST_SLOPE: f64 = 2e-3;
/// Pixels that a step moves the picture by at most, root mean square: linearized colors hold no farther.
const LONGEST: f64 = 2.0;

type Matrix = [[f64; TWIST]; TWIST];

/// A camera's view of a scene, and its photo.
#[derive(Clone, Copy, Debug)]
pub struct Views<'a> {
    /// The drawn image `[H, W, 3]`.
    pub image: &'a [f32],
    /// Its opacity `[H, W]`.
    pub alpha: &'a [f32],
    /// Its depth times opacity `[H, W]`, world units.
    pub depth: &'a [f32],
    /// The photo `[H, W, 3]`.
    pub photo: &'a [f32],
    /// Mask of the pixels of the photo that count, `[H, W]`; `None` if all do.
    pub mask: Option<&'a [bool]>,
}

/// The equations of a Gauss-Newton step of a camera toward its photo, the scene as it is.
///
/// A pixel u at depth z moves by `J x` under the camera's numbers x, and the color drawn there changes by `-c' J x`,
/// with c' the mean of the slopes of image and photo (which makes the step one of second order). The matrix `sum w J^T
/// c'^T c' J` and the right side `sum w J^T c'^T (image - photo)` belong to the cost `sum w |image - photo - c' J x|^2`
/// with w = 1 / max(|image - photo|, 0.05), which counts misfits by their absolute value.
///
/// Sources: Lucas and Kanade, 1981; Benhimane and Malis, Real-time image-based tracking of planes using efficient
/// second-order minimization, 2004, for the mean of the slopes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Alignment {
    matrix: Matrix,
    right: [f64; TWIST],
    /// `sum J^T J`: the movement of pixels by the numbers.
    motion: Matrix,
    pixels: f64,
}

impl Alignment {
    /// The equations of a camera and its view.
    pub fn new(camera: &LensCamera, views: &Views<'_>) -> Self {
        let (width, height) = (camera.camera.width, camera.camera.height);
        let mut rows = vec![Self::default(); height.saturating_sub(2)];
        parallel::for_chunks(&mut rows, GRAIN, |chunk, rows| {
            for (i, row) in rows.iter_mut().enumerate() {
                let y = 1 + chunk * GRAIN + i;
                (1..width - 1).for_each(|x| row.add_pixel(camera, views, x, y));
            }
        });
        // Row by row: the sum does not depend on threads.
        rows.iter().fold(Self::default(), |mut sum, row| {
            sum.add(row);
            sum
        })
    }

    fn add_pixel(&mut self, camera: &LensCamera, views: &Views<'_>, x: usize, y: usize) {
        let width = camera.camera.width;
        let at = y * width + x;
        let alpha = f64::from(views.alpha[at]);
        // A pixel that is mostly background has no depth to move by.
        if alpha < 0.5 || views.mask.is_some_and(|mask| !mask[at]) {
            return;
        }
        let mut slopes = [0.0; 3];
        let mut right = DVec2::ZERO;
        for c in 0..3 {
            let color = |at: usize| f64::from(views.image[3 * at + c] + views.photo[3 * at + c]);
            let slope = 0.25 * DVec2::new(color(at + 1) - color(at - 1), color(at + width) - color(at - width));
            let difference = f64::from(views.image[3 * at + c] - views.photo[3 * at + c]);
            let weight = 1.0 / difference.abs().max(SMALL);
            right += weight * difference * slope;
            let parts = [slope.x * slope.x, slope.x * slope.y, slope.y * slope.y];
            (0..3).for_each(|i| slopes[i] += weight * parts[i]);
        }
        let pixel = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
        // Nothing is drawn where a lens sees nothing.
        let Some([u, v]) = motion(camera, pixel, f64::from(views.depth[at]) / alpha) else { return };
        for a in 0..TWIST {
            let (du, dv) = (slopes[0] * u[a] + slopes[1] * v[a], slopes[1] * u[a] + slopes[2] * v[a]);
            self.right[a] += u[a] * right.x + v[a] * right.y;
            for b in a..TWIST {
                self.matrix[a][b] += du * u[b] + dv * v[b];
                self.motion[a][b] += u[a] * u[b] + v[a] * v[b];
            }
        }
        self.pixels += 1.0;
    }

    fn add(&mut self, other: &Self) {
        for a in 0..TWIST {
            self.right[a] += other.right[a];
            for b in a..TWIST {
                self.matrix[a][b] += other.matrix[a][b];
                self.motion[a][b] += other.motion[a][b];
            }
        }
        self.pixels += other.pixels;
    }

    /// The twist of the step; `None` if too little is seen.
    pub fn twist(&self) -> Option<[f64; TWIST]> {
        let weight = LEAST_SLOPE * LEAST_SLOPE / SMALL;
        let damped = |a: usize, b: usize| self.matrix[a.min(b)][a.max(b)] + weight * self.motion[a.min(b)][a.max(b)];
        let twist = solve(std::array::from_fn(|a| std::array::from_fn(|b| damped(a, b))), self.right)?;
        let square: f64 = (0..TWIST)
            .flat_map(|a| (0..TWIST).map(move |b| (a, b)))
            .map(|(a, b)| twist[a] * twist[b] * self.motion[a.min(b)][a.max(b)])
            .sum();
        let length = (square / self.pixels).sqrt();
        Some(twist.map(|x| x * (LONGEST / length.max(LONGEST))))
    }
}

/// Movement of a pixel's point at a depth in the picture with the camera's twist: derivatives of its x, and of its y;
/// `None` where a lens sees nothing.
pub fn motion(camera: &LensCamera, pixel: DVec2, depth: f64) -> Option<[[f64; TWIST]; 2]> {
    let p = camera.point(pixel, depth)?;
    // d pixel = J (v + w x p), J = [f/z, 0, -f x/z^2] for the x of a pinhole
    let row = |to_pixel: DVec3| {
        let turn = p.cross(to_pixel);
        [to_pixel.x, to_pixel.y, to_pixel.z, turn.x, turn.y, turn.z]
    };
    camera.gradients(p).map(|gradients| gradients.map(row))
}

/// The pose `exp(part x twist) pose`.
pub(crate) fn moved(pose: &Pose, twist: [f64; TWIST], part: f64) -> Pose {
    let [a, b, c, d, e, f] = twist.map(|x| part * x);
    se3::exp(DVec3::new(a, b, c), DVec3::new(d, e, f)).compose(pose)
}

/// Solves a positive definite system; `None` if it is singular.
fn solve(mut matrix: Matrix, mut right: [f64; TWIST]) -> Option<[f64; TWIST]> {
    let scale: [f64; TWIST] = std::array::from_fn(|i| matrix[i][i]);
    let sound = |i: usize, pivot: f64| pivot > 1e-12 * scale[i] && pivot.is_finite();
    dense::gauss_jordan(matrix.as_flattened_mut(), &mut right, TWIST, sound).then_some(right)
}

impl Poses {
    /// The part of its way that a camera goes in a step at this part of the run; 0 while cameras stand still.
    pub(crate) fn rate_at(&self, fraction: f64) -> f64 {
        if !self.refine || fraction < self.from || fraction >= self.until {
            return 0.0;
        }
        let done = (fraction - self.from) / (self.until - self.from).max(1e-9);
        self.rate * self.rate_end.powf(done)
    }
}
