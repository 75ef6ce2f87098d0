//! Settings of a run.

use crate::command::LidarRunError;
use crate::command::sources::Sources;
use crate::{LoopSettings, MapSettings, Scan, SurfelCamera, TrackSettings};
use clap::Args;
use serde::{Deserialize, Serialize};
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use weaver_command::{MOST_SEED, rows_and_columns};
use weaver_io::{LIDAR_FORMATS, TrajectoryFile, list_files, read_lidar_scan};

/// Scans and settings of a run: kept beside a checkpoint.
#[derive(Args, Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LidarPlan {
    /// Folder of scans (.bin as KITTI has them, .ply, .pcd, .npy), taken in the order of their names, in which numbers
    /// count as such
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
    #[arg(long, value_name = "LOW,HIGH", value_parser = elevations, allow_hyphen_values = true)]
    pub fov: Option<[f64; 2]>,
    /// Least and largest range of points that are used, meters
    #[arg(long, value_name = "NEAR,FAR", default_value = "1,60", value_parser = ranges)]
    pub range: [f64; 2],
    /// Steps of optimization at each keyframe
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u32).range(..=100_000))]
    pub steps: u32,
    /// Surfels for each pixel of a keyframe that is not covered yet
    #[arg(long, value_name = "SHARE", default_value_t = 0.3, value_parser = share)]
    pub density: f64,
    /// Distance to the last keyframe at which a scan becomes the next, meters
    #[arg(long, value_name = "METERS", default_value_t = 5.0, value_parser = distance)]
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
    /// The scans that the run began with; none in runs of earlier versions.
    #[arg(skip)]
    #[serde(default)]
    pub(crate) sources: Option<Sources>,
}

/// Two numbers with a comma between, the smaller first.
fn pair(text: &str) -> Option<[f64; 2]> {
    let number = |text: &str| text.trim().parse().ok().filter(|x: &f64| x.is_finite());
    let (low, high) = text.split_once(',')?;
    Some([number(low)?, number(high)?]).filter(|[low, high]| low < high)
}

/// Elevations in degrees, the lower first.
fn elevations(text: &str) -> Result<[f64; 2], String> {
    let within = |limits: &[f64; 2]| limits[0] >= -90.0 && limits[1] <= 90.0;
    pair(text)
        .filter(within)
        .ok_or(format!("expected two angles from -90 to 90, the smaller first, as -25,3; found {text}"))
}

/// Ranges in meters, the smaller first.
fn ranges(text: &str) -> Result<[f64; 2], String> {
    let within = |[near, _]: &[f64; 2]| *near >= 0.0;
    pair(text).filter(within).ok_or(format!("expected two ranges from 0 on, the smaller first, as 3,60; found {text}"))
}

/// A share above 0.
fn share(text: &str) -> Result<f64, String> {
    let within = |share: &f64| *share > 0.0 && *share <= 1.0;
    text.parse().ok().filter(within).ok_or(format!("expected a share above 0 up to 1; found {text}"))
}

/// Meters, at least 0.
fn distance(text: &str) -> Result<f64, String> {
    let within = |meters: &f64| *meters >= 0.0 && meters.is_finite();
    text.parse().ok().filter(within).ok_or(format!("expected meters from 0 on; found {text}"))
}

impl LidarPlan {
    /// The plan with absolute paths, which hold in every folder from which the run is resumed.
    pub(crate) fn absolute(self) -> std::io::Result<Self> {
        let absolute = |path: Option<PathBuf>| path.map(std::path::absolute).transpose();
        Ok(Self {
            scans: absolute(self.scans)?,
            poses: absolute(self.poses)?,
            reference: absolute(self.reference)?,
            ..self
        })
    }

    /// The equivalent words of the command line.
    pub(crate) fn words(&self) -> Vec<OsString> {
        // Field by field, so that none is forgotten.
        let Self {
            scans,
            poses,
            reference,
            size,
            fov,
            range,
            steps,
            density,
            keyframe_distance,
            deskew,
            loops,
            seed,
            sources: _,
        } = self;
        let pair = |[low, high]: &[f64; 2]| format!("{low},{high}");
        let mut words: Vec<OsString> = vec!["lidar".into()];
        let mut add = |flag: &str, value: Option<OsString>| words.extend(value.map(|value| joined(flag, &value)));
        add("--poses=", poses.clone().map(PathBuf::into_os_string));
        add("--reference=", reference.clone().map(PathBuf::into_os_string));
        add("--size=", Some(format!("{}x{}", size[0], size[1]).into()));
        add("--fov=", fov.as_ref().map(|fov| pair(fov).into()));
        add("--range=", Some(pair(range).into()));
        add("--steps=", Some(steps.to_string().into()));
        add("--density=", Some(density.to_string().into()));
        add("--keyframe-distance=", Some(keyframe_distance.to_string().into()));
        add("--deskew", deskew.then(OsString::new));
        add("--loops", loops.then(OsString::new));
        add("--seed=", Some(seed.to_string().into()));
        words.push("--".into());
        words.extend(scans.clone().map(PathBuf::into_os_string));
        words
    }

    fn folder(&self) -> &Path {
        self.scans.as_deref().unwrap_or(Path::new("."))
    }

    /// The plan with checksums of the present scans, for a new run.
    ///
    /// # Errors
    /// When they are fewer than two.
    pub(crate) fn begun(self) -> Result<Self, LidarRunError> {
        let sources = Some(Sources::of(self.folder())?);
        let plan = Self { sources, ..self };
        plan.files()?;
        Ok(plan)
    }

    /// Checks that the scans are unchanged since the run began. Runs of earlier versions have no checksums and pass.
    ///
    /// # Errors
    /// Names the first changed scan.
    pub(crate) fn check_sources(&self) -> Result<(), LidarRunError> {
        self.sources.as_ref().map_or(Ok(()), |began| began.check(self.folder()))
    }

    /// The files of scans in the order of processing. Runs of earlier versions took them in the order of the bytes of
    /// their names.
    pub(crate) fn files(&self) -> Result<Vec<PathBuf>, LidarRunError> {
        let folder = self.folder();
        let files = match &self.sources {
            Some(sources) => sources.files(folder),
            None => list_files(folder, &LIDAR_FORMATS)?,
        };
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
            // Small surfels locate scans more exactly; with given poses, large ones leave fewer holes.
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

/// A flag with its value.
fn joined(flag: &str, value: &OsStr) -> OsString {
    let mut word = OsString::from(flag);
    word.push(value);
    word
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
