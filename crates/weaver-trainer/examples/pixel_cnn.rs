//! A second model through the trainer: one Gaussian for every pixel, by a plain CNN, with the data's cameras.
//!
//! `cargo run --release -p weaver-trainer --example pixel_cnn` trains half a run, resumes it from its checkpoint, and prints the
//! evaluation and the path of the report. All of it is the trainer's; here are only the network and its losses.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use weaver_autograd::{Params, Tape, Var};
use weaver_geometry::sh;
use weaver_inference::{CameraSource, Density, Photos, Prediction, Predictor};
use weaver_kernels::random::Stream;
use weaver_nn::{Builder, Context, Conv2d, WeightInit};
use weaver_pose::CameraVars;
use weaver_scene::ActivatedGaussians;
use weaver_splat::{GaussianVars, RasterSettings, Rasterize, Workspace};
use weaver_trainer::losses::{ImageLosses, camera_constants};
use weaver_trainer::{
    CameraMode, Config, Error, EvaluationConfig, Example, Observer, Overrides, Recipe, Registry, Setup, Source,
    StageConfig, Step, StepReport, Terms, create_run,
};

/// The section `model`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CnnConfig {
    /// Width and height of the photos, pixels.
    #[schemars(inner(range(max = 16_384)))]
    size: [usize; 2],
    /// Channels of the hidden layers.
    #[schemars(range(min = 1, max = 4096))]
    channels: usize,
}

/// The section `stages.N.model`: nothing to choose.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct NoChoices {}

/// Three convolutions; the last gives log depth, opacity, three scales and a color for each pixel.
#[derive(Debug)]
pub struct PixelCnn {
    size: [usize; 2],
    layers: [Conv2d; 3],
}

impl PixelCnn {
    const OUTPUTS: usize = 8;

    fn new(config: &CnnConfig, mut b: Builder<'_, f32>) -> Self {
        let c = config.channels;
        let mut layer = |i: usize, inputs, outputs, kernel| {
            Conv2d::new(b.scope(format_args!("layers.{i}")), inputs, outputs, kernel, WeightInit::FanIn)
        };
        let layers = [layer(0, 3, c, 7), layer(1, c, c, 7), layer(2, c, Self::OUTPUTS, 3)];
        Self { size: config.size, layers }
    }

    /// Depth `[V, H, W]`, and a Gaussian for each pixel of photos `[V, 3, H, W]` seen by `cameras`.
    fn forward<'t>(
        &self,
        cx: Context<'t, '_, f32>,
        photos: Var<'t, f32>,
        cameras: &CameraVars<'t>,
    ) -> (Var<'t, f32>, GaussianVars<'t, f32>) {
        let [views, height, width] = [0, 2, 3].map(|axis| photos.shape()[axis]);
        let n = views * height * width;
        let [first, second, last] = &self.layers;
        let raw = last.forward(cx, second.forward(cx, first.forward(cx, photos).relu()).relu());
        let rows = |maps: Var<'t, f32>| maps.permute(&[0, 2, 3, 1]);
        let raw = rows(raw).reshape([n, Self::OUTPUTS]);
        let depth = raw.slice(1, 0, 1).clamp(-3.0, 3.0).exp().reshape([views, height, width]);
        let means = weaver_pose::unproject(depth, cameras.viewmats, cameras.intrinsics, 0.5).reshape([n, 3]);
        let focal = cameras.intrinsics.slice(1, 0, 1).reshape([views, 1, 1]).expand(depth.shape());
        let footprint = (depth / focal).reshape([n, 1]).expand([n, 3]);
        let color = rows(photos).reshape([n, 3]) + raw.slice(1, 5, 3) - 0.5;
        let gaussians = GaussianVars {
            means,
            quats: cx.tape.constant(&[1.0, 0.0, 0.0, 0.0], [1, 4]).expand([n, 4]),
            scales: footprint * raw.slice(1, 2, 3).clamp(-3.0, 3.0).exp() * 0.7,
            opacities: raw.slice(1, 1, 1).sigmoid().reshape([n]),
            colors: (color * (1.0 / sh::DC)).reshape([n, 1, 3]),
        };
        (depth, gaussians)
    }
}

/// How it is trained.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelCnnRecipe;

impl Recipe for PixelCnnRecipe {
    const ARCHITECTURE: &'static str = "pixel-cnn";
    const PRESETS: &'static [&'static str] = &["tiny"];
    type Network = PixelCnn;
    type Model = CnnConfig;
    type Stage = NoChoices;
    type Losses = ImageLosses;

    fn preset(name: &str) -> Option<Config<Self>> {
        let stage = StageConfig {
            name: "images".into(),
            steps: 300,
            tuples: 1,
            rate: 2e-3,
            warmup: 20,
            floor: 0.1,
            frozen: Vec::new(),
            recompute: false,
            model: NoChoices {},
            losses: ImageLosses { mse: 1.0, ssim: 0.15, ..ImageLosses::default() },
        };
        let evaluation = EvaluationConfig { cameras: CameraMode::Given, allocation: None, budget: None };
        let model = CnnConfig { size: [64, 48], channels: 16 };
        Self::PRESETS.contains(&name).then(|| Config::new(name, model, vec![stage], evaluation))
    }

    fn check(config: &Config<Self>) -> Result<(), String> {
        config.stages.iter().enumerate().try_for_each(|(i, s)| s.losses.check(&format!("stages.{i}.losses")))
    }

    fn lpips_weights(stage: &StageConfig<Self>) -> Option<&Path> {
        stage.losses.lpips_file()
    }

    fn image_size(model: &CnnConfig) -> [usize; 2] {
        [model.size[1], model.size[0]]
    }

    fn build(model: &CnnConfig, params: &mut Params<f32>, seed: u64) -> PixelCnn {
        PixelCnn::new(model, Builder::new(params, seed))
    }

    fn objective<'t>(
        cx: Context<'t, '_, f32>,
        network: &PixelCnn,
        step: &Step<'_, Self>,
        examples: &[Example],
    ) -> Result<Terms<'t>, Error> {
        let mut terms = Terms::default();
        let [width, height] = network.size;
        for example in examples {
            let views = example.context().len();
            let photos = cx.tape.constant(example.context_photos().planes, [views, 3, height, width]);
            let (_, gaussians) = network.forward(cx, photos, &camera_constants(cx, example.context()));
            let all = camera_constants(cx, &example.cameras);
            let background = cx.tape.constant(&[1.0; 3], [3]);
            let op = Rasterize::new(width, height, RasterSettings::default(), step.workspaces).without_depth();
            let image = op.apply(&gaussians, &all, background).image.permute(&[0, 3, 1, 2]).clamp(0.0, 1.0);
            let truth = cx.tape.constant(&example.images, image.shape());
            let share = 1.0 / examples.len() as f64;
            step.stage.losses.add(
                &mut terms,
                share,
                step.lpips,
                [image, truth],
                example.inside_of(example.cameras.len()),
            );
            terms.gaussians_per_pixel = 1.0;
        }
        Ok(terms)
    }

    fn predictor(
        network: Arc<PixelCnn>,
        params: Params<f32>,
        _config: &Config<Self>,
    ) -> Result<Box<dyn Predictor>, Error> {
        Ok(Box::new(CnnPredictor { network, params, tape: Tape::new(), workspace: Workspace::new() }))
    }
}

/// The network with its weights.
#[derive(Debug)]
struct CnnPredictor {
    network: Arc<PixelCnn>,
    params: Params<f32>,
    tape: Tape<f32>,
    workspace: Workspace<f32>,
}

impl Predictor for CnnPredictor {
    fn predict(
        &mut self,
        photos: Photos<'_>,
        cameras: CameraSource<'_>,
        density: Density,
        _stream: Stream,
    ) -> Result<Prediction, weaver_inference::Error> {
        self.density(density)?;
        let Some(cameras) = cameras.given() else {
            return Err(weaver_inference::Error::Input("this model needs given cameras".into()));
        };
        self.tape.reset();
        let (views, cx) = (photos.views(), Context::new(&self.tape, &self.params));
        let Photos { planes, height, width, .. } = photos;
        Ok(self.tape.without_gradient(|| {
            let photos = self.tape.constant(planes, [views, 3, height, width]);
            let (depth, g) = self.network.forward(cx, photos, &camera_constants(cx, cameras));
            let [means, scales, quats] = [g.means, g.scales, g.quats].map(|x| x.to_vec());
            let (opacities, sh) = (g.opacities.to_vec(), g.colors.to_vec());
            Prediction {
                gaussians: ActivatedGaussians { means, scales, quats, opacities, sh, degree: 0 },
                cameras: cameras.to_vec(),
                depth: depth.to_vec(),
                counts: vec![1; views * height * width],
                ..Prediction::default()
            }
        }))
    }

    fn image_size(&self) -> [usize; 2] {
        [self.network.size[1], self.network.size[0]]
    }

    fn workspace(&mut self) -> &mut Workspace<f32> {
        &mut self.workspace
    }
}

/// Stops a run after some steps.
struct StopAt<'a>(usize, &'a AtomicBool);

impl Observer for StopAt<'_> {
    fn step(&mut self, report: &StepReport) -> Result<(), Error> {
        self.1.store(report.step >= self.0, Ordering::Relaxed);
        Ok(())
    }
}

fn main() -> Result<(), Error> {
    let registry = Registry::new().with::<PixelCnnRecipe>();
    let recipe = registry.find(Some("pixel-cnn"))?;
    let config =
        recipe.resolve(&Setup { steps: std::env::args().nth(1).and_then(|n| n.parse().ok()), ..Setup::default() })?;
    let path = std::env::temp_dir().join(format!("pixel-cnn-{}", std::process::id()));
    let folder = create_run(Path::new(&path), &config)?;
    let (mut session, stop) = (recipe.start(&config)?, AtomicBool::new(false));
    print!("{}", session.plan());
    let half = session.steps().1 / 2;
    session.train(&folder, &mut StopAt(half, &stop), &stop)?;
    // As after Ctrl-C: the name in the folder finds the recipe, and the run goes on to the same bits.
    stop.store(false, Ordering::Relaxed);
    let mut session = registry.of_run(&folder)?.resume(&folder, None)?;
    println!("resumed at step {} of {}", session.steps().0, session.steps().1);
    session.train(&folder, &mut StopAt(usize::MAX, &stop), &stop)?;
    let evaluation =
        registry.of_run(&folder)?.open(&folder)?.evaluate(&Source::Unseen, &Overrides::default(), &mut |_, _| {})?;
    println!("{}report: {}", evaluation.table(), folder.report_path().display());
    Ok(())
}
