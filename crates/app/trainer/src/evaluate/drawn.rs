//! A held-out view drawn from a predictor's Gaussians for its context.

use super::light::{as_photos, photo_of};
use super::{Matching, Options, Targets};
use crate::{CameraMode, Error, Example, LooksConfig};
use weaver_data::{Scene, Tuple};
use weaver_geometry::{Camera, Pose, Similarity};
use weaver_inference::{CameraSource, Density, JointPrediction, Look, LookPrediction, Prediction, Predictor, planar};
use weaver_io::Image;
use weaver_kernels::random::Stream;
use weaver_pose::PoseErrors;
use weaver_procedural::appearance::Appearance;

/// A held-out view as it was drawn.
pub(super) struct Drawn {
    pub prediction: Prediction,
    pub render: Image,
    /// Where it was drawn from.
    pub camera: Camera,
    /// With estimated cameras: the same in the capture's own scale and through its own lens.
    pub strict: Option<Image>,
    /// Errors of the context's cameras, unless they were given.
    pub errors: Option<PoseErrors>,
    /// Remark for the reader.
    pub remark: Option<Remark>,
}

/// Remarks on a view.
#[derive(Clone, Copy, Debug, Eq, Ord, PartialEq, PartialOrd)]
pub(super) enum Remark {
    Rescaled,
    OnOneLine,
    WithoutPoints,
    NotPlaced,
    PartlyPlaced,
    Masked,
}

/// The predictor and the options of drawing.
pub(super) struct Drawing<'a> {
    pub predictor: &'a mut dyn Predictor,
    pub options: &'a Options,
    pub density: Density,
}

impl Drawing<'_> {
    pub fn draw(&mut self, scene: &Scene, number: usize, tuple: &Tuple) -> Result<Drawn, Error> {
        let matching = self.options.matching.as_ref();
        let size = self.predictor.image_size();
        let found = matching.map(|Matching { scenes, focal_known }| {
            scenes[number].estimated_context(&tuple.context, size, *focal_known)
        });
        let Some(found) = found else {
            return if self.options.targets == Targets::Joint {
                self.jointly(scene, tuple)
            } else {
                self.with(scene, tuple, self.options.cameras)
            };
        };
        let Some(found) = found else {
            let drawn = self.with(scene, tuple, CameraMode::Predicted)?;
            return Ok(Drawn { remark: Some(Remark::NotPlaced), ..drawn });
        };
        let context: Vec<usize> = found.placed.iter().map(|i| tuple.context[*i]).collect();
        let remark = (context.len() < tuple.context.len()).then_some(Remark::PartlyPlaced);
        let (example, measured) = self.example(scene, Tuple { context, ..tuple.clone() })?;
        let source = CameraSource::GivenWithPoints { cameras: &found.cameras, points: &found.points };
        let prediction = self.predict(scene, &example, source)?;
        let factor = prediction.scale_to_used(example.context());
        // Users who estimated the lens would draw through it, too.
        let longer = found.cameras[0].intrinsics.fx / example.context()[0].intrinsics.fx;
        let target = example.targets()[0];
        let mut camera = Camera { pose: target.pose.scaled(factor), ..target };
        (camera.intrinsics.fx, camera.intrinsics.fy) = (longer * target.intrinsics.fx, longer * target.intrinsics.fy);
        let render = self.render(&prediction, camera)?;
        let strict = if measured { Some(self.render(&prediction, target)?) } else { None };
        let errors = errors(&prediction.cameras, &example);
        Ok(Drawn { prediction, render, camera, strict, errors, remark })
    }

    pub fn with(&mut self, scene: &Scene, tuple: &Tuple, cameras: CameraMode) -> Result<Drawn, Error> {
        let (example, measured) = self.example(scene, tuple.clone())?;
        let asked = self.options.points && cameras == CameraMode::Given;
        let points = asked.then(|| example.points(scene)).flatten();
        let source = example.camera_source(cameras, measured, points.as_ref());
        let prediction = self.predict(scene, &example, source)?;
        let factor = if measured { 1.0 } else { prediction.scale_to_predicted(example.context()) };
        let target = example.targets()[0];
        let by_centers = self.options.targets == Targets::Centers && cameras == CameraMode::Predicted;
        let carried = if by_centers { between(&prediction.predicted, example.context()) } else { None };
        let pose = carried.map_or_else(|| target.pose.scaled(factor), |carried| carried.apply_to_pose(&target.pose));
        let camera = Camera { pose, ..target };
        let render = self.render(&prediction, camera)?;
        let remark = match carried {
            Some(_) => None,
            None if by_centers => Some(Remark::OnOneLine),
            None if !measured => Some(Remark::Rescaled),
            None => (asked && points.is_none()).then_some(Remark::WithoutPoints),
        };
        let errors = errors(&prediction.predicted, &example).filter(|_| cameras == CameraMode::Predicted);
        Ok(Drawn { prediction, render, camera, strict: None, errors, remark })
    }

    /// Draws from the model's own camera for the held-out photo, which it has then seen.
    fn jointly(&mut self, scene: &Scene, tuple: &Tuple) -> Result<Drawn, Error> {
        let (example, _) = self.example(scene, tuple.clone())?;
        let (stream, context) = (self.stream(&example), example.context().len());
        let JointPrediction { prediction, targets } =
            self.predictor.as_joint()?.predict_jointly(example.photos(), context, self.density, stream)?;
        let camera = targets[0];
        let render = self.render(&prediction, camera)?;
        let errors = errors(&prediction.predicted, &example);
        Ok(Drawn { prediction, render, camera, strict: None, errors, remark: None })
    }

    fn stream(&self, example: &Example) -> Stream {
        let Tuple { scene, targets, .. } = &example.tuple;
        Stream::new(self.options.seed, targets[0] as u64, "evaluation").fork(*scene as u64)
    }

    /// An evaluation's example; the mask of planted rectangles is given to the model only if the run's settings do so.
    fn example(&self, scene: &Scene, tuple: Tuple) -> Result<(Example, bool), Error> {
        let (mut example, measured) = Example::for_evaluation(scene, tuple)?;
        if self.options.planted.as_ref().is_some_and(|planted| !planted.masks) {
            example.inside = None;
        }
        Ok((example, measured))
    }

    fn predict(&mut self, scene: &Scene, example: &Example, cameras: CameraSource<'_>) -> Result<Prediction, Error> {
        let (stream, photos) = (self.stream(example), example.context_photos());
        let Some(asked) = self.options.look else {
            return Ok(self.predictor.predict(photos, cameras, self.density, stream)?);
        };
        let photo = photo_of(asked, scene, &example.tuple);
        let size = [photos.width, photos.height];
        let look = photo.as_ref().map_or(Look::Unknown, |photo| Look::Of(as_photos(photo, size)));
        Ok(self.predictor.as_lights()?.predict_looks(photos, cameras, &[look], stream)?.prediction)
    }

    /// The photo of a tuple's target in the light that it was given and in another one, and renders in these lights.
    pub fn in_two_lights(
        &mut self,
        planted: &LooksConfig,
        plain: &Scene,
        scene: &Scene,
        number: usize,
        tuple: &Tuple,
    ) -> Result<([Image; 2], [Image; 2]), Error> {
        let (example, measured) = self.example(scene, tuple.clone())?;
        let target = tuple.targets[0];
        let view = &plain.views[target];
        let size = [view.image.width, view.image.height];
        // Light alone: pixels under a rectangle are not compared.
        let photos = [0, 1].map(|which| {
            let drawn = planted.of_view(number, target, which, size);
            Appearance { occluders: Vec::new(), ..drawn }.photo(&view.image, view.inside.as_deref())
        });
        let shown = photos.each_ref().map(|photo| planar([photo]));
        let looks = shown.each_ref().map(|planes| Look::Of(as_photos(planes, size)));
        let source = example.camera_source(self.options.cameras, measured, None);
        let stream = self.stream(&example);
        let LookPrediction { mut prediction, colors } =
            self.predictor.as_lights()?.predict_looks(example.context_photos(), source, &looks, stream)?;
        let factor = if measured { 1.0 } else { prediction.scale_to_predicted(example.context()) };
        let camera = example.targets()[0];
        let camera = Camera { pose: camera.pose.scaled(factor), ..camera };
        let mut renders = Vec::new();
        for sh in colors {
            prediction.gaussians.sh = sh;
            renders.push(self.render(&prediction, camera)?);
        }
        let renders = renders.try_into().expect("a render for each of two looks");
        Ok((photos, renders))
    }

    fn render(&mut self, prediction: &Prediction, camera: Camera) -> Result<Image, Error> {
        Ok(self.predictor.render(prediction, &[camera])?.remove(0))
    }
}

/// The similarity that carries a context's centers to the predicted ones; `None` where they do not determine one.
fn between(predicted: &[Camera], context: &[Camera]) -> Option<Similarity> {
    let centers = |cameras: &[Camera]| -> Vec<_> { cameras.iter().map(|camera| camera.pose.center()).collect() };
    (predicted.len() == context.len()).then(|| Similarity::fit(&centers(context), &centers(predicted)))?
}

/// Errors of cameras against the context's own; `None` for a single one.
fn errors(cameras: &[Camera], example: &Example) -> Option<PoseErrors> {
    let poses = |c: &[Camera]| -> Vec<Pose> { c.iter().map(|c| c.pose).collect() };
    let several = cameras.len() > 1 && cameras.len() == example.context().len();
    several.then(|| PoseErrors::between(&poses(cameras), &poses(example.context())))
}
