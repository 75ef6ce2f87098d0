//! `splatweaver infer`.

use crate::Console;
use crate::arguments::Infer;
use crate::failure::Failure;
use std::path::PathBuf;
use weaver_trainer::infer::{self, Options};

pub fn run(arguments: &Infer, console: &mut Console) -> Result<(), Failure> {
    let images = photos(&arguments.images)?;
    let options = Options {
        cameras: arguments.cameras.clone(),
        allocation: arguments.dial.allocation,
        budget: arguments.dial.budget,
    };
    let report = infer::run(&arguments.run, &images, &options, &arguments.out)?;
    for remark in &report.remarks {
        console.note(remark);
    }
    console.print(&format!(
        "{} Gaussians, {:.3} per pixel; the input views come back at {:.2} dB\nscene: {}\noverview: {}",
        report.gaussians,
        report.gaussians_per_pixel,
        report.psnr,
        arguments.out.join("scene.ply").display(),
        report.overview.display()
    ))
}

/// The photos, folders replaced by what is in them.
fn photos(paths: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let mut photos = Vec::new();
    for path in paths {
        if !path.is_dir() {
            photos.push(path.clone());
            continue;
        }
        let found = weaver_io::list_files(path, &["png", "jpg", "jpeg"])?;
        if found.is_empty() {
            return Err(Failure::message(format!("{}: expected photos (PNG or JPEG), found none", path.display())));
        }
        photos.extend(found);
    }
    Ok(photos)
}
