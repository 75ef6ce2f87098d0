//! The Gaussians of a whole capture: many photos with cameras, a few at a time.

use crate::predictor::inside_of;
use crate::{CameraSource, Density, Error, Photos, Predictor, planar};
use std::path::Path;
use weaver_data::capture::{self, CaptureOptions};
use weaver_data::{Layout, Scene, Tuple};
use weaver_geometry::{Camera, Similarity};
use weaver_kernels::random::Stream;
use weaver_scene::Gaussians;

/// Predicts the Gaussians of `views` of a scene, `context` at a time, with the scene's cameras and in its world.
///
/// Groups are a view and its nearest neighbors among those that are left. Where views see points of the scene, depth is
/// brought to these. The photos must have the predictor's size.
///
/// # Errors
/// When the predictor refuses photos, cameras or density.
pub fn predict_capture(
    predictor: &mut dyn Predictor,
    scene: &Scene,
    views: &[usize],
    context: usize,
    seed: u64,
) -> Result<Gaussians, Error> {
    let density = predictor.density(Density::default())?;
    let layout = Layout::of(scene);
    let mut left = views.to_vec();
    let mut all = Gaussians::default();
    while let Some(first) = left.first().copied() {
        let mut group = vec![first];
        group.extend(layout.nearest(first, &left, context.max(1) - 1));
        left.retain(|view| !group.contains(view));
        let stream = Stream::new(seed, first as u64, "inference.capture");
        append(&mut all, predict_group(predictor, scene, &group, density, stream)?);
    }
    Ok(all)
}

/// Photos that [`predict_photos`] gives to the network at once.
const AT_ONCE: usize = 4;

/// Predicts the Gaussians of the training photos of a capture, or of `most` of them, evenly spread; the photos are read
/// at the predictor's size, whatever the options say.
///
/// # Errors
/// When the capture cannot be read, or the predictor refuses it.
pub fn predict_photos(
    predictor: &mut dyn Predictor,
    capture: &Path,
    options: &CaptureOptions,
    most: Option<usize>,
    seed: u64,
) -> Result<Gaussians, Error> {
    let [height, width] = predictor.image_size();
    let scene = capture::load(capture, &CaptureOptions { width, height, ..*options })?;
    let mut views = scene.training_views();
    if let Some(most) = most {
        views = weaver_data::uniform(views.len(), most.min(views.len())).into_iter().map(|i| views[i]).collect();
    }
    predict_capture(predictor, &scene, &views, AT_ONCE, seed)
}

/// Predicts the Gaussians of a few views of a scene together, with the scene's cameras and in its world.
///
/// Where the density gives one Gaussian to each pixel, they come in the order of views, rows and columns. Depth is
/// brought to points where views see some. The photos must have the predictor's size.
///
/// # Errors
/// No views, and when the predictor refuses photos, cameras or density.
pub fn predict_group(
    predictor: &mut dyn Predictor,
    scene: &Scene,
    group: &[usize],
    density: Density,
    stream: Stream,
) -> Result<Gaussians, Error> {
    let [height, width] = predictor.image_size();
    let planes = planar(group.iter().map(|v| &scene.views[*v].image));
    let inside = inside_of(group.iter().map(|v| scene.views[*v].inside.as_deref()), height * width);
    let tuple = Tuple { scene: 0, context: group.to_vec(), targets: Vec::new() };
    let Some(first) = group.first() else { return Err(Error::Input("expected views, found none".into())) };
    let origin = scene.views[*first].camera.pose;
    // Without points or a stated scale nothing says how large the scene is; the predictor then chooses the factor.
    let known = scene.normalized(&tuple).ok().map(|posed| posed.scale);
    let scale = known.unwrap_or(1.0);
    let camera = |v: &usize| {
        let camera = scene.views[*v].camera;
        Camera { pose: camera.pose.relative_to(&origin).scaled(scale), ..camera }
    };
    let cameras: Vec<Camera> = tuple.context.iter().map(camera).collect();
    let points = scene.points_seen(&tuple.context, scale);
    let source = match known {
        Some(_) if !points.positions.is_empty() => CameraSource::GivenWithPoints { cameras: &cameras, points: &points },
        Some(_) => CameraSource::Given(&cameras),
        None => CameraSource::GivenUnscaled(&cameras),
    };
    let prediction = predictor.predict(
        Photos { planes: &planes, inside: inside.as_deref(), height, width },
        source,
        density,
        stream,
    )?;
    let scale = 1.0 / (scale * prediction.scaled_by.unwrap_or(1.0));
    let to_world = Similarity { scale, rotation: origin.rotation.transpose(), translation: origin.center() };
    Ok(prediction.gaussians.to_stored().transformed(&to_world))
}

fn append(all: &mut Gaussians, mut more: Gaussians) {
    all.degree = more.degree;
    all.means.append(&mut more.means);
    all.log_scales.append(&mut more.log_scales);
    all.quats.append(&mut more.quats);
    all.opacity_logits.append(&mut more.opacity_logits);
    all.sh.append(&mut more.sh);
}
