//! The covariance of a Gaussian from its scales and its quaternion.

use crate::matrix::{Mat33, Vec3, dot};
use crate::rotation::{rotation, rotation_backward};
use weaver_autograd::{Backward, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{Real, parallel};

/// Gaussians per parallel chunk.
const CHUNK: usize = 256;

#[derive(Debug)]
struct Covariance;

/// A Gaussian's axes.
struct Axes<T> {
    scale: Vec3<T>,
    /// Unit quaternion, and 1 over the length of the one given; `None` for zero.
    unit: Option<([T; 4], T)>,
    /// R.
    rotation: Mat33<T>,
    /// M = R diag(s).
    m: Mat33<T>,
}

impl<T: Real> Axes<T> {
    fn of(ins: &[View<'_, T>], n: usize) -> Self {
        let scale: Vec3<T> = std::array::from_fn(|i| ins[0][3 * n + i]);
        let unit = unit_quaternion(std::array::from_fn(|i| ins[1][4 * n + i]));
        let (one, zero) = (T::ONE, T::ZERO);
        let rotation = rotation(one, unit.map_or([one, zero, zero, zero], |(q, _)| q));
        let m = rotation.map(|row| std::array::from_fn(|j| row[j] * scale[j]));
        Self { scale, unit, rotation, m }
    }

    /// The gradient of M from the gradient of M M^T.
    fn dm(&self, d: &[T]) -> Mat33<T> {
        std::array::from_fn(|i| {
            let row: Vec3<T> = std::array::from_fn(|j| d[3 * i + j] + d[3 * j + i]);
            std::array::from_fn(|k| row[0] * self.m[0][k] + row[1] * self.m[1][k] + row[2] * self.m[2][k])
        })
    }
}

/// The unit quaternion along `q` and 1 / |q|; `None` for zero. Scaled first, so that nothing overflows.
fn unit_quaternion<T: Real>(q: [T; 4]) -> Option<([T; 4], T)> {
    let largest = q.iter().fold(T::ZERO, |m, x| m.max(x.abs()));
    if largest == T::ZERO {
        return None;
    }
    let q = q.map(|x| x / largest);
    let length = (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]).sqrt();
    Some((q.map(|x| x / length), T::ONE / (length * largest)))
}

/// Runs `body(n, part)` on the `size` numbers of every Gaussian n, in parallel.
fn for_gaussians<T: Real>(values: &mut [T], size: usize, body: impl Fn(usize, &mut [T]) + Sync) {
    parallel::for_chunks(values, CHUNK * size, |chunk, values| {
        values.chunks_exact_mut(size).enumerate().for_each(|(i, part)| body(chunk * CHUNK + i, part));
    });
}

impl<T: Real> Op<T> for Covariance {
    fn name(&self) -> &'static str {
        "covariance"
    }

    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let fits = |n: usize| ins[0] == Shape::from([n, 3]) && ins[1] == Shape::from([n, 4]);
        ensure_shape!(ins.len() == 2 && ins[0].rank() == 2 && fits(ins[0][0]), "scales [N, 3] and quats [N, 4]");
        Ok(Shapes::one([ins[0][0], 3, 3]))
    }

    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        for_gaussians(&mut outs[0], 9, |n, out| {
            let m = Axes::of(ins, n).m;
            out.iter_mut().enumerate().for_each(|(i, out)| *out = dot(m[i / 3], m[i % 3]));
        });
    }

    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, .. } = at;
        let d = |n: usize| &douts[0].data()[9 * n..9 * n + 9];
        if let Some(dscales) = &mut dins[0] {
            for_gaussians(dscales.accumulator(), 3, |n, dscale| {
                let axes = Axes::of(ins, n);
                let (r, dm) = (axes.rotation, axes.dm(d(n)));
                (0..3).for_each(|k| dscale[k] += dm[0][k] * r[0][k] + dm[1][k] * r[1][k] + dm[2][k] * r[2][k]);
            });
        }
        if let Some(dquats) = &mut dins[1] {
            for_gaussians(dquats.accumulator(), 4, |n, dquat| {
                let axes = Axes::of(ins, n);
                let Some(unit) = axes.unit else { return };
                let drotation = axes.dm(d(n)).map(|row| std::array::from_fn(|k| row[k] * axes.scale[k]));
                dquat.iter_mut().zip(rotation_backward(unit.0, unit.1, &drotation)).for_each(|(sum, g)| *sum += g);
            });
        }
    }
}

/// The covariance of Gaussians in the world, as the rasterizer draws them: R diag(s^2) R^T.
///
/// `scales` `[N, 3]` (standard deviations, in units of the scene) and `quats` `[N, 4]` (wxyz, of any length) give
/// `[N, 3, 3]`. Differentiable in both, through the normalization of the quaternion. A quaternion of zeros, which the
/// rasterizer rejects, stands for no rotation and has gradient 0. Source: Kerbl et al., "3D Gaussian Splatting" (2023),
/// equation 6.
///
/// ```
/// use weaver_autograd::Tape;
/// let tape = Tape::<f64>::new();
/// let (scales, quarter_turn) = (tape.leaf(&[1.0, 2.0, 3.0], [1, 3]), tape.leaf(&[1.0, 0.0, 0.0, 1.0], [1, 4]));
/// let covariance = weaver_splat::covariance(scales, quarter_turn).to_vec();
/// let expected = [4.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 9.0];
/// assert!(covariance.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12));
/// ```
#[track_caller]
pub fn covariance<'t, T: Real>(scales: Var<'t, T>, quats: Var<'t, T>) -> Var<'t, T> {
    let [covariance] = scales.tape().apply(Covariance, &[scales, quats]);
    covariance
}
