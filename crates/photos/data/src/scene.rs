//! Scenes: photos of one place with their cameras.

use crate::sparse_points::mean_distance;
use crate::{Error, SparsePoints, Tuple};
use std::collections::BTreeMap;
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Pose};
use weaver_io::Image;

/// One photo of a scene.
#[derive(Clone, Debug)]
pub struct View {
    /// The photo's name inside its scene.
    pub name: String,
    /// The photo, at the size the network sees.
    pub image: Image,
    /// Its camera, with intrinsics for `image`.
    pub camera: Camera,
    /// Mask of the pixels that count, `[height * width]`; `None` if all do. Other pixels are white in `image`, and have
    /// no depth.
    pub inside: Option<Vec<bool>>,
    /// Depth along the optical axis, `[height * width]`, scene units; 0 where unknown.
    pub depth: Option<Vec<f32>>,
    /// The thing at each pixel's center, `[height * width]`, where that is known: 0 for the sky, else a number from 1
    /// that the thing has in all views of the scene.
    pub instances: Option<Vec<u16>>,
    /// When the photo was taken, where the capture says so, in its own unit.
    pub time: Option<f64>,
    /// A number that the capture gives to the photo, such as its exposure group.
    pub number: Option<u64>,
    /// Further entries of the camera file about the photo: JSON text by key.
    pub extras: BTreeMap<String, String>,
    /// Kept from training, for evaluation.
    pub held_out: bool,
}

/// Photos of one place, their cameras, and a sparse cloud of points on its surfaces.
#[derive(Clone, Debug)]
pub struct Scene {
    /// The name of the scene in reports.
    pub name: String,
    /// The photos, in a fixed order.
    pub views: Vec<View>,
    /// Points on surfaces, scene units; may be empty.
    pub points: Vec<DVec3>,
    /// For each view, which of `points` it sees: inside the image, in front of the camera, unoccluded.
    pub visible: Vec<Vec<u32>>,
    /// The length that becomes 1 in training where no points determine it (the `scene_scale` option).
    pub scale: Option<f64>,
    /// Remarks for the user about how it was loaded.
    pub remarks: Vec<String>,
}

/// The poses of a [`Tuple`] in the frame and the scale of training.
#[derive(Clone, Debug, PartialEq)]
pub struct NormalizedPoses {
    /// Poses of the context, then of the targets; the first is the identity.
    pub poses: Vec<Pose>,
    /// The factor from scene units to training units.
    pub scale: f64,
}

impl View {
    /// True if no pixel counts.
    pub fn is_masked(&self) -> bool {
        self.inside.as_ref().is_some_and(|inside| !inside.contains(&true))
    }
}

impl Scene {
    /// Indices of the views to train on.
    pub fn training_views(&self) -> Vec<usize> {
        self.indices(false)
    }

    /// Indices of the views kept for evaluation.
    pub fn held_out_views(&self) -> Vec<usize> {
        self.indices(true)
    }

    fn indices(&self, held_out: bool) -> Vec<usize> {
        (0..self.views.len()).filter(|&i| self.views[i].held_out == held_out).collect()
    }

    /// The poses of a tuple in the frame and the scale of training.
    ///
    /// The first context camera becomes the identity. Lengths are divided by the mean distance from its center to the
    /// points that at least one context view sees, or by [`Scene::scale`] where they see none.
    ///
    /// # Errors
    /// [`Error::Scale`] if neither points nor a positive `scale` determine the size of the scene.
    pub fn normalized(&self, tuple: &Tuple) -> Result<NormalizedPoses, Error> {
        let reference = self.views[tuple.context[0]].camera.pose;
        let unit = mean_distance(&self.points, &self.visible_to(&tuple.context), reference.center()).or(self.scale);
        let unit = unit.filter(|unit| unit.is_finite() && *unit > 0.0).ok_or_else(|| Error::Scale {
            scene: self.name.clone(),
            context: tuple.context.clone(),
            found: self.scale,
        })?;
        let scale = 1.0 / unit;
        let poses = std::iter::once(Pose::IDENTITY)
            .chain(
                tuple.context[1..]
                    .iter()
                    .chain(&tuple.targets)
                    .map(|&v| self.views[v].camera.pose.relative_to(&reference).scaled(scale)),
            )
            .collect();
        Ok(NormalizedPoses { poses, scale })
    }

    /// The points that some views see, in the frame of the first of these views, lengths times `scale`.
    ///
    /// With the scale of [`Scene::normalized`] for the same context, in training units.
    ///
    /// # Panics
    /// If `views` is empty.
    pub fn points_seen(&self, views: &[usize], scale: f64) -> SparsePoints {
        let reference = &self.views[views[0]].camera.pose;
        SparsePoints::seen_from(reference, scale, &self.points, &self.visible_to(views))
    }

    fn visible_to(&self, views: &[usize]) -> Vec<&[u32]> {
        views.iter().map(|&v| self.visible[v].as_slice()).collect()
    }

    /// Checks that there is at least one training view beside `context` others.
    ///
    /// # Errors
    /// [`Error::Views`] with how many there are.
    pub fn check_training(&self, context: usize) -> Result<(), Error> {
        self.check(self.training_views().len(), "training views", context + 1)
    }

    /// Checks that there is a view to evaluate on and that `context` training views can be given with it.
    ///
    /// # Errors
    /// [`Error::Views`] with how many there are.
    pub fn check_evaluation(&self, context: usize) -> Result<(), Error> {
        self.check(self.held_out_views().len(), "held-out views", 1)?;
        self.check(self.training_views().len(), "training views", context)
    }

    fn check(&self, found: usize, key: &'static str, least: usize) -> Result<(), Error> {
        if found >= least {
            return Ok(());
        }
        Err(Error::Views { scene: self.name.clone(), key, expected: format!("at least {least}"), found })
    }
}
