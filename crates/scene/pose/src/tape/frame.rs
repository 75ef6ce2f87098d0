//! The frame in the middle of some cameras.

use super::row_map::{RowMap, RowMapOp};
use weaver_autograd::{Dual, Real, Var, ops};

fn unit<T: Real, const N: usize>(v: [Dual<T, N>; 3]) -> [Dual<T, N>; 3] {
    let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt().max(1e-12);
    v.map(|x| x / length)
}

fn cross<T: Real, const N: usize>(a: [Dual<T, N>; 3], b: [Dual<T, N>; 3]) -> [Dual<T, N>; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// From the means of the axes and centers `[3, 4]` to the frame.
#[derive(Debug)]
struct Middle;

impl RowMap<12, 12> for Middle {
    const NAME: &'static str = "middle_frame";
    const INPUTS: &'static [&'static [usize]] = &[&[3, 4]];
    const OUTPUTS: &'static [&'static [usize]] = &[&[3, 4]];
    fn eval<T: Real>(&self, m: [Dual<T, 12>; 12]) -> [Dual<T, 12>; 12] {
        let column = |j: usize| [m[j], m[4 + j], m[8 + j]];
        let forward = unit(column(2));
        let down = column(1);
        let along = down[0] * forward[0] + down[1] * forward[1] + down[2] * forward[2];
        let down = unit([0, 1, 2].map(|i| down[i] - forward[i] * along));
        let columns = [cross(down, forward), down, forward, column(3)];
        std::array::from_fn(|at| columns[at % 4][at / 4])
    }
}

/// A pose in a frame: both camera-to-world, A^-1 M with the inverse by transposition.
#[derive(Debug)]
struct InFrame;

impl RowMap<24, 12> for InFrame {
    const NAME: &'static str = "pose_in_frame";
    const INPUTS: &'static [&'static [usize]] = &[&[3, 4], &[3, 4]];
    const OUTPUTS: &'static [&'static [usize]] = &[&[3, 4]];
    fn eval<T: Real>(&self, all: [Dual<T, 24>; 24]) -> [Dual<T, 24>; 12] {
        let (m, a) = all.split_at(12);
        std::array::from_fn(|at| {
            let (row, column) = (at / 4, at % 4);
            let entry = |k: usize| if column == 3 { m[4 * k + 3] - a[4 * k + 3] } else { m[4 * k + column] };
            a[row] * entry(0) + a[4 + row] * entry(1) + a[8 + row] * entry(2)
        })
    }
}

/// Cameras in the frame in the middle of some of them.
#[derive(Clone, Copy, Debug)]
pub struct AverageFrame<'t, T: Real = f32> {
    /// A = [r d f | c], camera-to-world, `[B, 3, 4]`.
    pub frame: Var<'t, T>,
    /// s, `[B]`: a constant. 1 where all of the centers are the same.
    pub scale: Var<'t, T>,
    /// The cameras in it, camera-to-world, `[B, V, 3, 4]`.
    pub cameras: Var<'t, T>,
}

/// Expresses cameras in the mean frame of the first `context` of them, in which no coordinate of these is beyond 1.
///
/// With camera-to-world (R_i, c_i): f = unit(mean R_i e3), m = mean R_i e2, d = unit(m - (m . f) f), r = d x f, A = [r
/// d f | mean c_i]; each becomes A^-1 c2w, its translation times s = 1 / max |t| over context and axes. `c2w` `[B, V,
/// 3, 4]`. Differentiable, s taken as a constant.
///
/// # Source
/// 2Xplat, Jeong et al., arXiv 2603.21064. (There s is infinite where all centers are the same.)
///
/// ```
/// use weaver_autograd::Tape;
/// let tape = Tape::<f64>::new();
/// let at = |x: f64| [1.0, 0.0, 0.0, x, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
/// let c2w = tape.constant(&[at(0.0), at(4.0)].concat(), [1, 2, 3, 4]);
/// let middle = weaver_pose::average_frame(c2w, 2);
/// assert_eq!(middle.cameras.to_vec(), [at(-1.0), at(1.0)].concat());
/// ```
#[track_caller]
pub fn average_frame<T: Real>(c2w: Var<'_, T>, context: usize) -> AverageFrame<'_, T> {
    let shape = c2w.shape();
    let fits = shape.rank() == 4 && shape.dims()[2..] == [3, 4] && (1..=shape[1]).contains(&context);
    c2w.tape().ensure_shapes(fits, "average_frame", format_args!("c2w [B, V, 3, 4], V at least {context}"), &[shape]);
    let [batch, views] = [shape[0], shape[1]];
    let [frame] = c2w.tape().apply(RowMapOp(Middle), &[c2w.slice(1, 0, context).mean_axis(1)]);
    let of_all = frame.reshape([batch, 1, 3, 4]).expand(shape);
    let [moved] = c2w.tape().apply(RowMapOp(InFrame), &[c2w, of_all]);
    let scale = c2w.tape().constant_with([batch], |scales| {
        let moved = moved.value();
        for (scale, moved) in scales.iter_mut().zip(moved.chunks(12 * views)) {
            let largest = moved[..12 * context].iter().skip(3).step_by(4).fold(T::ZERO, |most, x| most.max(x.abs()));
            *scale = if largest > T::ZERO { T::ONE / largest } else { T::ONE };
        }
    });
    let translations = moved.slice(3, 3, 1);
    let scaled = translations * scale.reshape([batch, 1, 1, 1]).expand(translations.shape());
    AverageFrame { frame, scale, cameras: ops::concat(&[moved.slice(3, 0, 3), scaled], 3) }
}
