//! What a run is asked for.

use crate::LidarRunError;
use clap::Args;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use weaver_command::{MOST_SEED, rows_and_columns};
use weaver_io::{LIDAR_FORMATS, TrajectoryFile, list_files, read_lidar_scan};
use weaver_lidar::{LoopSettings, MapSettings, Scan, SurfelCamera, TrackSettings};

/// Scans and settings of a run: kept beside a checkpoint.
#[derive(Args, Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LidarPlan {
    /// Folder of scans (.bin as KITTI has them, .ply, .pcd, .npy), taken in the order of their names
    #[arg(value_name = "SCANS", required_unless_present = "resume")]
    pub scans: Option<PathBuf>,
    /// Poses of the sensor (KITTI or TUM): only the map is made, nothing is tracked
    #[arg(long, value_name = "FILE")]
    pub poses: Option<PathBuf>,
    /// Trajectory to compare the result with (KITTI or TUM)
    #[arg(long, value_name = "FILE", conflicts_with = "poses")]
    pub reference: Option<PathBuf>,
    /// Rows and columns of range images
    #[arg(long, value_name = "HxW", default_value = "64x1024", value_parser = rows_and_columns)]
    pub size: [usize; 2],
    /// Lowest and highest elevation in degrees [default: those of the first scan and half a degree more]
    #[arg(long, value_name = "LOW,HIGH", value_parser = pair, allow_hyphen_values = true)]
    pub fov: Option<[f64; 2]>,
    /// Least and largest range of points that are used, meters
    #[arg(long, value_name = "NEAR,FAR", default_value = "1,60", value_parser = pair)]
    pub range: [f64; 2],
    /// Steps of optimization at each keyframe
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u32).range(..=100_000))]
    pub steps: u32,
    /// Surfels for each pixel of a keyframe that is not covered yet
    #[arg(long, value_name = "SHARE", default_value_t = 0.3)]
    pub density: f64,
    /// Distance to the last keyframe at which a scan becomes the next, meters
    #[arg(long, value_name = "METERS", default_value_t = 5.0)]
    pub keyframe_distance: f64,
    /// Points are moved to where the sensor was at the beginning of the sweep, by their times
    #[arg(long)]
    pub deskew: bool,
    /// Keyframes that come back are registered to earlier ones, and the trajectory is bent so that all agree
    #[arg(long, conflicts_with_all = ["poses", "deskew"])]
    pub loops: bool,
    /// Seed of everything that is drawn at random
    #[arg(long, value_name = "S", default_value_t = 0, value_parser = clap::value_parser!(u64).range(..=MOST_SEED))]
    pub seed: u64,
}

/// Two numbers with a comma between.
fn pair(text: &str) -> Result<[f64; 2], String> {
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|x| x.trim().parse().ok().filter(|x: &f64| x.is_finite())).collect();
    match numbers.as_deref() {
        Some(&[low, high]) if low < high => Ok([low, high]),
        _ => Err(format!("expected two numbers, the smaller first, as 3,60; found {text}")),
    }
}

impl LidarPlan {
    /// The same with paths that hold wherever a run is resumed from.
    pub(crate) fn absolute(self) -> std::io::Result<Self> {
        let absolute = |path: Option<PathBuf>| path.map(std::path::absolute).transpose();
        Ok(Self {
            scans: absolute(self.scans)?,
            poses: absolute(self.poses)?,
            reference: absolute(self.reference)?,
            ..self
        })
    }

    /// The files of scans.
    pub(crate) fn files(&self) -> Result<Vec<PathBuf>, LidarRunError> {
        let folder = self.scans.as_deref().unwrap_or(Path::new("."));
        let files = list_files(folder, &LIDAR_FORMATS)?;
        match files.len() {
            0 | 1 => Err(LidarRunError::Invalid {
                path: folder.into(),
                what: "scans",
                expected: "at least two that end in .bin, .ply, .pcd or .npy".into(),
                found: files.len().to_string(),
            }),
            _ => Ok(files),
        }
    }

    /// The trajectory in a file, which must have a pose for each of `scans` scans.
    pub(crate) fn trajectory(path: &Path, scans: usize) -> Result<TrajectoryFile, LidarRunError> {
        let file = TrajectoryFile::read(path)?;
        match file.poses.len() == scans {
            true => Ok(file),
            false => Err(LidarRunError::Invalid {
                path: path.into(),
                what: "poses",
                expected: format!("{scans}, one for each scan"),
                found: file.poses.len().to_string(),
            }),
        }
    }

    pub(crate) fn camera(&self, first: &Scan) -> SurfelCamera {
        let margin = 0.5_f64.to_radians();
        let (kept, _) = first.within(self.range);
        let of_scan = || {
            let [low, high] = kept.elevations();
            if low < high { [low - margin, high + margin] } else { [-margin, margin] }
        };
        let limits = self.fov.map_or_else(of_scan, |fov| fov.map(f64::to_radians));
        SurfelCamera::spherical([self.size[1], self.size[0]], limits)
    }

    pub(crate) fn map(&self) -> MapSettings {
        MapSettings {
            iterations: self.steps as usize,
            density: self.density,
            seed: self.seed,
            // Small surfels locate scans more exactly; where poses are given, large ones leave fewer holes.
            scale_mean: self.poses.is_some(),
            ..Default::default()
        }
    }

    pub(crate) fn track(&self) -> TrackSettings {
        TrackSettings {
            farthest: self.keyframe_distance,
            deskew: self.deskew,
            loops: self.loops.then(LoopSettings::default),
            ..Default::default()
        }
    }
}

/// Reads a scan.
pub(crate) fn read(path: &Path) -> Result<Scan, LidarRunError> {
    let file = read_lidar_scan(path)?;
    Ok(Scan { points: file.points, times: file.times })
}

/// The name of a scan in messages.
pub(crate) fn name(path: &Path) -> String {
    path.file_name().map_or(String::new(), |name| name.to_string_lossy().into_owned())
}
