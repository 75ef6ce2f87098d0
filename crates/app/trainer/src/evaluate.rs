//! Evaluation on held-out views, beside two baselines: the nearest context view copied, and the mean color.

mod aligned;
mod drawn;
mod looks;

use crate::evaluation::{AlignedFigures, CameraFigures, Evaluation, SceneFigures, areas};
use crate::losses::ImageNetworks;
use crate::{CameraMode, Error, LooksConfig};
use aligned::AlignedView;
pub use aligned::{AlignLoss, Alignment};
use drawn::{Drawing, Drawn, Remark};
pub use looks::LookOf;
use looks::Recovery;
use std::borrow::Borrow;
use std::collections::BTreeMap;
use std::path::Path;
use weaver_autograd::Pool;
use weaver_data::{Scene, Tuple, View, evaluation_tuples};
use weaver_inference::{Density, Predictor, planar};
use weaver_io::Image;
use weaver_losses::lpips::{Network, Tensors};
use weaver_losses::{Lpips, Perceptual, metrics};
use weaver_pose::PoseErrors;
use weaver_wavelet::{EnergyMap, Wavelet};

/// The least side of an image, pixels: SSIM, which every evaluation measures, has windows of so many.
pub(crate) const LEAST_SIDE: usize = 11;

/// Which photos judge, and where they are drawn from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Targets {
    /// Held-out photos, from the data's cameras.
    #[default]
    Data,
    /// Held-out photos, from cameras that are predicted along with the context's, from these photos themselves; with predicted cameras
    /// only.
    Joint,
    /// Held-out photos, from the data's cameras carried over by the similarity between the context's centers, the data's and the predicted; as
    /// [`Data`](Self::Data) where these do not determine one. With predicted cameras only.
    Centers,
    /// The context photos, from their own cameras: how well what was made of them shows them.
    Context,
}

/// Options of an evaluation.
#[derive(Clone, Debug)]
pub struct Options {
    /// Context views for each held-out view.
    pub context_views: usize,
    /// Source of the cameras.
    pub cameras: CameraMode,
    /// Which photos judge.
    pub targets: Targets,
    /// True if depth is brought to the points that the context views see; with given cameras only.
    pub points: bool,
    /// Estimates the cameras of context views, in place of others, from these photos; depth is brought to the points that come
    /// with them.
    pub matching: Option<Matching>,
    /// Which pixels get Gaussians, and how many; the predictor fills what is left open.
    pub density: Density,
    /// Alignment of held-out views' cameras with their photos, for figures beside the others.
    pub align: Option<Alignment>,
    /// Light and passers-by that photos are given, as the run's were.
    pub planted: Option<LooksConfig>,
    /// In whose light held-out views are drawn, for models that know about light.
    pub look: Option<LookOf>,
    /// Seed of allocations that draw random numbers.
    pub seed: u64,
    /// Optimizer steps that the weights were trained for.
    pub step: usize,
}

impl Default for Options {
    /// Four context views with given cameras, and nothing out of the ordinary.
    fn default() -> Self {
        Self {
            context_views: 4,
            cameras: CameraMode::Given,
            targets: Targets::Data,
            points: false,
            matching: None,
            density: Density::default(),
            align: None,
            planted: None,
            look: None,
            seed: 0,
            step: 0,
        }
    }
}

/// Inputs that cameras are estimated from.
#[derive(Clone, Debug)]
pub struct Matching {
    /// The same scenes with the same views in the same order, as large as they are matched.
    pub scenes: Vec<Scene>,
    /// True if focal lengths are told, as EXIF would.
    pub focal_known: bool,
}

/// Reads LPIPS weights from a safetensors file.
///
/// # Errors
/// When the file is not one, or lacks a tensor.
pub fn load_lpips(path: &Path) -> Result<Lpips<f32>, Error> {
    let weights = tensors_of(path)?;
    let first = weights.get("net.slice1.0.weight");
    let network = if first.is_some_and(|(shape, _)| shape.last() == Some(&11)) { Network::Alex } else { Network::Vgg };
    Lpips::from_tensors(network, &weights, &path.display().to_string()).map_err(|e| Error::Input(e.to_string()))
}

fn wrong(path: &Path, message: String) -> Error {
    Error::Checkpoint { path: path.to_path_buf(), message }
}

fn tensors_of(path: &Path) -> Result<Tensors, Error> {
    let tensors = weaver_io::safetensors::Tensors::read(path)?.tensors;
    let widened = tensors.iter().map(|(name, tensor)| {
        let values = tensor.data.widened().ok_or_else(|| {
            wrong(path, format!("tensor {name}: expected F16, BF16 or F32, found {}", tensor.data.dtype()))
        })?;
        Ok((name.clone(), (tensor.shape.clone(), values.into_owned())))
    });
    widened.collect()
}

/// Reads LPIPS weights, if asked for, and checks that images of the model's size (H, W) are large enough for them.
pub(crate) fn lpips_for(path: Option<&Path>, [height, width]: [usize; 2]) -> Result<Option<Lpips<f32>>, Error> {
    let Some(path) = path else { return Ok(None) };
    let lpips = load_lpips(path)?;
    large_enough(path, lpips.least_side(), [height, width])?;
    Ok(Some(lpips))
}

fn large_enough(path: &Path, least: usize, [height, width]: [usize; 2]) -> Result<(), Error> {
    let message = || format!("expected images of at least {least} x {least} pixels, found {width} x {height}");
    if height.min(width) >= least { Ok(()) } else { Err(wrong(path, message())) }
}

/// Reads the networks of training, where there are files for them, LPIPS first, and checks that images of the model's size (H, W) are large
/// enough.
pub(crate) fn image_networks(
    [(_, lpips), (_, perceptual)]: [(&str, Option<&Path>); 2],
    size: [usize; 2],
) -> Result<ImageNetworks, Error> {
    let read = |path: &Path| {
        let network = Perceptual::from_tensors(&tensors_of(path)?, &path.display().to_string());
        large_enough(path, Perceptual::<f32>::LEAST_SIDE, size)?;
        network.map_err(|e| Error::Input(e.to_string()))
    };
    Ok(ImageNetworks { lpips: lpips_for(lpips, size)?, perceptual: perceptual.map(read).transpose()? })
}

/// Evaluates a predictor on loaded scenes; `progress` is told how many views of how many are done.
///
/// # Errors
/// When the scenes have too few views or the options do not suit the model.
pub fn evaluate(
    predictor: &mut dyn Predictor,
    scenes: &[impl Borrow<Scene>],
    options: &Options,
    lpips: Option<&Lpips<f32>>,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Evaluation, Error> {
    let Options { context_views: context, cameras, targets, seed, step, .. } = *options;
    let density = predictor.density(options.density)?;
    let measure = Measure { experts: predictor.max_per_pixel() + 1, lpips };
    if options.points && options.matching.is_none() && cameras == CameraMode::Predicted {
        return Err(Error::Input("points: expected given cameras, found predicted ones".into()));
    }
    if matches!(targets, Targets::Joint | Targets::Centers)
        && (options.matching.is_some() || cameras != CameraMode::Predicted)
    {
        return Err(Error::Input(
            "joint targets and those by centers: expected predicted cameras, found other ones".into(),
        ));
    }
    let [height, width] = predictor.image_size();
    if height.min(width) < LEAST_SIDE {
        let least = format!("expected a network for images of at least {LEAST_SIDE} x {LEAST_SIDE} pixels");
        return Err(Error::Input(format!("{least}, the window of SSIM, found {width} x {height}")));
    }
    if options.look.is_some() && (targets != Targets::Data || options.matching.is_some()) {
        return Err(Error::Input(
            "look: expected held-out views and predicted or given cameras of context views, found other ones".into(),
        ));
    }
    if context == 0 {
        return Err(Error::Input("expected at least 1 context view, found 0".into()));
    }

    let mut all = Vec::new();
    let plain: Vec<&Scene> = scenes.iter().map(Borrow::borrow).collect();
    let varied: Option<Vec<Scene>> = options
        .planted
        .as_ref()
        .map(|looks| plain.iter().enumerate().map(|(number, scene)| looks.of_scene(scene, number)).collect());
    let scenes: Vec<&Scene> = varied.as_ref().map_or_else(|| plain.clone(), |varied| varied.iter().collect());
    for (index, scene) in scenes.iter().enumerate() {
        scene.check_evaluation(context)?;
        let tuples = evaluation_tuples(scene, index, context);
        all.push(if targets == Targets::Context { of_context(&tuples) } else { tuples });
    }
    let total: usize = all.iter().map(Vec::len).sum();
    let mut done = 0;
    let mut remarked: BTreeMap<Remark, Vec<&str>> = BTreeMap::new();
    let mut figures = Vec::new();
    let mut drawing = Drawing { predictor, options, density };
    for ((index, scene), tuples) in scenes.iter().enumerate().zip(all) {
        let mean_color = mean_color(scene);
        let mut views = Vec::new();
        let mut recovery = Recovery::default();
        for tuple in tuples {
            let target = &looks::judged(scene, &tuple, options);
            if target.is_masked() {
                remarked.entry(Remark::Masked).or_default().push(&scene.name);
                done += 1;
                continue;
            }
            let drawn = drawing.draw(scene, index, &tuple)?;
            if let Some(remark) = drawn.remark {
                remarked.entry(remark).or_default().push(&scene.name);
            }
            let mut figures = measure.view(scene, &tuple, target, &drawn, mean_color);
            if options.look.is_some() {
                figures.look = Some(looks::figures(&drawn.render, target));
                if let Some(planted) = &options.planted {
                    let (photos, renders) = drawing.in_two_lights(planted, plain[index], scene, index, &tuple)?;
                    recovery.add(photos.each_ref(), renders.each_ref(), target);
                }
            }
            if let Some(align) = &options.align {
                let found = aligned::aligned(drawing.predictor, &drawn, target, align)?;
                let [before, after] =
                    aligned::control(&mut drawing, scene, &tuple, align)?.map(|i| measure.psnr(&i, target));
                let cameras = [&drawn.camera, &found.camera].map(|camera| aligned::off(&drawn, camera, scene, &tuple));
                let mut of_view = measure.aligned(&found, target, cameras, figures.psnr);
                of_view.gain_given = after - before;
                // Once for each scene: what alignment makes of a photo that the scene has nothing to do with.
                let next = scenes[(index + 1) % scenes.len()];
                if let (true, Some(other)) = (views.is_empty() && scenes.len() > 1, next.held_out_views().first()) {
                    let other = &next.views[*other];
                    let shown = aligned::with_another_scenes_photo(drawing.predictor, &drawn, other, align)?;
                    let flat = mean_color_of(&other.image);
                    of_view.elsewhere =
                        Some([&shown, &flat].map(|image| metrics::psnr(&image.pixels, &other.image.pixels)));
                }
                figures.aligned = Some(of_view);
            }
            views.push(figures);
            done += 1;
            progress(done, total);
        }
        let mut of_scene = SceneFigures::mean_of(&views, Some(scene.name.clone()));
        if let (Some(look), Some([slope, correlation])) = (&mut of_scene.look, recovery.slope_and_correlation()) {
            (look.slope, look.correlation) = (Some(slope), Some(correlation));
        }
        figures.push(of_scene);
    }
    // How a capture was loaded may say which of its photos are not judged.
    let of_loading = plain.iter().flat_map(|scene| scene.remarks.iter().cloned());
    let remarks = of_loading.chain(remarked.into_iter().map(|(remark, scenes)| explained(remark, &scenes))).collect();
    let mut cameras = if options.matching.is_some() { "estimated".into() } else { cameras.to_string() };
    cameras += match targets {
        Targets::Data => "",
        Targets::Joint => ", of held-out photos as well (which it has then seen)",
        Targets::Centers => ", held-out ones by the context's centers",
        Targets::Context => ", judged by the context photos themselves",
    };
    Ok(Evaluation {
        cameras,
        points: options.points,
        allocation: density.allocation.map(|kind| kind.to_string()),
        budget: density.budget,
        look: options.look.map(|look| look.to_string()),
        context_views: context,
        seed,
        step,
        mean: SceneFigures::mean_of(&figures, None),
        scenes: figures,
        remarks,
    })
}

/// Each of these tuples once for each view of its context, which is then the target.
fn of_context(tuples: &[Tuple]) -> Vec<Tuple> {
    let of = |tuple: &Tuple| {
        let targets = tuple.context.clone().into_iter();
        let tuple = tuple.clone();
        targets.map(move |view| Tuple { targets: vec![view], ..tuple.clone() })
    };
    tuples.iter().flat_map(of).collect()
}

/// Measurement of a rendered view.
struct Measure<'a> {
    /// Counts of Gaussians that a pixel can have, 0 included.
    experts: usize,
    lpips: Option<&'a Lpips<f32>>,
}

impl Measure<'_> {
    fn view(&self, scene: &Scene, tuple: &Tuple, target: &View, drawn: &Drawn, mean_color: [f32; 3]) -> SceneFigures {
        let Drawn { prediction, render, strict, errors, .. } = drawn;
        let truth = &target.image;
        // A view of the context is not copied to itself, unless it is the only one.
        let other = tuple.context.iter().find(|view| **view != tuple.targets[0]);
        let nearest = &scene.views[*other.unwrap_or(&tuple.context[0])].image;
        let flat = mean_color.iter().copied().cycle().take(truth.pixels.len()).collect();
        let flat = Image { width: truth.width, height: truth.height, pixels: flat };
        let mut energy = vec![0.0; truth.width * truth.height];
        let true_planes = planar([truth]);
        EnergyMap::new(Wavelet::Db2, [truth.height, truth.width]).compute(&true_planes, &Pool::new(), &mut energy);
        let energetic = metrics::energetic_mask(&energy, target.inside.as_deref());
        let pixels = prediction.counts.len() as f64;
        SceneFigures {
            name: None,
            views: 1,
            psnr: self.psnr(render, target),
            psnr_strict: strict.as_ref().map(|image| self.psnr(image, target)),
            psnr_energetic: metrics::psnr_masked(&planar([render]), &true_planes, &energetic).unwrap_or(f64::NAN),
            ssim: self.ssim(render, target),
            lpips: self.lpips(render, target),
            psnr_nearest: self.psnr(nearest, target),
            psnr_mean_color: self.psnr(&flat, target),
            aligned: None,
            look: None,
            gaussians_per_pixel: prediction.gaussians.opacities.len() as f64 / pixels,
            expert_share: (0..self.experts)
                .map(|e| prediction.counts.iter().filter(|&&x| usize::from(x) == e).count() as f64 / pixels)
                .collect(),
            pose_rotation_deg: errors.as_ref().and_then(PoseErrors::mean_rotation),
            pose_translation_deg: errors.as_ref().and_then(PoseErrors::mean_translation),
            pose_auc: errors.as_ref().and_then(areas),
        }
    }

    /// `before` is the PSNR of the view as it was drawn.
    fn aligned(&self, found: &AlignedView, target: &View, cameras: [CameraFigures; 2], before: f64) -> AlignedFigures {
        let psnr = self.psnr(&found.render, target);
        AlignedFigures {
            psnr,
            ssim: self.ssim(&found.render, target),
            lpips: self.lpips(&found.render, target),
            gain_given: 0.0,
            degrees: found.moved[0],
            distance: found.moved[1],
            elsewhere: None,
            steps: found.steps as f64,
            cameras,
            found: f64::from(u8::from(found.found)),
            better: f64::from(u8::from(psnr > before)),
        }
    }

    fn psnr(&self, image: &Image, view: &View) -> f64 {
        let (shown, truth) = (planar([image]), planar([&view.image]));
        match view.inside.as_deref() {
            None => metrics::psnr(&shown, &truth),
            Some(inside) => metrics::psnr_masked(&shown, &truth, inside).unwrap_or(f64::NAN),
        }
    }

    fn ssim(&self, image: &Image, view: &View) -> f64 {
        let (shown, truth, size) = (planar([image]), planar([&view.image]), [3, image.height, image.width]);
        match view.inside.as_deref() {
            None => metrics::ssim(&shown, &truth, size),
            Some(inside) => metrics::ssim_masked(&shown, &truth, size, inside).unwrap_or(f64::NAN),
        }
    }

    fn lpips(&self, image: &Image, view: &View) -> Option<f64> {
        let (shown, truth, size) = (planar([image]), planar([&view.image]), [image.height, image.width]);
        let network = self.lpips?;
        match view.inside.as_deref() {
            None => Some(metrics::lpips(network, &shown, &truth, size)),
            Some(inside) => metrics::lpips_masked(network, &shown, &truth, size, inside),
        }
    }
}

/// A remark on some views, for the reader.
fn explained(remark: Remark, scenes: &[&str]) -> String {
    let mut names: Vec<&str> = scenes.to_vec();
    names.dedup();
    let (names, views) = (names.join(", "), scenes.len());
    match remark {
        Remark::Rescaled => format!(
            "{names}: no points tell the scale, so camera centers were scaled until their mean distance to camera 0 equalled that of the predicted ones"
        ),
        Remark::OnOneLine => format!(
            "{names}: centers of {views} contexts that are fewer than three or on one line; camera 0's frame was taken"
        ),
        Remark::WithoutPoints => format!("{names}: context views without points, whose depth stays"),
        Remark::NotPlaced => {
            format!("{names}: no cameras could be estimated for {views} views, and predicted ones were taken")
        }
        Remark::Masked => format!("{names}: left out {views} views of which no pixel counts"),
        Remark::PartlyPlaced => format!("{names}: not all context views have an estimated camera for {views} views"),
    }
}

/// A photo's mean color, everywhere.
fn mean_color_of(image: &Image) -> Image {
    let mut sum = [0.0f64; 3];
    for pixel in image.pixels.chunks_exact(3) {
        sum.iter_mut().zip(pixel).for_each(|(s, p)| *s += f64::from(*p));
    }
    let count = (image.pixels.len() / 3) as f64;
    Image::filled(image.width, image.height, sum.map(|s| (s / count) as f32))
}

fn mean_color(scene: &Scene) -> [f32; 3] {
    let (mut sum, mut count) = ([0.0f64; 3], 0.0);
    for view in scene.training_views() {
        let View { image, inside, .. } = &scene.views[view];
        let counts = |i: usize| inside.as_ref().is_none_or(|inside| inside[i]);
        for (_, pixel) in image.pixels.chunks_exact(3).enumerate().filter(|(i, _)| counts(*i)) {
            sum.iter_mut().zip(pixel).for_each(|(s, p)| *s += f64::from(*p));
            count += 1.0;
        }
    }
    sum.map(|s| (s / count) as f32)
}
