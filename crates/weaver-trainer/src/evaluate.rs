//! Evaluation on held-out views, beside two baselines: the nearest context view copied, and the mean color.

use crate::batch::{Batch, push_planar};
use crate::evaluation::{Evaluation, SceneFigures};
use crate::predictor::{CameraSource, Predictor};
use crate::{Cameras, Checkpoint, Config, Error, RunFolder};
use std::borrow::Borrow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use weaver_autograd::Pool;
use weaver_data::{Scene, evaluation_tuples};
use weaver_geometry::{Camera, Pose};
use weaver_io::Image;
use weaver_kernels::random::Stream;
use weaver_losses::lpips::Network;
use weaver_losses::{Lpips, metrics};
use weaver_pose::PoseErrors;
use weaver_router::AllocationKind;
use weaver_wavelet::{EnergyMap, Wavelet};

/// Which scenes to evaluate on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Source {
    /// The data of the run.
    Run,
    /// Folders of captures.
    Folders(Vec<PathBuf>),
    /// The built-in procedural scenes that are never trained on.
    Unseen,
}

/// How to evaluate; what is `None` is taken from the run's configuration.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Context views for each held-out view.
    pub context_views: Option<usize>,
    /// Whose cameras.
    pub cameras: Option<Cameras>,
    /// Which pixels get Gaussians.
    pub allocation: Option<AllocationKind>,
    /// Gaussians per context pixel.
    pub budget: Option<f64>,
    /// File with the weights of LPIPS.
    pub lpips: Option<PathBuf>,
}

/// Evaluates the weights of a run.
///
/// `progress` is told how many views of how many are done.
///
/// # Errors
/// When the run or the data cannot be read, or the options make no sense together.
pub fn run(
    run: &Path,
    source: &Source,
    options: &Options,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Evaluation, Error> {
    let (folder, config) = RunFolder::open(run)?;
    let checkpoint = Checkpoint::read(&folder.checkpoint_path(), &config)?;
    let scenes = match source {
        Source::Run => crate::scenes::load(&config)?,
        Source::Folders(folders) => crate::scenes::load_captures(folders, &config)?,
        Source::Unseen => weaver_data::procedural::default_unseen_set(config.model.width, config.model.height),
    };
    let lpips = options.lpips.as_deref().map(load_lpips).transpose()?;
    let (model, params) = checkpoint.evaluated_model(&config);
    let mut predictor = Predictor::new(&model, &params);
    scenes_with(&mut predictor, &config, &scenes, options, lpips.as_ref(), checkpoint.step, progress)
}

/// Reads LPIPS weights from a safetensors file.
///
/// # Errors
/// When the file is not one, or lacks a tensor.
pub fn load_lpips(path: &Path) -> Result<Lpips<f32>, Error> {
    let tensors = weaver_io::checkpoint::Tensors::read(path)?;
    let wrong = |message: String| Error::Checkpoint { path: path.to_path_buf(), message };
    let weights = tensors
        .tensors
        .iter()
        .map(|(name, tensor)| {
            let values = tensor.data.widened().ok_or_else(|| {
                wrong(format!("tensor {name}: expected F16, BF16 or F32, found {}", tensor.data.dtype()))
            })?;
            Ok((name.clone(), (tensor.shape.clone(), values.into_owned())))
        })
        .collect::<Result<BTreeMap<_, _>, Error>>()?;
    let first: Option<&(Vec<usize>, Vec<f32>)> = BTreeMap::get(&weights, "net.slice1.0.weight");
    let network = if first.is_some_and(|(shape, _)| shape.last() == Some(&11)) { Network::Alex } else { Network::Vgg };
    Lpips::from_tensors(network, &weights, &path.display().to_string()).map_err(|e| wrong(e.to_string()))
}

/// Evaluates on loaded scenes.
///
/// # Errors
/// When the scenes have too few views or the options make no sense together.
pub fn scenes_with(
    predictor: &mut Predictor<'_>,
    config: &Config,
    scenes: &[impl Borrow<Scene>],
    options: &Options,
    lpips: Option<&Lpips<f32>>,
    step: usize,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Evaluation, Error> {
    let cameras = options.cameras.unwrap_or(config.evaluation.cameras);
    let kind = match options.allocation {
        Some(kind) => kind,
        None => parse_allocation(&config.evaluation.allocation)?,
    };
    let budget = check_budget(kind, options.budget)?.or_else(|| kind.has_budget().then_some(config.evaluation.budget));
    let experts = config.model.gaussians.experts + 1;
    let allocation = kind.allocation::<f32>(budget.unwrap_or(0.0), experts).map_err(|e| Error::Usage(e.to_string()))?;
    let context = options.context_views.unwrap_or(config.data.context_views);
    if context == 0 {
        return Err(Error::Usage("--views: expected at least 1 context view, found 0".into()));
    }

    let mut all = Vec::new();
    let scenes = || scenes.iter().map(Borrow::borrow);
    for (index, scene) in scenes().enumerate() {
        scene.check_evaluation(context)?;
        all.push(evaluation_tuples(scene, index, context));
    }
    let total: usize = all.iter().map(Vec::len).sum();
    let mut done = 0;
    let mut rescaled = Vec::new();
    let mut figures = Vec::new();
    for (scene, tuples) in scenes().zip(all) {
        let mean_color = mean_color(scene);
        let mut views = Vec::new();
        for tuple in tuples {
            let stream = Stream::new(config.seed, tuple.targets[0] as u64, "evaluation").fork(tuple.scene as u64);
            let (batch, measured) = Batch::for_evaluation(scene, tuple)?;
            let source = match (cameras, measured) {
                (Cameras::Predicted, _) => CameraSource::Predicted,
                (Cameras::Given, true) => CameraSource::Given(batch.context()),
                (Cameras::Given, false) => CameraSource::GivenUnscaled(batch.context()),
            };
            let prediction = predictor.predict(batch.context_images(), source, &*allocation, stream);
            let factor = if measured { 1.0 } else { prediction.scale_to_predicted(batch.context()) };
            let target: Vec<Camera> =
                batch.targets().iter().map(|c| Camera { pose: c.pose.scaled(factor), ..*c }).collect();
            let render = predictor.render(&prediction.splats, &target).map_err(|e| Error::Usage(e.to_string()))?;
            if !measured && !rescaled.contains(&scene.name) {
                rescaled.push(scene.name.clone());
            }
            views.push(view_figures(scene, &batch, &prediction, &render[0], mean_color, cameras, experts, lpips));
            done += 1;
            progress(done, total);
        }
        figures.push(SceneFigures::mean_of(&views, Some(scene.name.clone())));
    }
    let mut remarks = Vec::new();
    if !rescaled.is_empty() {
        remarks.push(format!(
            "{}: no points tell the scale, so camera centers were scaled until their mean distance to camera 0 equalled that of the predicted ones",
            rescaled.join(", ")
        ));
    }
    Ok(Evaluation {
        cameras: cameras.to_string(),
        allocation: kind.to_string(),
        budget,
        context_views: context,
        seed: config.seed,
        step,
        mean: SceneFigures::mean_of(&figures, None),
        scenes: figures,
        remarks,
    })
}

pub(crate) fn parse_allocation(name: &str) -> Result<AllocationKind, Error> {
    name.parse().map_err(|e| Error::Usage(format!("{e}")))
}

/// A budget is only for allocations that have one.
pub(crate) fn check_budget(kind: AllocationKind, budget: Option<f64>) -> Result<Option<f64>, Error> {
    match budget {
        Some(budget) if !kind.has_budget() => Err(Error::Usage(format!(
            "--budget {budget}: the allocation `{kind}` has no budget; dithered, grid and random have one"
        ))),
        budget => Ok(budget),
    }
}

fn view_figures(
    scene: &Scene,
    batch: &Batch,
    prediction: &crate::Prediction,
    render: &Image,
    mean_color: [f32; 3],
    cameras: Cameras,
    experts: usize,
    lpips: Option<&Lpips<f32>>,
) -> SceneFigures {
    let truth = &scene.views[batch.tuple.targets[0]].image;
    let nearest = &scene.views[batch.tuple.context[0]].image;
    let flat: Vec<f32> = mean_color.iter().copied().cycle().take(truth.pixels.len()).collect();
    let (shown, true_planes) = (planes(render), planes(truth));
    let size = [3, truth.height, truth.width];
    let mut energy = vec![0.0; truth.width * truth.height];
    EnergyMap::new(Wavelet::Db2, [truth.height, truth.width]).compute(&true_planes, &Pool::new(), &mut energy);
    let mask = metrics::energetic_mask(&energy);
    let pixels = prediction.experts.len() as f64;
    let errors = (cameras == Cameras::Predicted && batch.context().len() > 1).then(|| {
        let poses = |c: &[Camera]| -> Vec<Pose> { c.iter().map(|c| c.pose).collect() };
        PoseErrors::between(&poses(&prediction.predicted), &poses(batch.context()))
    });
    SceneFigures {
        name: None,
        views: 1,
        psnr: metrics::psnr(&shown, &true_planes),
        psnr_energetic: metrics::psnr_masked(&shown, &true_planes, &mask).unwrap_or(f64::NAN),
        ssim: metrics::ssim(&shown, &true_planes, size),
        lpips: lpips.map(|l| metrics::lpips(l, &shown, &true_planes, [truth.height, truth.width])),
        psnr_nearest: metrics::psnr(&nearest.pixels, &truth.pixels),
        psnr_mean_color: metrics::psnr(&flat, &truth.pixels),
        gaussians_per_pixel: prediction.splats.opacities.len() as f64 / pixels,
        expert_share: (0..experts)
            .map(|e| prediction.experts.iter().filter(|&&x| usize::from(x) == e).count() as f64 / pixels)
            .collect(),
        pose_rotation_deg: errors.as_ref().and_then(PoseErrors::mean_rotation),
        pose_translation_deg: errors.as_ref().and_then(PoseErrors::mean_translation),
    }
}

fn planes(image: &Image) -> Vec<f32> {
    let mut planes = Vec::with_capacity(image.pixels.len());
    push_planar(&mut planes, image);
    planes
}

fn mean_color(scene: &Scene) -> [f32; 3] {
    let (mut sum, mut count) = ([0.0f64; 3], 0.0);
    for view in scene.training_views() {
        for pixel in scene.views[view].image.pixels.chunks_exact(3) {
            sum.iter_mut().zip(pixel).for_each(|(s, p)| *s += f64::from(*p));
            count += 1.0;
        }
    }
    sum.map(|s| (s / count) as f32)
}
