//! Sample pictures: what the model makes of some context views, side by side.

use crate::evaluate::Options;
use crate::{Error, Example};
use std::path::Path;
use weaver_data::{Scene, evaluation_tuples};
use weaver_inference::Predictor;
use weaver_inference::pictures::{row, stack};
use weaver_io::Image;
use weaver_kernels::random::Stream;

/// Scenes that a picture shows.
const SHOWN: usize = 3;

/// Writes one picture of a few scenes: each row input, render, depth and Gaussians per pixel of a context view.
///
/// # Errors
/// When the picture cannot be written.
pub fn write(predictor: &mut dyn Predictor, options: &Options, scenes: &[Scene], path: &Path) -> Result<(), Error> {
    let mut rows = Vec::new();
    for (index, scene) in scenes.iter().enumerate().take(SHOWN) {
        let Some(tuple) = evaluation_tuples(scene, index, options.context_views).into_iter().next() else {
            continue;
        };
        let (example, measured) = Example::for_evaluation(scene, tuple)?;
        let points = options.points.then(|| example.points(scene)).flatten();
        let source = example.camera_source(options.cameras, measured, points.as_ref());
        let stream = Stream::new(options.seed, index as u64, "samples");
        let prediction = predictor.predict(example.context_photos(), source, options.density, stream)?;
        let renders = predictor.render(&prediction.gaussians, &prediction.cameras)?;
        let first = &scene.views[example.tuple.context[0]].image;
        rows.extend(renders.first().map(|render| row(first, render, &prediction, 0)));
    }
    let rows: Vec<&Image> = rows.iter().collect();
    stack(&rows).write_png(path)?;
    Ok(())
}
