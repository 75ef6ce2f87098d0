//! The whole head, from pixel features to Gaussians.

use crate::surface::{DESCRIPTORS, Frames, Surface};
use crate::two_layers::TwoLayers;
use crate::{
    CardinalityExperts, NeighborPredictor, Neighbors, Origin, Parametrization, PatchOf, Patches, PixelOf, Routes,
    decode, local_count, patch_mean, place, slot_width,
};
use weaver_autograd::{Buffer, Outputs, Real, Var};
use weaver_nn::{Builder, Context, Linear, WeightInit};
use weaver_router::{Assignment, Router};
use weaver_splat::GaussianVars;

/// Sizes and options of a [`CardinalityHead`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadConfig {
    /// Channels F of the pixel features.
    pub features: usize,
    /// Hidden channels of the router.
    pub router_hidden: usize,
    /// Largest number M of Gaussians of a pixel; there are E = M + 1 experts.
    pub max_per_pixel: usize,
    /// Degree of the spherical harmonics.
    pub sh_degree: usize,
    /// Attention over neighbors; `None` decodes the experts' parameters without it.
    pub neighbors: Option<NeighborConfig>,
    /// Factor on the initial output layers of the experts.
    pub expert_output_gain: f64,
    /// Meaning of the raw parameters.
    pub parametrization: Parametrization,
}

/// Sizes and options of the attention over neighbors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NeighborConfig {
    /// Number k of neighbors of each Gaussian, itself not counted.
    pub count: usize,
    /// Channels of the projected pixel features.
    pub projector: usize,
    /// Channels C of the attention.
    pub width: usize,
    /// True if the attention starts as the identity, with its last layer zero.
    pub zero_head: bool,
}

impl HeadConfig {
    /// The sizes of the published model.
    pub fn published() -> Self {
        Self {
            features: 128,
            router_hidden: 32,
            max_per_pixel: 3,
            sh_degree: 2,
            neighbors: Some(NeighborConfig { count: 8, projector: 32, width: 32, zero_head: false }),
            expert_output_gain: 1.0,
            parametrization: Parametrization::published(),
        }
    }

    /// A small head for training from scratch, with the footprint parametrization and Gaussians that start alike.
    pub fn tiny() -> Self {
        Self {
            features: 32,
            router_hidden: 16,
            max_per_pixel: 3,
            sh_degree: 1,
            neighbors: Some(NeighborConfig { count: 8, projector: 16, width: 16, zero_head: true }),
            expert_output_gain: 0.3,
            parametrization: Parametrization::footprint(),
        }
    }
}

/// The inputs of a scene's P = V H W pixels, in (view, row, column) order.
#[derive(Clone, Copy, Debug)]
pub struct PixelInputs<'t, T: Real = f32> {
    /// Expert features `[P, F]`; differentiable.
    pub features: Var<'t, T>,
    /// Unprojected points `[P, 3]`, in world units; differentiable.
    pub points: Var<'t, T>,
    /// depth / fx `[P]`, in world units; differentiable by the footprint parametrization. Not for the published one.
    pub footprints: Option<Var<'t, T>>,
    /// Colors `[P, 3]`, 0 to 1; held constant. Not for the published parametrization.
    pub colors: Option<Var<'t, T>>,
    /// Rows H of a view.
    pub height: usize,
    /// Columns W of a view.
    pub width: usize,
}

impl<'t, T: Real> PixelInputs<'t, T> {
    fn footprint(&self) -> Var<'t, T> {
        self.footprints.expect("relative parametrizations are given footprints")
    }

    fn color(&self) -> Var<'t, T> {
        self.colors.expect("relative parametrizations are given colors")
    }
}

/// The Gaussians of a scene, and the pixel of each.
#[derive(Debug)]
pub struct PixelGaussians<'t, T: Real = f32> {
    /// The N Gaussians, in world units, colors as spherical harmonics `[N, K, 3]`.
    pub gaussians: GaussianVars<'t, T>,
    /// The pixel that each Gaussian comes from `[N]`.
    pub pixel: Buffer<u32>,
}

impl<T: Real> Outputs<T> for PixelGaussians<'_, T> {
    fn for_each_var(&self, visit: &mut dyn FnMut(Var<'_, T>)) {
        self.gaussians.for_each_var(visit);
    }
}

/// The experts' output, before the attention over neighbors and before decoding.
#[derive(Debug)]
pub struct Proposed<'t, T: Real = f32> {
    /// Means `[N, 3]`, in world units.
    pub means: Var<'t, T>,
    /// Raw parameters `[N, S - 3]`, to be refined and decoded.
    pub theta: Var<'t, T>,
    /// Projected features of the Gaussians' pixels `[N, c]`, where there is attention over neighbors.
    pub feature: Option<Var<'t, T>>,
    /// Reference of the raw parameters, but under the published parametrization.
    pub origin: Option<Origin<'t, T>>,
    /// The pixel that each Gaussian comes from `[N]`.
    pub pixel: Buffer<u32>,
}

impl<T: Real> Outputs<T> for Proposed<'_, T> {
    fn for_each_var(&self, visit: &mut dyn FnMut(Var<'_, T>)) {
        (self.means, self.theta, self.feature, self.origin).for_each_var(visit);
    }
}

/// Router, cardinality experts, neighbor attention and decoding.
///
/// Parameters (below the builder's path, `gs_moe` in checkpoints): `gating.*` ([`Router`]), `experts.*`
/// ([`CardinalityExperts`]), `patch_embedding` (of the patch parametrization), `pixel_projector.0`,
/// `pixel_projector.2`, `gs_predictor.*` ([`NeighborPredictor`]).
#[derive(Clone, Debug)]
pub struct CardinalityHead {
    config: HeadConfig,
    /// Scores the experts for every pixel.
    pub router: Router,
    /// Turn features of pixels into raw numbers of Gaussians.
    pub experts: CardinalityExperts,
    /// Embeds a cell's size and content for the experts.
    embedding: Option<Linear>,
    attention: Option<(TwoLayers, NeighborPredictor)>,
}

impl CardinalityHead {
    /// Adds the head's parameters.
    pub fn new<T: Real>(mut builder: Builder<'_, T>, config: HeadConfig) -> Self {
        let HeadConfig { features, max_per_pixel, .. } = config;
        let slot = slot_width(config.sh_degree);
        let router = Router::new(builder.scope("gating"), features, config.router_hidden, max_per_pixel + 1);
        let gain = config.expert_output_gain;
        let experts = CardinalityExperts::new(builder.scope("experts"), features, max_per_pixel, slot, gain);
        let embedding = matches!(config.parametrization, Parametrization::Patch { .. })
            .then(|| Linear::new(builder.scope("patch_embedding"), DESCRIPTORS, features, WeightInit::FanIn));
        let attention = config.neighbors.map(|neighbors| {
            let NeighborConfig { projector, width, zero_head, .. } = neighbors;
            let projection = TwoLayers::new(builder.scope("pixel_projector"), features, projector, projector);
            let builder = builder.scope("gs_predictor");
            (projection, NeighborPredictor::new(builder, slot - 3, projector, width, zero_head))
        });
        Self { config, router, experts, embedding, attention }
    }

    /// The sizes and options that the head was built with.
    pub fn config(&self) -> &HeadConfig {
        &self.config
    }

    /// The Gaussians of a scene whose pixels are assigned to experts; a scene without Gaussians is fine.
    ///
    /// With a `choice` `[P, E]` (see [`Assignment::choice`](weaver_router::Assignment::choice)) a gradient reaches the
    /// router. Every other parameter gets a gradient, too, which is zero for an expert without pixels. Panics on other
    /// shapes.
    pub fn gaussians<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        pixels: &PixelInputs<'t, T>,
        assignment: &Assignment<T>,
        choice: Option<Var<'t, T>>,
    ) -> PixelGaussians<'t, T> {
        let decoded = |proposed: Proposed<'t, T>| {
            let Proposed { means, mut theta, feature, origin, pixel } = proposed;
            if !cx.tape.is_recording() {
                // The experts' buffers have other sizes than the attention's.
                cx.tape.pool().trim::<T>();
            }
            if let (Some((_, predictor)), Some(feature), Some(config)) =
                (&self.attention, feature, self.config.neighbors)
            {
                let search = || Neighbors::search(&means.value(), config.count, cx.tape.pool());
                let neighbors = cx.tape.timed("nearest neighbors", search);
                theta = predictor.forward(cx, means, theta, feature, &neighbors);
            }
            let gaussians = decode(means, theta, self.config.sh_degree, origin, self.config.parametrization);
            PixelGaussians { gaussians, pixel }
        };
        cx.part("gs_moe", || cx.tape.steps(|| self.propose(cx, pixels, assignment, choice)).then(decoded).end())
    }

    /// The experts' output for a scene, before the attention over neighbors.
    pub fn propose<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        pixels: &PixelInputs<'t, T>,
        assignment: &Assignment<T>,
        choice: Option<Var<'t, T>>,
    ) -> Proposed<'t, T> {
        let routes = Routes::new(&assignment.expert, self.experts.max_per_pixel(), cx.tape.pool());
        let parametrization = self.config.parametrization;
        let (features, points, origin) = match self.embedding {
            Some(embedding) => {
                let (features, points, patch) = self.patches(cx, pixels, assignment, &routes, embedding);
                (features, points, Some(Origin::Patch(patch)))
            }
            None => {
                let origin =
                    parametrization.is_relative().then(|| self.pixel_of(cx, pixels, &assignment.expert, &routes));
                let features = pixels.features.gather_rows(&routes.routed);
                (features, pixels.points.gather_rows(&routes.pixel), origin.map(Origin::Pixel))
            }
        };
        let raw = self.experts.forward(cx, features, &routes, choice);
        let means = place(points, raw, origin, parametrization);
        let feature = self.attention.as_ref().map(|(projection, _)| {
            cx.part("pixel_projector", || {
                let projected = projection.forward(cx, features);
                if routes.is_single() { projected } else { projected.gather_rows(&routes.source) }
            })
        });
        let theta = raw.slice(1, 3, raw.shape()[1] - 3);
        Proposed { means, theta, feature, origin, pixel: routes.pixel }
    }

    /// Features of the routed cells `[R, F]`, points of the Gaussians `[N, 3]`, and their patches.
    fn patches<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        pixels: &PixelInputs<'t, T>,
        assignment: &Assignment<T>,
        routes: &Routes,
        embedding: Linear,
    ) -> (Var<'t, T>, Var<'t, T>, PatchOf<'t, T>) {
        let (tape, pool) = (cx.tape, cx.tape.pool());
        let (height, width, cells) = (pixels.height, pixels.width, assignment.cells.as_ref());
        let patches = Patches::new(routes, cells, [height, width], pool);
        // Pixels that stand for more than themselves, without cells that say for which.
        let stretch = cells.is_none().then(|| {
            let mut stretch = local_count::<T>(&assignment.expert, height, width, pool);
            for (stretch, &e) in stretch.iter_mut().zip(assignment.expert.iter()) {
                *stretch = (T::from_f64(f64::from(e)) / *stretch).sqrt();
            }
            stretch
        });
        let Frames { extents, rotations, shifts, descriptors } = {
            let (points, footprints, colors) =
                (pixels.points.value(), pixels.footprint().value(), pixels.color().value());
            let surface = Surface { points: &points, footprints: &footprints, colors: &colors, height, width };
            surface.frames(routes, &patches, cells, stretch.as_deref())
        };
        let (cells, n) = (routes.routed.len(), routes.gaussians());
        let described = embedding.forward(cx, tape.constant(&descriptors, [cells, DESCRIPTORS]));
        let features = patch_mean(pixels.features, &patches.cell) + described;
        let points = patch_mean(pixels.points, &patches.band) + tape.constant(&shifts, [n, 3]);
        let color = patch_mean(pixels.color().detach(), &patches.band);
        let [extents, rotation] = [(&extents, 3), (&rotations, 4)].map(|(values, k)| tape.constant(values, [n, k]));
        (features, points, PatchOf { extents, rotation, color })
    }

    /// The attention over neighbors, if there is one.
    pub fn predictor(&self) -> Option<&NeighborPredictor> {
        self.attention.as_ref().map(|(_, predictor)| predictor)
    }

    /// Footprint, local count and color of each Gaussian's pixel.
    fn pixel_of<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        pixels: &PixelInputs<'t, T>,
        expert: &[u8],
        routes: &Routes,
    ) -> PixelOf<'t, T> {
        let (footprints, colors) = (pixels.footprint(), pixels.color());
        let count = local_count::<T>(expert, pixels.height, pixels.width, cx.tape.pool());
        let n = routes.gaussians();
        let local_count = cx.tape.constant_with([n], |out| {
            out.iter_mut().zip(routes.pixel.iter()).for_each(|(out, &p)| *out = count[p as usize]);
        });
        let color = colors.detach().gather_rows(&routes.pixel);
        PixelOf { footprint: footprints.gather_rows(&routes.pixel), local_count, color }
    }
}
