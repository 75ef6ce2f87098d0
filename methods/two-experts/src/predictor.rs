//! 2Xplat with its weights.

use crate::{TwoExperts, TwoExpertsConfig};
use weaver_autograd::Params;
use weaver_geometry::Camera;
use weaver_inference::{
    CameraSource, Error, GivenCameras, JointPrediction, Network, Photos, Prediction, Pretrained, SceneNetwork,
    ViewOpacity, cameras_of, of_pixels, one_for_each,
};
use weaver_model::RasterConfig;
use weaver_scene::ActivatedGaussians;

/// 2Xplat with its weights, ready to run without gradients.
///
/// The geometry expert runs with given cameras, too: its estimate sets their scale when nothing else fixes it. The
/// number of photos is one, or a multiple of the appearance expert's group.
pub type TwoExpertsPredictor = Pretrained<TwoExperts>;

impl Network for TwoExperts {
    const NAME: &'static str = "two-experts";
    type Config = TwoExpertsConfig;

    fn check(config: &TwoExpertsConfig) -> Result<(), String> {
        config.check()
    }

    fn declare(config: TwoExpertsConfig, params: &mut Params<f32>) -> Self {
        Self::declare(config, params)
    }
}

impl SceneNetwork for TwoExperts {
    fn image_size(&self) -> [usize; 2] {
        [self.config().height, self.config().width]
    }

    fn raster(&self) -> &RasterConfig {
        &self.config().raster
    }

    fn run(
        model: &mut TwoExpertsPredictor,
        photos: Photos<'_>,
        context: usize,
        source: CameraSource<'_>,
    ) -> Result<JointPrediction, Error> {
        check(model.network.config(), photos, context)?;
        GivenCameras::check(source, context)?;
        model.tape.reset();
        let Photos { planes, height, width, .. } = photos;
        Ok(model.tape.without_gradient(|| {
            let all = model.tape.constant(planes, [1, photos.views(), 3, height, width]);
            let mut predicted = cameras_of(&model.network.cameras(model.context(), all).cameras, photos);
            let targets = predicted.split_off(context);
            let given = GivenCameras::of(source, &predicted);
            let scaled_by = given.as_ref().and_then(|given| given.scaled_by);
            let cameras = given.map_or_else(|| predicted.clone(), |given| given.cameras);
            let made = gaussians(model, photos.first(context), &cameras);
            JointPrediction { prediction: Prediction { cameras, predicted, scaled_by, ..made }, targets }
        }))
    }
}

/// Fails unless the sides of the photos are multiples of both experts' patches and their number is one or whole groups.
fn check(config: &TwoExpertsConfig, photos: Photos<'_>, views: usize) -> Result<(), Error> {
    let (side, group) = (4 * config.appearance.patch, config.appearance.group);
    for patch in [config.geometry.patch, side] {
        if !photos.height.is_multiple_of(patch) || !photos.width.is_multiple_of(patch) {
            let found = format!("{}x{}", photos.width, photos.height);
            return Err(Error::Input(format!("expected photos whose sides are multiples of {patch}, found {found}")));
        }
    }
    if views == 0 || views > 1 && !views.is_multiple_of(group) {
        return Err(Error::Input(format!("expected photos in multiples of {group}, or one alone, found {views}")));
    }
    Ok(())
}

/// The appearance expert's prediction from photos with these cameras, for the pixels inside the masks.
fn gaussians(model: &TwoExpertsPredictor, photos: Photos<'_>, cameras: &[Camera]) -> Prediction {
    let Photos { planes, height, width, .. } = photos;
    let all = model.tape.constant(planes, [photos.views(), 3, height, width]);
    let made = model.network.gaussians(model.context(), all, &model.camera_vars(cameras));
    let g = made.gaussians;
    let [means, scales, quats, opacities, sh] = [g.means, g.scales, g.quats, g.opacities, g.colors].map(|x| x.to_vec());
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
