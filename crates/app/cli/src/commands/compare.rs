//! `splatweaver compare`: one file of Gaussians against the photos of a capture.

use crate::flags::LENSES;
use clap::Args;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use weaver_command::{
    Console, DeviceFlag, DrawingFlags, DrawingOptions, Failure, Progress, Threads, choice, device, in_pool,
};
use weaver_data::capture::posed::{self, Lenses, PosedOptions};
use weaver_fit::{Judge, Quality};
use weaver_io::{SceneFile, read_scene};
use weaver_reconstruct::Outcome;
use weaver_scene::Photo;
use weaver_splat::Renderer;
use weaver_trainer::evaluate::load_lpips;

/// Compares what a file of Gaussians shows with the photos of a capture.
///
/// At the photos' own size, by those that the capture holds out, or by all where it holds none out.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver compare fits/garden-1/scene.ply --data garden --lpips alex.safetensors
  splatweaver compare scene.spz --data garden --long-side 1600 --background black
  splatweaver compare scene.ply --data garden --json")]
pub struct Compare {
    /// The Gaussians, whose world is the capture's
    #[arg(value_name = "SCENE")]
    pub scene: PathBuf,
    /// Folder of the capture
    #[arg(long, value_name = "DIR")]
    pub data: PathBuf,
    /// Longest side of the photos in pixels; larger ones are shrunk [default: as they are]
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub long_side: Option<u32>,
    /// Does not count what is black in masks: mask_path of transforms.json, a file in masks/ named as the photo, or its alpha
    #[arg(long)]
    pub masks: bool,
    /// Lenses that bend straight lines: keep draws through them, undistort undoes them [default: keep from 120 degrees on]
    #[arg(long, value_parser = choice(&LENSES))]
    pub lens: Option<Lenses>,
    /// Also LPIPS, with the weights in this safetensors file
    #[arg(long, value_name = "WEIGHTS")]
    pub lpips: Option<PathBuf>,
    /// Prints the figures as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub device: DeviceFlag,
    #[command(flatten)]
    pub threads: Threads,
    // Last: its heading would be that of what follows.
    #[command(flatten)]
    pub drawing: DrawingFlags,
}

pub fn run(arguments: &Compare, console: &mut Console) -> Result<(), Failure> {
    in_pool(arguments.threads.count(), || compare(arguments, console))
}

fn compare(arguments: &Compare, console: &mut Console) -> Result<(), Failure> {
    let Compare { scene, data, .. } = arguments;
    let mut renderer = Renderer::new(device::rasterizer(&arguments.device)?);
    let judge = Judge::new(arguments.lpips.as_deref().map(load_lpips).transpose()?);
    let SceneFile { gaussians, drawing } = read_scene(scene)?;
    let (background, settings) = DrawingOptions::from(arguments.drawing).beside(scene, drawing)?;
    if gaussians.is_empty() {
        return Err(Failure::message(format!("{}: expected Gaussians to judge, found none", scene.display())));
    }
    let long_side = arguments.long_side.map(|side| side as usize);
    let masks = arguments.masks;
    // Devices draw pinholes.
    let chosen = device::name(&arguments.device).map_or(Lenses::Auto, |_| Lenses::Undistort);
    let lenses = arguments.lens.unwrap_or(chosen);
    let options = PosedOptions { long_side, background, masks, lenses, held_out_only: true, ..PosedOptions::default() };
    let capture = posed::load(data, &options)?;
    capture.remarks.iter().for_each(|remark| console.note(&format!("warning: {remark}")));
    let held_out = capture.photos.iter().any(|photo| photo.held_out);
    // Of a photo that is masked altogether, nothing can be judged.
    let photos = capture.photos.into_iter().map(|posed| posed.photo).filter(|photo| !photo.is_masked());
    let photos: Vec<Photo> = photos.collect();
    if !held_out {
        console.note(&format!("{}: no photo is held out; these are all of them", data.display()));
    }
    let fit = outcome_beside(scene);
    let activated = gaussians.to_activated();
    let mut progress = Progress::new("compare", 0, photos.len(), console);
    let mut views = Vec::new();
    for photo in &photos {
        let mut image = renderer
            .render_through(photo.model(), &activated, &[photo.camera], background, &settings)
            .map_err(|e| Failure::message(format!("{}: {e}", scene.display())))?
            .concat();
        if let Some(exposure) = fit.as_ref().and_then(|fit| fit.exposure_of(&photo.name)) {
            let drawn = image.clone();
            exposure.apply(&drawn, &mut image);
        }
        let quality = judge.compare_inside(&image, &photo.rgb, photo.size(), photo.mask.as_deref());
        views.push((photo.name.as_str(), quality));
        progress.at(views.len(), photos.len(), String::new, console);
    }
    progress.finish();
    let all: Vec<Quality> = views.iter().map(|(_, quality)| *quality).collect();
    let mean = Quality::mean(&all)
        .ok_or_else(|| Failure::message(format!("{}: expected at least one photo, found none", data.display())))?;
    if arguments.json {
        let views: Vec<Value> = views.iter().map(|(name, quality)| figures(Some(name), quality)).collect();
        let report = json!({
            "scene": scene.display().to_string(),
            "gaussians": gaussians.len(),
            "held_out": held_out,
            "views": views,
            "mean": figures(None, &mean),
        });
        return console.print(&serde_json::to_string_pretty(&report)?);
    }
    let kind = if held_out { "held out" } else { "all, none held out" };
    console.print(&format!("{}views: {} ({kind}), Gaussians: {}", table(&views, &mean), views.len(), gaussians.len()))
}

/// The outcome of the fit beside a scene; `None` where there is no such fit.
fn outcome_beside(scene: &Path) -> Option<Outcome> {
    let summary = weaver_io::read_text(scene.with_file_name("summary.json")).ok()?;
    serde_json::from_str(&summary).ok()
}

fn figures(name: Option<&str>, quality: &Quality) -> Value {
    let Quality { psnr, psnr_aligned, ssim, lpips } = quality;
    let mut figures = json!({ "psnr": psnr, "psnr_aligned": psnr_aligned, "ssim": ssim, "lpips": lpips });
    if let Some(name) = name {
        figures["name"] = name.into();
    }
    figures
}

fn table(views: &[(&str, Quality)], mean: &Quality) -> String {
    let width = views.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0).max("mean".len());
    let number = |value: Option<f64>, digits| value.map_or("-".into(), |value| format!("{value:.digits$}"));
    let mut text = format!("{:<width$}     PSNR  aligned    SSIM   LPIPS\n", "view");
    for (name, quality) in views.iter().copied().chain([("mean", *mean)]) {
        let Quality { psnr, psnr_aligned, ssim, lpips } = quality;
        let (aligned, ssim, lpips) = (number(psnr_aligned, 2), number(ssim, 4), number(lpips, 4));
        let _ = writeln!(text, "{name:<width$}  {psnr:>7.2}  {aligned:>7}  {ssim:>6}  {lpips:>6}");
    }
    text
}
