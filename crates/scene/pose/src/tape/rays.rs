//! The rays of pixels: origins and directions.

use super::{CameraVars, unproject};
use weaver_autograd::{Real, Var, ops};

/// The rays through the centers of all pixels of V views, in the world.
#[derive(Clone, Copy, Debug)]
pub struct Rays<'t, T: Real = f32> {
    /// Where the rays of a view begin, o = -R^T t, `[V, 3]`.
    pub origins: Var<'t, T>,
    /// Where they go, unit vectors d, `[V, H W, 3]`.
    pub directions: Var<'t, T>,
    /// The part of them along the optical axis, 1 / |K^-1 (u + 1/2, v + 1/2, 1)|, `[V, H W, 1]`.
    cosines: Var<'t, T>,
    /// H, W.
    size: [usize; 2],
}

impl<'t, T: Real> Rays<'t, T> {
    /// The rays of cameras with viewmats `[V, 3, 4]` and intrinsics `[V, 4]`, for images of `size` (H, W) pixels.
    ///
    /// d = unit(R^T K^-1 (u + 1/2, v + 1/2, 1)). Differentiable in both, the entries of R taken as independent.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// use weaver_pose::{CameraVars, Rays};
    /// let tape = Tape::<f64>::new();
    /// let viewmats = tape.constant(&[1.0, 0.0, 0.0, 5.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0], [1, 3, 4]);
    /// let intrinsics = tape.constant(&[1.0, 1.0, 0.5, 0.5], [1, 4]);
    /// let rays = Rays::new(&CameraVars { viewmats, intrinsics }, [1, 1]);
    /// assert_eq!((rays.origins.to_vec(), rays.directions.to_vec()), (vec![-5.0, 0.0, 0.0], vec![0.0, 0.0, 1.0]));
    /// ```
    #[track_caller]
    pub fn new(cameras: &CameraVars<'t, T>, size: [usize; 2]) -> Self {
        let [height, width] = size;
        let CameraVars { viewmats, intrinsics } = *cameras;
        let views = viewmats.shape()[0];
        let (tape, rotations) = (viewmats.tape(), viewmats.slice(2, 0, 3));
        let one = tape.constant_with([views, height, width], |all| all.fill(T::ONE));
        let own = tape.constant_with(viewmats.shape(), |all| {
            all.chunks_exact_mut(12).for_each(|e| [0, 5, 10].into_iter().for_each(|i| e[i] = T::ONE));
        });
        // Unit vectors before they are turned: a turn keeps lengths, so that its gradient is the turn's alone.
        let local = unproject(one, own, intrinsics, 0.5).reshape([views, height * width, 3]).normalize_rows(0.0);
        Self { origins: cameras.centers(), directions: local.matmul(rotations), cosines: local.slice(2, 2, 1), size }
    }

    /// The points at a distance from where rays begin, o + rho d, for `distance` `[V, H W, 1]`: `[V, H W, 3]`.
    #[track_caller]
    pub fn points(&self, distance: Var<'t, T>) -> Var<'t, T> {
        each(self.origins, distance.shape()[1]) + self.directions * distance.expand(self.directions.shape())
    }

    /// Depth along the optical axis at a distance `[V, H W, 1]` from where rays begin: rho / |K^-1 (u + 1/2, v + 1/2,
    /// 1)|, `[V, H, W]`.
    #[track_caller]
    pub fn depth(&self, distance: Var<'t, T>) -> Var<'t, T> {
        let [height, width] = self.size;
        (self.cosines * distance).reshape([distance.shape()[0], height, width])
    }

    /// Map of rays and photos `[V, 3, H, W]` for a network: o, d, o x d and 2 I - 1 for each pixel, `[V, H W, 12]`.
    ///
    /// o x d is the same wherever on the ray o lies. Differentiable in the rays and the photos.
    ///
    /// # Source
    /// 2Xplat, Jeong et al., arXiv 2603.21064.
    #[track_caller]
    pub fn map(&self, photos: Var<'t, T>) -> Var<'t, T> {
        let [views, pixels] = [0, 1].map(|axis| self.directions.shape()[axis]);
        let moments = self.directions.matmul_with(self.crosses(), false, true);
        let colors = photos.permute(&[0, 2, 3, 1]).reshape([views, pixels, 3]) * 2.0 - 1.0;
        ops::concat(&[each(self.origins, pixels), self.directions, moments, colors], 2)
    }

    /// The matrices [o]x with [o]x d = o x d, `[V, 3, 3]`.
    fn crosses(&self) -> Var<'t, T> {
        let mut generators = [T::ZERO; 27];
        for (axis, row, column) in [(0, 2, 1), (1, 0, 2), (2, 1, 0)] {
            generators[9 * axis + 3 * row + column] = T::ONE;
            generators[9 * axis + 3 * column + row] = -T::ONE;
        }
        let generators = self.origins.tape().constant(&generators, [3, 9]);
        self.origins.matmul(generators).reshape([self.origins.shape()[0], 3, 3])
    }
}

/// A vector of each view `[V, 3]` for all of its pixels `[V, pixels, 3]`.
fn each<T: Real>(vectors: Var<'_, T>, pixels: usize) -> Var<'_, T> {
    let views = vectors.shape()[0];
    vectors.reshape([views, 1, 3]).expand([views, pixels, 3])
}
