//! `splatweaver align`.

use clap::Args;
use std::path::PathBuf;
use weaver_command::{
    Console, ConsoleObserver, DeviceFlag, DrawingFlags, DrawingOptions, Failure, Output, Threads, camera_files, choice,
    device,
};
use weaver_data::posed::{PosedOptions, load_frames, load_named};
use weaver_fit::align::{AlignLoss, Method, Options};
use weaver_io::photos_at;
use weaver_reconstruct::{AlignRequest, align_photos, claim_alignment, closest_views};

const DESCENT: &str = "Descent";

/// Methods by which a camera descends.
pub const METHODS: [(&str, Method, &str); 3] = [
    ("own", Method::Own, "Small and blurred photos first, steps in units of the depth, the best camera seen"),
    ("2xplat", Method::TwoXplat, "As in 2Xplat: quaternion and center"),
    ("noposplat", Method::NoPoSplat, "As in NoPoSplat: rigid increments"),
];

/// Losses between photo and render.
pub const LOSSES: [(&str, AlignLoss, &str); 3] = [
    ("mse", AlignLoss::MeanSquare, "The mean square of differences"),
    ("photometric", AlignLoss::Photometric, "Absolute differences and structure, as scenes are fitted"),
    ("ssim", AlignLoss::Similarity, "Structural similarity alone"),
];

const SWITCH: [(&str, bool, &str); 2] = [("on", true, ""), ("off", false, "")];

/// Finds where photos of a finished scene were taken: their cameras move until the scene looks like the photo.
///
/// Writes transforms.json, a COLMAP model in sparse/0, the folder renders and align.json. A photo's first guess should
/// be within a few degrees; a photo for which nothing better is found keeps its guess, and the table says why.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver align scene.ply --photos new --cameras guess.json -o aligned
  splatweaver align fits/garden-1/scene.ply --photos later.jpg -o aligned
  splatweaver align scene.spz --photos new --cameras sparse/0 --long-side 800 --refine-focal -o aligned")]
pub struct Align {
    /// The Gaussians: PLY as 3DGS stores them, or another format of `splatweaver convert`
    #[arg(value_name = "SCENE.ply")]
    pub scene: PathBuf,
    /// Photos, or folders of photos
    #[arg(long, value_name = "DIR|FILE", required = true, num_args = 1..)]
    pub photos: Vec<PathBuf>,
    /// First guesses, matched with photos by name: transforms.json, a folder with a COLMAP model, or a RealEstate10K
    /// file [default: for each photo that camera of the transforms.json beside the scene from which the scene looks
    /// most like it]
    #[arg(long, value_name = "FILE")]
    pub cameras: Option<PathBuf>,
    /// Folder for the results
    #[arg(short, long, value_name = "DIR", value_parser = Output::folder())]
    pub out: Output,
    /// Which numbers descend, and at what rate
    #[arg(long = "as", value_parser = choice(&METHODS), default_value = "own", help_heading = DESCENT)]
    pub method: Method,
    /// Steps at most [default: 200, or 100 as published]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000), help_heading = DESCENT)]
    pub steps: Option<u32>,
    /// True if photo and render are blurred in the first half of the steps
    #[arg(long, value_parser = choice(&SWITCH), default_value = "on", help_heading = DESCENT)]
    pub blur: bool,
    /// Loss between photo and render [default: photometric, or mse as published]
    #[arg(long, value_parser = choice(&LOSSES), help_heading = DESCENT)]
    pub loss: Option<AlignLoss>,
    /// Focal lengths descend as well
    #[arg(long, help_heading = DESCENT)]
    pub refine_focal: bool,
    /// Does not count pixels that are black in masks: mask_path of the cameras, a file in masks/ named as the photo, or
    /// its alpha
    #[arg(long, help_heading = DESCENT)]
    pub masks: bool,
    /// Longest side of the photos in pixels; larger ones are shrunk [default: as they are]
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(1..=65_536), help_heading = DESCENT)]
    pub long_side: Option<u32>,
    /// Prints the result as JSON, and nothing else on standard output
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

pub fn run(arguments: &Align, console: &mut Console) -> Result<(), Failure> {
    let read = arguments.photos.iter().chain([&arguments.scene]).chain(&arguments.cameras);
    let out = claim_alignment(&arguments.out, read)?;
    let rasterizer = device::rasterizer(&arguments.device)?;
    let (gaussians, background, settings) = DrawingOptions::from(arguments.drawing).read(&arguments.scene)?;
    let gaussians = gaussians.to_activated();
    // No photo is no mistake: then there is nothing to do.
    let paths = photos_at(&arguments.photos)?;
    let loading = PosedOptions {
        long_side: arguments.long_side.map(|size| size as usize),
        masks: arguments.masks,
        background,
        ..PosedOptions::default()
    };
    let photos = match &arguments.cameras {
        Some(file) => load_named(file, &paths, &loading)?,
        None => {
            let file = arguments.scene.with_file_name("transforms.json");
            if !file.is_file() {
                let expected = "expected first guesses, or the scene's own cameras in";
                return Err(Failure::Usage(format!("--cameras: {expected} {}", file.display())));
            }
            let frames = camera_files::read(&file, camera_files::Size::default())?;
            load_frames(closest_views(&gaussians, &frames, &paths, background, &settings)?, &file, &loading)?
        }
    };
    let loss = arguments.loss.unwrap_or(AlignLoss::of(arguments.method));
    let least = loss.least_side();
    if let Some(photo) = photos.iter().find(|found| found.photo.size().into_iter().min() < Some(least)) {
        let (name, [height, width]) = (photo.frame.path.display(), photo.photo.size());
        let expected = format!("--loss ssim: expected photos of at least {least} x {least} pixels");
        return Err(Failure::message(format!("{name}: {expected}, found {width} x {height}")));
    }
    let options = Options {
        blur: arguments.blur,
        intrinsics: arguments.refine_focal,
        ..Options::of(arguments.method).in_steps(arguments.steps.map(|steps| steps as usize))
    };
    let request =
        AlignRequest { gaussians: &gaussians, background, settings, photos: &photos, options, loss, rasterizer };
    let aligned = align_photos(&request, &out, &mut ConsoleObserver::new(console))?;
    let text = || format!("{aligned}cameras: {}", arguments.out.join("transforms.json").display());
    console.print(&if arguments.json { aligned.json() } else { text() })
}
