//! The descent of one camera, for any loss and without a tape: on slopes by its world-to-camera transform, as
//! rasterizers give them.

use crate::rotation::matrix;
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Intrinsics, Pose, se3};
use weaver_kernels::Dual;
use weaver_kernels::optim::AdamW;

/// The numbers of a camera that descend, and their rate.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Method {
    /// Increments `T <- exp(v, w) T` of the world-to-camera transform, v in units of the depth that the camera sees,
    /// both at 5e-3.
    Own,
    /// As in NoPoSplat (Ye et al., arXiv 2410.24207): the same increments in the units of the world.
    NoPoSplat,
    /// As in 2Xplat (Jeong et al., arXiv 2603.21064): quaternion and center of the camera-to-world transform, both at
    /// 1e-4, the center in units of the scene.
    TwoXplat,
}

impl Method {
    /// Movement of a number in a step, about.
    pub fn rate(self) -> f64 {
        match self {
            Self::Own | Self::NoPoSplat => 5e-3,
            Self::TwoXplat => 1e-4,
        }
    }
}

/// Movement of the logarithms of focal lengths in a step, about.
const FOCAL_RATE: f64 = 1e-3;
/// Length of a gradient below which it is rounding: Adam would take full steps by it.
const NOISE: f64 = 1e-10;
/// Adam with rate 1: the numbers carry their own rate.
const ADAM: AdamW<f64> =
    AdamW { rate: 1.0, beta1: 0.9, beta2: 0.999, eps: 1e-8, weight_decay: 0.0, gradient_scale: 1.0 };

/// The gradient `(dl/dv, dl/dw)` at 0 of `l(exp(v, w) T)`, from `dl/d[A | t]` by the twelve numbers of `T = [A | t]`.
///
/// `dl/dv = t'` and `dl/dw = sum over the columns y of [A | t] of y x y'`, primes for gradients. Rows of four numbers.
///
/// ```
/// use weaver_geometry::Pose;
/// use weaver_pose::descent::twist_gradient;
/// // The loss is the first coordinate of the world's origin, before the camera at depth 2.
/// let pose = Pose { translation: [0.0, 0.0, 2.0].into(), ..Pose::IDENTITY };
/// let gradient = [0., 0., 0., 1., 0., 0., 0., 0., 0., 0., 0., 0.];
/// assert_eq!(twist_gradient(&pose, &gradient), [1., 0., 0., 0., 2., 0.]);
/// ```
pub fn twist_gradient(pose: &Pose, gradient: &[f64; 12]) -> [f64; 6] {
    let slopes: [DVec3; 4] = std::array::from_fn(|j| DVec3::new(gradient[j], gradient[4 + j], gradient[8 + j]));
    let columns = [pose.rotation.x_axis, pose.rotation.y_axis, pose.rotation.z_axis, pose.translation];
    let turn: DVec3 = columns.iter().zip(&slopes).map(|(y, slope)| y.cross(*slope)).sum();
    let shift = slopes[3];
    [shift.x, shift.y, shift.z, turn.x, turn.y, turn.z]
}

/// Moments of a few numbers, and how many steps they are of.
#[derive(Clone, Debug)]
struct Moments<const N: usize> {
    first: [f64; N],
    second: [f64; N],
    steps: u64,
}

impl<const N: usize> Moments<N> {
    const NONE: Self = Self { first: [0.0; N], second: [0.0; N], steps: 0 };

    /// Adam's step, for a rate of 1.
    fn step(&mut self, gradient: [f64; N]) -> [f64; N] {
        let mut step = [0.0; N];
        if gradient.iter().map(|g| g * g).sum::<f64>().sqrt() >= NOISE {
            self.steps += 1;
            ADAM.step(self.steps, &mut step, &gradient, &mut self.first, &mut self.second);
        }
        step
    }
}

/// A camera on its way down, by Adam (Kingma and Ba, 2015).
///
/// ```
/// use weaver_geometry::{Camera, Intrinsics, Pose};
/// use weaver_pose::descent::{Descent, Method};
/// let intrinsics = Intrinsics { fx: 40.0, fy: 40.0, cx: 32.0, cy: 24.0 };
/// let camera = Camera { pose: Pose::IDENTITY, intrinsics, width: 64, height: 48 };
/// let mut descent = Descent::new(Method::NoPoSplat, camera, 1.0);
/// // Half the squared distance of t from (0.1, 0, 0).
/// for _ in 0..300 {
///     let x = descent.camera().pose.translation.x - 0.1;
///     descent.step(&[0., 0., 0., x, 0., 0., 0., 0., 0., 0., 0., 0.], [0.0; 2], 1.0);
/// }
/// assert!((descent.camera().pose.translation.x - 0.1).abs() < 1e-3);
/// ```
#[derive(Clone, Debug)]
pub struct Descent {
    method: Method,
    camera: Camera,
    unit: f64,
    /// The quaternion xyzw of the camera-to-world transform, of any length, and the center in units.
    coordinates: [f64; 7],
    pose: Moments<7>,
    focal: Moments<2>,
}

impl Descent {
    /// From a first guess. `unit` is the length that translations are measured in: the mean depth of the camera's view,
    /// or the scene's size; [`Method::NoPoSplat`] has none.
    pub fn new(method: Method, camera: Camera, unit: f64) -> Self {
        let unit = if method == Method::NoPoSplat { 1.0 } else { unit };
        let to_world = camera.pose.inverse();
        let ([w, x, y, z], center) = (to_world.wxyz(), to_world.translation / unit);
        let coordinates = [x, y, z, w, center.x, center.y, center.z];
        Self { method, camera, unit, coordinates, pose: Moments::NONE, focal: Moments::NONE }
    }

    /// The camera as it is now.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// One step of Adam against the loss's gradient by the numbers of `[A | t]`, and by the logarithms of fx and fy, at
    /// `factor` times the method's rate. Adam's moments persist, although increments begin at 0 each time.
    pub fn step(&mut self, viewmat: &[f64; 12], log_focal: [f64; 2], factor: f64) {
        let rate = factor * self.method.rate();
        match self.method {
            Method::Own | Method::NoPoSplat => self.step_increment(viewmat, rate),
            Method::TwoXplat => self.step_coordinates(viewmat, rate),
        }
        let [x, y] = self.focal.step(log_focal).map(|step| (factor * FOCAL_RATE * step).exp());
        let Intrinsics { fx, fy, .. } = self.camera.intrinsics;
        self.camera.intrinsics = Intrinsics { fx: x * fx, fy: y * fy, ..self.camera.intrinsics };
    }

    fn step_increment(&mut self, viewmat: &[f64; 12], rate: f64) {
        let [a, b, c, d, e, f] = twist_gradient(&self.camera.pose, viewmat);
        let u = self.unit;
        let [a, b, c, d, e, f, _] = self.pose.step([u * a, u * b, u * c, d, e, f, 0.0]).map(|step| rate * step);
        let moved = se3::exp(u * DVec3::new(a, b, c), DVec3::new(d, e, f)).compose(&self.camera.pose);
        // Products of rotations drift away from rotations.
        self.camera.pose = Pose::from_wxyz(moved.wxyz(), moved.translation);
    }

    fn step_coordinates(&mut self, viewmat: &[f64; 12], rate: f64) {
        let [x, y, z, w, center @ ..] = Dual::inputs(self.coordinates);
        let to_world = matrix([x, y, z, w]);
        let mut gradient = [0.0; 7];
        for (j, slopes) in viewmat.as_chunks::<4>().0.iter().enumerate() {
            // A = R^T and t = -R^T c.
            let row = [to_world[j], to_world[3 + j], to_world[6 + j]];
            let t = -(row[0] * center[0] + row[1] * center[1] + row[2] * center[2]) * self.unit;
            for (number, slope) in row.into_iter().chain([t]).zip(slopes) {
                gradient.iter_mut().zip(number.partial).for_each(|(sum, partial)| *sum += slope * partial);
            }
        }
        let steps = self.pose.step(gradient);
        self.coordinates.iter_mut().zip(steps).for_each(|(x, step)| *x += rate * step);
        let [x, y, z, w, center @ ..] = self.coordinates;
        self.camera.pose = Pose::from_wxyz([w, x, y, z], self.unit * DVec3::from(center)).inverse();
    }
}
