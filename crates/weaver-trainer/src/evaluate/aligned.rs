//! Held-out views whose cameras were aligned with their photos.
//!
//! A model that predicts cameras explains photos in a frame of its own, where the data's camera for the held-out view is a little off; PSNR
//! punishes that more than blur. Alignment looks at the held-out photo: its figures stand beside the others, with what it gains where
//! the camera is right, which is six numbers fitted to the photo and nothing else.

use super::drawn::{Drawing, Drawn};
use crate::{CameraMode, Error};
use weaver_align::{Options, Outcome, Photo, Scene as AlignScene, align, mean_square};
use weaver_data::{Scene, Tuple, View};
use weaver_geometry::glam::DVec3;
use weaver_inference::Predictor;
use weaver_io::Image;
use weaver_splat::CpuRasterizer;

/// A held-out view from where it was aligned to.
pub(super) struct AlignedView {
    pub render: Image,
    /// How far its camera turned, degrees, and moved, in parts of the mean depth.
    pub moved: [f64; 2],
    /// Whether anything better than the guess was found.
    pub found: bool,
}

/// Aligns a view that was drawn with its photo.
pub(super) fn aligned(
    predictor: &dyn Predictor,
    drawn: &Drawn,
    view: &View,
    options: &Options,
) -> Result<AlignedView, Error> {
    let prediction = &drawn.prediction;
    // Opacities that depend on the view stay as they are at the guess.
    let seen = prediction.seen_by(&drawn.camera);
    let scene = AlignScene {
        gaussians: seen.as_slices(),
        background: predictor.background(),
        settings: predictor.raster_settings(),
        unit: unit(prediction.cameras.iter().map(|camera| camera.pose.center())),
    };
    let mask: Option<Vec<u8>> = view.inside.as_ref().map(|inside| inside.iter().map(|i| u8::from(*i)).collect());
    let photo = Photo { pixels: &view.image.pixels, mask: mask.as_deref(), camera: drawn.camera };
    let found = align(&CpuRasterizer, &scene, &[photo], options, mean_square);
    let found = found.map_err(|e| Error::Input(format!("{}: {e}", view.name)))?.remove(0);
    let pixels = found.image.iter().map(|x| x.clamp(0.0, 1.0)).collect();
    let render = Image { width: drawn.camera.width, height: drawn.camera.height, pixels };
    Ok(AlignedView { render, moved: found.moved, found: found.outcome == Outcome::Found })
}

/// A view aligned with a photo of another scene, which nothing in it shows.
pub(super) fn with_another_scenes_photo(
    predictor: &dyn Predictor,
    drawn: &Drawn,
    other: &View,
    options: &Options,
) -> Result<Image, Error> {
    let view = View { inside: None, ..other.clone() };
    Ok(aligned(predictor, drawn, &view, options)?.render)
}

/// The same view with given cameras: as it was drawn, and aligned, from where the data says that it was taken.
pub(super) fn control(
    drawing: &mut Drawing<'_>,
    scene: &Scene,
    tuple: &Tuple,
    options: &Options,
) -> Result<[Image; 2], Error> {
    let drawn = drawing.with(scene, tuple, CameraMode::Given)?;
    let aligned = aligned(drawing.predictor, &drawn, &scene.views[tuple.targets[0]], options)?;
    Ok([drawn.render, aligned.render])
}

/// The largest coordinate of a camera from the middle of all, which is 1 in 2Xplat's world.
fn unit(centers: impl Iterator<Item = DVec3> + Clone) -> f64 {
    let middle = centers.clone().sum::<DVec3>() / centers.clone().count().max(1) as f64;
    let largest = centers.map(|center| (center - middle).abs().max_element()).fold(0.0, f64::max);
    if largest > 0.0 { largest } else { 1.0 }
}
