//! The page about a run.

use crate::alignment;
use crate::command::plan::name;
use crate::command::results::Summary;
use crate::command::{LidarJob, LidarPlan, LidarRunError, maps};
use weaver_run::{Folder, Page};

/// Titles of curves in place of the log's keys.
pub const CURVES: [(&str, &str); 1] = [("range_error", "mean difference of ranges at keyframes, m")];

/// Number of keyframes in the page.
const SHOWN: usize = 3;

/// Writes the page.
pub(crate) fn leave(job: &mut LidarJob, summary: &Summary, folder: &Folder) -> Result<(), LidarRunError> {
    let mut page = Page::new("Lidar odometry and mapping");
    page.heading(1, "Lidar odometry and mapping").preformatted(&summary.text());
    let poses = job.odometry().poses().to_vec();
    let keyframes = job.records().iter().enumerate().filter(|(_, record)| record.keyframe).map(|(i, _)| i);
    let keyframes: Vec<usize> = keyframes.collect();
    let mut reference = match &job.plan().reference {
        Some(path) => LidarPlan::trajectory(path, job.files().len())?.poses,
        None => Vec::new(),
    };
    reference.truncate(poses.len());
    if reference.len() >= 2 {
        let motion = alignment(&reference, &poses);
        reference.iter_mut().for_each(|pose| *pose = motion.compose(pose));
    }
    page.heading(2, "Trajectory");
    let (image, scale) = maps::trajectory(&poses, &reference, &keyframes);
    let gray = if reference.is_empty() { "" } else { "; gray: the reference, moved onto it" };
    page.picture(&format!("from above, {scale:.1} pixels a meter; blue: the trajectory; red: keyframes{gray}"), &image);
    ranges(job, &keyframes, &mut page)?;
    let centers = job.odometry().mapper().all().centers;
    if !centers.is_empty() {
        page.heading(2, "Map");
        page.picture("centers of surfels from above", &maps::map(&centers, [0, 1]));
        page.picture("from the side", &maps::map(&centers, [0, 2]));
    }
    lost(job, &mut page);
    page.curves(&folder.records()?, &CURVES);
    Ok(folder.report(&page)?)
}

/// Measured and drawn range images of a few keyframes of the current map.
fn ranges(job: &mut LidarJob, keyframes: &[usize], page: &mut Page) -> Result<(), LidarRunError> {
    // Earlier maps cannot be drawn any more.
    let current: Vec<usize> = job.odometry().mapper().keyframes().iter().map(|keyframe| keyframe.scan).collect();
    let count = SHOWN.min(current.len());
    page.heading(2, "Range images");
    page.paragraph(&format!(
        "Of {} keyframes, {count}: measured, drawn, their difference up to 0.2 m, and drawn normals (red, green, blue: forward, left, up). \
         Black: nothing there.",
        keyframes.len()
    ));
    for k in 0..count {
        let scan = current[k * current.len() / count];
        let pose = job.odometry().poses()[scan];
        let frame = job.frame(scan)?;
        let width = frame.camera.width;
        let images = job.odometry_mut().mapper_mut().draw(&pose)?;
        let normals = images.normal.clone();
        let seen = images.mean_range().into_iter().zip(&images.opacity);
        let drawn: Vec<f32> = seen.map(|(r, a)| if *a > 0.5 { r } else { 0.0 }).collect();
        let mut sorted: Vec<f32> = frame.range.iter().copied().filter(|r| *r > 0.0).collect();
        sorted.sort_by(f32::total_cmp);
        let most = sorted.get(sorted.len() * 19 / 20).copied().unwrap_or(1.0);
        page.heading(3, &name(&job.files()[scan]));
        let caption = |what: &str| format!("{what}, up to {most:.0} m");
        page.picture(&caption("measured"), &maps::ranges(&frame.range, width, most));
        page.picture(&caption("drawn"), &maps::ranges(&drawn, width, most));
        page.picture("difference, up to 0.2 m", &maps::differences(&drawn, &frame.range, width, 0.2));
        page.picture("normals", &maps::normals(&normals, width));
    }
    Ok(())
}

/// The lost scans.
fn lost(job: &LidarJob, page: &mut Page) {
    let lost = job.records().iter().zip(job.files()).filter(|(record, _)| !record.remark.is_empty());
    let rows: Vec<[String; 2]> = lost.map(|(record, file)| [name(file), record.remark.clone()]).collect();
    if !rows.is_empty() {
        page.heading(2, "Scans that were lost, or whose ranges were not used");
        page.table(&["scan", "why"], &rows);
    }
}
