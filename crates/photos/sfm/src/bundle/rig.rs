//! Rigs: cameras with one center, turned from each other by known rotations.

use super::Bundle;
use std::ops::Range;
use weaver_geometry::Pose;
use weaver_geometry::glam::DMat3;

/// The place of a camera in a rig: its axes are turned from the axes of the rig's first camera, and its center is the
/// same.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mounted {
    /// Number of the first camera of the rig.
    pub on: usize,
    /// Rotation from the axes of that camera to its own.
    pub rotation: DMat3,
}

impl Bundle {
    /// The place of a camera in its rig; a camera that stands alone is its own.
    pub(crate) fn mounted(&self, camera: usize) -> Mounted {
        self.rig.get(camera).copied().unwrap_or(Mounted { on: camera, rotation: DMat3::IDENTITY })
    }

    /// True for the first camera of a rig, and for a camera that stands alone.
    pub(crate) fn leads(&self, camera: usize) -> bool {
        self.mounted(camera).on == camera
    }

    /// The cameras of a camera's rig, itself among them.
    pub(crate) fn together(&self, camera: usize) -> Range<usize> {
        let first = self.mounted(camera).on;
        let others = self.rig.iter().skip(first + 1).take_while(|mounted| mounted.on == first).count();
        first..first + 1 + others
    }

    /// The rotation of a camera that is turned from the first of its rig; `None` for that one, and for a lone camera.
    pub(super) fn turned(&self, camera: usize) -> Option<DMat3> {
        let Mounted { on, rotation } = self.mounted(camera);
        (on != camera).then_some(rotation)
    }

    /// The pose of the first camera of a rig, given a camera's pose.
    pub(crate) fn pose_of_first(&self, camera: usize, pose: Pose) -> Pose {
        self.turned(camera).map_or(pose, |turn| Pose::new(turn.transpose(), Default::default()).compose(&pose))
    }

    /// The pose of a camera, given the first of its rig.
    pub(crate) fn pose_by_first(&self, camera: usize, first: &Pose) -> Pose {
        self.turned(camera).map_or(*first, |turn| Pose::new(turn, Default::default()).compose(first))
    }

    /// Gives a camera a pose, and with it the others of its rig.
    pub(crate) fn put(&mut self, camera: usize, pose: Pose) {
        let first = self.pose_of_first(camera, pose);
        for other in self.together(camera) {
            self.cameras[other].pose = self.pose_by_first(other, &first);
        }
    }

    /// The rig of each camera, numbered without gaps; a lone camera is one.
    pub(crate) fn bodies(&self) -> Vec<usize> {
        let mut count = 0;
        let number = |camera: usize| {
            count += usize::from(self.leads(camera));
            count - 1
        };
        (0..self.cameras.len()).map(number).collect()
    }

    /// Numbers of cameras, summed over their rigs: each camera gets its rig's.
    pub(crate) fn summed(&self, of_cameras: Vec<usize>) -> Vec<usize> {
        if self.rig.is_empty() {
            return of_cameras;
        }
        (0..of_cameras.len()).map(|camera| self.together(camera).map(|other| of_cameras[other]).sum()).collect()
    }

    /// The rigs of some of the cameras, renumbered with these; `kept` ascend, and have all of a rig or none.
    pub(crate) fn rig_of(&self, kept: &[usize]) -> Vec<Mounted> {
        let of = |camera: &usize| {
            let mounted = self.mounted(*camera);
            Mounted { on: kept.partition_point(|i| *i < mounted.on), ..mounted }
        };
        if self.rig.is_empty() { Vec::new() } else { kept.iter().map(of).collect() }
    }

    /// True for lenses of cameras in rigs, which are calibrated.
    pub(crate) fn calibrated(&self) -> Vec<bool> {
        let mut of_rigs = vec![false; self.lenses.len()];
        for camera in (0..self.rig.len()).filter(|camera| self.together(*camera).len() > 1) {
            of_rigs[self.lens_of[camera]] = true;
        }
        of_rigs
    }
}
