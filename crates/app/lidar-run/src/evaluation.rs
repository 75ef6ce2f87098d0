//! `splatweaver eval-trajectory`.

use crate::LidarRunError;
use crate::results::Errors;
use clap::Args;
use std::path::{Path, PathBuf};
use weaver_command::{Console, Failure};
use weaver_geometry::Pose;
use weaver_io::TrajectoryFile;
use weaver_lidar::trajectory_errors;

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
    /// What it should be
    #[arg(value_name = "REFERENCE")]
    reference: PathBuf,
    /// Prints figures as JSON
    #[arg(long)]
    json: bool,
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
