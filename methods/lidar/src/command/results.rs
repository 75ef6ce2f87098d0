//! Results of a run beside its report.

use crate::command::evaluation::Errors;
use crate::command::{LidarJob, LidarPlan, LidarRunError};
use serde::{Deserialize, Serialize};
use std::fmt::Write;
use weaver_geometry::glam::{DQuat, DVec3};
use weaver_io::{TrajectoryFile, TrajectoryFormat, write_gaussians, write_text};
use weaver_run::Folder;
use weaver_scene::Gaussians;
use weaver_scene::forms::harmonic;
use weaver_surfel::Surfels;

/// The file of poses.
pub(crate) const TRAJECTORY: &str = "trajectory.txt";
/// The file of keyframes.
pub(crate) const KEYFRAMES: &str = "keyframes.toml";
/// The file of surfels.
pub(crate) const MAP: &str = "map.ply";

/// Logarithm of the thickness of surfels as Gaussians, a tenth of a millimeter.
const THICKNESS: f32 = -9.21;

/// The outcome of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Scans with a pose.
    pub scans: usize,
    /// Scans of the folder.
    pub of: usize,
    /// Scans that were lost.
    pub lost: usize,
    /// The numbers of the keyframe scans.
    pub keyframes: Vec<usize>,
    /// Surfels of all maps.
    pub surfels: usize,
    /// Length of the trajectory, meters.
    pub length_m: f64,
    /// Mean share of a scan that fits the map, over tracked scans.
    pub fitness: f64,
    /// Errors, given a reference.
    pub errors: Option<Errors>,
}

impl Summary {
    /// Lines for people.
    pub(crate) fn text(&self) -> String {
        let Self { scans, of, lost, surfels, length_m, fitness, errors, .. } = self;
        let keyframes = self.keyframes.len();
        let mut text = format!(
            "{scans} of {of} scans, {lost} lost; {keyframes} keyframes, {surfels} surfels; {length_m:.2} m, mean fitness {fitness:.2}"
        );
        if let Some(errors) = errors {
            text += &format!("\n{}", errors.text());
        }
        text
    }
}

/// Writes trajectory, keyframes and map.
pub(crate) fn write(job: &mut LidarJob, folder: &Folder) -> Result<Summary, LidarRunError> {
    let poses = job.odometry().poses().to_vec();
    let times = (0..poses.len()).map(|i| i as f64).collect();
    let trajectory = TrajectoryFile { poses, times };
    trajectory.write(folder.out().file(TRAJECTORY)?, TrajectoryFormat::Tum)?;
    write_text(folder.out().file(KEYFRAMES)?, &graph(job, &trajectory))?;
    let surfels = job.odometry().mapper().all();
    write_gaussians(folder.out().file(MAP)?, &gaussians(&surfels))?;
    let records = job.records();
    let steps = trajectory.poses.windows(2).map(|pair| pair[0].translation.distance(pair[1].translation));
    let tracked: Vec<f64> = records.iter().filter(|record| !record.lost).map(|record| record.fitness).collect();
    let errors = match &job.plan().reference {
        None => None,
        Some(path) => {
            let reference = LidarPlan::trajectory(path, job.files().len())?.poses;
            let own = &trajectory.poses;
            (own.len() >= 2).then(|| Errors::new(own, &reference[..own.len()]))
        }
    };
    Ok(Summary {
        scans: records.len(),
        of: job.files().len(),
        lost: records.iter().filter(|record| record.lost).count(),
        keyframes: records.iter().enumerate().filter(|(_, record)| record.keyframe).map(|(i, _)| i).collect(),
        surfels: surfels.len(),
        length_m: steps.sum(),
        fitness: tracked.iter().sum::<f64>() / tracked.len().max(1) as f64,
        errors,
    })
}

/// Keyframes and the edges between consecutive ones as TOML.
fn graph(job: &LidarJob, trajectory: &TrajectoryFile) -> String {
    let mut text = String::from("# Sensor to world: position x y z, quaternion x y z w.\n");
    let keyframes = job.records().iter().enumerate().filter(|(_, record)| record.keyframe).map(|(i, _)| i);
    let keyframes: Vec<usize> = keyframes.collect();
    for i in &keyframes {
        let ([w, x, y, z], t) = (trajectory.poses[*i].wxyz(), trajectory.poses[*i].translation);
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "\n[[keyframe]]\nscan = {i}\nposition = [{}, {}, {}]\nquaternion = [{x}, {y}, {z}, {w}]\n",
            t.x, t.y, t.z
        );
    }
    for pair in keyframes.windows(2) {
        let _ = write!(text, "\n[[edge]]\nfrom = {}\nto = {}\nkind = \"odometry\"\n", pair[0], pair[1]);
    }
    text
}

/// Surfels as Gaussians of a tenth of a millimeter's thickness, in the colors of their normals: gray ones would show
/// nothing of their shape.
pub(crate) fn gaussians(surfels: &Surfels<f32>) -> Gaussians {
    let color = |q: &[f32]| -> [f32; 3] {
        let normal = DQuat::from_xyzw(q[1].into(), q[2].into(), q[3].into(), q[0].into()).normalize() * DVec3::Z;
        let up = if normal.z < 0.0 { -normal } else { normal };
        (0.5 + 0.5 * up).as_vec3().to_array().map(harmonic)
    };
    let triples = |x: &[f32]| x.chunks_exact(3).map(|x| [x[0], x[1], x[2]]).collect();
    Gaussians {
        means: triples(&surfels.centers),
        log_scales: surfels.log_scales.chunks_exact(2).map(|s| [s[0], s[1], THICKNESS]).collect(),
        quats: surfels.quats.chunks_exact(4).map(|q| [q[0], q[1], q[2], q[3]]).collect(),
        opacity_logits: surfels.opacity_logits.clone(),
        sh: surfels.quats.chunks_exact(4).flat_map(color).collect(),
        degree: 0,
    }
}

/// The surfels of a written map.
pub(crate) fn surfels(gaussians: &Gaussians) -> Surfels<f32> {
    Surfels {
        centers: gaussians.means.concat(),
        quats: gaussians.quats.concat(),
        log_scales: gaussians.log_scales.iter().flat_map(|s| [s[0], s[1]]).collect(),
        opacity_logits: gaussians.opacity_logits.clone(),
    }
}
