//! Estimated cameras in a world of meters, east, north and up, or at least upright: one similarity transform of cameras
//! and points, after everything else.

mod bar;
mod positions;
mod similarity;
mod upright;

use crate::{Error, EstimatedPhotos, Placement};
use bar::Bar;
use positions::Target;
use similarity::Robust;
use std::path::{Path, PathBuf};
use upright::Up;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::{Pose, Similarity};
use weaver_io::Positions;
use weaver_kernels::order::{median_mean, quantile};

/// Deviation of a scale, as a part of it, from which positions are too coarse to set it.
const COARSE: f64 = 0.1;
/// Part of the points below which the ground is: some are wrong.
const GROUND: f64 = 0.05;
/// Fewer points tell nothing about a ground.
const FEW: usize = 50;
/// Height of a point above or below the median, over the median of these, from which it does not count: points that are
/// hardly triangulated lie anywhere along their rays.
const ASTRAY: f64 = 8.0;

/// Knowledge about the world of photos whose cameras are estimated.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Placing {
    /// A table of positions in place of the photos' own GPS ([`weaver_io::read_positions`]).
    pub positions: Option<PathBuf>,
    /// True if the GPS of photos is used.
    pub gps: bool,
    /// A table with the ends of a bar of known length ([`weaver_io::read_scale_bar`]).
    pub scale_bar: Option<PathBuf>,
    /// True if the world is turned upright; otherwise it is left as it is, and nothing else is used.
    pub up: bool,
}

impl Default for Placing {
    fn default() -> Self {
        Self { positions: None, gps: true, scale_bar: None, up: true }
    }
}

impl Placing {
    /// The world as it was estimated.
    pub const KEEP: Self = Self { positions: None, gps: false, scale_bar: None, up: false };

    /// Checks that its tables can be read and name some of the photos: to be called before these are matched.
    ///
    /// # Errors
    /// When a table cannot be read, or names none of the photos.
    pub fn check(&self, photos: &[PathBuf]) -> Result<(), Error> {
        let is_named = |name: &str| {
            let name = Path::new(name).file_name();
            photos.iter().any(|photo| photo.file_name() == name || photo.file_stem() == name)
        };
        let named = |file: &Path, names: Vec<String>| match names.iter().any(|name| is_named(name)) {
            true => Ok(()),
            false => {
                let found = names.first().map_or("none".into(), |name| format!("{name}, ..."));
                Err(Error::unexpected(file, "name", "names of the photos", found))
            }
        };
        if let Some(file) = &self.positions {
            let names = match weaver_io::read_positions(file)? {
                Positions::Geographic(rows) => rows.into_iter().map(|(name, _)| name).collect(),
                Positions::Local(rows) => rows.into_iter().map(|(name, _)| name).collect(),
            };
            named(file, names)?;
        }
        if let Some(file) = &self.scale_bar {
            named(file, weaver_io::read_scale_bar(file)?.into_iter().map(|row| row.name).collect())?;
        }
        Ok(())
    }

    /// The files that it reads.
    pub fn files(&self) -> impl Iterator<Item = &PathBuf> {
        self.positions.iter().chain(&self.scale_bar)
    }
}

impl EstimatedPhotos {
    /// Brings cameras and points to the world that positions, a scale bar and the photos themselves tell of; returns
    /// where that is. `originals` are the files that [`paths`](Self::paths) were made of, in the same order, with their
    /// GPS.
    ///
    /// Positions set scale, heading and place by a robust similarity transform, and the vertical too, unless the photos
    /// know it better: by a drone's gimbal, or by their horizons. Then heights only shift it. Positions that leave more
    /// than a tenth of the scale open are not followed. Without positions y is down, as in photos, and the ground is at
    /// y = 0.
    ///
    /// # Errors
    /// When a table cannot be read, or names no photo that has a camera.
    pub fn place(&mut self, originals: &[PathBuf], placing: &Placing) -> Result<Placement, Error> {
        let mut placement = Placement::default();
        if !placing.up {
            return Ok(placement);
        }
        let target = Target::of(self, originals, placing)?;
        let up = Up::of(self, target.ups());
        let bar = placing.scale_bar.as_deref().map(|file| Bar::read(self, file)).transpose()?;
        let by_bar = bar.as_ref().and_then(Bar::scale);
        let followed = target.fit(up.as_ref(), &mut placement);
        let up = if followed.is_some() { up } else { up.map(|up| up.by_ground(self)) };
        let scale = by_bar.unwrap_or(1.0);
        let mut onto = match (&followed, &up) {
            (Some(Robust { similarity, .. }), _) => *similarity,
            (None, Some(up)) => upright(up.direction, scale),
            (None, None) => Similarity { scale, rotation: DMat3::IDENTITY, translation: DVec3::ZERO },
        };
        placement.east_north_up = followed.is_some();
        placement.meters = followed.is_some() || by_bar.is_some();
        placement.vertical = placement.vertical.or(up.as_ref().map(|up| up.source.name().to_string()));
        placement.scale_bar = bar.map(|bar| bar.fit(onto.scale));
        // The ground at height 0.
        let vertical = if placement.east_north_up { DVec3::Z } else { DVec3::NEG_Y };
        let mut heights: Vec<f64> = self.firm_points().iter().map(|p| onto.apply(*p).dot(vertical)).collect();
        if let Some(ground) = ground(&mut heights).filter(|_| up.is_some() || followed.is_some()) {
            onto.translation -= vertical * ground;
            placement.origin = target.origin(ground).filter(|_| placement.east_north_up);
        }
        self.apply(&onto);
        placement.ground_sample = self.ground_sample().filter(|_| placement.meters);
        self.placement = placement.clone();
        Ok(placement)
    }

    /// Moves cameras, points and their deviations.
    fn apply(&mut self, onto: &Similarity) {
        let estimate = &mut self.estimate;
        estimate.cameras.iter_mut().flatten().for_each(|camera| camera.pose = onto.apply_to_pose(&camera.pose));
        estimate.points.iter_mut().for_each(|point| *point = onto.apply(*point));
        if let Some(uncertainty) = &mut estimate.uncertainty {
            uncertainty.centers.iter_mut().for_each(|deviation| *deviation *= onto.scale);
            uncertainty.spread *= onto.scale;
        }
    }

    /// The points that three photos or more see; all, where these are few. Two rays may hardly meet.
    fn firm_points(&self) -> Vec<DVec3> {
        let points = &self.estimate.points;
        let mut seen = vec![0; points.len()];
        self.estimate.observations.iter().for_each(|observation| seen[observation.point] += 1);
        let firm: Vec<DVec3> = points.iter().zip(&seen).filter(|(_, seen)| **seen >= 3).map(|(p, _)| *p).collect();
        if firm.len() < FEW { points.clone() } else { firm }
    }

    /// Poses of the photos that have one, with their numbers.
    fn poses(&self) -> Vec<(usize, Pose)> {
        let cameras = self.estimate.cameras.iter().enumerate();
        cameras.filter_map(|(i, camera)| Some((i, camera.ok()?.pose))).collect()
    }

    /// World units for each pixel of a photo's file: the median over photos of the median depth of points.
    fn ground_sample(&self) -> Option<f64> {
        let mut depths = vec![Vec::new(); self.paths.len()];
        for seen in &self.estimate.observations {
            if let Ok(camera) = self.estimate.cameras[seen.camera] {
                depths[seen.camera].push(camera.pose.apply(self.estimate.points[seen.point]).z);
            }
        }
        let sample = |(i, depths): (usize, &mut Vec<f64>)| {
            let camera = self.estimate.cameras[i].ok()?;
            let larger = self.sizes[i].0 as f64 / camera.width as f64;
            Some(median_mean(depths)? / (camera.intrinsics.fx * larger))
        };
        let mut samples: Vec<f64> = depths.iter_mut().enumerate().filter_map(sample).collect();
        median_mean(&mut samples)
    }
}

/// The height of the ground, by the heights of points.
fn ground(heights: &mut Vec<f64>) -> Option<f64> {
    let middle = median_mean(heights)?;
    let spread = median_mean(&mut heights.iter().map(|height| (height - middle).abs()).collect::<Vec<_>>())?;
    heights.retain(|height| (height - middle).abs() <= ASTRAY * spread);
    (!heights.is_empty()).then(|| quantile(heights, GROUND))
}

/// The transform that turns a direction to -y by the smallest angle, and scales.
fn upright(up: DVec3, scale: f64) -> Similarity {
    let rotation = DMat3::from_quat(weaver_geometry::glam::DQuat::from_rotation_arc(up, DVec3::NEG_Y));
    Similarity { scale, rotation, translation: DVec3::ZERO }
}

#[cfg(test)]
mod tests {
    /// A twelfth of the points lies far below, along rays that hardly meet.
    #[test]
    fn points_astray_are_no_ground() {
        let mut heights: Vec<f64> = (0..110).map(|i| f64::from(i) * 0.1).collect();
        heights.extend((0..10).map(|i| -1e3 * 10_f64.powi(i)));
        let ground = super::ground(&mut heights).unwrap();
        assert!((0.4..0.7).contains(&ground), "{ground}");
        assert_eq!(super::ground(&mut Vec::new()), None);
        assert_eq!(super::ground(&mut vec![2.0; 5]), Some(2.0));
    }
}
