//! A trained model at work: photos to cameras and Gaussians, and Gaussians to pictures.

use weaver_autograd::{Params, Tape};
use weaver_geometry::Camera;
use weaver_geometry::glam::DVec3;
use weaver_io::Image;
use weaver_kernels::random::Stream;
use weaver_model::SplatWeaver;
use weaver_nn::Context;
use weaver_pose::Cameras as CameraVars;
use weaver_router::Allocation;
use weaver_scene::{ActivatedGaussians, CameraRows, CameraSlices};
use weaver_splat::{Images, RasterError, RasterSettings, Workspace};

/// What the model makes of some photos.
#[derive(Clone, Debug, Default)]
pub struct Prediction {
    /// The Gaussians, in the frame of camera 0.
    pub splats: ActivatedGaussians,
    /// The cameras that the Gaussians were built with: the network's, or the given ones.
    pub cameras: Vec<Camera>,
    /// The network's own cameras.
    pub predicted: Vec<Camera>,
    /// Depth `[V, H, W]`.
    pub depth: Vec<f32>,
    /// Gaussians of each pixel `[V, H, W]`.
    pub experts: Vec<u8>,
    /// What given cameras were scaled by, if their scale was unknown.
    pub scaled_by: Option<f64>,
}

impl Prediction {
    /// The factor that gives cameras in units of their own the predicted cameras' mean distance to camera 0.
    pub fn scale_to_predicted(&self, cameras: &[Camera]) -> f64 {
        self.scaled_by.unwrap_or_else(|| spread_ratio(&self.predicted, cameras))
    }
}

/// Whose cameras the Gaussians are built with.
#[derive(Clone, Copy, Debug)]
pub enum CameraSource<'a> {
    /// The network's own.
    Predicted,
    /// These, in the frame of camera 0 and in training units.
    Given(&'a [Camera]),
    /// These, in the frame of camera 0, in units of their own: they are scaled so that the mean distance of the centers
    /// to camera 0 equals that of the predicted ones.
    GivenUnscaled(&'a [Camera]),
}

/// A model with its weights, ready to run without gradients.
#[derive(Debug)]
pub struct Predictor<'m> {
    model: &'m SplatWeaver,
    params: &'m Params<f32>,
    tape: Tape<f32>,
    workspace: Workspace<f32>,
}

impl<'m> Predictor<'m> {
    /// Pairs a model with weights.
    pub fn new(model: &'m SplatWeaver, params: &'m Params<f32>) -> Self {
        Self { model, params, tape: Tape::new(), workspace: Workspace::new() }
    }

    /// Calls `watcher` with the path of each part of the model that is done.
    pub fn watch(&self, watcher: impl Fn(&str) + Send + 'static) {
        self.tape.watch(watcher);
    }

    /// Runs the model on photos `[V, 3, H, W]` of the configured size.
    pub fn predict(
        &mut self,
        images: &[f32],
        source: CameraSource<'_>,
        allocation: &dyn Allocation<f32>,
        stream: Stream,
    ) -> Prediction {
        let config = self.model.config();
        self.predict_at(images, [config.height, config.width], source, allocation, stream)
    }

    /// The same for photos of another size (H, W), multiples of the patch.
    pub fn predict_at(
        &mut self,
        images: &[f32],
        [height, width]: [usize; 2],
        source: CameraSource<'_>,
        allocation: &dyn Allocation<f32>,
        stream: Stream,
    ) -> Prediction {
        self.tape.reset();
        let config = self.model.config();
        let views = images.len() / (3 * width * height);
        let cx = Context::new(&self.tape, self.params);
        self.tape.without_gradient(|| {
            let photos = self.tape.constant(images, [views, 3, height, width]);
            let encoded = self.model.encode(cx, photos.reshape([1, views, 3, height, width]));
            let read = |cameras: &CameraVars<'_, f32>| {
                let (viewmats, intrinsics) = (&cameras.w2c.value(), &cameras.intrinsics.value());
                CameraSlices { viewmats, intrinsics, background: &[], width, height }.to_cameras()
            };
            let predicted = read(&encoded.cameras);
            let (given, scaled_by) = match source {
                CameraSource::Predicted => (None, None),
                CameraSource::Given(cameras) => (Some(cameras.to_vec()), None),
                CameraSource::GivenUnscaled(cameras) => {
                    let factor = spread_ratio(&predicted, cameras);
                    (Some(cameras.iter().map(|c| Camera { pose: c.pose.scaled(factor), ..*c }).collect()), Some(factor))
                }
            };
            let vars = match &given {
                Some(cameras) => {
                    let rows = CameraRows::new(cameras);
                    CameraVars {
                        w2c: self.tape.constant(&rows.viewmats, [views, 3, 4]),
                        intrinsics: self.tape.constant(&rows.intrinsics, [views, 4]),
                    }
                }
                None => encoded.scene_cameras(0),
            };
            let dense = self.model.dense(cx, &encoded, 0, photos);
            let made = self.model.gaussians(cx, &dense, photos, &vars, allocation, stream);
            let g = &made.gaussians;
            Prediction {
                splats: ActivatedGaussians {
                    means: g.means.to_vec(),
                    scales: g.scales.to_vec(),
                    quats: g.quats.to_vec(),
                    opacities: g.opacities.to_vec(),
                    sh: g.colors.to_vec(),
                    degree: config.gaussians.sh_degree,
                },
                cameras: given.unwrap_or_else(|| predicted.clone()),
                predicted,
                depth: dense.depth.to_vec(),
                experts: made.assignment.expert.to_vec(),
                scaled_by,
            }
        })
    }

    /// Gives back the memory that the last prediction was made in.
    pub fn release(&mut self) {
        self.tape.reset();
        self.tape.pool().trim::<f32>();
    }

    /// Renders Gaussians with the model's settings; one image per camera, all of one size.
    ///
    /// # Errors
    /// When sizes do not fit or there are too many Gaussians for one call.
    pub fn render(&mut self, splats: &ActivatedGaussians, cameras: &[Camera]) -> Result<Vec<Image>, RasterError> {
        let raster = &self.model.config().raster;
        let settings = RasterSettings { near: raster.near, alpha_max: raster.alpha_max, ..RasterSettings::default() };
        render(splats, cameras, raster.background.map(|c| c as f32), &settings, &mut self.workspace)
    }
}

/// Renders Gaussians; one image per camera, all of one size.
///
/// # Errors
/// When sizes do not fit or there are too many Gaussians for one call.
pub fn render(
    splats: &ActivatedGaussians,
    cameras: &[Camera],
    background: [f32; 3],
    settings: &RasterSettings,
    workspace: &mut Workspace<f32>,
) -> Result<Vec<Image>, RasterError> {
    let Some(first) = cameras.first() else { return Ok(Vec::new()) };
    let (width, height, pixels) = (first.width, first.height, first.width * first.height);
    let mut image = vec![0.0; 3 * pixels * cameras.len()];
    let mut alpha = vec![0.0; pixels * cameras.len()];
    let images = Images { image: &mut image, alpha: &mut alpha, depth: None, features: None };
    weaver_splat::rasterize(
        &splats.as_slices(),
        &CameraRows::new(cameras).as_slices(&background),
        settings,
        workspace,
        images,
    )?;
    Ok(image
        .chunks(3 * pixels)
        .map(|view| Image { width, height, pixels: view.iter().map(|x| x.clamp(0.0, 1.0)).collect() })
        .collect())
}

/// Mean distance of the centers to camera 0: predicted over given. 1 where either stands still.
fn spread_ratio(predicted: &[Camera], given: &[Camera]) -> f64 {
    let spread = |cameras: &[Camera]| -> f64 {
        let origin = cameras.first().map_or(DVec3::ZERO, |c| c.pose.center());
        cameras.iter().map(|c| c.pose.center().distance(origin)).sum()
    };
    let ratio = spread(predicted) / spread(given);
    if ratio.is_finite() && ratio > 0.0 { ratio } else { 1.0 }
}
