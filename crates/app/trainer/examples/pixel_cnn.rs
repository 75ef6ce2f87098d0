//! A second model through the trainer: one Gaussian for every pixel, by a plain CNN, with the data's cameras.
//!
//! `cargo run --release -p weaver-trainer --example pixel_cnn` trains half a run, resumes it from its checkpoint, and
//! prints the evaluation and the path of the report. All of it is the trainer's; here are only the network and its
//! losses.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use weaver_autograd::{Params, Var};
use weaver_geometry::sh;
use weaver_inference::{
    Checkpoint, PixelAligned, PixelAlignedNetwork, PixelAlignedPredictor, Predictor, RunFolder, WeightSet,
};
use weaver_nn::{Builder, Context, Conv2d, WeightInit};
use weaver_pose::CameraVars;
use weaver_splat::GaussianVars;
use weaver_trainer::losses::{ImageLosses, camera_constants, photo_constant};
use weaver_trainer::{
    Config, ConfigSource, Error, EvalOptions, Example, NoSettings, Recipe, Registry, Source, StageConfig, Step,
    StepReport, Terms, create_run,
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
}

impl PixelAlignedNetwork for PixelCnn {
    fn image_size(&self) -> [usize; 2] {
        [self.size[1], self.size[0]]
    }

    fn forward<'t>(&self, cx: Context<'t, '_>, photos: Var<'t>, cameras: &CameraVars<'t>) -> PixelAligned<'t> {
        let [views, height, width] = [0, 2, 3].map(|axis| photos.shape()[axis]);
        let n = views * height * width;
        let [first, second, last] = &self.layers;
        let raw = last.forward(cx, second.forward(cx, first.forward(cx, photos).relu()).relu());
        let rows = |maps: Var<'t>| maps.permute(&[0, 2, 3, 1]);
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
        PixelAligned { depth, gaussians }
    }
}

/// Recipe of its training.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelCnnRecipe;

impl Recipe for PixelCnnRecipe {
    const ARCHITECTURE: &'static str = "pixel-cnn";
    const PRESETS: &'static [&'static str] = &["tiny"];
    type Network = PixelCnn;
    type Model = CnnConfig;
    type Stage = NoSettings;
    type Losses = ImageLosses;
    type Evaluation = NoSettings;

    fn preset(name: &str) -> Option<Config<Self>> {
        let losses = ImageLosses { mse: 1.0, ssim: 0.15, ..ImageLosses::default() };
        let (model, stage) =
            (CnnConfig { size: [64, 48], channels: 16 }, StageConfig::new("images", 300, 2e-3, losses));
        Self::PRESETS.contains(&name).then(|| Config::new(name, model, vec![stage], NoSettings {}))
    }

    fn image_size(model: &CnnConfig) -> [usize; 2] {
        [model.size[1], model.size[0]]
    }

    fn build(model: &CnnConfig, params: &mut Params, seed: u64) -> PixelCnn {
        PixelCnn::new(model, Builder::new(params, seed))
    }

    fn objective<'t>(
        cx: Context<'t, '_>,
        network: &PixelCnn,
        step: &Step<'_, Self>,
        examples: &[Example],
    ) -> Result<Terms<'t>, Error> {
        let mut terms = Terms::default();
        terms.gaussians_per_pixel = 1.0;
        for example in examples {
            let photos = photo_constant(cx, example.context_photos());
            let made = network.forward(cx, photos, &camera_constants(cx, example.context()));
            let image = step.render(&made.gaussians, &camera_constants(cx, &example.cameras));
            let (truth, share) = (photo_constant(cx, example.photos()), 1.0 / examples.len() as f64);
            step.stage.losses.add(
                &mut terms,
                share,
                step.networks,
                [image, truth],
                example.inside_of(example.cameras.len()),
            );
        }
        Ok(terms)
    }

    fn predictor(network: Arc<PixelCnn>, params: Params, _: &Config<Self>) -> Result<Box<dyn Predictor>, Error> {
        Ok(Box::new(PixelAlignedPredictor::new(network, params)))
    }

    fn from_checkpoint(checkpoint: &Checkpoint) -> Result<Box<dyn Predictor>, Error> {
        let mut params = Params::new();
        let network = Self::build(&checkpoint.model_config(Self::ARCHITECTURE)?, &mut params, 0);
        checkpoint.fill(&mut params, WeightSet::Averaged)?;
        Ok(Box::new(PixelAlignedPredictor::new(Arc::new(network), params)))
    }
}

fn main() -> Result<(), Error> {
    let registry = Registry::empty().with::<PixelCnnRecipe>();
    let recipe = registry.find(Some("pixel-cnn"))?;
    let steps = std::env::args().nth(1).and_then(|n| n.parse().ok());
    let config = recipe.resolve(&ConfigSource { steps, ..ConfigSource::default() })?;
    let folder = create_run(&std::env::temp_dir().join(format!("pixel-cnn-{}", std::process::id())), &config)?;
    let written = RunFolder::at(folder.path());
    let (mut session, stop) = (recipe.start(&config)?, AtomicBool::new(false));
    print!("{}", session.plan());
    let half = session.steps().1 / 2;
    let mut stop_halfway = |report: &StepReport| {
        stop.store(report.step == half, Ordering::Relaxed);
        Ok(())
    };
    session.train(&folder, &mut stop_halfway, &stop)?;
    // As after Ctrl-C: the name in the folder finds the recipe, and the run goes on to the same bits.
    stop.store(false, Ordering::Relaxed);
    let mut session = registry.of_run(&written)?.resume(&written, None)?;
    println!("resumed at step {} of {}", session.steps().0, session.steps().1);
    session.train(&folder, &mut stop_halfway, &stop)?;
    let mut run = registry.of_run(&written)?.open(&written)?;
    let evaluation = run.evaluate(&Source::Unseen, &EvalOptions::default(), &mut |_, _| {})?;
    println!("{}report: {}", evaluation.table(), written.path().join("report.html").display());
    Ok(())
}
