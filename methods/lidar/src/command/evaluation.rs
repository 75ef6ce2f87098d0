//! `splatweaver eval-trajectory`.

use crate::command::LidarRunError;
use crate::trajectory_errors;
use clap::Args;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use weaver_command::{Console, Failure};
use weaver_geometry::Pose;
use weaver_io::TrajectoryFile;

/// Compares a trajectory with a reference (KITTI or TUM): absolute and relative errors.
///
/// Poses belong together by their order where both files have as many, else by their times; files that have as many and
/// no time in common are refused.
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
    /// Root mean square distance with equal first poses, meters.
    pub ate_first_m: f64,
    /// Root mean square error of consecutive relative translations, meters.
    pub rpe_m: f64,
    /// Mean relative error of translations, percent; `None` for a reference without motion.
    pub rpe_percent: Option<f64>,
    /// Root mean square error of consecutive relative rotations, degrees.
    pub rpe_degrees: f64,
    /// Length of the reference, meters.
    pub length_m: f64,
    /// Poses that were compared.
    pub poses: usize,
}

impl Errors {
    /// The errors of poses paired by their order, at least two.
    pub(crate) fn new(estimate: &[Pose], reference: &[Pose]) -> Self {
        let (errors, poses) = (trajectory_errors(estimate, reference), estimate.len());
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
        let percent = self.rpe_percent.map_or(String::new(), |percent| format!("{percent:.2} %, "));
        format!(
            "ATE {:.2} cm ({:.2} cm with equal first poses), RPE {:.2} cm, {percent}{:.3} degrees; {} poses over {:.1} m",
            100.0 * self.ate_m,
            100.0 * self.ate_first_m,
            100.0 * self.rpe_m,
            self.rpe_degrees,
            self.poses,
            self.length_m
        )
    }
}

/// Runs `splatweaver eval-trajectory`.
///
/// Fails on unreadable files and on files without common poses.
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
/// When these are fewer than two, or the times for pairing have nothing in common.
pub fn paired_errors(
    estimate: &TrajectoryFile,
    reference: &TrajectoryFile,
    path: &Path,
) -> Result<Errors, LidarRunError> {
    let invalid = |what: &'static str, expected: String, found: String| LidarRunError::Invalid {
        path: path.into(),
        what,
        expected,
        found,
    };
    if estimate.poses.len() == reference.poses.len() && estimate.poses.len() >= 2 {
        if let (Some(own), Some(others)) = (span(estimate), span(reference))
            && (own[1] < others[0] || others[1] < own[0])
        {
            let [expected, found] = [own, others].map(|[first, last]| format!("{first} to {last}"));
            let expected = format!("some of those of the estimate, {expected}, or none, as in KITTI's files");
            return Err(invalid("times", expected, found));
        }
        return Ok(Errors::new(&estimate.poses, &reference.poses));
    }
    let (own, others): (Vec<Pose>, Vec<Pose>) = by_times(estimate, reference).into_iter().unzip();
    if own.len() < 2 {
        let expected = format!("at least two of the {} times of the estimate", estimate.poses.len());
        return Err(invalid("poses", expected, own.len().to_string()));
    }
    Ok(Errors::new(&own, &others))
}

/// The first and the last time of a trajectory with times.
fn span(trajectory: &TrajectoryFile) -> Option<[f64; 2]> {
    Some([*trajectory.times.first()?, *trajectory.times.last()?])
}

/// Poses that are each other's nearest in time, within half of the smaller mean step. Without times, the numbers of
/// poses count.
fn by_times(estimate: &TrajectoryFile, reference: &TrajectoryFile) -> Vec<(Pose, Pose)> {
    let times = |file: &TrajectoryFile| match file.times.as_slice() {
        [] => (0..file.poses.len()).map(|i| i as f64).collect(),
        times => times.to_vec(),
    };
    let (own, others) = (times(estimate), times(reference));
    let step = |times: &[f64]| (times[times.len() - 1] - times[0]) / (times.len().max(2) - 1) as f64;
    let reach = step(&own).min(step(&others)) / 2.0;
    let pairs = own.iter().enumerate().filter_map(|(i, time)| {
        let j = nearest(&others, *time);
        let belong = nearest(&own, others[j]) == i && (others[j] - time).abs() <= reach;
        belong.then(|| (estimate.poses[i], reference.poses[j]))
    });
    pairs.collect()
}

/// The index of the time nearest to `time`, the first of two equally near ones.
fn nearest(times: &[f64], time: f64) -> usize {
    let after = times.partition_point(|other| *other < time);
    let (before, after) = (after.saturating_sub(1), after.min(times.len() - 1));
    if (times[after] - time).abs() < (times[before] - time).abs() { after } else { before }
}
