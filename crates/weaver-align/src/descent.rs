//! The descent of one camera, whatever its loss is.

use weaver_geometry::glam::{DMat3, DQuat, DVec3, DVec4};
use weaver_geometry::{Camera, Intrinsics, Pose, se3};

/// Which numbers of a camera descend, at what rate.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Method {
    /// Increments `T <- exp(v, w) T` of the world-to-camera transform, v in units of the depth that the camera sees, both
    /// at 5e-3.
    Own,
    /// As in NoPoSplat: the same increments in the units of the world.
    NoPoSplat,
    /// As in 2Xplat: quaternion and center of the camera-to-world transform, both at 1e-4, the center in units of the scene.
    TwoXplat,
}

impl Method {
    /// How far a number goes in a step, about.
    pub fn rate(self) -> f64 {
        match self {
            Self::Own | Self::NoPoSplat => 5e-3,
            Self::TwoXplat => 1e-4,
        }
    }
}

/// How far the logarithms of focal lengths go in a step, about.
const FOCAL_RATE: f64 = 1e-3;
/// Decay of Adam's first and second moments, and what keeps its quotient finite.
const BETAS: [f64; 2] = [0.9, 0.999];
const EPS: f64 = 1e-8;
/// Length of a gradient below which it is rounding: Adam would take full steps by it.
const NOISE: f64 = 1e-10;

/// The gradient `(dl/dv, dl/dw)` at 0 of `l(exp(v, w) T)`, from `dl/d[A | t]` by the twelve numbers of `T = [A | t]`.
///
/// `dl/dv = t'` and `dl/dw = sum over the columns y of [A | t] of y x y'`, primes for gradients. Rows of four numbers.
///
/// ```
/// use weaver_align::twist_gradient;
/// use weaver_geometry::Pose;
/// // The loss is the first coordinate of the world's origin, before the camera at depth 2.
/// let pose = Pose { translation: [0.0, 0.0, 2.0].into(), ..Pose::IDENTITY };
/// let gradient = [0., 0., 0., 1., 0., 0., 0., 0., 0., 0., 0., 0.];
/// assert_eq!(twist_gradient(&pose, &gradient), [1., 0., 0., 0., 2., 0.]);
/// ```
pub fn twist_gradient(pose: &Pose, gradient: &[f64; 12]) -> [f64; 6] {
    let [columns, slopes] = [numbers(pose), *gradient].map(columns);
    let turn: DVec3 = columns.iter().zip(&slopes).map(|(y, slope)| y.cross(*slope)).sum();
    let shift = slopes[3];
    [shift.x, shift.y, shift.z, turn.x, turn.y, turn.z]
}

fn numbers(pose: &Pose) -> [f64; 12] {
    let rows = pose.rows();
    std::array::from_fn(|i| rows[i / 4][i % 4])
}

fn columns(m: [f64; 12]) -> [DVec3; 4] {
    std::array::from_fn(|j| DVec3::new(m[j], m[4 + j], m[8 + j]))
}

/// Adam (Kingma and Ba, 2015) of a few numbers.
#[derive(Clone, Debug)]
struct Adam<const N: usize> {
    moments: [[f64; 2]; N],
    /// What is left of the moments' start, `beta^steps`.
    left: [f64; 2],
}

impl<const N: usize> Adam<N> {
    fn new() -> Self {
        Self { moments: [[0.0; 2]; N], left: [1.0; 2] }
    }

    /// The step, for a rate of 1.
    fn step(&mut self, gradient: [f64; N]) -> [f64; N] {
        if gradient.iter().map(|g| g * g).sum::<f64>().sqrt() < NOISE {
            return [0.0; N];
        }
        self.left = [self.left[0] * BETAS[0], self.left[1] * BETAS[1]];
        let [first, second] = self.left.map(|left| 1.0 - left);
        std::array::from_fn(|i| {
            let (g, [m, v]) = (gradient[i], self.moments[i]);
            let (m, v) = (BETAS[0] * m + (1.0 - BETAS[0]) * g, BETAS[1] * v + (1.0 - BETAS[1]) * g * g);
            self.moments[i] = [m, v];
            -(m / first) / ((v / second).sqrt() + EPS)
        })
    }
}

/// A camera on its way down.
///
/// ```
/// use weaver_align::{Descent, Method};
/// use weaver_geometry::{Camera, Intrinsics, Pose};
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
    /// Of the quaternion xyzw and the center.
    coordinates: ([f64; 4], DVec3),
    pose: Adam<7>,
    focal: Adam<2>,
}

impl Descent {
    /// From a first guess. `unit` is the length that translations are measured in: the mean depth of what the camera sees, or the scene's
    /// size; [`Method::NoPoSplat`] knows none.
    pub fn new(method: Method, camera: Camera, unit: f64) -> Self {
        let center = camera.pose.inverse();
        let [w, x, y, z] = center.wxyz();
        let unit = if method == Method::NoPoSplat { 1.0 } else { unit };
        let coordinates = ([x, y, z, w], center.translation);
        Self { method, camera, unit, coordinates, pose: Adam::new(), focal: Adam::new() }
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
        // Products of rotations drift from what rotations are.
        self.camera.pose = Pose::from_wxyz(moved.wxyz(), moved.translation);
    }

    fn step_coordinates(&mut self, viewmat: &[f64; 12], rate: f64) {
        let (q, center) = self.coordinates;
        let [r1, r2, r3, t] = columns(*viewmat);
        let rotation = self.camera.pose.rotation.transpose();
        // A = R^T and t = -R^T c.
        let by_rotation = DMat3::from_cols(r1, r2, r3).transpose() - outer(center, t);
        let by_center = -(rotation * t) * self.unit;
        let [x, y, z, w] = quaternion_gradient(q, &by_rotation);
        let steps = self.pose.step([x, y, z, w, by_center.x, by_center.y, by_center.z]).map(|step| rate * step);
        let q = std::array::from_fn(|i| q[i] + steps[i]);
        let center = center + self.unit * DVec3::new(steps[4], steps[5], steps[6]);
        self.coordinates = (q, center);
        let [x, y, z, w] = q;
        self.camera.pose = Pose::from_wxyz([w, x, y, z], center).inverse();
    }
}

fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// The gradient by a quaternion xyzw of any length, from that by the rotation that it stands for.
fn quaternion_gradient(q: [f64; 4], by_rotation: &DMat3) -> [f64; 4] {
    let q = DVec4::from_array(q);
    let DQuat { x, y, z, w } = DQuat::from_vec4(q / q.length());
    // g[column][row]
    let g = by_rotation.to_cols_array_2d();
    let sum = |i: usize, j: usize| g[j][i] + g[i][j];
    let turn = |i: usize, j: usize| g[j][i] - g[i][j];
    let unit = DVec4::new(
        2.0 * (y * sum(0, 1) + z * sum(0, 2) - 2.0 * x * (g[1][1] + g[2][2]) + w * turn(2, 1)),
        2.0 * (x * sum(0, 1) + z * sum(1, 2) - 2.0 * y * (g[0][0] + g[2][2]) + w * turn(0, 2)),
        2.0 * (x * sum(0, 2) + y * sum(1, 2) - 2.0 * z * (g[0][0] + g[1][1]) + w * turn(1, 0)),
        2.0 * (x * turn(2, 1) + y * turn(0, 2) + z * turn(1, 0)),
    );
    let axis = q / q.length();
    ((unit - axis * axis.dot(unit)) / q.length()).to_array()
}
