//! WildSplatter with its weights.

use crate::{Wild, WildConfig};
use weaver_autograd::{Params, Var};
use weaver_geometry::Camera;
use weaver_inference::{
    CameraSource, Error, GivenCameras, JointPrediction, Lights, LitNetwork, Look, LookPrediction, Network, Photos,
    Prediction, Pretrained, SceneNetwork, cameras_of, depth_to_points, of_pixels, one_for_each,
};
use weaver_model::RasterConfig;
use weaver_nn::Context;
use weaver_scene::ActivatedGaussians;

/// WildSplatter with its weights, ready to run without gradients.
///
/// [`Predictor::predict`](weaver_inference::Predictor::predict) shows the place in the light of the first photo,
/// [`Lights::predict_looks`](weaver_inference::Lights::predict_looks) in the light of any photo. Photos of a look may
/// differ in size from photos of the place, in multiples of the patch.
pub type WildPredictor = Pretrained<Wild>;

impl Network for Wild {
    const NAME: &'static str = "wild";
    type Config = WildConfig;

    fn check(config: &WildConfig) -> Result<(), String> {
        config.check()
    }

    fn declare(config: WildConfig, params: &mut Params<f32>) -> Self {
        Self::declare(config, params)
    }
}

/// A prediction in several lights: the prediction, colors under each look, and the cameras of photos beyond the
/// context.
struct Lit {
    prediction: Prediction,
    colors: Vec<Vec<f32>>,
    targets: Vec<Camera>,
}

impl SceneNetwork for Wild {
    fn image_size(&self) -> [usize; 2] {
        [self.config().height, self.config().width]
    }

    fn raster(&self) -> &RasterConfig {
        &self.config().raster
    }

    fn run(
        model: &mut WildPredictor,
        photos: Photos<'_>,
        context: usize,
        source: CameraSource<'_>,
    ) -> Result<JointPrediction, Error> {
        let Lit { prediction, targets, .. } = run(model, photos, context, source, &[Look::Of(photos)])?;
        Ok(JointPrediction { prediction, targets })
    }

    fn lights(model: &mut WildPredictor) -> Option<&mut dyn Lights> {
        Some(model)
    }
}

impl LitNetwork for Wild {
    fn run_lit(
        model: &mut WildPredictor,
        photos: Photos<'_>,
        source: CameraSource<'_>,
        looks: &[Look<'_>],
    ) -> Result<LookPrediction, Error> {
        let Lit { prediction, colors, .. } = run(model, photos, photos.views(), source, looks)?;
        Ok(LookPrediction { prediction, colors })
    }
}

fn check(model: &WildPredictor, photos: Photos<'_>, what: &str) -> Result<(), Error> {
    let (patch, views) = (model.network.config().patch, photos.views());
    if views > 0 && photos.height.is_multiple_of(patch) && photos.width.is_multiple_of(patch) {
        return Ok(());
    }
    let found = format!("{views} of {}x{}", photos.width, photos.height);
    Err(Error::Input(format!("expected {what} whose sides are multiples of {patch}, found {found}")))
}

/// The embedding `[1, E]` of a look.
fn embedding<'t>(network: &Wild, cx: Context<'t, '_, f32>, look: &Look<'_>) -> Var<'t, f32> {
    let of = |photo: &Photos<'_>| {
        let Photos { planes, height, width, .. } = *photo;
        let one = cx.tape.constant(&planes[..3 * height * width], [1, 3, height, width]);
        network.embed(cx, one)
    };
    match look {
        Look::Unknown => network.no_look(cx),
        Look::Of(photo) => of(photo),
        // The ends equal the looks of the photos, to the bit.
        Look::Between(from, _, 0.0) => of(from),
        Look::Between(_, to, 1.0) => of(to),
        Look::Between(from, to, part) => of(from) * f64::from(1.0 - part) + of(to) * f64::from(*part),
    }
}

/// Predicts from the first `context` photos, while the backbone sees all of them.
fn run(
    model: &mut WildPredictor,
    photos: Photos<'_>,
    context: usize,
    source: CameraSource<'_>,
    looks: &[Look<'_>],
) -> Result<Lit, Error> {
    check(model, photos, "photos")?;
    for look in looks {
        match look {
            Look::Unknown => {}
            Look::Of(photo) => check(model, *photo, "a photo of the look")?,
            Look::Between(from, to, _) => {
                [from, to].into_iter().try_for_each(|photo| check(model, *photo, "photos of the looks"))?;
            }
        }
    }
    if looks.is_empty() {
        return Err(Error::Input("looks: expected at least one, found none".into()));
    }
    GivenCameras::check(source, context)?;
    model.tape.reset();
    let (network, tape, cx) = (&*model.network, &model.tape, model.context());
    let Photos { planes, height, width, .. } = photos;
    let views = photos.views();
    Ok(tape.without_gradient(|| {
        let all = tape.constant(planes, [views, 3, height, width]);
        let encoded = network.encode(cx, all.reshape([1, views, 3, height, width]));
        let mut predicted = cameras_of(&encoded.cameras, photos);
        let targets = predicted.split_off(context);
        let given = GivenCameras::of(source, &predicted);
        let cameras = given.as_ref().map_or(&predicted, |given| &given.cameras);
        let vars = model.camera_vars(cameras);
        let mut depth = network.depth(cx, &encoded, 0, context, [height, width]);
        let seen = given.as_ref().map_or(&[][..], |given| &given.seen);
        let mut points_used = Vec::new();
        if !seen.is_empty() {
            let correction = depth_to_points(&depth.value(), [height, width], seen);
            depth = depth * tape.constant(&correction.factors(), [context, height, width]);
            points_used = correction.points;
        }
        let inside = photos.first(context).inside;
        let shown = if context == views { all } else { all.slice(0, 0, context) };
        let surface = network.surface(cx, (&encoded, 0), shown, inside, depth, &vars);
        let colors: Vec<Vec<f32>> = looks
            .iter()
            .map(|look| network.colors(cx, &surface, embedding(network, cx, look)).to_vec())
            .map(|rows| inside.map_or_else(|| rows.clone(), |inside| of_pixels(&rows, inside)))
            .collect();
        let [means, scales, quats, opacities] =
            [surface.means, surface.scales, surface.quats, surface.opacities].map(|x| x.to_vec());
        let degree = network.config().gaussians.sh_degree;
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
