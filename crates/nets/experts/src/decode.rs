//! Decoding of raw parameters to Gaussians.

use crate::parametrization::{BEFORE_HARMONICS, Parametrization, harmonics};
use weaver_autograd::{Backward, Op, Outputs, Pool, Real, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_geometry::sh::DC;
use weaver_kernels::parallel;
use weaver_splat::GaussianVars;

/// Gaussians per parallel chunk.
const GRAIN: usize = 512;
/// Added to a quaternion's norm before dividing by it.
const NORM_EPSILON: f64 = 1e-8;
/// Bounds of the raw scale under the relative parametrizations.
const RAW_SCALE: (f64, f64) = (-3.0, 3.0);

/// The factor of the coefficients of a degree: 1, 0.025, 0.00625, ...
pub(crate) fn degree_factor(degree: usize) -> f64 {
    if degree == 0 { 1.0 } else { 0.1 * 0.25_f64.powi(degree as i32) }
}

/// exp of a raw scale within its bounds, and whether it is.
fn bounded_exp<T: Real>(raw: T) -> (T, bool) {
    let (low, high) = (T::from_f64(RAW_SCALE.0), T::from_f64(RAW_SCALE.1));
    (raw.max(low).min(high).exp(), raw >= low && raw <= high)
}

/// The product of two quaternions wxyz.
fn product<T: Real>([w, x, y, z]: [T; 4], q: [T; 4]) -> [T; 4] {
    [
        w * q[0] - x * q[1] - y * q[2] - z * q[3],
        w * q[1] + x * q[0] + y * q[3] - z * q[2],
        w * q[2] - x * q[3] + y * q[0] + z * q[1],
        w * q[3] + x * q[2] - y * q[1] + z * q[0],
    ]
}

fn softplus<T: Real>(x: T) -> T {
    x.max(T::ZERO) + (-x.abs()).exp().ln_1p()
}

fn sigmoid<T: Real>(x: T) -> T {
    let small = (-x.abs()).exp();
    (if x >= T::ZERO { T::ONE } else { small }) / (T::ONE + small)
}

#[derive(Debug)]
struct Decode {
    parametrization: Parametrization,
    sh_degree: usize,
}

/// A scale and its slope.
struct Scale<T> {
    value: T,
    by_raw: T,
    by_footprint: T,
}

impl Decode {
    fn scale<T: Real>(&self, raw: T, ins: &[View<'_, T>], (i, axis): (usize, usize)) -> Scale<T> {
        match self.parametrization {
            Parametrization::Published { scale_multiplier, scale_max, .. } => {
                let (multiplier, most) = (T::from_f64(scale_multiplier), T::from_f64(scale_max));
                let value = multiplier * softplus(raw);
                let by_raw = if value <= most { multiplier * sigmoid(raw) } else { T::ZERO };
                Scale { value: value.min(most), by_raw, by_footprint: T::ZERO }
            }
            Parametrization::Footprint { scale, .. } => {
                let (factor, inside) = bounded_exp(raw);
                let unit = T::from_f64(scale) * factor / ins[2][i].sqrt();
                let value = unit * ins[1][i];
                Scale { value, by_raw: if inside { value } else { T::ZERO }, by_footprint: unit }
            }
            Parametrization::Patch { scale, .. } => {
                let (factor, inside) = bounded_exp(raw);
                let value = T::from_f64(scale) * factor * ins[1][3 * i + axis];
                Scale { value, by_raw: if inside { value } else { T::ZERO }, by_footprint: T::ZERO }
            }
        }
    }

    /// The raw quaternion xyzw, which starts at the identity where the parametrization says so.
    fn quaternion<T: Real>(&self, row: &[T]) -> [T; 4] {
        let w = if self.parametrization.is_relative() { T::ONE } else { T::ZERO };
        [row[4], row[5], row[6], row[7] + w]
    }

    /// The rotation of the patch wxyz, where there is one.
    fn frame<T: Real>(&self, ins: &[View<'_, T>], i: usize) -> Option<[T; 4]> {
        let has_patch = matches!(self.parametrization, Parametrization::Patch { .. });
        has_patch.then(|| [0, 1, 2, 3].map(|a| ins[2][4 * i + a]))
    }

    fn coefficient(&self, k: usize) -> f64 {
        degree_factor(k.isqrt())
    }
}

fn norm<T: Real>(q: [T; 4]) -> T {
    (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]).sqrt()
}

impl<T: Real> Op<T> for Decode {
    fn name(&self) -> &'static str {
        "decode_gaussians"
    }

    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let (n, k) = (ins[0].rows(), harmonics(self.sh_degree));
        let width = BEFORE_HARMONICS + 3 * k;
        ensure_shape!(ins[0] == Shape::from([n, width]), "raw parameters [N, {width}]");
        match self.parametrization {
            Parametrization::Published { .. } => {}
            Parametrization::Footprint { .. } => {
                ensure_shape!(ins[1] == Shape::from([n]) && ins[2] == ins[1], "footprints and local counts [{n}]");
                ensure_shape!(ins[3] == Shape::from([n, 3]), "colors [{n}, 3]");
            }
            Parametrization::Patch { .. } => {
                ensure_shape!(ins[1] == Shape::from([n, 3]) && ins[3] == ins[1], "extents and colors [{n}, 3]");
                ensure_shape!(ins[2] == Shape::from([n, 4]), "rotations [{n}, 4]");
            }
        }
        Ok(Shapes::one([n, 3]).and([n, 4]).and([n]).and([n, k, 3]))
    }

    fn differentiable(&self, index: usize) -> bool {
        index == 0 || (index == 1 && matches!(self.parametrization, Parametrization::Footprint { .. }))
    }

    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let theta = ins[0];
        let width = theta.shape().last();
        let row = |i: usize| &theta[i * width..(i + 1) * width];
        let [scales, quats, opacities, sh] = outs else { unreachable!("four outputs") };
        parallel::for_chunks(scales, GRAIN * 3, |chunk, out| {
            for (at, s) in out.iter_mut().enumerate() {
                let i = chunk * GRAIN + at / 3;
                *s = self.scale(row(i)[1 + at % 3], ins, (i, at % 3)).value;
            }
        });
        parallel::for_chunks(quats, GRAIN * 4, |chunk, out| {
            for (at, quat) in out.chunks_exact_mut(4).enumerate() {
                let i = chunk * GRAIN + at;
                let q = self.quaternion(row(i));
                let length = norm(q) + T::from_f64(NORM_EPSILON);
                let own = [q[3], q[0], q[1], q[2]].map(|q| q / length);
                quat.copy_from_slice(&self.frame(ins, i).map_or(own, |frame| product(frame, own)));
            }
        });
        opacities.iter_mut().enumerate().for_each(|(i, o)| *o = sigmoid(row(i)[0]));
        let k = harmonics(self.sh_degree);
        parallel::for_chunks(sh, GRAIN * 3 * k, |chunk, out| {
            for (at, out) in out.chunks_exact_mut(3 * k).enumerate() {
                let i = chunk * GRAIN + at;
                let raw = &row(i)[BEFORE_HARMONICS..];
                for (basis, rgb) in out.chunks_exact_mut(3).enumerate() {
                    let factor = T::from_f64(self.coefficient(basis));
                    for c in 0..3 {
                        rgb[c] = raw[c * k + basis] * factor;
                    }
                }
                if let Some(colors) = ins.get(3) {
                    for c in 0..3 {
                        out[c] += (colors[3 * i + c] - T::from_f64(0.5)) / T::from_f64(DC);
                    }
                }
            }
        });
    }

    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, outs, douts, dins, .. } = at;
        let theta = ins[0];
        let (width, k) = (theta.shape().last(), harmonics(self.sh_degree));
        let (dscale, dquat, dopacity, dsh) = (douts[0], douts[1], douts[2], douts[3]);
        if let Some(dtheta) = &mut dins[0] {
            parallel::for_chunks(dtheta.accumulator(), GRAIN * width, |chunk, out| {
                for (at, dtheta) in out.chunks_exact_mut(width).enumerate() {
                    let i = chunk * GRAIN + at;
                    let raw = &theta[i * width..(i + 1) * width];
                    let opacity = outs[2][i];
                    dtheta[0] += dopacity[i] * opacity * (T::ONE - opacity);
                    for a in 0..3 {
                        dtheta[1 + a] += dscale[3 * i + a] * self.scale(raw[1 + a], ins, (i, a)).by_raw;
                    }
                    // u = q / (|q| + e): dq = (du - q (q . du) / (|q| (|q| + e))) / (|q| + e)
                    let q = self.quaternion(raw);
                    let mut du = [0, 1, 2, 3].map(|a| dquat[4 * i + a]);
                    if let Some([w, x, y, z]) = self.frame(ins, i) {
                        // The transpose of a product with a unit quaternion is that with its inverse.
                        du = product([w, -x, -y, -z], du);
                    }
                    let du = [du[1], du[2], du[3], du[0]];
                    let length = norm(q);
                    let longer = length + T::from_f64(NORM_EPSILON);
                    let along: T = q.iter().zip(du).map(|(q, du)| *q * du).sum();
                    let along = if length > T::ZERO { along / (length * longer) } else { T::ZERO };
                    for a in 0..4 {
                        dtheta[4 + a] += (du[a] - q[a] * along) / longer;
                    }
                    let dharmonics = &mut dtheta[BEFORE_HARMONICS..];
                    for basis in 0..k {
                        let factor = T::from_f64(self.coefficient(basis));
                        for c in 0..3 {
                            dharmonics[c * k + basis] += factor * dsh[3 * (k * i + basis) + c];
                        }
                    }
                }
            });
        }
        if let Some(Some(dfootprint)) = dins.get_mut(1) {
            dfootprint.add_each(|i| {
                let raw = &theta[i * width + 1..i * width + 4];
                raw.iter().enumerate().map(|(a, &s)| dscale[3 * i + a] * self.scale(s, ins, (i, a)).by_footprint).sum()
            });
        }
    }
}

/// The properties of each Gaussian's pixel that the footprint parametrization uses.
#[derive(Clone, Copy, Debug)]
pub struct PixelOf<'t, T: Real = f32> {
    /// depth / fx `[N]`, in world units; differentiable.
    pub footprint: Var<'t, T>,
    /// Gaussians per pixel around the Gaussian's pixel `[N]`; constant.
    pub local_count: Var<'t, T>,
    /// Color of the Gaussian's pixel `[N, 3]`, 0 to 1; constant.
    pub color: Var<'t, T>,
}

/// The patch of surface that a Gaussian stands for, which the patch parametrization uses; all of it is constant.
#[derive(Clone, Copy, Debug)]
pub struct PatchOf<'t, T: Real = f32> {
    /// Extents along its axes `[N, 3]`, in world units.
    pub extents: Var<'t, T>,
    /// Rotation from its axes to the world as unit quaternions wxyz `[N, 4]`.
    pub rotation: Var<'t, T>,
    /// Mean color `[N, 3]`, 0 to 1.
    pub color: Var<'t, T>,
}

/// Reference of a Gaussian's raw numbers.
#[derive(Clone, Copy, Debug)]
pub enum Origin<'t, T: Real = f32> {
    /// Its pixel.
    Pixel(PixelOf<'t, T>),
    /// Its patch.
    Patch(PatchOf<'t, T>),
}

impl<T: Real> Outputs<T> for Origin<'_, T> {
    fn for_each_var(&self, visit: &mut dyn FnMut(Var<'_, T>)) {
        match self {
            Self::Pixel(pixel) => pixel.for_each_var(visit),
            Self::Patch(patch) => [patch.extents, patch.rotation, patch.color].for_each_var(visit),
        }
    }
}

impl<T: Real> Outputs<T> for PixelOf<'_, T> {
    fn for_each_var(&self, visit: &mut dyn FnMut(Var<'_, T>)) {
        [self.footprint, self.local_count, self.color].for_each_var(visit);
    }
}

/// The Gaussians with these means and raw parameters, as the rasterizer takes them; see [`Parametrization`] for the
/// formulas.
///
/// The result has standard deviations `[N, 3]` in world units, unit quaternions wxyz `[N, 4]`, opacities `[N]` in
/// (0, 1) and spherical harmonics `[N, K, 3]`; the `means` `[N, 3]` are passed on as they are.
///
/// `theta` `[N, 8 + 3 K]` holds, per Gaussian, opacity 1, scale 3, quaternion xyzw 4 and harmonics 3 K (color-major),
/// with K = (`sh_degree` + 1)^2. It and footprints are differentiable. Where a scale is clamped its gradient is 0;
/// at the bound itself it passes. Panics on other shapes, and if the parametrization needs an `origin` of another kind.
/// Source: official SplatWeaver code, `UnifiedGaussianAdapter`.
///
/// ```
/// use weaver_autograd::Tape;
/// use weaver_experts::{Parametrization, decode};
/// let tape = Tape::<f64>::new();
/// let means = tape.constant(&[0.0, 0.0, 2.0], [1, 3]);
/// let theta = tape.leaf(&[0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 2.0, 0.1, 0.2, 0.3], [1, 11]);
/// let gaussian = decode(means, theta, 0, None, Parametrization::published());
/// assert_eq!(gaussian.opacities.to_vec(), [0.5]);
/// assert!((gaussian.quats.to_vec()[0] - 1.0).abs() < 1e-7);
/// assert_eq!(gaussian.colors.to_vec(), [0.1, 0.2, 0.3]);
/// ```
#[track_caller]
pub fn decode<'t, T: Real>(
    means: Var<'t, T>,
    theta: Var<'t, T>,
    sh_degree: usize,
    origin: Option<Origin<'t, T>>,
    parametrization: Parametrization,
) -> GaussianVars<'t, T> {
    let (tape, op) = (theta.tape(), Decode { parametrization, sh_degree });
    let [scales, quats, opacities, colors] = match (parametrization, origin) {
        (Parametrization::Published { .. }, _) => tape.apply(op, &[theta]),
        (Parametrization::Footprint { .. }, Some(Origin::Pixel(pixel))) => {
            tape.apply(op, &[theta, pixel.footprint, pixel.local_count, pixel.color])
        }
        (Parametrization::Patch { .. }, Some(Origin::Patch(patch))) => {
            tape.apply(op, &[theta, patch.extents, patch.rotation, patch.color])
        }
        _ => panic!("{parametrization:?} is given what it is relative to"),
    };
    GaussianVars { means, quats, scales, opacities, colors }
}
