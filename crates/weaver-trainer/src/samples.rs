//! Sample pictures: what the model makes of some context views, side by side.

use crate::batch::Batch;
use crate::predictor::{CameraSource, Prediction, Predictor};
use crate::{Cameras, Config, Error, evaluate};
use std::path::Path;
use weaver_autograd::Params;
use weaver_data::{Scene, evaluation_tuples};
use weaver_io::{Image, false_color};
use weaver_kernels::random::Stream;
use weaver_model::SplatWeaver;

/// Least width of one image in a picture, pixels.
const SEEN: usize = 256;
/// Scenes that a picture shows.
const SHOWN: usize = 3;

/// Writes one picture of a few scenes: each row input, render, depth and expert map of a context view.
///
/// # Errors
/// When the picture cannot be written.
pub fn write(
    model: &SplatWeaver,
    params: &Params<f32>,
    config: &Config,
    scenes: &[Scene],
    path: &Path,
) -> Result<(), Error> {
    let mut predictor = Predictor::new(model, params);
    let kind = evaluate::parse_allocation(&config.evaluation.allocation)?;
    let allocation = kind
        .allocation::<f32>(config.evaluation.budget, config.model.gaussians.experts + 1)
        .map_err(|e| Error::Usage(e.to_string()))?;
    let mut rows = Vec::new();
    for (index, scene) in scenes.iter().enumerate().take(SHOWN) {
        let Some(tuple) = evaluation_tuples(scene, index, config.data.context_views).into_iter().next() else {
            continue;
        };
        let (batch, measured) = Batch::for_evaluation(scene, tuple)?;
        let source = match (config.evaluation.cameras, measured) {
            (Cameras::Predicted, _) => CameraSource::Predicted,
            (Cameras::Given, true) => CameraSource::Given(batch.context()),
            (Cameras::Given, false) => CameraSource::GivenUnscaled(batch.context()),
        };
        let stream = Stream::new(config.seed, index as u64, "samples");
        let prediction = predictor.predict(batch.context_images(), source, &*allocation, stream);
        let renders =
            predictor.render(&prediction.splats, &prediction.cameras).map_err(|e| Error::Usage(e.to_string()))?;
        let inputs = batch.tuple.context.iter().map(|&v| &scene.views[v].image);
        for (v, (input, render)) in inputs.zip(renders).enumerate().take(1) {
            rows.push(row(input, &render, &prediction, v));
        }
    }
    let rows: Vec<&Image> = rows.iter().collect();
    stack(&rows).write_png(path)?;
    Ok(())
}

/// Input, render, depth and expert map of view `v`, side by side, enlarged until they can be seen.
pub fn row(input: &Image, render: &Image, prediction: &Prediction, v: usize) -> Image {
    let (depth, experts) = (depth_picture(prediction, v, input), expert_picture(prediction, v, input));
    let times = SEEN.div_ceil(input.width.max(1));
    let large = [input, render, &depth, &experts].map(|image| enlarged(image, times));
    Image::mosaic(&large.each_ref())
}

/// Each pixel as a square of `times` x `times`.
fn enlarged(image: &Image, times: usize) -> Image {
    let (width, height) = (image.width * times, image.height * times);
    let at = |i: usize| ((i / width / times) * image.width + i % width / times) * 3;
    let pixels = (0..width * height).flat_map(|i| image.pixels[at(i)..at(i) + 3].iter().copied()).collect();
    Image { width, height, pixels }
}

/// The depth of view `v` on a logarithmic scale, bright is near.
pub fn depth_picture(prediction: &Prediction, v: usize, like: &Image) -> Image {
    let pixels = like.width * like.height;
    let nearness: Vec<f32> = prediction.depth[v * pixels..][..pixels].iter().map(|d| -d.max(1e-6).ln()).collect();
    let (low, high) = nearness.iter().fold((f32::MAX, f32::MIN), |(a, b), x| (a.min(*x), b.max(*x)));
    false_color(&nearness, like.width, like.height, low, high)
}

/// How many Gaussians each pixel of view `v` got: black is none, the brighter the more.
pub fn expert_picture(prediction: &Prediction, v: usize, like: &Image) -> Image {
    let pixels = like.width * like.height;
    let most = prediction.experts.iter().copied().max().unwrap_or(1).max(1);
    let gray = |e: &u8| [f32::from(*e) / f32::from(most); 3];
    let pixels = prediction.experts[v * pixels..][..pixels].iter().flat_map(gray).collect();
    Image { width: like.width, height: like.height, pixels }
}

/// Images of one width, one below the other.
pub fn stack(rows: &[&Image]) -> Image {
    let width = rows.first().map_or(0, |r| r.width);
    let height = rows.iter().map(|r| r.height).sum();
    Image { width, height, pixels: rows.iter().flat_map(|r| r.pixels.iter().copied()).collect() }
}
