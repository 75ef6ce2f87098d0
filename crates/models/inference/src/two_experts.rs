//! 2Xplat with its weights.

use crate::given_cameras::{self, GivenCameras};
use crate::pixel_aligned::{of_pixels, one_for_each};
use crate::{
    CameraSource, Checkpoint, Density, Error, JointPrediction, Photos, Prediction, Predictor, ViewOpacity, WeightSet,
};
use std::sync::Arc;
use weaver_autograd::{Params, Tape};
use weaver_geometry::Camera;
use weaver_kernels::random::Stream;
use weaver_model::{TwoExperts, TwoExpertsConfig};
use weaver_nn::Context;
use weaver_pose::CameraVars;
use weaver_scene::{ActivatedGaussians, CameraRows, CameraSlices, Model};
use weaver_splat::{RasterSettings, Renderer};

/// 2Xplat with its weights, ready to run without gradients.
///
/// The geometry expert runs with given cameras, too: what it says sets their scale where nothing else does. Photos come in multiples of the appearance expert's group, or one
/// alone.
#[derive(Debug)]
pub struct TwoExpertsPredictor {
    model: Arc<TwoExperts>,
    params: Params<f32>,
    tape: Tape<f32>,
    renderer: Renderer,
}

impl TwoExpertsPredictor {
    /// The name of this model in checkpoints.
    pub const ARCHITECTURE: &str = "two-experts";

    /// Pairs a model with weights.
    pub fn new(model: impl Into<Arc<TwoExperts>>, params: Params<f32>) -> Self {
        Self { model: model.into(), params, tape: Tape::new(), renderer: Renderer::default() }
    }

    /// Builds the network that a checkpoint describes and fills in its averaged weights.
    ///
    /// # Errors
    /// When the checkpoint is of another model, or a tensor is missing, of another shape, or unknown.
    pub fn from_checkpoint(checkpoint: &Checkpoint) -> Result<Self, Error> {
        let config: TwoExpertsConfig = checkpoint.model_config(Self::ARCHITECTURE)?;
        config.check().map_err(|message| checkpoint.wrong(message))?;
        let mut params = Params::new();
        let model = TwoExperts::declare(config, &mut params);
        checkpoint.fill(&mut params, WeightSet::Averaged)?;
        Ok(Self::new(model, params))
    }

    /// Photos that the networks take: of sides in multiples of both experts' patches, in whole groups.
    fn check(&self, photos: Photos<'_>, views: usize) -> Result<(), Error> {
        let config = self.model.config();
        let (side, group) = (4 * config.appearance.patch, config.appearance.group);
        for patch in [config.geometry.patch, side] {
            if !photos.height.is_multiple_of(patch) || !photos.width.is_multiple_of(patch) {
                let found = format!("{}x{}", photos.width, photos.height);
                return Err(Error::Input(format!(
                    "expected photos whose sides are multiples of {patch}, found {found}"
                )));
            }
        }
        if views == 0 || views > 1 && !views.is_multiple_of(group) {
            return Err(Error::Input(format!("expected photos in multiples of {group}, or one alone, found {views}")));
        }
        Ok(())
    }

    /// Cameras that the geometry expert says, of photos `[N, 3, H, W]`.
    fn predicted(&self, photos: Photos<'_>) -> Vec<Camera> {
        let Photos { planes, height, width, .. } = photos;
        let views = photos.views();
        let all = self.tape.constant(planes, [1, views, 3, height, width]);
        let CameraVars { viewmats, intrinsics } =
            self.model.cameras(Context::new(&self.tape, &self.params), all).cameras;
        let (viewmats, intrinsics) = (&viewmats.value(), &intrinsics.value());
        CameraSlices { viewmats, intrinsics, background: &[], width, height, model: Model::Pinhole }.to_cameras()
    }

    /// What the appearance expert makes of photos with these cameras, of the pixels that count.
    fn gaussians(&self, photos: Photos<'_>, cameras: &[Camera]) -> Prediction {
        let Photos { planes, height, width, .. } = photos;
        let (views, rows) = (photos.views(), CameraRows::new(cameras));
        let vars = CameraVars {
            viewmats: self.tape.constant(&rows.viewmats, [views, 3, 4]),
            intrinsics: self.tape.constant(&rows.intrinsics, [views, 4]),
        };
        let all = self.tape.constant(planes, [views, 3, height, width]);
        let made = self.model.gaussians(Context::new(&self.tape, &self.params), all, &vars);
        let g = made.gaussians;
        let [means, scales, quats, opacities, sh] =
            [g.means, g.scales, g.quats, g.opacities, g.colors].map(|x| x.to_vec());
        let degree = g.colors.shape()[1].isqrt() - 1;
        let plain = ActivatedGaussians { means, scales, quats, opacities, sh, degree };
        let mut prediction = one_for_each(plain, made.depth.to_vec(), photos.inside);
        if made.opacities.depend_on_view() {
            let all = made.opacities.numbers.to_vec();
            let harmonics = match photos.inside {
                Some(inside) => of_pixels(&all, inside),
                None => all,
            };
            let opacity = ViewOpacity { harmonics };
            prediction.gaussians.opacities = opacity.over(&prediction.gaussians.means, cameras);
            prediction.view_opacity = Some(opacity);
        }
        prediction
    }

    /// A prediction with its cameras.
    fn prediction(
        &self,
        photos: Photos<'_>,
        cameras: Vec<Camera>,
        predicted: Vec<Camera>,
        scaled_by: Option<f64>,
    ) -> Prediction {
        let made = self.gaussians(photos, &cameras);
        Prediction { cameras, predicted, scaled_by, ..made }
    }
}

impl Predictor for TwoExpertsPredictor {
    fn predict(
        &mut self,
        photos: Photos<'_>,
        source: CameraSource<'_>,
        density: Density,
        _stream: Stream,
    ) -> Result<Prediction, Error> {
        self.density(density)?;
        let views = photos.views();
        self.check(photos, views)?;
        given_cameras::check(source, views)?;
        self.tape.reset();
        Ok(self.tape.without_gradient(|| {
            let predicted = self.predicted(photos);
            let given = GivenCameras::of(source, &predicted);
            let scaled_by = given.as_ref().and_then(|given| given.scaled_by);
            let cameras = given.map_or_else(|| predicted.clone(), |given| given.cameras);
            self.prediction(photos, cameras, predicted, scaled_by)
        }))
    }

    fn predict_jointly(
        &mut self,
        photos: Photos<'_>,
        context: usize,
        density: Density,
        _stream: Stream,
    ) -> Result<JointPrediction, Error> {
        self.density(density)?;
        self.check(photos, context)?;
        self.tape.reset();
        Ok(self.tape.without_gradient(|| {
            let mut cameras = self.predicted(photos);
            let targets = cameras.split_off(context);
            let prediction = self.prediction(photos.first(context), cameras.clone(), cameras, None);
            JointPrediction { prediction, targets }
        }))
    }

    fn image_size(&self) -> [usize; 2] {
        let config = self.model.config();
        [config.height, config.width]
    }

    fn raster_settings(&self) -> RasterSettings {
        self.model.config().raster.settings()
    }

    fn background(&self) -> [f32; 3] {
        self.model.config().raster.background.map(|c| c as f32)
    }

    fn renderer(&mut self) -> &mut Renderer {
        &mut self.renderer
    }
}
