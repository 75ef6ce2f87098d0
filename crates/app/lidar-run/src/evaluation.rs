//! `splatweaver eval-trajectory`.

use crate::LidarRunError;
use clap::Args;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use weaver_command::{Console, Failure};
use weaver_geometry::Pose;
use weaver_io::TrajectoryFile;
use weaver_lidar::{TrajectoryErrors, trajectory_errors};

/// Compares a trajectory with a reference (KITTI or TUM): absolute and relative errors.
///
/// Poses belong together by their order where both files have as many, else by their times.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver eval-trajectory runs/street/trajectory.txt poses.txt
  splatweaver eval-trajectory estimate.txt reference.txt --json")]
pub struct EvalTrajectory {
    /// The trajectory
    #[arg(value_name = "ESTIMATE")]
    estimate: PathBuf,
    /// The trajectory that it should be
    #[arg(value_name = "REFERENCE")]
    reference: PathBuf,
    /// Prints figures as JSON
    #[arg(long)]
    json: bool,
}

/// Errors of a trajectory.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Errors {
    /// Root mean square distance after the best rigid motion, meters.
    pub ate_m: f64,
    /// The same with equal first poses, meters.
    pub ate_first_m: f64,
    /// Root mean square error of consecutive relative translations, meters.
    pub rpe_m: f64,
    /// Mean relative error of translations, percent.
    pub rpe_percent: f64,
    /// Root mean square error of consecutive relative rotations, degrees.
    pub rpe_degrees: f64,
    /// Length of the reference, meters.
    pub length_m: f64,
    /// Poses that were compared.
    pub poses: usize,
}

impl Errors {
    pub(crate) fn new(errors: TrajectoryErrors, poses: usize) -> Self {
        Self {
            ate_m: errors.ate,
            ate_first_m: errors.ate_first,
            rpe_m: errors.rpe,
            rpe_percent: errors.rpe_percent,
            rpe_degrees: errors.rpe_degrees,
            length_m: errors.length,
            poses,
        }
    }

    /// A line for people.
    pub(crate) fn text(&self) -> String {
        format!(
            "ATE {:.2} cm ({:.2} cm with equal first poses), RPE {:.2} cm, {:.2} %, {:.3} degrees; {} poses over {:.1} m",
            100.0 * self.ate_m,
            100.0 * self.ate_first_m,
            100.0 * self.rpe_m,
            self.rpe_percent,
            self.rpe_degrees,
            self.poses,
            self.length_m
        )
    }
}

/// Runs `splatweaver eval-trajectory`.
///
/// Fails where files cannot be read or have no poses in common.
pub fn eval_trajectory(arguments: &EvalTrajectory, console: &mut Console) -> Result<(), Failure> {
    let [estimate, reference] =
        [TrajectoryFile::read(&arguments.estimate)?, TrajectoryFile::read(&arguments.reference)?];
    let errors = paired_errors(&estimate, &reference, &arguments.reference)?;
    match arguments.json {
        true => console.print(&serde_json::to_string_pretty(&errors)?),
        false => console.print(&errors.text()),
    }
}

/// The errors of the poses that two trajectories have in common; `path` is the reference's, for messages.
///
/// # Errors
/// When these are fewer than two.
pub fn paired_errors(
    estimate: &TrajectoryFile,
    reference: &TrajectoryFile,
    path: &Path,
) -> Result<Errors, LidarRunError> {
    let pairs: Vec<(Pose, Pose)> = match estimate.poses.len() == reference.poses.len() {
        true => estimate.poses.iter().copied().zip(reference.poses.iter().copied()).collect(),
        false => by_times(estimate, reference),
    };
    if pairs.len() < 2 {
        return Err(LidarRunError::Invalid {
            path: path.into(),
            what: "poses",
            expected: format!("at least two of the {} times of the estimate", estimate.poses.len()),
            found: pairs.len().to_string(),
        });
    }
    let (estimate, reference): (Vec<Pose>, Vec<Pose>) = pairs.into_iter().unzip();
    Ok(Errors::new(trajectory_errors(&estimate, &reference), estimate.len()))
}

/// Each pose of the estimate with the one of the reference that is nearest in time, within half of the reference's mean step.
fn by_times(estimate: &TrajectoryFile, reference: &TrajectoryFile) -> Vec<(Pose, Pose)> {
    let times = &reference.times;
    let step = (times[times.len() - 1] - times[0]) / (times.len().max(2) - 1) as f64;
    let nearest = |time: f64| {
        let after = times.partition_point(|other| *other < time);
        let near = [after.checked_sub(1), (after < times.len()).then_some(after)];
        let away = |i: &usize| (times[*i] - time).abs();
        let best = near.into_iter().flatten().min_by(|a, b| away(a).total_cmp(&away(b)));
        best.filter(|i| away(i) <= step / 2.0)
    };
    let pairs = estimate.times.iter().zip(&estimate.poses);
    pairs.filter_map(|(time, pose)| Some((*pose, reference.poses[nearest(*time)?]))).collect()
}
