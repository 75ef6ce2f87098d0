//! The end of a fit, as it is printed.

use std::path::Path;
use weaver_command::{Console, Failure, Interrupt, ShellCommand, duration};
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
    let memory = weaver_io::peak_mb().map_or(String::new(), |peak| format!(", at most {peak:.0} MB of memory"));
    let left_out = match outcome.left_out {
        0 => String::new(),
        count => format!(", of which {count} were left out to end in time"),
    };
    console.note(&format!("{} steps{left_out}, {}{memory}", outcome.steps, duration(outcome.seconds)));
    outcome.missing.iter().for_each(|missing| console.note(&format!("warning: not written: {missing}")));
    for name in &outcome.outliers {
        console.note(&format!("warning: {name} is met far worse than the other photos; it may show something else"));
    }
    if !outcome.transients.is_empty() {
        let most = 100.0 * outcome.transients.values().fold(0.0, |a: f64, b| a.max(*b));
        let count = outcome.transients.len();
        console.note(&format!(
            "in {count} photos something was left out that no other photo shows, at most {most:.0} % of a photo: {}",
            path("transients")
        ));
    }
    if outcome.steps < outcome.planned {
        let (done, planned) = (outcome.steps, outcome.planned);
        let resume = ShellCommand::new("splatweaver fit --resume").path(folder);
        console.note(&format!("ended at step {done} of {planned}; to go on: {resume}"));
    }
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
