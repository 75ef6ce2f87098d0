//! The section of a report about estimated cameras.

use std::path::Path;
use weaver_data::{CameraSummary, CamerasSummary};
use weaver_run::Page;

/// The picture of the points that photos share, beside the cameras.
const POINTS: &str = "points.png";

/// Puts a warning on top of the page where cameras are doubtful.
pub fn warning(cameras: &CamerasSummary, page: &mut Page) {
    if let Some(doubt) = &cameras.doubt {
        let help = cameras.help.as_deref().unwrap_or_default();
        page.warning(&format!("The cameras of this scene are doubtful: {doubt}; {help}."));
    }
}

/// Section about the exactness of the cameras.
pub fn section(cameras: &CamerasSummary, capture: &Path, page: &mut Page) {
    page.heading(2, "Estimated cameras");
    let number = |x: Option<f64>, digits: usize| x.map_or("unknown".into(), |x| format!("{x:.digits$}"));
    let placed = || cameras.photos.values().filter(|photo| photo.left_out.is_none());
    let most = |of: &dyn Fn(&CameraSummary) -> Option<f64>| placed().filter_map(of).reduce(f64::max);
    let part = |center: Option<f64>| Some(100.0 * center? / cameras.spread_of_centers?);
    page.paragraph(&format!(
        "{} of {} photos have a camera; {} points, off by {} pixels in the median. Focal length {} +- {} of the longer side. \
         Rotations are within +- {} degrees, centers within +- {} % of their spread: the standard deviations of the camera that is told least.",
        placed().count(),
        cameras.photos.len(),
        cameras.points,
        number(cameras.error_pixels, 2),
        number(cameras.focal_length, 3),
        number(cameras.focal_length_deviation, 3),
        number(most(&|photo| photo.rotation_deviation_degrees), 2),
        number(most(&|photo| part(photo.center_deviation)), 1),
    ));
    let row = |(name, photo): (&String, &CameraSummary)| match &photo.left_out {
        Some(reason) => [name.clone(), format!("left out: {reason}"), String::new(), String::new(), String::new()],
        None => [
            name.clone(),
            photo.points.to_string(),
            number(photo.focal_length, 3),
            number(photo.rotation_deviation_degrees, 3),
            number(part(photo.center_deviation), 2),
        ],
    };
    let header = ["photo", "points", "focal length", "rotation +-, degrees", "center +-, % of the spread"];
    page.table(&header, &cameras.photos.iter().map(row).collect::<Vec<_>>());
    let folder = if capture.is_dir() { Some(capture) } else { capture.parent() };
    let points = folder.map(|folder| folder.join(POINTS)).filter(|points| points.is_file());
    // A picture that is not there is no reason to lose a report.
    if let Some(points) = points {
        page.paragraph(
            "What of each photo was found in others: green where it is exact, red where it is off by two pixels.",
        );
        let _ = page.picture_file(points);
    }
}
