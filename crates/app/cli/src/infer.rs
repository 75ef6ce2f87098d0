//! `splatweaver infer`.

use crate::arguments::{CameraChoice, ClipFlags, Infer};
use crate::estimate::{cameras_folder, estimated};
use crate::refine::refined;
use crate::{Console, Interrupt, clip};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::sync::{Arc, mpsc};
use weaver_command::{Failure, Progress, device};
use weaver_fit::FitRasterizer;
use weaver_inference::published::{self, Fit};
use weaver_inference::reconstruct::{self, Options, Report, reconstruct};
use weaver_inference::{Density, Looks, OutputFolder, Predictor, RunFolder, SplatWeaverPredictor, is_of_run};
use weaver_splat::Renderer;

pub fn run(arguments: &Infer, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    let asked = arguments.cameras == Some(CameraChoice::Estimated);
    let mut cameras = match &arguments.cameras {
        None | Some(CameraChoice::Estimated | CameraChoice::Predicted) => None,
        Some(CameraChoice::File(path)) => Some(path.clone()),
        Some(other) => return Err(other.refused("estimated, predicted or a file")),
    };
    let files = arguments.run.as_deref().map(|run| RunFolder::at(run).checkpoint_path());
    let read = arguments.images.iter().chain(&files).chain(&arguments.weights);
    let out = OutputFolder::claim(&arguments.out, "infer", read.chain(&cameras))?;
    let rasterizer = device::rasterizer(&arguments.device)?;
    let photos = clip::photos(&arguments.images, ClipFlags::default(), &out, console)?;
    let mut images = photos.paths.clone();
    reconstruct::check(&out, &images)?;
    let built_in = arguments.run.is_none() && arguments.weights.is_none();
    let estimating = asked || built_in && arguments.cameras.is_none();
    if estimating {
        let folder = cameras_folder(&out, &images)?;
        let located = vec![false; images.len()];
        match estimated(&photos, &located, arguments.matching, &folder, console) {
            Ok(found) => {
                photos.settle(&out)?;
                (images, cameras) = (found.photos, Some(folder.path().join("transforms.json")));
            }
            Err(failure) if asked => return Err(failure),
            Err(failure) => {
                let reason = failure.line().unwrap_or_default();
                console.note(&format!(
                    "warning: {reason}; the network's own cameras are taken, which are hardly right on new places"
                ));
            }
        }
    }
    if !estimating {
        // Cameras that an earlier run estimated here name its frames.
        if !out.path().join("cameras").exists() {
            photos.settle(&out)?;
        }
        arguments.matching.check_unused("other ones")?;
    }
    let of_run = arguments.weights.as_deref().map(is_of_run).transpose()?.unwrap_or(false);
    let report = match &arguments.weights {
        Some(weights) if !of_run => {
            if arguments.masks {
                return Err(Failure::Usage("--masks: expected weights of a run, found a published checkpoint".into()));
            }
            if arguments.light.light.is_some() {
                return Err(Failure::Usage(
                    "--light: expected a run that knows about light, found a published checkpoint".into(),
                ));
            }
            if arguments.refine.is_asked() {
                let message = "--refine: expected weights of a run; published checkpoints are not refined yet";
                return Err(Failure::Usage(message.into()));
            }
            published(weights, &images, (cameras, rasterizer), (arguments, &out), console, interrupt)?
        }
        _ => own(&images, (cameras, rasterizer), (arguments, &out), console)?,
    };
    for remark in &report.remarks {
        console.note(remark);
    }
    let file = |name: &str| arguments.out.join(name).display().to_string();
    let result = match report.psnr {
        Some(psnr) => format!(
            "{} Gaussians, {:.3} per pixel; the input views come back at {psnr:.2} dB\nscene: {}",
            report.gaussians,
            report.gaussians_per_pixel,
            file("scene.ply")
        ),
        None => format!("points: {}\ncameras: {}", file("points.ply"), file("transforms.json")),
    };
    let looks = arguments.light.light.as_ref().map_or(String::new(), |_| format!("\nlooks: {}", file("looks.png")));
    console.print(&format!("{result}\noverview: {}{looks}", report.overview.display()))
}

/// Runs the network of a run, of a file of a run's weights, or the one that comes with the program.
fn own(
    images: &[PathBuf],
    (cameras, rasterizer): (Option<PathBuf>, Arc<dyn FitRasterizer>),
    (arguments, out): (&Infer, &OutputFolder),
    console: &mut Console,
) -> Result<Report, Failure> {
    let published = arguments.size.is_some() || arguments.keep_aspect || arguments.geometry || arguments.bf16_products;
    if published {
        let message = "--size, --keep-aspect, --geometry, --bf16-products: expected a published checkpoint, found weights of a run";
        return Err(Failure::Usage(message.into()));
    }
    let (mut predictor, seed): (Box<dyn Predictor>, u64) = match (&arguments.run, &arguments.weights) {
        (Some(run), _) => {
            let folder = RunFolder::at(run);
            let run = weaver_recipes::registry().of_run(&folder)?.open(&folder)?;
            (run.predictor, run.seed)
        }
        (None, Some(weights)) => {
            let run = weaver_recipes::open_weights(weights)?;
            (run.predictor, arguments.seed.unwrap_or(run.seed))
        }
        (None, None) => (Box::new(SplatWeaverPredictor::built_in()?), 0),
    };
    *predictor.renderer() = Renderer::new(rasterizer.clone());
    let density: Density = arguments.density.into();
    if let Some(remark) = predictor.remark(density) {
        console.note(&format!("warning: {remark}"));
    }
    let mut predictor = refined(predictor, &arguments.refine, images, rasterizer)?;
    if arguments.light.light.is_some() && (density != Density::default() || arguments.refine.is_asked()) {
        let message = "--light: expected neither --allocation nor --budget nor --refine with it, found one of them";
        return Err(Failure::Usage(message.into()));
    }
    let looks = arguments.light.light.clone().map(|from| Looks {
        from,
        to: arguments.light.to.clone().map(|to| (to, arguments.light.light_steps as usize)),
    });
    let options = Options { cameras, masks: arguments.masks, density, looks, seed };
    Ok(reconstruct(&mut *predictor, images, &options, out)?)
}

/// Runs a published checkpoint while another thread shows the progress.
fn published(
    weights: &Path,
    images: &[PathBuf],
    (cameras, rasterizer): (Option<PathBuf>, Arc<dyn FitRasterizer>),
    (arguments, out): (&Infer, &OutputFolder),
    console: &mut Console,
    interrupt: &Interrupt,
) -> Result<Report, Failure> {
    let options = published::Options {
        cameras,
        size: arguments.size,
        fit: if arguments.keep_aspect { Fit::KeepAspect } else { Fit::Crop },
        geometry: arguments.geometry,
        density: arguments.density.into(),
        seed: arguments.seed.unwrap_or(0),
        rasterizer,
        bf16_products: arguments.bf16_products,
    };
    let (sender, receiver) = mpsc::channel::<published::Progress>();
    let report = std::thread::scope(|scope| {
        scope.spawn(move || {
            let mut progress: Option<Progress> = None;
            for heard in receiver {
                let shown = progress.get_or_insert_with(|| Progress::new("infer", 0, heard.total, console));
                shown.at(heard.done, heard.total, || heard.stage.to_string(), console);
            }
            if let Some(progress) = progress {
                progress.finish();
            }
        });
        let tell = move |progress| {
            // Sending fails only when the receiving thread is gone, and then there is nothing to show.
            let _ = sender.send(progress);
        };
        // Before the first file is written, Ctrl-C ends the process at once; afterward, once all files are written.
        published::run(weights, images, &options, out, tell, || {
            interrupt.watch();
        })
    })?;
    if interrupt.watch().load(Ordering::Relaxed) {
        return Err(Failure::message("interrupted; the results were complete and are written"));
    }
    Ok(report)
}
