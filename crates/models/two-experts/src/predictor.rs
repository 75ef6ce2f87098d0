//! 2Xplat with its weights.

use crate::{TwoExperts, TwoExpertsConfig};
use std::sync::Arc;
use weaver_autograd::Params;
use weaver_geometry::Camera;
use weaver_inference::{
    CameraSource, Checkpoint, Density, Error, GivenCameras, Joint, JointPrediction, Network, Photos, Prediction,
    Predictor, Pretrained, ViewOpacity, cameras_of, of_pixels, one_for_each,
};
use weaver_kernels::random::Stream;
use weaver_scene::ActivatedGaussians;
use weaver_splat::{RasterSettings, Renderer};

/// 2Xplat with its weights, ready to run without gradients.
///
/// The geometry expert runs with given cameras, too: what it says sets their scale where nothing else does. Photos come in multiples of the appearance expert's group, or one
/// alone.
#[derive(Debug)]
pub struct TwoExpertsPredictor(Pretrained<TwoExperts>);

impl Network for TwoExperts {
    const NAME: &'static str = TwoExpertsPredictor::ARCHITECTURE;
    type Config = TwoExpertsConfig;

    fn check(config: &TwoExpertsConfig) -> Result<(), String> {
        config.check()
    }

    fn declare(config: TwoExpertsConfig, params: &mut Params<f32>) -> Self {
        Self::declare(config, params)
    }
}

impl TwoExpertsPredictor {
    /// The name of this model in checkpoints.
    pub const ARCHITECTURE: &str = "two-experts";

    /// Pairs a model with weights.
    pub fn new(model: impl Into<Arc<TwoExperts>>, params: Params<f32>) -> Self {
        Self(Pretrained::new(model, params))
    }

    /// Builds the network that a checkpoint describes and fills in its averaged weights.
    ///
    /// # Errors
    /// When the checkpoint is of another model, or a tensor is missing, of another shape, or unknown.
    pub fn from_checkpoint(checkpoint: &Checkpoint) -> Result<Self, Error> {
        Pretrained::from_checkpoint(checkpoint).map(Self)
    }

    /// Photos that the networks take: of sides in multiples of both experts' patches, in whole groups.
    fn check(&self, photos: Photos<'_>, views: usize) -> Result<(), Error> {
        let config = self.0.network.config();
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

    /// The appearance expert's prediction from photos with these cameras, of the pixels that count.
    fn gaussians(&self, photos: Photos<'_>, cameras: &[Camera]) -> Prediction {
        let Photos { planes, height, width, .. } = photos;
        let all = self.0.tape.constant(planes, [photos.views(), 3, height, width]);
        let made = self.0.network.gaussians(self.0.context(), all, &self.0.camera_vars(cameras));
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

    /// Predicts from the first `context` photos, while the geometry expert sees all of them.
    fn run(
        &mut self,
        photos: Photos<'_>,
        context: usize,
        source: CameraSource<'_>,
        density: Density,
    ) -> Result<JointPrediction, Error> {
        self.density(density)?;
        self.check(photos, context)?;
        GivenCameras::check(source, context)?;
        self.0.tape.reset();
        let Photos { planes, height, width, .. } = photos;
        Ok(self.0.tape.without_gradient(|| {
            let all = self.0.tape.constant(planes, [1, photos.views(), 3, height, width]);
            let mut predicted = cameras_of(&self.0.network.cameras(self.0.context(), all).cameras, photos);
            let targets = predicted.split_off(context);
            let given = GivenCameras::of(source, &predicted);
            let scaled_by = given.as_ref().and_then(|given| given.scaled_by);
            let cameras = given.map_or_else(|| predicted.clone(), |given| given.cameras);
            let made = self.gaussians(photos.first(context), &cameras);
            JointPrediction { prediction: Prediction { cameras, predicted, scaled_by, ..made }, targets }
        }))
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
        Ok(self.run(photos, photos.views(), source, density)?.prediction)
    }

    fn joint(&mut self) -> Option<&mut dyn Joint> {
        Some(self)
    }

    fn image_size(&self) -> [usize; 2] {
        let config = self.0.network.config();
        [config.height, config.width]
    }

    fn raster_settings(&self) -> RasterSettings {
        self.0.network.config().raster.settings()
    }

    fn background(&self) -> [f32; 3] {
        self.0.network.config().raster.background.map(|c| c as f32)
    }

    fn renderer(&mut self) -> &mut Renderer {
        &mut self.0.renderer
    }
}

impl Joint for TwoExpertsPredictor {
    fn predict_jointly(
        &mut self,
        photos: Photos<'_>,
        context: usize,
        density: Density,
        _stream: Stream,
    ) -> Result<JointPrediction, Error> {
        self.run(photos, context, CameraSource::Predicted, density)
    }
}
