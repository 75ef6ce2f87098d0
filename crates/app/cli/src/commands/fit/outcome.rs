//! The end of a fit, as it is printed.

use std::path::Path;
use weaver_command::{Console, Failure, Interrupt};
use weaver_fit::Quality;
use weaver_reconstruct::{Outcome, VIEW, Views};

/// Notes that a fit was stopped, which may have been wished at its page: what was stopped is no complete unit of work.
pub fn conclude(outcome: &Outcome, interrupt: &Interrupt) {
    if outcome.steps < outcome.planned {
        interrupt.request();
    }
}

/// Prints the quality of a scene, for people or as JSON.
pub fn print(outcome: &Outcome, folder: &Path, json: bool, console: &mut Console) -> Result<(), Failure> {
    let path = |name: &str| folder.join(name).display().to_string();
    let views = |name: &str, views: &Views| {
        let number = |x: Option<f64>, digits| x.map_or("-".into(), |x| format!("{x:.digits$}"));
        let Quality { psnr, psnr_aligned, ssim, lpips } = views.quality;
        let (aligned, ssim, lpips) = (number(psnr_aligned, 2), number(ssim, 4), number(lpips, 4));
        format!("{name:<10}{:>5}  {psnr:>7.2}  {aligned:>7}  {ssim:>6}  {lpips:>6}\n", views.views)
    };
    let test = match &outcome.test {
        Some(test) => views("held out", test),
        None => "held out   none\n".into(),
    };
    if json {
        return console.print(&serde_json::to_string_pretty(outcome)?);
    }
    console.print(&format!(
        "photos   views     PSNR  aligned    SSIM   LPIPS\n{test}{}{} Gaussians: {}\nreport: {}{}",
        views("fitted", &outcome.train),
        outcome.gaussians,
        path("scene.ply"),
        path("report.html"),
        if folder.join(VIEW).is_file() { format!("\nlook: {}", path(VIEW)) } else { String::new() }
    ))
}
