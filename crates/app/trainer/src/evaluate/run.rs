//! An evaluation, scene by scene and view by view.

use super::align::{self, AlignedView};
use super::drawn::{Drawing, Drawn, Remark};
use super::light::{self, Recovery};
use super::{LEAST_SIDE, Options, Targets};
use crate::figures::{AlignedFigures, CameraFigures, Evaluation, SceneFigures, areas};
use crate::{CameraMode, Error};
use std::borrow::Borrow;
use std::collections::BTreeMap;
use weaver_autograd::Pool;
use weaver_data::{Scene, Tuple, View, evaluation_tuples};
use weaver_inference::{Predictor, planar};
use weaver_io::Image;
use weaver_losses::Lpips;
use weaver_losses::metrics::{self, PerceptualDistance};
use weaver_pose::PoseErrors;
use weaver_wavelet::{EnergyMap, Wavelet};

/// Evaluates a predictor on loaded scenes; `progress` receives the numbers of views done and of all views.
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
    // The rest has one type of scenes, so that it is compiled here and not in each calling crate.
    run(predictor, &scenes.iter().map(Borrow::borrow).collect::<Vec<_>>(), options, lpips, progress)
}

fn run(
    predictor: &mut dyn Predictor,
    plain: &[&Scene],
    options: &Options,
    lpips: Option<&Lpips<f32>>,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Evaluation, Error> {
    let Options { context_views: context, cameras, targets, seed, step, .. } = *options;
    let points = options.points || cameras == CameraMode::Given && predictor.needs_points();
    let options = &Options { points, ..options.clone() };
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
    let varied: Option<Vec<Scene>> = options
        .planted
        .as_ref()
        .map(|looks| plain.iter().enumerate().map(|(number, scene)| looks.of_scene(scene, number)).collect());
    let scenes: Vec<&Scene> = varied.as_ref().map_or_else(|| plain.to_vec(), |varied| varied.iter().collect());
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
            let target = &light::judged(scene, &tuple, options);
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
                figures.look = Some(light::figures(&drawn.render, target));
                if let Some(planted) = &options.planted {
                    let (photos, renders) = drawing.in_two_lights(planted, plain[index], scene, index, &tuple)?;
                    recovery.add(photos.each_ref(), renders.each_ref(), target);
                }
            }
            if let Some(align) = &options.align {
                let found = align::aligned(drawing.predictor, &drawn, target, align)?;
                let [before, after] =
                    align::control(&mut drawing, scene, &tuple, align)?.map(|i| measure.psnr(&i, target));
                let cameras = [&drawn.camera, &found.camera].map(|camera| align::off(&drawn, camera, scene, &tuple));
                let mut of_view = measure.aligned(&found, target, cameras, figures.psnr);
                of_view.gain_given = after - before;
                // Once for each scene: alignment with an unrelated photo.
                let next = scenes[(index + 1) % scenes.len()];
                if let (true, Some(other)) = (views.is_empty() && scenes.len() > 1, next.held_out_views().first()) {
                    let other = &next.views[*other];
                    let shown = align::with_another_scenes_photo(drawing.predictor, &drawn, other, align)?;
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
    // Remarks of loading may name photos that are not judged.
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

/// Each of these tuples once for each view of its context, with that view as the target.
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
            None => Some(network.between(&shown, &truth, size)),
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
