//! WildSplatter with its weights.

use crate::{Wild, WildConfig};
use std::sync::Arc;
use weaver_autograd::{Params, Var};
use weaver_geometry::Camera;
use weaver_inference::{
    CameraSource, Checkpoint, Density, Error, GivenCameras, Joint, JointPrediction, Lights, Look, LookPrediction,
    Network, Photos, Prediction, Predictor, Pretrained, cameras_of, depth_to_points, of_pixels, one_for_each,
};
use weaver_kernels::random::Stream;
use weaver_nn::Context;
use weaver_scene::ActivatedGaussians;
use weaver_splat::{RasterSettings, Renderer};

/// WildSplatter with its weights, ready to run without gradients.
///
/// [`Predictor::predict`] shows the place in the light of the first photo, [`Lights::predict_looks`] in that of any. Photos of a look
/// may have other sizes than those of the place, in multiples of the patch.
#[derive(Debug)]
pub struct WildPredictor(Pretrained<Wild>);

impl Network for Wild {
    const NAME: &'static str = WildPredictor::ARCHITECTURE;
    type Config = WildConfig;

    fn check(config: &WildConfig) -> Result<(), String> {
        config.check()
    }

    fn declare(config: WildConfig, params: &mut Params<f32>) -> Self {
        Self::declare(config, params)
    }
}

/// A prediction in several lights: the prediction, colors under each look, and the cameras of photos beyond the context.
struct Lit {
    prediction: Prediction,
    colors: Vec<Vec<f32>>,
    targets: Vec<Camera>,
}

impl WildPredictor {
    /// The name of this model in checkpoints.
    pub const ARCHITECTURE: &str = "wild";

    /// Pairs a model with weights.
    pub fn new(model: impl Into<Arc<Wild>>, params: Params<f32>) -> Self {
        Self(Pretrained::new(model, params))
    }

    /// Builds the network that a checkpoint describes and fills in its averaged weights.
    ///
    /// # Errors
    /// When the checkpoint is of another model, or a tensor is missing, of another shape, or unknown.
    pub fn from_checkpoint(checkpoint: &Checkpoint) -> Result<Self, Error> {
        Pretrained::from_checkpoint(checkpoint).map(Self)
    }

    fn check(&self, photos: Photos<'_>, what: &str) -> Result<(), Error> {
        let (patch, views) = (self.0.network.config().patch, photos.views());
        if views > 0 && photos.height.is_multiple_of(patch) && photos.width.is_multiple_of(patch) {
            return Ok(());
        }
        let found = format!("{views} of {}x{}", photos.width, photos.height);
        Err(Error::Input(format!("expected {what} whose sides are multiples of {patch}, found {found}")))
    }

    /// The embedding `[1, E]` of a look.
    fn embedding<'t>(&'t self, cx: Context<'t, '_, f32>, look: &Look<'_>) -> Var<'t, f32> {
        let of = |photo: &Photos<'_>| {
            let Photos { planes, height, width, .. } = *photo;
            let one = cx.tape.constant(&planes[..3 * height * width], [1, 3, height, width]);
            self.0.network.embed(cx, one)
        };
        match look {
            Look::Unknown => self.0.network.no_look(cx),
            Look::Of(photo) => of(photo),
            // The ends are those of the photos, to the bit.
            Look::Between(from, _, 0.0) => of(from),
            Look::Between(_, to, 1.0) => of(to),
            Look::Between(from, to, part) => of(from) * f64::from(1.0 - part) + of(to) * f64::from(*part),
        }
    }

    /// Predicts from the first `context` photos, while the backbone sees all of them.
    fn run(
        &mut self,
        photos: Photos<'_>,
        context: usize,
        source: CameraSource<'_>,
        looks: &[Look<'_>],
    ) -> Result<Lit, Error> {
        self.check(photos, "photos")?;
        for look in looks {
            match look {
                Look::Unknown => {}
                Look::Of(photo) => self.check(*photo, "a photo of the look")?,
                Look::Between(from, to, _) => {
                    [from, to].into_iter().try_for_each(|photo| self.check(*photo, "photos of the looks"))?;
                }
            }
        }
        if looks.is_empty() {
            return Err(Error::Input("looks: expected at least one, found none".into()));
        }
        GivenCameras::check(source, context)?;
        self.0.tape.reset();
        let (model, tape, cx) = (&*self.0.network, &self.0.tape, self.0.context());
        let Photos { planes, height, width, .. } = photos;
        let views = photos.views();
        Ok(tape.without_gradient(|| {
            let all = tape.constant(planes, [views, 3, height, width]);
            let encoded = model.encode(cx, all.reshape([1, views, 3, height, width]));
            let mut predicted = cameras_of(&encoded.cameras, photos);
            let targets = predicted.split_off(context);
            let given = GivenCameras::of(source, &predicted);
            let cameras = given.as_ref().map_or(&predicted, |given| &given.cameras);
            let vars = self.0.camera_vars(cameras);
            let mut depth = model.depth(cx, &encoded, 0, context, [height, width]);
            let seen = given.as_ref().map_or(&[][..], |given| &given.seen);
            let mut points_used = Vec::new();
            if !seen.is_empty() {
                let correction = depth_to_points(&depth.value(), [height, width], seen);
                depth = depth * tape.constant(&correction.factors(), [context, height, width]);
                points_used = correction.points;
            }
            let inside = photos.first(context).inside;
            let shown = if context == views { all } else { all.slice(0, 0, context) };
            let surface = model.surface(cx, (&encoded, 0), shown, inside, depth, &vars);
            let colors: Vec<Vec<f32>> = looks
                .iter()
                .map(|look| model.colors(cx, &surface, self.embedding(cx, look)).to_vec())
                .map(|rows| inside.map_or_else(|| rows.clone(), |inside| of_pixels(&rows, inside)))
                .collect();
            let [means, scales, quats, opacities] =
                [surface.means, surface.scales, surface.quats, surface.opacities].map(|x| x.to_vec());
            let degree = model.config().gaussians.sh_degree;
            let plain = ActivatedGaussians { means, scales, quats, opacities, sh: Vec::new(), degree };
            let mut prediction = Prediction {
                scaled_by: given.as_ref().and_then(|given| given.scaled_by),
                cameras: cameras.clone(),
                points_used,
                ..one_for_each(plain, surface.depth.to_vec(), inside)
            };
            prediction.gaussians.sh.clone_from(&colors[0]);
            prediction.predicted = predicted;
            Lit { prediction, colors, targets }
        }))
    }
}

impl Predictor for WildPredictor {
    fn predict(
        &mut self,
        photos: Photos<'_>,
        source: CameraSource<'_>,
        density: Density,
        _stream: Stream,
    ) -> Result<Prediction, Error> {
        self.density(density)?;
        Ok(self.run(photos, photos.views(), source, &[Look::Of(photos)])?.prediction)
    }

    fn joint(&mut self) -> Option<&mut dyn Joint> {
        Some(self)
    }

    fn lights(&mut self) -> Option<&mut dyn Lights> {
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

impl Joint for WildPredictor {
    fn predict_jointly(
        &mut self,
        photos: Photos<'_>,
        context: usize,
        density: Density,
        _stream: Stream,
    ) -> Result<JointPrediction, Error> {
        self.density(density)?;
        let Lit { prediction, targets, .. } =
            self.run(photos, context, CameraSource::Predicted, &[Look::Of(photos)])?;
        Ok(JointPrediction { prediction, targets })
    }
}

impl Lights for WildPredictor {
    fn predict_looks(
        &mut self,
        photos: Photos<'_>,
        source: CameraSource<'_>,
        looks: &[Look<'_>],
        _stream: Stream,
    ) -> Result<LookPrediction, Error> {
        let Lit { prediction, colors, .. } = self.run(photos, photos.views(), source, looks)?;
        Ok(LookPrediction { prediction, colors })
    }
}
