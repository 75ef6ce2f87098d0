//! A training example: the photos, cameras and depth of one tuple of views.

use crate::{CameraMode, Error};
use weaver_data::{Layout, NormalizedPoses, Scene, SparsePoints, Tuple};
use weaver_geometry::{Camera, Pose};
use weaver_inference::{CameraSource, Photos, planar};

/// The photos, cameras and depth of one tuple of views: context first, then targets.
#[derive(Clone, Debug)]
pub struct Example {
    /// The tuple that this was made of.
    pub tuple: Tuple,
    /// Photos `[V, 3, H, W]`, values in [0, 1].
    pub images: Vec<f32>,
    /// Which pixels count `[V, H, W]`; `None` if all do.
    pub inside: Option<Vec<bool>>,
    /// Cameras in the tuple's frame: camera 0 is the identity, lengths in training units.
    pub cameras: Vec<Camera>,
    /// Time of each photo, in the capture's unit, where the capture has it.
    pub times: Vec<Option<f64>>,
    /// The number that the capture gives to each photo, where it does.
    pub numbers: Vec<Option<u64>>,
    /// Training units per scene unit.
    pub scale: f64,
    /// Depth of the context views `[C, H, W]` in training units, 0 where unknown.
    pub depth: Vec<f32>,
    /// Poses of the context views in the scene's own frame, translations in training units; none in evaluation, which
    /// has no loss on them.
    pub absolute: Vec<Pose>,
}

impl Example {
    /// Gathers the views of a tuple. `layout` is the scene's.
    ///
    /// # Errors
    /// When the scene's scale is unknown.
    pub fn new(scene: &Scene, layout: &Layout, tuple: Tuple) -> Result<Self, Error> {
        let center = &scene.views[layout.central_view()].camera.pose;
        let posed = scene.normalized(&tuple)?;
        let context = tuple.context.iter().map(|&v| &scene.views[v].camera.pose);
        let absolute = context.map(|pose| pose.relative_to(center).scaled(posed.scale)).collect();
        Ok(Self { absolute, ..Self::with(scene, tuple, &posed) })
    }

    /// Gathers the views of a tuple for evaluation. Where the scale is unknown, lengths stay in the scene's own units
    /// and the second value is false.
    ///
    /// # Errors
    /// When the tuple does not fit the scene.
    pub fn for_evaluation(scene: &Scene, tuple: Tuple) -> Result<(Self, bool), Error> {
        match scene.normalized(&tuple) {
            Ok(posed) => Ok((Self::with(scene, tuple, &posed), true)),
            Err(weaver_data::Error::Scale { .. }) => {
                let reference = scene.views[tuple.context[0]].camera.pose;
                let views = tuple.context.iter().chain(&tuple.targets);
                let poses = views.map(|&v| scene.views[v].camera.pose.relative_to(&reference)).collect();
                Ok((Self::with(scene, tuple, &NormalizedPoses { poses, scale: 1.0 }), false))
            }
            Err(error) => Err(error.into()),
        }
    }

    fn with(scene: &Scene, tuple: Tuple, posed: &NormalizedPoses) -> Self {
        let views: Vec<usize> = tuple.context.iter().chain(&tuple.targets).copied().collect();
        let images = planar(views.iter().map(|&v| &scene.views[v].image));
        let mut depth = Vec::new();
        let mut inside = views.iter().any(|&v| scene.views[v].inside.is_some()).then(Vec::new);
        for (i, &v) in views.iter().enumerate() {
            let view = &scene.views[v];
            if let Some(inside) = &mut inside {
                match &view.inside {
                    Some(own) => inside.extend(own),
                    None => inside.resize(inside.len() + view.image.width * view.image.height, true),
                }
            }
            if i < tuple.context.len() {
                match &view.depth {
                    Some(d) => depth.extend(d.iter().map(|z| (f64::from(*z) * posed.scale) as f32)),
                    None => depth.resize(depth.len() + view.image.width * view.image.height, 0.0),
                }
            }
        }
        let cameras =
            views.iter().zip(&posed.poses).map(|(&v, pose)| Camera { pose: *pose, ..scene.views[v].camera }).collect();
        let times = views.iter().map(|&v| scene.views[v].time).collect();
        let numbers = views.iter().map(|&v| scene.views[v].number).collect();
        Self { tuple, images, inside, cameras, times, numbers, scale: posed.scale, depth, absolute: Vec::new() }
    }

    /// Cameras of the context views.
    pub fn context(&self) -> &[Camera] {
        &self.cameras[..self.tuple.context.len()]
    }

    /// Cameras of the target views.
    pub fn targets(&self) -> &[Camera] {
        &self.cameras[self.tuple.context.len()..]
    }

    /// Photos of all views.
    pub fn photos(&self) -> Photos<'_> {
        let Camera { width, height, .. } = self.cameras[0];
        Photos { planes: &self.images, inside: self.inside.as_deref(), height, width }
    }

    /// Photos of the context views.
    pub fn context_photos(&self) -> Photos<'_> {
        let view = self.images.len() / self.cameras.len();
        Photos {
            planes: &self.images[..view * self.tuple.context.len()],
            inside: self.inside_of(self.tuple.context.len()),
            ..self.photos()
        }
    }

    /// Which pixels of the first `views` views count; `None` if all of them do.
    pub fn inside_of(&self, views: usize) -> Option<&[bool]> {
        let pixels = self.images.len() / 3 / self.cameras.len();
        self.inside.as_deref().map(|inside| &inside[..views * pixels])
    }

    /// The points that the context views see, in the frame and the units of the cameras; `None` where they see none.
    ///
    /// `scene` is the scene that this was made of.
    pub fn points(&self, scene: &Scene) -> Option<SparsePoints> {
        let points = scene.points_seen(&self.tuple.context, self.scale);
        (!points.positions.is_empty()).then_some(points)
    }

    /// The cameras to predict with: the network's, or the context's, with points if there are any, else with a known
    /// scale if `measured`.
    pub fn camera_source<'a>(
        &'a self,
        mode: CameraMode,
        measured: bool,
        points: Option<&'a SparsePoints>,
    ) -> CameraSource<'a> {
        let cameras = self.context();
        match (mode, points) {
            (CameraMode::Predicted, _) => CameraSource::Predicted,
            (CameraMode::Given, Some(points)) => CameraSource::GivenWithPoints { cameras, points },
            (CameraMode::Given, None) if measured => CameraSource::Given(cameras),
            (CameraMode::Given, None) => CameraSource::GivenUnscaled(cameras),
        }
    }
}

/// The rotation `[3, 3]` of a pose, row by row.
pub fn rotation_row(pose: &Pose) -> [f32; 9] {
    let r = pose.rotation.to_cols_array_2d();
    std::array::from_fn(|at| r[at % 3][at / 3] as f32)
}

/// The translation `[3]` of a pose.
pub fn translation_row(pose: &Pose) -> [f32; 3] {
    pose.translation.to_array().map(|x| x as f32)
}
