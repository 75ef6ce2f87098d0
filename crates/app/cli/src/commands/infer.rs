//! `splatweaver infer`.

use crate::flags::{CameraChoice, ClipFlags, CompleteFlag, DensityFlags, LightFlags, MatchingFlags, RefineFlags};
use crate::methods;
use clap::{ArgGroup, Args};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use weaver_clip::PhotoFiles;
use weaver_command::{Console, ConsoleObserver, DeviceFlag, Failure, Interrupt, Output, Threads, device};
use weaver_fit::FitRasterizer;
use weaver_inference::published::{self, Framing};
use weaver_inference::{Density, Looks, OutputFolder, Predictor, RunFolder, SplatWeaverPredictor, is_of_run};
use weaver_inference::{PredictOptions, PredictReport, check_prediction_folder, predict_to_folder};
use weaver_io::{Observe, write_text};
use weaver_reconstruct::{EstimatedCameras, VIEW};
use weaver_splat::Renderer;
use weaver_view::HtmlOptions;
use weaver_view_run::SceneFiles;

/// The file with the output of `--json`.
pub const FIGURES: &str = "infer.json";
/// Heading of flags.
const PUBLISHED: &str = "With --weights";

/// Turns photos into Gaussians, cameras, renders, depth and expert maps.
///
/// Writes scene.ply, transforms.json, a COLMAP model in sparse/0, the folders input, render, depth and experts, and
/// overview.png. From a checkpoint without a Gaussian head (VGGT), or with --geometry: points.ply, depth.safetensors
/// and the cameras.
#[derive(Args, Debug)]
#[command(group(ArgGroup::new("network").args(["run", "weights"])))]
#[command(after_help = "Examples:
  splatweaver infer a.jpg b.jpg c.jpg d.jpg -o result
  splatweaver infer --run runs/mine a.jpg b.jpg c.jpg d.jpg -o result
  splatweaver infer --run runs/mine photos --budget 0.2 -o compact
  splatweaver infer --run runs/mine photos --refine 30 -o better
  splatweaver infer --run runs/mine photos/*.jpg --cameras transforms.json -o posed
  splatweaver infer --run runs/wild photos --light sunset.jpg --to noon.jpg -o lights
  splatweaver infer --weights model.safetensors photos -o scene
  splatweaver infer --weights model.safetensors photos --cameras transforms.json -o posed
  splatweaver infer --weights model.safetensors photos --keep-aspect --size 448 -o wide")]
pub struct Infer {
    /// The run folder [default: the weights that come with the program, and estimated cameras]
    #[arg(long)]
    pub run: Option<PathBuf>,
    /// A published checkpoint: safetensors file, index of several, or the folder; SplatWeaver's names or VGGT's. Or the
    /// checkpoint.safetensors of a run, or small weights made of one
    #[arg(long, value_name = "FILE")]
    pub weights: Option<PathBuf>,
    /// Side of the square that photos are cut to, or WxH; multiples of the patch [default: the model's, 448]
    #[arg(long, value_name = "N|WxH", requires = "weights", help_heading = PUBLISHED, value_parser = size)]
    pub size: Option<[usize; 2]>,
    /// Photos keep their proportions; the long side takes the size, the other whole patches
    #[arg(long, requires = "weights", help_heading = PUBLISHED)]
    pub keep_aspect: bool,
    /// Cameras, depth and points only
    #[arg(long, requires = "weights", help_heading = PUBLISHED, conflicts_with_all = ["allocation", "budget"])]
    pub geometry: bool,
    /// Seed of the router's noise [default: 0]
    #[arg(long, value_name = "S", requires = "weights", help_heading = PUBLISHED)]
    pub seed: Option<u64>,
    /// Round the other factor of bf16 matrices to bf16 (8 bits) as well; faster on processors with AVX-512 BF16,
    /// the same on others
    #[arg(long, requires = "weights", help_heading = PUBLISHED)]
    pub bf16_products: bool,
    /// Photos (JPEG, PNG, TIFF, WebP), folders of photos, or clips; the first one's camera becomes the origin
    #[arg(required = true)]
    pub photos: Vec<PathBuf>,
    /// Cameras of the photos, matched by the ends of their paths: transforms.json or a folder with a COLMAP model,
    /// whose points repair depth; or `estimated`: by matching, as `splatweaver cameras` does, whose results go to the
    /// folder `cameras` [default: with --run and --weights predicted, else estimated]
    #[arg(long, value_name = "estimated|predicted|FILE")]
    pub cameras: Option<CameraChoice>,
    /// Gives no Gaussians to pixels that are black in masks: mask_path of --cameras, a file in a folder masks beside
    /// the photo, or beside its folder, named as the photo, or its alpha
    #[arg(long)]
    pub masks: bool,
    #[command(flatten)]
    pub clip: ClipFlags,
    #[command(flatten)]
    pub matching: MatchingFlags,
    #[command(flatten)]
    pub density: DensityFlags,
    #[command(flatten)]
    pub refine: RefineFlags,
    #[command(flatten)]
    pub light: LightFlags,
    #[command(flatten)]
    pub device: DeviceFlag,
    /// Folder for the results
    #[arg(short, long, value_name = "DIR", value_parser = Output::folder())]
    pub out: Output,
    /// Prints the result as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
    /// Writes no view.html, the page to look at the scene
    #[arg(long)]
    pub no_html: bool,
    #[command(flatten)]
    pub complete: CompleteFlag,
    #[command(flatten)]
    pub threads: Threads,
}

/// Height and width from `N` or `WxH`.
fn size(text: &str) -> Result<[usize; 2], String> {
    let (width, height) = text.split_once('x').unwrap_or((text, text));
    let side = |text: &str| text.parse().ok().filter(|n| (1..=16_384).contains(n));
    match (side(height), side(width)) {
        (Some(height), Some(width)) => Ok([height, width]),
        _ => Err("expected a number of pixels or WxH, as in 448 or 448x252".into()),
    }
}

impl Infer {
    /// Files and folders that have a say in the results.
    pub fn read(&self) -> Vec<PathBuf> {
        let run = self.run.as_deref().map(|run| RunFolder::at(run).checkpoint_path());
        let cameras = match &self.cameras {
            Some(CameraChoice::File(path)) => Some(path),
            _ => None,
        };
        let named = [&self.weights, &self.light.light, &self.light.to].into_iter().flatten();
        self.photos.iter().chain(&run).chain(cameras).chain(named).cloned().collect()
    }
}

pub fn run(arguments: &Infer, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    let asked = arguments.cameras == Some(CameraChoice::Estimated);
    let mut cameras = match &arguments.cameras {
        None | Some(CameraChoice::Estimated | CameraChoice::Predicted) => None,
        Some(CameraChoice::File(path)) => Some(path.clone()),
        Some(other) => return Err(other.refused("estimated, predicted or a file")),
    };
    let files = arguments.run.as_deref().map(|run| RunFolder::at(run).checkpoint_path());
    let read = arguments.photos.iter().chain(&files).chain(&arguments.weights);
    let out = OutputFolder::claim(&arguments.out, "infer", read.chain(&cameras))?;
    let rasterizer = device::rasterizer(&arguments.device)?;
    let mut observer = ConsoleObserver::new(console);
    let photos = PhotoFiles::collect(&arguments.photos, arguments.clip.most(), &out, &mut observer)?;
    let mut images = photos.paths.clone();
    check_prediction_folder(&out, &images)?;
    out.check([VIEW, FIGURES])?;
    let built_in = arguments.run.is_none() && arguments.weights.is_none();
    let opened = opened(arguments)?;
    let needs_points = matches!(&opened, Opened::Own(predictor, _) if predictor.needs_points());
    let estimating = asked || arguments.cameras.is_none() && (built_in || needs_points);
    if estimating {
        match EstimatedCameras::beside(&photos, &arguments.matching.into(), &out, &mut observer) {
            Ok((found, file)) => (images, cameras) = (found.photos, Some(file)),
            Err(error) if asked || needs_points => return Err(error.into()),
            Err(error) => {
                let reason = Failure::from(error).line().unwrap_or_default();
                observer.warning(&format!(
                    "{reason}; the network's own cameras are taken, which are hardly right on new places"
                ));
            }
        }
    }
    if !estimating {
        // Cameras that an earlier run estimated here name its frames.
        if !out.path().join("cameras").exists() {
            photos.remove_earlier_frames(&out)?;
        }
        arguments.matching.check_unused("other ones")?;
    }
    drop(observer);
    let report = match opened {
        Opened::Published(weights) => {
            let refused = [
                (arguments.masks, "--masks: expected weights of a run, found a published checkpoint"),
                (
                    arguments.light.light.is_some(),
                    "--light: expected a run that knows about light, found a published checkpoint",
                ),
                (
                    arguments.refine.is_asked(),
                    "--refine: expected weights of a run; published checkpoints are not refined yet",
                ),
            ];
            if let Some((_, message)) = refused.into_iter().find(|(given, _)| *given) {
                return Err(Failure::Usage(message.into()));
            }
            published(weights, &images, (cameras, rasterizer), (arguments, &out), console, interrupt)?
        }
        Opened::Own(predictor, seed) => {
            own((predictor, seed), &images, (cameras, rasterizer), (arguments, &out), console)?
        }
    };
    for remark in &report.remarks {
        console.note(remark);
    }
    // A network without Gaussians leaves nothing to look at.
    let viewed = report.psnr.is_some() && !arguments.no_html;
    if viewed {
        write_text(out.file(VIEW)?, &SceneFiles::of(out.path()).page()?.html(HtmlOptions::default())?)?;
    }
    let figures = report.json();
    write_text(out.file(FIGURES)?, &format!("{figures:#}\n"))?;
    if arguments.json {
        return console.print(&format!("{figures:#}"));
    }
    let others = [(arguments.light.light.is_some(), ("looks", "looks.png")), (viewed, ("look", VIEW))];
    let made: Vec<_> = others.into_iter().filter_map(|(made, file)| made.then_some(file)).collect();
    console.print(&report.text(&arguments.out, &made))
}

/// The network that is asked for.
enum Opened<'a> {
    /// A published checkpoint, which opens when it runs.
    Published(&'a Path),
    /// The network of a run, of a file of a run's weights, or the one that comes with the program, and its seed.
    Own(Box<dyn Predictor>, u64),
}

fn opened(arguments: &Infer) -> Result<Opened<'_>, Failure> {
    if let Some(run) = &arguments.run {
        let folder = RunFolder::at(run);
        let run = methods::models().open_run(&folder)?;
        return Ok(Opened::Own(run.predictor, run.seed));
    }
    let Some(weights) = &arguments.weights else {
        return Ok(Opened::Own(Box::new(SplatWeaverPredictor::built_in()?), 0));
    };
    if !is_of_run(weights)? {
        return Ok(Opened::Published(weights));
    }
    let run = methods::models().open_weights(weights)?;
    Ok(Opened::Own(run.predictor, arguments.seed.unwrap_or(run.seed)))
}

/// Runs a network that is no published one.
fn own(
    (mut predictor, seed): (Box<dyn Predictor>, u64),
    images: &[PathBuf],
    (cameras, rasterizer): (Option<PathBuf>, Arc<dyn FitRasterizer>),
    (arguments, out): (&Infer, &OutputFolder),
    console: &mut Console,
) -> Result<PredictReport, Failure> {
    if arguments.keep_aspect || arguments.geometry || arguments.bf16_products {
        let message =
            "--keep-aspect, --geometry, --bf16-products: expected a published checkpoint, found weights of a run";
        return Err(Failure::Usage(message.into()));
    }
    if arguments.size.is_some() && predictor.resizable().is_none() {
        let expected = "--size: expected a published checkpoint or a network for photos of any size";
        return Err(Failure::Usage(format!("{expected}, found weights of a run for one size")));
    }
    if let Some(photo) = images.first() {
        let wrong = |error: weaver_inference::Error| match arguments.size {
            Some(_) => Failure::Usage(format!("--{error}")),
            None => error.into(),
        };
        predictor.take_size(photo, arguments.size).map_err(wrong)?;
    }
    *predictor.renderer() = Renderer::new(rasterizer.clone());
    let density: Density = arguments.density.into();
    if let Some(remark) = predictor.remark(density) {
        console.warning(&remark);
    }
    let mut predictor = arguments.refine.refined(predictor, images, rasterizer)?;
    if arguments.light.light.is_some() && (density != Density::default() || arguments.refine.is_asked()) {
        let message = "--light: expected neither --allocation nor --budget nor --refine with it, found one of them";
        return Err(Failure::Usage(message.into()));
    }
    let looks = arguments.light.light.clone().map(|from| Looks {
        from,
        to: arguments.light.to.clone().map(|to| (to, arguments.light.light_steps as usize)),
    });
    let options = PredictOptions { cameras, masks: arguments.masks, density, looks, seed };
    Ok(predict_to_folder(&mut *predictor, images, &options, out)?)
}

/// Runs a published checkpoint while another thread shows the progress.
fn published(
    weights: &Path,
    images: &[PathBuf],
    (cameras, rasterizer): (Option<PathBuf>, Arc<dyn FitRasterizer>),
    (arguments, out): (&Infer, &OutputFolder),
    console: &mut Console,
    interrupt: &Interrupt,
) -> Result<PredictReport, Failure> {
    let options = published::Options {
        cameras,
        size: arguments.size,
        framing: if arguments.keep_aspect { Framing::KeepAspect } else { Framing::Crop },
        geometry: arguments.geometry,
        density: arguments.density.into(),
        seed: arguments.seed.unwrap_or(0),
        rasterizer,
        bf16_products: arguments.bf16_products,
    };
    // Before the first file is written, Ctrl-C ends the process at once; afterward, once all files are written.
    let writing = || _ = interrupt.watch_after("all files are written");
    let report = published::run_observed(weights, images, &options, out, &mut ConsoleObserver::new(console), writing)?;
    if interrupt.watch().load(Ordering::Relaxed) {
        return Err(Failure::message("interrupted; the results were complete and are written"));
    }
    Ok(report)
}
