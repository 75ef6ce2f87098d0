//! Held-out views whose cameras were aligned with their photos.
//!
//! A model that predicts cameras explains photos in a frame of its own, where the data's camera for the held-out view
//! is a little off; PSNR punishes that more than blur. Alignment looks at the held-out photo: its figures stand beside
//! the others, with its gain for correct cameras, which comes from six numbers fitted to the photo and nothing else.

use super::drawn::{Drawing, Drawn};
use crate::figures::CameraFigures;
use crate::{CameraMode, Error};
use std::sync::Arc;
use weaver_data::{Scene, Tuple, View};
use weaver_fit::align::{AlignLoss, Aligned, Options, Outcome, Photo, Scene as AlignScene, align, unit};
use weaver_geometry::{Camera, Pose};
use weaver_inference::{Predictor, ViewOpacityRasterizer};
use weaver_io::Image;
use weaver_pose::PoseErrors;

/// Alignment of held-out cameras.
#[derive(Clone, Copy, Debug)]
pub struct Alignment {
    /// Options of the descent.
    pub options: Options,
    /// The loss of the descent.
    pub loss: AlignLoss,
}

/// A held-out view from its aligned camera.
pub(super) struct AlignedView {
    pub render: Image,
    pub camera: Camera,
    /// Steps of the descent.
    pub steps: usize,
    /// Movement of its camera, degrees, and in parts of the mean depth.
    pub moved: [f64; 2],
    /// True if anything better than the guess was found.
    pub found: bool,
}

/// Aligns a view that was drawn with its photo.
pub(super) fn aligned(
    predictor: &mut dyn Predictor,
    drawn: &Drawn,
    view: &View,
    alignment: &Alignment,
) -> Result<AlignedView, Error> {
    let prediction = &drawn.prediction;
    let opacity = prediction.view_opacity.clone().map(Arc::new);
    let rasterizer = ViewOpacityRasterizer { rasterizer: predictor.renderer().rasterizer().clone(), opacity };
    let scene = AlignScene {
        gaussians: prediction.gaussians.as_slices(),
        background: predictor.background(),
        settings: predictor.raster_settings(),
        unit: unit(prediction.cameras.iter().map(|camera| camera.pose.center())),
    };
    let photo = Photo { pixels: &view.image.pixels, mask: view.inside.as_deref(), camera: drawn.camera };
    let found = align(&rasterizer, &scene, &[photo], &alignment.options, alignment.loss.function());
    let found = found.map_err(|e| Error::Input(format!("{}: {e}", view.name)))?.remove(0);
    let steps = found.losses.len().saturating_sub(1);
    let pixels = found.image.iter().map(|x| x.clamp(0.0, 1.0)).collect();
    let render = Image { width: drawn.camera.width, height: drawn.camera.height, pixels };
    let Aligned { camera, moved, outcome, .. } = found;
    Ok(AlignedView { render, camera, steps, moved, found: outcome == Outcome::Found })
}

/// Error of a held-out camera relative to each camera that the Gaussians were made with, against the data's.
pub(super) fn off(drawn: &Drawn, camera: &Camera, scene: &Scene, tuple: &Tuple) -> CameraFigures {
    let truth = |view: usize| scene.views[view].camera.pose;
    let target = truth(tuple.targets[0]);
    let mut all = PoseErrors { rotation: Vec::new(), translation: Vec::new() };
    for (seen_from, view) in drawn.prediction.cameras.iter().zip(&tuple.context) {
        let found: [Pose; 2] = [seen_from.pose, camera.pose];
        let PoseErrors { rotation, translation } = PoseErrors::between(&found, &[truth(*view), target]);
        all.rotation.extend(rotation);
        all.translation.extend(translation);
    }
    CameraFigures::of(&all)
}

/// A view aligned with a photo of another scene.
pub(super) fn with_another_scenes_photo(
    predictor: &mut dyn Predictor,
    drawn: &Drawn,
    other: &View,
    alignment: &Alignment,
) -> Result<Image, Error> {
    let view = View { inside: None, ..other.clone() };
    Ok(aligned(predictor, drawn, &view, alignment)?.render)
}

/// The same view with given cameras, from the data's held-out camera: as drawn, and aligned.
pub(super) fn control(
    drawing: &mut Drawing<'_>,
    scene: &Scene,
    tuple: &Tuple,
    alignment: &Alignment,
) -> Result<[Image; 2], Error> {
    let drawn = drawing.with(scene, tuple, CameraMode::Given)?;
    let aligned = aligned(drawing.predictor, &drawn, &scene.views[tuple.targets[0]], alignment)?;
    Ok([drawn.render, aligned.render])
}
