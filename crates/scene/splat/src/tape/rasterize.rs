//! The rasterizer as an operation on the tape.

use super::shelf::Shelf;
use super::statistics::SharedStatistics;
use crate::cpu_rasterizer::CpuRasterizer;
use crate::depth::LEAST_ALPHA;
use crate::error::RasterError;
use crate::gradients::{Cotangents, Gradients, Target};
use crate::rasterizer::{AnyRasterizer, Images, Session};
use crate::settings::RasterSettings;
use crate::tiles::Region;
use std::sync::{Arc, Mutex, PoisonError};
use weaver_autograd::{Backward, Op, Outputs, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_geometry::sh::MAX_DEGREE;
use weaver_kernels::Real;
use weaver_pose::CameraVars;
use weaver_scene::{CameraSlices, Color, Features, GaussianSlices, Groups, Model};

/// A rasterizer, and its sessions that are kept from step to step. Cloning shares them.
///
/// A [`Rasterize`] on the tape holds a session until the tape is reset.
#[derive(Clone, Debug)]
pub struct WorkspacePool<T: Real> {
    rasterizer: AnyRasterizer<T>,
    shelf: Shelf<Box<dyn Session<T>>>,
}

impl<T: Real> WorkspacePool<T> {
    /// An empty pool of the rasterizer of this crate.
    pub fn new() -> Self {
        Self::of(Arc::new(CpuRasterizer))
    }

    /// An empty pool of any rasterizer.
    pub fn of(rasterizer: AnyRasterizer<T>) -> Self {
        Self { rasterizer, shelf: Shelf::default() }
    }

    /// The rasterizer.
    pub fn rasterizer(&self) -> &AnyRasterizer<T> {
        &self.rasterizer
    }

    /// The failure since the last call: arguments that the rasterizer refused, or a device that failed. Everything
    /// drawn since then is NaN.
    pub fn failure(&self) -> Option<RasterError> {
        self.shelf.failure()
    }
}

impl<T: Real> Default for WorkspacePool<T> {
    fn default() -> Self {
        Self::new()
    }
}

/// Draws Gaussians in several views, differentiably: [`rasterize`](crate::rasterize()) on the tape.
///
/// Inputs, in this order: means `[N, 3]`, quats `[N, 4]` (wxyz), scales `[N, 3]`, opacities `[N]`, colors `[N, 3]` or
/// spherical harmonics `[N, K, 3]` with K of 1, 4, 9, 16, 25 or none `[N, 0]`, view matrices `[V, 3, 4]` or `[V, 4,
/// 4]`, intrinsics `[V, 4]` (fx, fy, cx, cy), background `[3]` or `[V, 3]`, and optionally features `[N, C]`. Outputs:
/// image `[V, H, W, 3]` (`[V, H, W, 0]` without colors), alpha `[V, H, W]`, depth `[V, H, W]` (`[0]` unless requested),
/// features `[V, H, W, C]` where given, and auxiliary, without gradient, the counts `[3]` of splats, list entries and
/// rejected Gaussians. With a [region](RasterSettings::region) H and W are its sizes. Every input has a gradient;
/// [`rasterize_backward`](crate::rasterize_backward()) lists the quantities held constant.
///
/// ```
/// use weaver_autograd::Tape;
/// use weaver_pose::CameraVars;
/// use weaver_splat::{GaussianVars, RasterSettings, Rasterize, WorkspacePool};
/// let workspaces = WorkspacePool::new();
/// let tape = Tape::<f32>::new();
/// let gaussians = GaussianVars {
///     means: tape.leaf(&[0.0, 0.0, 2.0], [1, 3]),
///     quats: tape.leaf(&[1.0, 0.0, 0.0, 0.0], [1, 4]),
///     scales: tape.leaf(&[0.5, 0.5, 0.5], [1, 3]),
///     opacities: tape.leaf(&[0.8], [1]),
///     colors: tape.leaf(&[1.0, 0.5, 0.0], [1, 3]),
/// };
/// let cameras = CameraVars {
///     viewmats: tape.constant(&[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0], [1, 3, 4]),
///     intrinsics: tape.constant(&[10.0, 10.0, 1.5, 1.5], [1, 4]),
/// };
/// let background = tape.constant(&[0.0; 3], [3]);
/// let drawn = Rasterize::new(3, 3, RasterSettings::default(), &workspaces).apply(&gaussians, &cameras, background);
/// drawn.image.sum().backward();
/// assert!(gaussians.opacities.grad().unwrap()[0] > 0.0);
/// ```
#[derive(Debug)]
pub struct Rasterize<T: Real> {
    width: usize,
    height: usize,
    settings: RasterSettings,
    depth: bool,
    groups: Option<(Arc<[u32]>, usize)>,
    statistics: Option<SharedStatistics<T>>,
    pool: WorkspacePool<T>,
    /// Set by forward; backward works in it too.
    session: Mutex<Option<Box<dyn Session<T>>>>,
}

/// The Gaussians as tensors; shapes are with [`Rasterize`].
#[derive(Clone, Copy, Debug)]
pub struct GaussianVars<'t, T: Real> {
    /// `[N, 3]`
    pub means: Var<'t, T>,
    /// `[N, 4]`
    pub quats: Var<'t, T>,
    /// `[N, 3]`
    pub scales: Var<'t, T>,
    /// `[N]`
    pub opacities: Var<'t, T>,
    /// `[N, 3]`, or `[N, K, 3]` for spherical harmonics, or `[N, 0]` for none.
    pub colors: Var<'t, T>,
}

impl<T: Real> GaussianVars<'_, T> {
    /// The Gaussians for which `kept` `[N]` is true.
    ///
    /// # Panics
    /// If there are fewer Gaussians than that.
    #[must_use]
    pub fn kept(&self, kept: &[bool]) -> Self {
        let rows: Vec<u32> = (0..).zip(kept).filter(|(_, kept)| **kept).map(|(row, _)| row).collect();
        self.gathered(&rows)
    }

    /// These of them, in this order.
    ///
    /// # Panics
    /// If there is no Gaussian of a number.
    #[must_use]
    pub fn gathered(&self, rows: &[u32]) -> Self {
        let [means, quats, scales, opacities, colors] =
            [self.means, self.quats, self.scales, self.opacities, self.colors].map(|all| all.gather_rows(rows));
        Self { means, quats, scales, opacities, colors }
    }
}

impl<T: Real> Outputs<T> for GaussianVars<'_, T> {
    fn for_each_var(&self, visit: &mut dyn FnMut(Var<'_, T>)) {
        [self.means, self.quats, self.scales, self.opacities, self.colors].for_each_var(visit);
    }
}

/// A drawing.
#[derive(Clone, Copy, Debug)]
pub struct RenderedVars<'t, T: Real> {
    /// `[V, H, W, 3]`; `[V, H, W, 0]` of Gaussians without colors.
    pub image: Var<'t, T>,
    /// `[V, H, W]`
    pub alpha: Var<'t, T>,
    /// sum of w z, not divided by alpha, `[V, H, W]`; `[0]` after [`Rasterize::without_depth`].
    pub depth: Var<'t, T>,
    /// Splats, list entries, rejected Gaussians; no gradient, `[3]`.
    pub counts: Var<'t, T>,
}

impl<'t, T: Real> RenderedVars<'t, T> {
    /// The expected depth `depth / max(alpha, 1e-10)`, `[V, H, W]`, in world units, differentiable in both. Where
    /// nothing is seen it is 0, and alpha has no gradient.
    ///
    /// # Panics
    ///
    /// After [`Rasterize::without_depth`].
    #[track_caller]
    pub fn expected_depth(&self) -> Var<'t, T> {
        self.depth / self.alpha.clamp(LEAST_ALPHA, f64::INFINITY)
    }
}

impl<T: Real> Rasterize<T> {
    /// For views of `width` x `height` pixels. Rasterizer and memory come from `workspaces`, and the memory returns
    /// there.
    pub fn new(width: usize, height: usize, settings: RasterSettings, workspaces: &WorkspacePool<T>) -> Self {
        let (pool, session) = (workspaces.clone(), Mutex::new(None));
        Self { width, height, settings, depth: true, groups: None, statistics: None, pool, session }
    }

    /// Adds the by-products of the backward pass to `statistics`.
    pub fn with_statistics(mut self, statistics: &SharedStatistics<T>) -> Self {
        self.statistics = Some(statistics.clone());
        self
    }

    /// Draws K pictures of each view, each of the Gaussians of one group, as if they were alone: `of` `[N]` has their
    /// groups, 0 to K - 1. Images are `[V K, ..]` instead of `[V, ..]`, the pictures of a view one after the other.
    pub fn in_groups(mut self, of: Arc<[u32]>, count: usize) -> Self {
        self.groups = Some((of, count));
        self
    }

    /// Region of each view that is drawn.
    fn region(&self) -> Region {
        self.settings.region.unwrap_or(Region::whole(self.width, self.height))
    }

    /// Draws no depth, which is faster.
    pub fn without_depth(mut self) -> Self {
        self.depth = false;
        self
    }

    /// Draws over `background`, `[3]` or `[V, 3]`.
    ///
    /// # Panics
    ///
    /// If shapes do not fit. Where the rasterizer refuses or fails, the images are NaN, and [`WorkspacePool::failure`]
    /// says why.
    #[track_caller]
    pub fn apply<'t>(
        self,
        gaussians: &GaussianVars<'t, T>,
        cameras: &CameraVars<'t, T>,
        background: Var<'t, T>,
    ) -> RenderedVars<'t, T> {
        let [image, alpha, depth, counts] = gaussians.means.tape().apply(self, &inputs(gaussians, cameras, background));
        RenderedVars { image, alpha, depth, counts }
    }

    /// Draws over `background`, and blends `features` `[N, C]` over zeros: `[V, H, W, C]`, sum of w f.
    ///
    /// # Panics
    ///
    /// If shapes do not fit. Where the rasterizer refuses or fails, the images are NaN, and [`WorkspacePool::failure`]
    /// says why.
    #[track_caller]
    pub fn apply_with_features<'t>(
        self,
        gaussians: &GaussianVars<'t, T>,
        cameras: &CameraVars<'t, T>,
        background: Var<'t, T>,
        features: Var<'t, T>,
    ) -> (RenderedVars<'t, T>, Var<'t, T>) {
        let [a, b, c, d, e, f, g, h] = inputs(gaussians, cameras, background);
        let [image, alpha, depth, features, counts] = features.tape().apply(self, &[a, b, c, d, e, f, g, h, features]);
        (RenderedVars { image, alpha, depth, counts }, features)
    }

    fn scene<'a>(&'a self, ins: &[View<'a, T>]) -> (GaussianSlices<'a, T>, CameraSlices<'a, T>) {
        let colors = ins[4];
        let color = match colors.shape().rank() {
            2 if colors.shape()[1] == 0 => Color::None,
            2 => Color::Plain(colors.data()),
            _ => Color::Sh { coefficients: colors.data(), degree: degree_of(colors.shape()[1]).unwrap_or(0) },
        };
        let gaussians = GaussianSlices {
            means: ins[0].data(),
            quats: ins[1].data(),
            scales: ins[2].data(),
            opacities: ins[3].data(),
            color,
            features: ins.get(8).map(|f| Features { values: f.data(), channels: f.shape()[1] }),
            groups: self.groups.as_ref().map(|(of, count)| Groups { of, count: *count }),
        };
        let cameras = CameraSlices {
            viewmats: ins[5].data(),
            intrinsics: ins[6].data(),
            background: ins[7].data(),
            width: self.width,
            height: self.height,
            model: Model::Pinhole,
        };
        (gaussians, cameras)
    }
}

/// The inputs that every drawing has.
fn inputs<'t, T: Real>(
    gaussians: &GaussianVars<'t, T>,
    cameras: &CameraVars<'t, T>,
    background: Var<'t, T>,
) -> [Var<'t, T>; 8] {
    let GaussianVars { means, quats, scales, opacities, colors } = *gaussians;
    let CameraVars { viewmats, intrinsics } = *cameras;
    [means, quats, scales, opacities, colors, viewmats, intrinsics, background]
}

/// The degree with `terms` coefficients.
fn degree_of(terms: usize) -> Option<usize> {
    (0..=MAX_DEGREE).find(|degree| (degree + 1) * (degree + 1) == terms)
}

impl<T: Real> Drop for Rasterize<T> {
    fn drop(&mut self) {
        self.pool.shelf.put_back(&mut self.session);
    }
}

impl<T: Real> Op<T> for Rasterize<T> {
    fn name(&self) -> &'static str {
        "rasterize"
    }

    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(ins.len() == 8 || ins.len() == 9, "8 inputs, 9 with features");
        ensure_shape!(ins[0].rank() == 2 && ins[6].rank() == 2, "means [N, 3], .., intrinsics [V, 4], ..");
        let (n, v) = (ins[0][0], ins[6][0]);
        let is = |index: usize, dims: &[usize]| ins[index] == Shape::new(dims);
        let gaussians = is(0, &[n, 3]) && is(1, &[n, 4]) && is(2, &[n, 3]) && is(3, &[n]);
        ensure_shape!(gaussians, "means [N, 3], quats [N, 4], scales [N, 3], opacities [N], ..");
        let harmonics = ins[4].rank() == 3 && degree_of(ins[4][1]).is_some() && is(4, &[n, ins[4][1], 3]);
        let colors = is(4, &[n, 3]) || is(4, &[n, 0]) || harmonics;
        ensure_shape!(colors, "colors [N, 3], or [N, K, 3] with K of 1, 4, 9, 16, 25, or [N, 0]");
        ensure_shape!(is(5, &[v, 3, 4]) || is(5, &[v, 4, 4]), "view matrices [V, 3, 4] or [V, 4, 4]");
        ensure_shape!(is(6, &[v, 4]), "intrinsics [V, 4]");
        ensure_shape!(is(7, &[3]) || is(7, &[v, 3]), "background [3] or [V, 3]");
        let region = self.region();
        ensure_shape!(region.is_within(self.width, self.height), "an image, or a region of it, of at least one pixel");
        let (h, w) = (region.height, region.width);
        let pictures = v * self.groups.as_ref().map_or(1, |(_, count)| *count);
        let channels = if is(4, &[n, 0]) { 0 } else { 3 };
        let drawn = Shapes::one([pictures, h, w, channels]).and([pictures, h, w]);
        let drawn = if self.depth { drawn.and([pictures, h, w]) } else { drawn.and([0]) };
        let Some(features) = ins.get(8) else { return Ok(drawn.and([3])) };
        ensure_shape!(features.rank() == 2 && features[0] == n, "features [N, C]");
        Ok(drawn.and([pictures, h, w, features[1]]).and([3]))
    }

    fn auxiliary_outputs(&self) -> usize {
        1
    }

    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let (gaussians, cameras) = self.scene(ins);
        let [image, alpha, depth, features @ .., counts] = outs else {
            unreachable!("four outputs or five, by shapes()")
        };
        let mut session = self.pool.shelf.take(|| self.pool.rasterizer.session());
        let depth = self.depth.then_some(&mut **depth);
        let images = Images { image, alpha, depth, features: features.first_mut().map(|features| &mut **features) };
        let stats = match session.forward(&gaussians, &cameras, &self.settings, images) {
            Ok(stats) => stats,
            Err(error) => {
                self.pool.shelf.fail(error);
                return outs.iter_mut().for_each(|out| out.fill(T::from_f64(f64::NAN)));
            }
        };
        for (out, count) in counts.iter_mut().zip([stats.splats, stats.entries, stats.rejected]) {
            *out = T::from_usize(count);
        }
        self.session = Mutex::new(Some(session));
    }

    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, .. } = at;
        let (gaussians, cameras) = self.scene(ins);
        let mut held = self.session.lock().unwrap_or_else(PoisonError::into_inner);
        let cotangents = Cotangents {
            image: Some(&douts[0]),
            alpha: Some(&douts[1]),
            depth: self.depth.then_some(&douts[2]),
            features: gaussians.features.map(|_| &*douts[3]),
        };
        let mut statistics = self.statistics.as_ref().map(|shared| shared.lock(gaussians.opacities.len()));
        let mut targets = dins.iter_mut().map(|grad| {
            grad.as_mut().map(|grad| match grad.target() {
                (values, beta) if beta == T::ZERO => Target::write(values),
                (values, _) => Target::add(values),
            })
        });
        let mut next = || targets.next().flatten();
        let gradients = Gradients {
            means: next(),
            quats: next(),
            scales: next(),
            opacities: next(),
            colors: next(),
            viewmats: next(),
            intrinsics: next(),
            background: next(),
            features: next(),
            statistics: statistics.as_deref_mut().map(Vec::as_mut_slice),
        };
        // There is no session where forward failed.
        if let Some(session) = held.as_mut()
            && let Err(error) = session.backward(&gaussians, &cameras, &self.settings, &cotangents, gradients)
        {
            self.pool.shelf.fail(error);
        }
    }
}
