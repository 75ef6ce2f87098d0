//! Sample pictures: the model's results for some context views, side by side.

use crate::evaluate::Options;
use crate::{Error, Example};
use std::path::Path;
use weaver_data::{Scene, evaluation_tuples};
use weaver_inference::pictures::{camera_plan, depth_picture, row, side_by_side, stack};
use weaver_inference::{CameraSource, Look, Photos, Prediction, Predictor};
use weaver_io::Image;
use weaver_kernels::random::Stream;

/// Scenes that a picture shows.
const SHOWN: usize = 3;

/// Writes one picture of a few scenes. Each row is input, render and depth of a context view, and the Gaussians per
/// pixel; where a model makes one for each pixel, a plan of its predicted cameras instead ([`camera_plan`]). For models
/// with light, a second row shows the view in the light of two photos: photo, render, render, photo.
///
/// # Errors
/// When the picture cannot be written.
pub fn write(predictor: &mut dyn Predictor, options: &Options, scenes: &[Scene], path: &Path) -> Result<(), Error> {
    let mut rows = Vec::new();
    for (index, scene) in scenes.iter().enumerate().take(SHOWN) {
        let varied = options.planted.as_ref().map(|planted| planted.of_scene(scene, index));
        let scene = varied.as_ref().unwrap_or(scene);
        let Some(tuple) = evaluation_tuples(scene, index, options.context_views).into_iter().next() else {
            continue;
        };
        let (example, measured) = Example::for_evaluation(scene, tuple)?;
        let asked = options.points || predictor.needs_points();
        let points = asked.then(|| example.points(scene)).flatten();
        let source = example.camera_source(options.cameras, measured, points.as_ref());
        let stream = Stream::new(options.seed, index as u64, "samples");
        let prediction = predictor.predict(example.context_photos(), source, options.density, stream)?;
        let renders = predictor.render(&prediction, &prediction.cameras)?;
        let first = &scene.views[example.tuple.context[0]].image;
        let one_each = predictor.max_per_pixel() == 1 && prediction.predicted.len() > 1;
        rows.extend(renders.first().map(|render| match one_each {
            true => with_cameras(first, render, &prediction, &example),
            false => row(first, render, &prediction, 0),
        }));
        if predictor.lights().is_some() {
            rows.push(in_two_lights(predictor, scene, &example, source, stream)?);
        }
    }
    let rows: Vec<&Image> = rows.iter().collect();
    stack(&rows).write_png(path)?;
    Ok(())
}

/// Input, render, depth and cameras.
fn with_cameras(input: &Image, render: &Image, prediction: &Prediction, example: &Example) -> Image {
    let three = side_by_side(&[input, render, &depth_picture(prediction, 0, input)]);
    let plan = camera_plan(&prediction.predicted, example.context(), input);
    Image::mosaic(&[&three, &plan])
}

/// The first context view in the light of its own photo and in the light of the held-out photo, between these two
/// photos.
fn in_two_lights(
    predictor: &mut dyn Predictor,
    scene: &Scene,
    example: &Example,
    cameras: CameraSource<'_>,
    stream: Stream,
) -> Result<Image, Error> {
    let [own, other] = [example.tuple.context[0], example.tuple.targets[0]].map(|view| &scene.views[view].image);
    let pixels = 3 * own.width * own.height;
    let of = |first: usize| Photos { planes: &example.images[first..first + pixels], ..example.photos().first(1) };
    let looks = [Look::Of(of(0)), Look::Of(of(example.tuple.context.len() * pixels))];
    let made = predictor.as_lights()?.predict_looks(example.context_photos(), cameras, &looks, stream)?;
    let mut prediction = made.prediction;
    let mut renders = Vec::new();
    for sh in made.colors {
        prediction.gaussians.sh = sh;
        renders.extend(predictor.render(&prediction, &prediction.cameras[..1])?);
    }
    Ok(side_by_side(&[own, &renders[0], &renders[1], other]))
}
