//! The command lines of `splatweaver image`.

use crate::Window;
use clap::{ArgGroup, Args, Subcommand};
use std::path::PathBuf;
use weaver_command::{LiveFlag, MOST_SEED, Output, Threads};

/// Writes pictures as sums of 2-D Gaussians (.wgi), draws them at any size, and measures both.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver image fit photo.jpg -o photo.wgi
  splatweaver image fit photo.jpg -o photo.wgi --bytes 20000
  splatweaver image fit photos -o runs/photos
  splatweaver image draw photo.wgi -o thumbnail.png --scale 0.25
  splatweaver image bench photo.jpg -o runs/photo")]
pub struct Pictures {
    #[command(subcommand)]
    pub(crate) command: ImageCommand,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum ImageCommand {
    Fit(ImageFit),
    Draw(ImageDraw),
    Bench(ImageBench),
}

/// Fits Gaussians to a picture and writes them as a .wgi file, or to several, into a folder.
///
/// Alpha is composited over black; numbers of 16 bits are taken to 8. Ctrl-C ends the fit of a file: what there is is
/// written, unless the file is there already, which then stays. In a folder it saves, and --resume goes on to the same
/// bits.
#[derive(Args, Debug)]
#[command(group(ArgGroup::new("size").args(["ratio", "gaussians", "bytes", "psnr"])))]
#[command(after_help = "Examples:
  splatweaver image fit photo.jpg -o photo.wgi
  splatweaver image fit photo.jpg -o photo.wgi --ratio 100 --steps 1000
  splatweaver image fit photo.jpg -o photo.wgi --psnr 30
  splatweaver image fit photos more.png -o runs/photos --steps 3000
  splatweaver image fit --resume runs/photos
  splatweaver image fit photo.jpg -o photo.wgi --published --steps 3000")]
pub struct ImageFit {
    /// Pictures, and folders of them
    #[arg(value_name = "PICTURE", required_unless_present = "resume", num_args = 1..)]
    pub pictures: Vec<PathBuf>,
    /// The .wgi file of one picture, or a folder for files, checkpoints and a report
    #[arg(short, long, value_name = "FILE|DIR", required_unless_present = "resume", value_parser = Output::file_or_folder(&["wgi"]))]
    pub out: Option<Output>,
    /// Goes on with the run in this folder, with its own settings
    #[arg(long, value_name = "RUN", conflicts_with_all = ["pictures", "out", "size", "steps", "seed", "coarse", "published"])]
    pub resume: Option<PathBuf>,
    /// Compression ratio that the number of Gaussians is for, 56 bits each; files take about half of that [default: 50]
    #[arg(long, value_name = "RATIO")]
    pub ratio: Option<f64>,
    /// Number of Gaussians
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub gaussians: Option<u32>,
    /// Length of the file at most; fits several times, for one file
    #[arg(long, value_name = "BYTES", value_parser = clap::value_parser!(u32).range(128..))]
    pub bytes: Option<u32>,
    /// Decibels at least; fits several times, for one file
    #[arg(long, value_name = "DECIBELS")]
    pub psnr: Option<f64>,
    /// Optimization steps
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = clap::value_parser!(u32).range(1..))]
    pub steps: u32,
    /// Seed of what is drawn at random
    #[arg(long, value_name = "S", default_value_t = 0, value_parser = clap::value_parser!(u64).range(..=MOST_SEED))]
    pub seed: u64,
    /// The first half of the steps at half the size: three quarters of the time, a tenth of a decibel less
    #[arg(long, conflicts_with = "published")]
    pub coarse: bool,
    /// SmartSplat's published start, loss and rates in place of ours
    #[arg(long)]
    pub published: bool,
    /// Prints the result as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub live: LiveFlag,
    #[command(flatten)]
    pub threads: Threads,
}

/// Draws a .wgi file, or a part of it, as PNG.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver image draw photo.wgi -o photo.png
  splatweaver image draw photo.wgi -o part.png --scale 2 --region 100,50,640,480")]
pub struct ImageDraw {
    /// The file to draw
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// The picture to write, PNG
    #[arg(short, long, value_name = "FILE", value_parser = Output::file(&["png"]))]
    pub out: Output,
    /// Sides of the picture in parts of its own; smaller ones are filtered
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    pub scale: f64,
    /// Only these pixels of the scaled picture: first column, first row, columns, rows
    #[arg(long, value_name = "X,Y,W,H", value_parser = region)]
    pub region: Option<Window>,
    /// Prints the result as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub threads: Threads,
}

/// Fits pictures at several ratios and prints bytes, decibels and times, beside other codecs at equal bytes.
///
/// JPEG is the program's own baseline encoder, unless --others has files of other encoders: NAME-ANYTHING.jpg, .webp,
/// or .avif with what it decodes to as NAME-ANYTHING.avif.png, for the picture NAME.png.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver image bench photo.jpg
  splatweaver image bench a.png b.png --steps 1000 -o runs/pictures --others encoded")]
pub struct ImageBench {
    /// The pictures
    #[arg(value_name = "PICTURE", required = true)]
    pub pictures: Vec<PathBuf>,
    /// Folder for a report with crops and curves
    #[arg(short, long, value_name = "DIR", value_parser = Output::folder())]
    pub out: Option<Output>,
    /// Folder of the same pictures by other encoders
    #[arg(long, value_name = "DIR")]
    pub others: Option<PathBuf>,
    /// Compression ratios
    #[arg(long, value_name = "RATIO,..", value_delimiter = ',', default_value = "200,100,50,25")]
    pub ratios: Vec<f64>,
    /// Optimization steps
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = clap::value_parser!(u32).range(1..))]
    pub steps: u32,
    /// Seed of what is drawn at random
    #[arg(long, value_name = "S", default_value_t = 0, value_parser = clap::value_parser!(u64).range(..=MOST_SEED))]
    pub seed: u64,
    #[command(flatten)]
    pub threads: Threads,
}

fn region(text: &str) -> Result<Window, String> {
    let numbers: Result<Vec<usize>, _> = text.split(',').map(str::parse).collect();
    match numbers.as_deref() {
        Ok([x, y, width, height]) if *width > 0 && *height > 0 => {
            Ok(Window { x: *x, y: *y, width: *width, height: *height })
        }
        _ => Err("expected X,Y,W,H: four whole numbers, the last two above 0".into()),
    }
}
