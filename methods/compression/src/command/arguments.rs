//! The command line of `splatweaver bench compress`.

use clap::Args;
use std::path::PathBuf;
use weaver_command::{Output, Threads};

/// Compares methods of compression: bytes, bits of a Gaussian, decibels of pictures beside the scene's, and seconds.
///
/// Formats of files, `lite` (`splatweaver compress`) at several qualities, methods of papers with several constants,
/// and controls: `zstd` packs the PLY, `half` keeps the more important half of the Gaussians, `half-random` half of
/// them at random. Pictures that judge are six of an orbit, 256 pixels square, or every eighth camera of a file or a
/// capture; methods learn from other cameras. Scenes are drawn as the summary.json beside them says, else over white.
/// Files that other programs wrote of the scene are read as they are, and judged beside the rest. With a folder, what
/// each method wrote is kept there, Ctrl-C saves, and --resume goes on to the same bytes.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver bench compress scene.ply
  splatweaver bench compress scene.ply --methods lite,sog --peer theirs/scene.sog --peer theirs/scene.spz
  splatweaver bench compress scene.ply --methods lite,spz4,sog --cameras transforms.json --html table.html
  splatweaver bench compress fern/scene.ply --data fern --methods lite,lightgaussian --steps 500 --chamfer
  splatweaver bench compress scene.ply --methods mesongs,c3dgs --steps 5000 -o runs/methods
  splatweaver bench compress --resume runs/methods")]
pub struct BenchCompress {
    /// Files of Gaussians
    #[arg(value_name = "SCENE", required_unless_present = "resume")]
    pub(super) scenes: Vec<PathBuf>,
    /// Formats, lite, lightgaussian, mesongs, c3dgs, speedysplat, haclite, zstd, half, half-random [default: all]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub(super) methods: Vec<String>,
    /// A file of the scene that another program wrote, judged as well; may be repeated
    #[arg(long, value_name = "FILE")]
    pub(super) peer: Vec<PathBuf>,
    /// Cameras of the pictures: transforms.json, a folder with a COLMAP model, or a RealEstate10K file
    #[arg(long, value_name = "FILE", conflicts_with = "data")]
    pub(super) cameras: Option<PathBuf>,
    /// Folder of the capture that the scenes were fitted to: methods train with its photos, and those that it holds out
    /// judge as well
    #[arg(long, value_name = "DIR")]
    pub(super) data: Option<PathBuf>,
    /// Optimization steps in place of 5000 in a method's paper; other numbers in proportion
    #[arg(long, value_name = "N", default_value_t = 300)]
    pub(super) steps: usize,
    /// Seed of everything that is drawn at random
    #[arg(long, value_name = "S", default_value_t = 0)]
    pub(super) seed: u64,
    /// Also compares surfaces: Chamfer distance of meshes of the drawn depth, in thousandths of the cameras' distance
    #[arg(long)]
    pub(super) chamfer: bool,
    /// Writes the table and curves as one page
    #[arg(long, value_name = "FILE", value_parser = Output::file(&["html", "htm"]))]
    pub(super) html: Option<Output>,
    /// Folder for the files of the methods, checkpoints, a log, summary.json and report.html
    #[arg(short, long, value_name = "DIR", value_parser = Output::folder())]
    pub(super) out: Option<Output>,
    /// Goes on with the comparison in this folder, with its own settings
    #[arg(long, value_name = "RUN", conflicts_with_all = [
        "scenes", "methods", "peer", "cameras", "data", "steps", "seed", "chamfer", "out",
    ])]
    pub(super) resume: Option<PathBuf>,
    /// Prints the figures as JSON, and nothing else on standard output
    #[arg(long)]
    pub(super) json: bool,
    #[command(flatten)]
    pub(super) threads: Threads,
}
