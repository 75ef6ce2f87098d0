//! Positions of photos, by their GPS or a table.

use super::similarity::{Robust, free, vertical};
use super::upright::Up;
use super::{COARSE, Placing};
use crate::{Error, EstimatedPhotos, Placement, PositionsFit};
use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use weaver_geometry::geodesy::{Geographic, Origin};
use weaver_geometry::glam::DVec3;
use weaver_io::{Positions, photo_place, read_positions};
use weaver_kernels::order::median_mean;

/// Largest expected error of the vertical of a world that positions turn, radians.
const LEVEL: f64 = 0.35;
/// Angle between the vertical of positions and that of photos from which the positions are wrong, radians.
const CONTRADICTED: f64 = 0.2;

/// Positions of cameras beside where these are in the estimate.
#[derive(Debug, Default)]
pub(super) struct Target {
    source: String,
    from: Vec<DVec3>,
    to: Vec<DVec3>,
    /// Up in the world of the estimate, by gimbals.
    ups: Vec<DVec3>,
    origin: Option<Origin>,
}

impl Target {
    /// The positions of the photos that have a camera.
    pub fn of(found: &EstimatedPhotos, originals: &[PathBuf], placing: &Placing) -> Result<Self, Error> {
        let mut target = Self::default();
        if let Some(file) = &placing.positions {
            target.read(found, originals, file)?;
        } else if placing.gps {
            target.source = "GPS".into();
            let mut places = Vec::new();
            for (i, pose) in found.poses() {
                // Another camera's remark, or no photo at all, is no position.
                let Some(place) = photo_place(originals.get(i).unwrap_or(&found.paths[i])).ok().flatten() else {
                    continue;
                };
                places.push((pose.center(), place.position));
                // A panorama has no axes that a gimbal holds.
                if let Some(up) = place.up.filter(|_| !found.ambiguous[i] && found.faces[i].is_none()) {
                    target.ups.push(pose.rotation.transpose() * up);
                }
            }
            target.set_geographic(&places);
        }
        Ok(target)
    }

    /// Reads a table, whose names are matched with the names of photos.
    fn read(&mut self, found: &EstimatedPhotos, originals: &[PathBuf], file: &Path) -> Result<(), Error> {
        self.source = file.display().to_string();
        let table = read_positions(file)?;
        let names: Vec<&String> = match &table {
            Positions::Geographic(rows) => rows.iter().map(|row| &row.0).collect(),
            Positions::Local(rows) => rows.iter().map(|row| &row.0).collect(),
        };
        let mut rows: BTreeMap<&OsStr, usize> = BTreeMap::new();
        for (row, name) in names.iter().enumerate() {
            let name = Path::new(name).file_name().unwrap_or_default();
            if let Some(before) = rows.insert(name, row) {
                let found = format!("{} in lines {} and {}", name.display(), before + 2, row + 2);
                return Err(Error::unexpected(file, "name", "each photo once", found));
            }
        }
        let row_of = |i: usize| {
            let path = originals.get(i).unwrap_or(&found.paths[i]);
            let name = path.file_name().unwrap_or_default();
            rows.get(name).or_else(|| rows.get(path.file_stem().unwrap_or_default())).copied()
        };
        let matched: Vec<(DVec3, usize)> =
            found.poses().into_iter().filter_map(|(i, pose)| Some((pose.center(), row_of(i)?))).collect();
        if matched.is_empty() {
            let first = names.first().map_or("none".into(), |name| format!("{name}, ..."));
            return Err(Error::unexpected(file, "name", "names of photos that have a camera", first));
        }
        match table {
            Positions::Geographic(rows) => {
                self.set_geographic(&matched.iter().map(|(center, row)| (*center, rows[*row].1)).collect::<Vec<_>>());
            }
            Positions::Local(rows) => {
                let middle = matched.iter().map(|(_, row)| rows[*row].1).sum::<DVec3>() / matched.len() as f64;
                let offset = middle.round();
                self.from = matched.iter().map(|(center, _)| *center).collect();
                self.to = matched.iter().map(|(_, row)| rows[*row].1 - offset).collect();
                self.origin = Some(Origin::Local { offset: offset.to_array() });
            }
        }
        Ok(())
    }

    fn set_geographic(&mut self, places: &[(DVec3, Geographic)]) {
        let median =
            |of: fn(&Geographic) -> f64| median_mean(&mut places.iter().map(|(_, p)| of(p)).collect::<Vec<_>>());
        let (Some(latitude), Some(longitude), Some(altitude)) =
            (median(|p| p.latitude), median(|p| p.longitude), median(|p| p.altitude))
        else {
            return;
        };
        let origin = Geographic { latitude, longitude, altitude };
        self.from = places.iter().map(|(center, _)| *center).collect();
        self.to = places.iter().map(|(_, place)| origin.to_local(place)).collect();
        self.origin = Some(Origin::Geographic(origin));
    }

    /// Directions up by gimbals.
    pub fn ups(&self) -> &[DVec3] {
        &self.ups
    }

    /// The origin, moved up.
    pub fn origin(&self, by: f64) -> Option<Origin> {
        Some(match self.origin? {
            Origin::Geographic(place) => Origin::Geographic(Geographic { altitude: place.altitude + by, ..place }),
            Origin::Local { offset: [x, y, z] } => Origin::Local { offset: [x, y, z + by] },
        })
    }

    /// The transform to the positions, unless they are too coarse; what was found is told in the placement.
    pub fn fit(&self, up: Option<&Up>, placement: &mut Placement) -> Option<Robust> {
        let Self { from, to, .. } = self;
        let free = free(from, to);
        // A vertical by a line or a small patch of positions, or by heights that drift, is worse than the photos' own.
        let tilt = |fit: &Robust| {
            let level = fit.deviation / (fit.spread(to)[1] * (fit.used() as f64).sqrt());
            let apart = up.map_or(0.0, |up| (fit.similarity.rotation * up.direction).angle_between(DVec3::Z));
            if apart > CONTRADICTED { f64::INFINITY } else { level }
        };
        let level = free.as_ref().map_or(f64::INFINITY, tilt);
        let better = up.filter(|up| up.deviation < level);
        let heights = |fit: &Robust| median_mean(&mut fit.above.iter().map(|x| x.abs()).collect::<Vec<_>>());
        let held = better.and_then(|up| Some((vertical(from, to, up.direction)?, Some(up))));
        let (fit, up) = held.or_else(|| Some((free?, None)))?;
        let used = fit.used();
        let scale_deviation = fit.deviation / (fit.spread(to)[0] * (used as f64).sqrt());
        let enough = used >= 3 && 2 * used > from.len();
        let followed = enough && scale_deviation < COARSE && level_of(up, level) < LEVEL;
        placement.positions = Some(PositionsFit {
            source: self.source.clone(),
            cameras: from.len(),
            used,
            median: median_mean(&mut fit.off.clone()).unwrap_or(f64::NAN),
            largest: fit
                .off
                .iter()
                .zip(&fit.agrees)
                .filter(|(_, agrees)| **agrees)
                .map(|(off, _)| *off)
                .fold(0.0, f64::max),
            height: heights(&fit).unwrap_or(f64::NAN),
            scale_deviation: if scale_deviation.is_finite() { scale_deviation } else { 1.0 },
            level_deviation: level.min(1.0).to_degrees(),
            followed,
        });
        if !followed {
            return None;
        }
        placement.vertical = Some(up.map_or("positions", |up| up.source.name()).to_string());
        Some(fit)
    }
}

/// Deviation of the vertical that is used.
fn level_of(up: Option<&Up>, free: f64) -> f64 {
    up.map_or(free, |up| up.deviation)
}
