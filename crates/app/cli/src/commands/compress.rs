//! `splatweaver compress`.

use clap::Args;
use clap::builder::TypedValueParser;
use serde_json::json;
use std::ops::Bound;
use std::path::PathBuf;
use weaver_command::camera_files::{self, Size};
use weaver_command::{Console, ConsoleObserver, DrawingFlags, DrawingOptions, Failure, Output, Threads, number};
use weaver_compress::{Compressed, Judged, MOST_DECIBELS, Pictures, compress_judged};
use weaver_geometry::Camera;
use weaver_io::{atomic_write, scene_bytes};

/// Longest side of the pictures that the scene is judged by, pixels.
const LONG_SIDE: usize = 384;
/// Pictures that steps are chosen by, at most, and of an orbit. As many between them judge.
const MOST: usize = 12;
const OF_ORBIT: usize = 6;

/// Compresses a file of Gaussians to a wanted quality of its pictures, as .wsz.
///
/// Positions, scales, opacities, rotations, colors and harmonics are rounded so that one more bit would gain as much in
/// any of them; the gain of a bit is measured in pictures of the scene; others say how good it is. `splatweaver convert
/// scene.ply scene.wsz` takes fixed steps, and no time.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver compress scene.ply -o scene.wsz
  splatweaver compress scene.ply -o small.wsz --psnr 40
  splatweaver compress fits/garden-1/scene.ply -o garden.wsz --cameras garden/transforms.json --json")]
pub struct Compress {
    /// The Gaussians: PLY as 3DGS stores them, or another format of `splatweaver convert`
    #[arg(value_name = "SCENE")]
    pub scene: PathBuf,
    /// The file to write, .wsz
    #[arg(short, long, value_name = "FILE", value_parser = Output::file(&["wsz"]))]
    pub out: Output,
    /// Quality of pictures of the compressed scene beside the scene's, decibels, at least in those that steps
    /// are chosen by; 46 is hard to tell apart, 40 shows on a closer look
    #[arg(long, value_name = "DECIBELS", default_value = "46", value_parser = decibels())]
    pub psnr: f64,
    /// Cameras of the pictures, every other one judges the choice of the others: transforms.json, a folder with
    /// a COLMAP model, or a RealEstate10K file [default: the transforms.json beside the scene, else an orbit]
    #[arg(long, value_name = "FILE")]
    pub cameras: Option<PathBuf>,
    /// Prints the result as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub threads: Threads,
    // Last: its heading would be that of what follows.
    #[command(flatten)]
    pub drawing: DrawingFlags,
}

fn decibels() -> impl TypedValueParser<Value = f64> {
    let expected = format!("expected decibels above 0 and up to {MOST_DECIBELS}, as in 46");
    number((Bound::Excluded(0.0), Bound::Included(MOST_DECIBELS)), expected)
}

pub fn run(arguments: &Compress, console: &mut Console) -> Result<(), Failure> {
    let Compress { scene, out, .. } = arguments;
    let named = |error: &dyn std::fmt::Display| Failure::message(format!("{}: {error}", scene.display()));
    let (gaussians, background, settings) = DrawingOptions::from(arguments.drawing).read(scene)?;
    let cameras = match &arguments.cameras {
        Some(file) => of_file(file)?,
        None => {
            let beside = scene.with_file_name("transforms.json");
            let orbit = || weaver_scene::orbit(&gaussians, 2 * OF_ORBIT, [LONG_SIDE, LONG_SIDE * 3 / 4]);
            if beside.is_file() {
                of_file(&beside)?
            } else {
                console.note(
                    "no cameras beside the scene: pictures are those of an orbit around it; closer ones may be worse, and --cameras names those that count",
                );
                orbit().ok_or_else(|| named(&"expected Gaussians, found none"))?
            }
        }
    };
    let pictures = Pictures { cameras: &cameras, background, settings };
    let judged = compress_judged(&gaussians, &pictures, arguments.psnr, &mut ConsoleObserver::new(console))
        .map_err(|error| named(&error))?;
    let quality = judged.to_string();
    let Judged { compressed: Compressed { bytes, psnr: chosen, .. }, choosing, judging, psnr } = judged;
    atomic_write(out, |file| std::io::Write::write_all(file, &bytes))?;
    let (before, after) = (scene_bytes(scene)?, bytes.len());
    let bits = 8.0 * after as f64 / gaussians.len().max(1) as f64;
    let figures = json!({
        "gaussians": gaussians.len(), "bytes": after, "bytes_before": before, "bits_per_gaussian": bits,
        "psnr": psnr, "pictures": judging,
        "chosen_by": { "psnr": chosen, "pictures": choosing },
    });
    let (times, file) = (before as f64 / after.max(1) as f64, out.display());
    let text = format!("{quality}; {bits:.1} bits a Gaussian: {after} bytes, {times:.1} times fewer\nscene: {file}");
    console.answer(arguments.json, &[out], figures, &text)
}

/// Some of the cameras of a file, evenly spread, for pictures of a size that is drawn fast.
fn of_file(file: &std::path::Path) -> Result<Vec<Camera>, Failure> {
    let frames = camera_files::read(file, Size::default())?;
    let chosen = weaver_data::uniform(frames.len(), frames.len().min(2 * MOST));
    Ok(chosen.into_iter().map(|i| frames[i].camera.shrunk(LONG_SIDE)).collect())
}
