//! `splatweaver align`.

mod guess;
mod results;

use crate::arguments::{Align, LossName, MethodName, Switch};
use results::{Results, Row};
use std::path::PathBuf;
use weaver_align::{AlignError, Method, Options, Photo, Scene, align, mean_square};
use weaver_command::DrawingOptions;
use weaver_command::{Console, Failure, Progress};
use weaver_data::posed::{PosedOptions, PosedPhoto, load_frames, load_named};
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Pose};
use weaver_io::{SceneFile, read_scene};
use weaver_splat::CpuRasterizer;
use weaver_trainer::AlignLoss;

pub fn run(arguments: &Align, console: &mut Console) -> Result<(), Failure> {
    let read = arguments.photos.iter().chain([&arguments.scene]).chain(&arguments.cameras);
    let mut results = Results::claim(&arguments.out, read)?;
    let SceneFile { gaussians, drawing } = read_scene(&arguments.scene)?;
    let (background, settings) = DrawingOptions::from(arguments.drawing).beside(&arguments.scene, drawing)?;
    let gaussians = gaussians.to_activated();
    let paths = paths(&arguments.photos)?;
    let loading = PosedOptions {
        long_side: arguments.long_side.map(|size| size as usize),
        masks: arguments.masks,
        background,
        ..PosedOptions::default()
    };
    let photos = match &arguments.cameras {
        Some(file) => load_named(file, &paths, &loading)?,
        None => {
            let (frames, file) = guess::nearest(&arguments.scene, &gaussians, &paths, background, &settings)?;
            load_frames(frames, &file, &loading)?
        }
    };
    let options = Options {
        blur: arguments.blur == Switch::On,
        intrinsics: arguments.refine_focal,
        ..options(arguments.method, arguments.steps)
    };
    let loss = loss(arguments.loss, arguments.method);
    let mut compare = loss.function();
    let least = loss.least_side();
    if let Some(photo) = photos.iter().find(|photo| photo.camera.width.min(photo.camera.height) < least) {
        let (name, Camera { width, height, .. }) = (photo.path.display(), photo.camera);
        let expected = format!("--loss ssim: expected photos of at least {least} x {least} pixels");
        return Err(Failure::message(format!("{name}: {expected}, found {width} x {height}")));
    }
    results.check(&photos)?;
    let scene = Scene { gaussians: gaussians.as_slices(), background, settings, unit: unit(&photos) };
    let mut progress = Progress::new("align", 0, photos.len(), console);
    for (done, photo) in photos.iter().enumerate() {
        let pixels: Vec<f32> = photo.rgb.iter().map(|b| f32::from(*b) / 255.0).collect();
        let asked = [Photo { pixels: &pixels, mask: photo.mask.as_deref(), camera: photo.camera }];
        let named = |error: AlignError| Failure::message(format!("{}: {error}", photo.path.display()));
        let aligned = align(&CpuRasterizer, &scene, &asked, &options, &mut compare).map_err(named)?;
        // Whatever was compared: decibels of all that masks leave, which users know.
        let decibels = |camera: Camera| -> Result<f64, Failure> {
            let still = Options { steps: 0, ..Options::of(Method::NoPoSplat) };
            let there = [Photo { camera, ..asked[0] }];
            let drawn = align(&CpuRasterizer, &scene, &there, &still, mean_square).map_err(named)?;
            Ok(-10.0 * drawn[0].loss[0].max(1e-10).log10())
        };
        for aligned in aligned {
            let psnr = [decibels(photo.camera)?, decibels(aligned.camera)?];
            results.push(Row { photo, aligned, psnr })?;
        }
        progress.at(done + 1, photos.len(), || photo.name.clone(), console);
    }
    progress.finish();
    console.print(&results.finish()?)
}

/// The photos; of a folder those in it. None is no mistake: then there is nothing to do.
fn paths(asked: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let mut paths = Vec::new();
    for path in asked {
        match path.is_dir() {
            true => paths.extend(weaver_io::list_photos(path)?),
            false => paths.push(path.clone()),
        }
    }
    Ok(paths)
}

/// What photos are compared by, or what the method does.
pub fn loss(asked: Option<LossName>, method: MethodName) -> AlignLoss {
    match asked {
        None => AlignLoss::of(method.into()),
        Some(LossName::Mse) => AlignLoss::MeanSquare,
        Some(LossName::Photometric) => AlignLoss::Photometric,
        Some(LossName::Ssim) => AlignLoss::Similarity,
    }
}

impl From<MethodName> for Method {
    fn from(name: MethodName) -> Self {
        match name {
            MethodName::Own => Self::Own,
            MethodName::TwoXplat => Self::TwoXplat,
            MethodName::NoPoSplat => Self::NoPoSplat,
        }
    }
}

/// How cameras descend by a method, in so many steps or as many as it usually has.
pub fn options(method: MethodName, steps: Option<u32>) -> Options {
    let options = Options::of(method.into());
    Options { steps: steps.map_or(options.steps, |steps| steps as usize), ..options }
}

/// The length that 2Xplat divides by: the largest coordinate of a camera, from the middle of all; 1 for one camera.
fn unit(photos: &[PosedPhoto]) -> f64 {
    let centers = || photos.iter().map(|photo| Pose::center(&photo.camera.pose));
    let middle = centers().sum::<DVec3>() / photos.len().max(1) as f64;
    let largest = centers().map(|center| (center - middle).abs().max_element()).fold(0.0, f64::max);
    if largest > 0.0 { largest } else { 1.0 }
}
