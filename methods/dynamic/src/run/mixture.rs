//! Experts and router together.

use crate::run::beginning::Beginning;
use crate::run::{ExpertKind, Preset, RunError, RunSettings};
use crate::{
    Code, CodeConfig, Expert, Field, FieldConfig, Gated, Keys, KeysConfig, PixelRouter, Poly, RouterConfig, Seen, Shot,
    Start,
};
use weaver_autograd::{ParamId, Params, Tape, ops};
use weaver_data::film::Film;
use weaver_geometry::Camera;
use weaver_nn::{Builder, Context};
use weaver_pose::CameraVars;
use weaver_scene::CameraRows;
use weaver_splat::{GaussianVars, RasterSettings, Workspace, WorkspacePool};

/// Initial opacity of all Gaussians.
const OPACITY: f64 = 0.1;
/// The box of a field around the points, as a share of their spread on each side.
const ROOM: f64 = 0.1;
/// Part of the points on each side of each axis outside of a field's box: strays.
const STRAYS: f64 = 0.01;

/// Experts and router, with parameters in [`Params`].
#[derive(Debug)]
pub struct Mixture {
    experts: Vec<Expert<f32>>,
    counts: Vec<usize>,
    router: PixelRouter,
    /// The box of fields.
    bounds: [[f64; 3]; 2],
    background: [f32; 3],
    workspaces: WorkspacePool<f32>,
}

/// Pictures of a mixture from a camera at a time, P pixels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pictures {
    /// Each expert's picture `[K, P, 3]`.
    pub experts: Vec<f32>,
    /// The gate `[K, P]`.
    pub gate: Vec<f32>,
    /// The mixture `[P, 3]`.
    pub mixture: Vec<f32>,
}

impl Mixture {
    /// Builds the parameters of all experts, one after the other, and of the router; fields cover `bounds`.
    pub(crate) fn new(
        params: &mut Params<f32>,
        settings: &RunSettings,
        film: &Film,
        beginnings: &[Beginning],
        bounds: [[f64; 3]; 2],
    ) -> Self {
        let mut root = Builder::new(params, settings.seed);
        let frames = film.times().len();
        let labels = settings.labels();
        let experts = labels.iter().zip(&settings.experts).zip(beginnings).map(|((label, kind), begin)| {
            let sizes = Sizes { preset: settings.preset, frames, bounds };
            sizes.expert(*kind, root.scope(label), begin)
        });
        let experts = experts.collect();
        let counts: Vec<usize> = beginnings.iter().map(|begin| begin.sizes.len()).collect();
        let owners: Vec<usize> = counts.iter().enumerate().flat_map(|(i, count)| vec![i; *count]).collect();
        let config = RouterConfig { temperature: settings.temperature, background_weight: settings.background_weight };
        let router = PixelRouter::new(root.scope("router"), &owners, config);
        Self { experts, counts, router, bounds, background: film.background, workspaces: WorkspacePool::new() }
    }

    /// The experts.
    pub fn experts(&self) -> &[Expert<f32>] {
        &self.experts
    }

    /// Gaussians of each expert.
    pub fn counts(&self) -> &[usize] {
        &self.counts
    }

    /// Lower and upper corner of the box of fields.
    pub(crate) fn bounds(&self) -> [[f64; 3]; 2] {
        self.bounds
    }

    /// The router.
    pub fn router(&self) -> &PixelRouter {
        &self.router
    }

    /// The parameters with a row for each Gaussian of the list: each expert's, and the router's.
    pub(crate) fn rows(&self) -> (Vec<Vec<ParamId>>, [ParamId; 2]) {
        (self.experts.iter().map(Expert::rows).collect(), [self.router.base(), self.router.time()])
    }

    /// All Gaussians at a time, expert by expert, without gradients.
    pub fn list<'t>(&self, cx: Context<'t, '_, f32>, time: f64) -> GaussianVars<'t, f32> {
        let all: Vec<GaussianVars<'t, f32>> = self.experts.iter().map(|expert| expert.at(cx, time)).collect();
        let joined = |part: fn(&GaussianVars<'t, f32>) -> weaver_autograd::Var<'t, f32>| {
            ops::concat(&all.iter().map(part).collect::<Vec<_>>(), 0).detach()
        };
        GaussianVars {
            means: joined(|g| g.means),
            quats: joined(|g| g.quats),
            scales: joined(|g| g.scales),
            opacities: joined(|g| g.opacities),
            colors: joined(|g| g.colors),
        }
    }

    /// A camera at a time, on a tape, for routers.
    pub fn shot<'t>(&self, tape: &'t Tape<f32>, camera: &Camera, time: f64) -> Shot<'_, 't, f32> {
        let rows = CameraRows::new(std::slice::from_ref(camera));
        Shot {
            camera: CameraVars {
                viewmats: tape.constant(&rows.viewmats, [1, 3, 4]),
                intrinsics: tape.constant(&rows.intrinsics, [1, 4]),
            },
            time,
            size: [camera.height, camera.width],
            background: tape.constant(&self.background, [3]),
            settings: RasterSettings::default(),
            workspaces: &self.workspaces,
        }
    }

    /// Draws and gates all experts.
    pub(crate) fn gated<'t>(&self, cx: Context<'t, '_, f32>, camera: &Camera, time: f64) -> Gated<'t, f32> {
        self.router.gated(cx, &self.list(cx, time), &self.shot(cx.tape, camera, time))
    }

    /// Draws all experts once, for the router's steps.
    pub(crate) fn see(
        &self,
        params: &Params<f32>,
        (camera, time): (&Camera, f64),
        workspace: &mut Workspace<f32>,
    ) -> Result<Seen<f32>, RunError> {
        let tape = Tape::new();
        let seen = tape.without_gradient(|| {
            let gaussians = self.list(Context::new(&tape, params), time);
            self.router.see(&gaussians, &self.shot(&tape, camera, time), workspace)
        });
        Ok(seen?)
    }

    /// Draws the view of a camera at a time.
    ///
    /// # Errors
    /// When the rasterizer refuses.
    pub fn pictures(&self, params: &Params<f32>, camera: &Camera, time: f64) -> Result<Pictures, RunError> {
        let tape = Tape::new();
        let pictures = tape.without_gradient(|| {
            let gated = self.gated(Context::new(&tape, params), camera, time);
            Pictures { experts: gated.images.to_vec(), gate: gated.gate.to_vec(), mixture: gated.image.to_vec() }
        });
        self.check()?;
        Ok(pictures)
    }

    /// Fails if the rasterizer refused something since the last check.
    pub(crate) fn check(&self) -> Result<(), RunError> {
        self.workspaces.failure().map_or(Ok(()), |error| Err(error.into()))
    }
}

/// The box of a field around Gaussians, without strays.
pub(crate) fn bounds(beginnings: &[Beginning]) -> [[f64; 3]; 2] {
    let sides = [0, 1, 2].map(|axis| {
        let mut all: Vec<f64> =
            beginnings.iter().flat_map(|begin| begin.positions.iter().skip(axis).step_by(3).copied()).collect();
        all.sort_by(f64::total_cmp);
        let strays = (STRAYS * all.len() as f64) as usize;
        let (low, high) = (all[strays], all[all.len() - 1 - strays]);
        let room = ROOM * (high - low) + 1e-6;
        [low - room, high + room]
    });
    [0, 1].map(|end| sides.map(|side| side[end]))
}

/// Sizes of the experts of a run.
struct Sizes {
    preset: Preset,
    /// Moments of the film.
    frames: usize,
    bounds: [[f64; 3]; 2],
}

impl Sizes {
    fn expert(&self, kind: ExpertKind, mut b: Builder<'_, f32>, begin: &Beginning) -> Expert<f32> {
        let start = Start { positions: &begin.positions, sizes: &begin.sizes, opacity: OPACITY };
        let colors = &begin.colors;
        match kind {
            ExpertKind::Field => {
                let motion = Field::new(b.scope_here(), &start, self.field());
                Expert::new(b, motion, colors)
            }
            ExpertKind::Code => {
                let motion = Code::new(b.scope_here(), &start, self.code());
                Expert::new(b, motion, colors)
            }
            ExpertKind::Keys => {
                let motion = Keys::new(b.scope_here(), &start, self.keys());
                Expert::new(b, motion, colors)
            }
            ExpertKind::Poly => {
                let motion = Poly::new(b.scope_here(), &start, &begin.times);
                Expert::new(b, motion, colors)
            }
        }
    }

    fn field(&self) -> FieldConfig {
        let bounds = self.bounds;
        match self.preset {
            Preset::Tiny => {
                let resolution = [16, 16, 8, (self.frames / 2).max(3)];
                FieldConfig { bounds, resolution, levels: 2, channels: 8, width: 32 }
            }
            Preset::Published => {
                FieldConfig { bounds, resolution: [64, 64, 64, 150], levels: 2, channels: 16, width: 128 }
            }
        }
    }

    fn code(&self) -> CodeConfig {
        match self.preset {
            Preset::Tiny => CodeConfig { code: 8, table: [16, 16], moments: [4, 16], width: 32, neighbors: 20 },
            Preset::Published => {
                CodeConfig { code: 32, table: [150, 256], moments: [30, 150], width: 128, neighbors: 20 }
            }
        }
    }

    fn keys(&self) -> KeysConfig {
        let interval = if self.preset == Preset::Tiny { 4 } else { 10 };
        KeysConfig { frames: self.frames, interval, pad: 1.0, margin: 3.0 }
    }
}
