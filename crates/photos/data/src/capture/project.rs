//! Captures described by another program's project.

use super::photo::{Photo, Photos};
use crate::Error;
use std::path::Path;
use weaver_geometry::glam::DVec3;
use weaver_io::Project;

/// The photos and points of a project.
pub(super) fn read(file: &Path) -> Result<Photos, Error> {
    Ok(photos(Project::read(file)?))
}

/// As [`read`], where photos may be missing if the file has their sizes.
pub(super) fn read_cameras(file: &Path) -> Result<Photos, Error> {
    Ok(photos(Project::read_cameras(file)?))
}

fn photos(project: Project) -> Photos {
    let Project { frames, points, colors, observations, origin, remarks, .. } = project;
    let photo = |(frame, seen): (_, Vec<([f64; 2], u32)>)| {
        let mut track: Vec<u32> = seen.into_iter().map(|(_, point)| point).collect();
        track.sort_unstable();
        track.dedup();
        Photo { frame, held_out: false, track }
    };
    let photos = frames.into_iter().zip(observations).map(photo).collect();
    let points = points.into_iter().map(DVec3::from).collect();
    Photos { photos, points, colors, origin, remarks, ..Photos::default() }
}
