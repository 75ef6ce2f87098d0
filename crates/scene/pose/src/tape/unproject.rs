//! Depth maps to world points.

use super::row_map::joined;
use weaver_autograd::{
    Backward, Buffer, Grad, Op, Pool, Real, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape,
};
use weaver_kernels::parallel;

/// Image rows per parallel chunk.
const ROWS: usize = 8;
/// Numbers of a camera: 3 x 4 pose entries, then fx, fy, cx, cy.
const CAMERA: usize = 16;

#[derive(Debug)]
struct Unproject {
    pixel_offset: f64,
}

/// One view's camera, and the image size.
struct Rays<'a, T> {
    pose: &'a [T],
    focal: [T; 2],
    center: [T; 2],
}

impl<'a, T: Real> Rays<'a, T> {
    fn of_row(ins: &[View<'a, T>], row: usize) -> Self {
        let view = row / ins[0].shape()[ins[0].shape().rank() - 2];
        let k = &ins[2].data()[view * 4..][..4];
        Self { pose: &ins[1].data()[view * 12..][..12], focal: [k[0], k[1]], center: [k[2], k[3]] }
    }

    /// The pixel's direction at depth 1 in camera coordinates, x and y.
    fn slope(&self, u: T, v: T) -> [T; 2] {
        [(u - self.center[0]) / self.focal[0], (v - self.center[1]) / self.focal[1]]
    }

    /// The camera-space point minus the translation.
    fn minus_translation(&self, slope: [T; 2], z: T) -> [T; 3] {
        [slope[0] * z - self.pose[3], slope[1] * z - self.pose[7], z - self.pose[11]]
    }

    fn to_world(&self, p: [T; 3]) -> [T; 3] {
        std::array::from_fn(|j| self.pose[j] * p[0] + self.pose[4 + j] * p[1] + self.pose[8 + j] * p[2])
    }

    fn to_camera(&self, d: &[T]) -> [T; 3] {
        std::array::from_fn(|i| self.pose[4 * i] * d[0] + self.pose[4 * i + 1] * d[1] + self.pose[4 * i + 2] * d[2])
    }
}

impl Unproject {
    fn coordinate<T: Real>(&self, index: usize) -> T {
        T::from_f64(index as f64 + self.pixel_offset)
    }

    /// The gradient of each image row with respect to its camera, in f64: `[rows of all views, 16]`.
    fn row_sums<T: Real>(&self, ins: &[View<'_, T>], dpoints: &[T], pool: &Pool) -> Buffer<f64> {
        let shape = ins[0].shape();
        let (height, width) = (shape[shape.rank() - 2], shape.last());
        let mut sums = pool.filled(shape.rows() * CAMERA, 0.0);
        parallel::for_chunks(&mut sums, ROWS * CAMERA, |chunk, sums| {
            for (i, sum) in sums.chunks_mut(CAMERA).enumerate() {
                let row = chunk * ROWS + i;
                let rays = Rays::of_row(ins, row);
                for column in 0..width {
                    let at = row * width + column;
                    let z = ins[0][at];
                    let slope = rays.slope(self.coordinate(column), self.coordinate(row % height));
                    let p = rays.minus_translation(slope, z);
                    let d = &dpoints[3 * at..3 * at + 3];
                    let c = rays.to_camera(d);
                    for i in 0..3 {
                        for j in 0..3 {
                            sum[4 * i + j] += (p[i] * d[j]).to_f64();
                        }
                        sum[4 * i + 3] -= c[i].to_f64();
                    }
                    for i in 0..2 {
                        let dcenter = -c[i] * z / rays.focal[i];
                        sum[12 + i] += (dcenter * slope[i]).to_f64();
                        sum[14 + i] += dcenter.to_f64();
                    }
                }
            }
        });
        sums
    }
}

/// Adds, view by view and row by row, the `range` of the sums to a gradient.
fn add_sums<T: Real>(grad: &mut Grad<'_, T>, sums: &[f64], height: usize, range: std::ops::Range<usize>) {
    let n = range.len();
    for (target, view) in grad.accumulator().chunks_mut(n).zip(sums.chunks((height * CAMERA).max(1))) {
        for (i, g) in target.iter_mut().enumerate() {
            let total: f64 = view.chunks(CAMERA).map(|row| row[range.start + i]).sum();
            *g += T::from_f64(total);
        }
    }
}

impl<T: Real> Op<T> for Unproject {
    fn name(&self) -> &'static str {
        "unproject"
    }

    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(
            ins.len() == 3 && ins[0].rank() >= 2,
            "depth [.., H, W], viewmats [.., 3, 4], intrinsics [.., 4]"
        );
        let depth = ins[0].dims();
        let leading = &depth[..depth.len() - 2];
        let ends = |shape: &Shape, last: &[usize]| shape.dims().strip_prefix(leading).is_some_and(|rest| rest == last);
        ensure_shape!(
            ends(&ins[1], &[3, 4]) && ends(&ins[2], &[4]),
            "viewmats {leading:?} x [3, 4] and intrinsics {leading:?} x [4]"
        );
        Ok(Shapes::one(joined(depth, &[3])))
    }

    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let shape = ins[0].shape();
        let (height, width) = (shape[shape.rank() - 2], shape.last());
        parallel::for_chunks(&mut outs[0], ROWS * width * 3, |chunk, points| {
            for (i, points) in points.chunks_mut(width * 3).enumerate() {
                let row = chunk * ROWS + i;
                let rays = Rays::of_row(ins, row);
                let depth = &ins[0][row * width..(row + 1) * width];
                for (column, (point, z)) in points.chunks_mut(3).zip(depth).enumerate() {
                    let slope = rays.slope(self.coordinate(column), self.coordinate(row % height));
                    point.copy_from_slice(&rays.to_world(rays.minus_translation(slope, *z)));
                }
            }
        });
    }

    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, pool, .. } = at;
        let shape = ins[0].shape();
        let (height, width) = (shape[shape.rank() - 2], shape.last());
        let dpoints = &douts[0];
        if let Some(ddepth) = &mut dins[0] {
            ddepth.add_each(|at| {
                let row = at / width;
                let rays = Rays::of_row(ins, row);
                let slope = rays.slope(self.coordinate(at % width), self.coordinate(row % height));
                let c = rays.to_camera(&dpoints[3 * at..3 * at + 3]);
                c[0] * slope[0] + c[1] * slope[1] + c[2]
            });
        }
        if dins[1].is_none() && dins[2].is_none() {
            return;
        }
        let sums = self.row_sums(ins, dpoints, pool);
        if let Some(dpose) = &mut dins[1] {
            add_sums(dpose, &sums, height, 0..12);
        }
        if let Some(dintrinsics) = &mut dins[2] {
            add_sums(dintrinsics, &sums, height, 12..16);
        }
    }
}

/// The world point of every pixel of depth maps.
///
/// X = R^T (((u - cx) z / fx, (v - cy) z / fy, z) - T) with u = column + `pixel_offset`, v = row + `pixel_offset`.
/// `depth` z `[.., H, W]` along the optical axis, `viewmats` [R | T] `[.., 3, 4]`, `intrinsics` fx, fy, cx, cy in
/// pixels `[.., 4]` give points `[.., H, W, 3]`. Differentiable in all three, the entries of R taken as independent.
/// `pixel_offset` is 0.5 where pixel centers lie at half-integers, the rasterizer's convention, and 0 for the published
/// weights.
///
/// ```
/// use weaver_autograd::Tape;
/// let tape = Tape::<f64>::new();
/// let identity = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
/// let (depth, viewmats) = (tape.leaf(&[2.0], [1, 1]), tape.leaf(&identity, [3, 4]));
/// let intrinsics = tape.leaf(&[1.0, 1.0, 0.0, 0.5], [4]);
/// let points = weaver_pose::unproject(depth, viewmats, intrinsics, 0.5);
/// assert_eq!(points.to_vec(), [1.0, 0.0, 2.0]);
/// ```
#[track_caller]
pub fn unproject<'t, T: Real>(
    depth: Var<'t, T>,
    viewmats: Var<'t, T>,
    intrinsics: Var<'t, T>,
    pixel_offset: f64,
) -> Var<'t, T> {
    let [points] = depth.tape().apply(Unproject { pixel_offset }, &[depth, viewmats, intrinsics]);
    points
}
