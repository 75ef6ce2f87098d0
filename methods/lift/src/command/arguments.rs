//! The command lines of `splatweaver lift` and `splatweaver query`.

use clap::builder::TypedValueParser;
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use weaver_command::{MOST_SEED, Output, Threads, number, positive};

const SOLVING: &str = "Solving";
const AGGREGATING: &str = "Features of masks";

/// Lifts features of photos to the Gaussians of a finished scene: drawn, they give the features of the photos.
///
/// Features (CLIP, DINO, classes, any numbers) are one .npy or .safetensors file per photo, [height, width, channels],
/// named as the photo; they are resized to the camera's image, and each pixel's divided by their length. Pixels that
/// hold NaN do not count. No training.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver lift scene.ply --cameras transforms.json --features dino -o lifted.safetensors
  splatweaver lift scene.spz --cameras sparse/0 --width 640 --features clip --dry-run -o lifted.safetensors
  splatweaver lift scene.ply --cameras transforms.json --features clip --solver row-sum --aggregate masks -o lifted.safetensors
  splatweaver lift --demo 1000 -o pictures
  splatweaver lift --demo 1000 1001 1002 --demo-gaussians predicted -o pictures")]
pub struct Lift {
    /// The Gaussians: PLY as 3DGS stores them, or another format of `splatweaver convert`
    #[arg(value_name = "SCENE.ply", required_unless_present = "demo")]
    pub scene: Option<PathBuf>,
    /// transforms.json, a folder with a COLMAP model, or a RealEstate10K camera file
    #[arg(long, value_name = "FILE", required_unless_present = "demo")]
    pub cameras: Option<PathBuf>,
    /// Folder of features, one file for each camera
    #[arg(long, value_name = "DIR", required_unless_present = "demo")]
    pub features: Option<PathBuf>,
    /// Folder of pictures, one for each photo that has one: what is dark in them does not count
    #[arg(long, value_name = "DIR")]
    pub mask_dir: Option<PathBuf>,
    /// File for the lifted features; pictures of them go into a folder beside it. With --demo: folder for pictures
    #[arg(short, long, value_name = "FILE", required_unless_present = "demo", value_parser = Output::file_or_folder(&["safetensors"]))]
    pub out: Option<Output>,
    /// Shows what the solvers do on built-in scenes of these seeds, where the truth is known
    #[arg(long, value_name = "SEED", num_args = 1.., value_parser = clap::value_parser!(u64).range(..=MOST_SEED),
        conflicts_with_all = ["scene", "cameras", "features", "mask_dir", "aggregate", "dry_run"])]
    pub demo: Vec<u64>,
    /// Gaussians that the demonstration lifts to
    #[arg(long, value_enum, default_value = "surface", requires = "demo")]
    pub demo_gaussians: DemoGaussians,
    /// With --demo-gaussians predicted: the folder of a run of `train` [default: the weights that come with the
    /// program]
    #[arg(long, value_name = "RUN", requires = "demo")]
    pub run: Option<PathBuf>,
    /// Solver of Gaussians' features
    #[arg(long, value_enum, default_value = "exact", help_heading = SOLVING)]
    pub solver: SolverName,
    /// Passes over the photos of exact and damped, at most; more of them fit borders of objects at the cost of the
    /// Gaussians
    #[arg(long, value_name = "K", default_value = "5", value_parser = clap::value_parser!(u32).range(1..=10_000), help_heading = SOLVING)]
    pub passes: u32,
    /// Conjugate gradients for exact: the least squares in fewer passes
    #[arg(long, help_heading = SOLVING)]
    pub conjugate: bool,
    /// Weight by which damped holds on to row-sum
    #[arg(long, value_name = "MU", default_value = "0.1", value_parser = positive(), help_heading = SOLVING)]
    pub mu: f64,
    /// Tikhonov guidance: opacities become sigmoid(LAMBDA logit) while lifting, and in queries; 1 is none
    #[arg(long, value_name = "LAMBDA", default_value = "1", value_parser = positive(), help_heading = SOLVING)]
    pub tikhonov: f64,
    /// With exact and damped: pixels of which Gaussians cover less than this part do not count, since there is little
    /// to draw features with
    #[arg(long, value_name = "PART", default_value = "0.5", value_parser = part(), help_heading = SOLVING)]
    pub least_alpha: f64,
    /// Divides the features of each Gaussian by their length
    #[arg(long, help_heading = SOLVING)]
    pub unit: bool,
    /// Channels at a time: less memory with fewer
    #[arg(long, value_name = "N", default_value = "64", value_parser = clap::value_parser!(u32).range(1..=65_536), help_heading = SOLVING)]
    pub block: u32,
    /// Width at which the photos are looked at, pixels; intrinsics follow [default: the cameras']
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=65_536), help_heading = SOLVING)]
    pub width: Option<u32>,
    /// Height in pixels [default: the cameras' aspect ratio]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=65_536), help_heading = SOLVING)]
    pub height: Option<u32>,
    /// Folder of masks, NAME.safetensors with `masks` [M, height, width] (U8) and `features` [M, channels]: Gaussians
    /// are clustered, and each cluster gets the mean feature of the masks that agree with it
    #[arg(long, value_name = "DIR", help_heading = AGGREGATING)]
    pub aggregate: Option<PathBuf>,
    /// Fewest Gaussians of a cluster
    #[arg(long, value_name = "N", default_value = "500", requires = "aggregate", value_parser = clap::value_parser!(u32).range(2..), help_heading = AGGREGATING)]
    pub smallest: u32,
    /// A mask agrees with a cluster if more than this part of both together, in pixels, is common to both
    #[arg(long, value_name = "PART", default_value = "0.8", requires = "aggregate", value_parser = part(), help_heading = AGGREGATING)]
    pub overlap: f64,
    /// Says what it would take, and writes nothing
    #[arg(long)]
    pub dry_run: bool,
    /// Prints the result as JSON, and nothing else on standard output
    #[arg(long, conflicts_with_all = ["demo", "dry_run"])]
    pub json: bool,
    #[command(flatten)]
    pub(crate) threads: Threads,
}

/// Where the Gaussians of a demonstration come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum DemoGaussians {
    /// Balls on the surfaces, of known places
    Surface,
    /// A network's, from the photos
    Predicted,
    /// Those of a short fit to the photos
    Fitted,
}

/// The solvers of weaver-lift.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SolverName {
    /// The mean of what a Gaussian is seen as
    RowSum,
    /// The same by squared weights
    Squared,
    /// Least squares
    Exact,
    /// Between row-sum and exact
    Damped,
}

impl SolverName {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::RowSum => "row-sum",
            Self::Squared => "squared",
            Self::Exact => "exact",
            Self::Damped => "damped",
        }
    }
}

/// Draws where lifted features agree with prompts.
///
/// For each camera a file of scores, [height, width, prompts], and a picture per prompt.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver query scene.ply --lifted lifted.safetensors --prompts words.npy --cameras transforms.json -o maps")]
pub struct Query {
    /// The Gaussians that the features were lifted to
    #[arg(value_name = "SCENE.ply")]
    pub scene: PathBuf,
    /// The features that `splatweaver lift` wrote
    #[arg(long, value_name = "FILE")]
    pub lifted: PathBuf,
    /// Prompts as features, [prompts, channels] in .npy or .safetensors; each is divided by its length
    #[arg(long, value_name = "FILE")]
    pub prompts: PathBuf,
    /// transforms.json, a folder with a COLMAP model, or a RealEstate10K camera file
    #[arg(long, value_name = "FILE")]
    pub cameras: PathBuf,
    /// Folder for the maps
    #[arg(short, long, value_name = "DIR", value_parser = Output::folder())]
    pub out: Output,
    /// Width in pixels; intrinsics follow [default: the cameras']
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub width: Option<u32>,
    /// Height in pixels [default: the cameras' aspect ratio]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub height: Option<u32>,
    /// Prints the result as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub(crate) threads: Threads,
}

fn part() -> impl TypedValueParser<Value = f64> {
    number(0.0..1.0, "expected a number of at least 0 and below 1")
}
