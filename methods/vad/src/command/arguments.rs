//! The command lines of `splatweaver vad`.

use crate::{Length, Rule};
use clap::{Args, Subcommand, ValueEnum};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use weaver_command::{LiveFlag, MOST_SEED, Output, Threads, choice};

/// Finds anomalies in videos of which only is known whether there are any (UR-DMU, temporal Gaussian splatting,
/// GS-MoE).
///
/// Videos are .npy files of features, a row for each snippet of 16 frames. Without any, videos with planted anomalies
/// are used.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver vad train --out runs/planted
  splatweaver vad eval --run runs/planted
  splatweaver vad train --features UCF-I3D --list UCF_Train.list --out runs/ucf
  splatweaver vad eval --run runs/ucf --features UCF-I3D --list UCF_Test.list --annotation UCF_Annotation.txt
  splatweaver vad score --run urdmu.safetensors Abuse028_x264__0.npy -o curves
  splatweaver vad metrics --scores curves --annotation UCF_Annotation.txt --json")]
pub struct Vad {
    #[command(subcommand)]
    pub(crate) command: VadCommand,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub(crate) enum VadCommand {
    Train(VadTrain),
    Eval(VadEval),
    Score(VadScore),
    Metrics(VadMetrics),
}

/// Trains a detector and writes a run folder: model.safetensors, metrics.jsonl and, of planted videos, summary.json and
/// report.html.
///
/// Ctrl-C saves a checkpoint and ends; --resume goes on to the same bits as an uninterrupted run.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver vad train --out runs/planted
  splatweaver vad train --features UCF-I3D --list UCF_Train.list --out runs/ucf
  splatweaver vad train --resume runs/ucf")]
pub(crate) struct VadTrain {
    #[command(flatten)]
    pub(crate) plan: VadPlan,
    /// Folder of the run [default: the first free one of runs/vad-1, runs/vad-2, ...]
    #[arg(short, long, value_name = "DIR", value_parser = Output::folder())]
    pub(crate) out: Option<Output>,
    /// Goes on from the checkpoint of a run that was stopped, with what it was started with
    #[arg(long, value_name = "RUN", conflicts_with_all = ["VadPlan", "out"])]
    pub(crate) resume: Option<PathBuf>,
    /// Prints the result as JSON, and nothing else on standard output
    #[arg(long)]
    pub(crate) json: bool,
    #[command(flatten)]
    pub(crate) live: LiveFlag,
    #[command(flatten)]
    pub(crate) threads: Threads,
}

/// Plan of a training, kept beside a checkpoint.
#[derive(Args, Clone, Debug, Serialize, Deserialize)]
pub(crate) struct VadPlan {
    /// Folder of .npy features; without it, planted videos
    #[arg(long, value_name = "DIR", requires = "list")]
    pub(crate) features: Option<PathBuf>,
    /// List of feature files, one to a line, as UR-DMU, RTFM and XD-Violence have it
    #[arg(long, value_name = "FILE", requires = "features")]
    pub(crate) list: Option<PathBuf>,
    /// Number of videos, the first of the list, that are abnormal, where their names do not say
    #[arg(long, value_name = "N", requires = "list", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) abnormal: Option<u32>,
    /// The network
    #[arg(long, value_enum, default_value = "urdmu")]
    pub(crate) encoder: EncoderName,
    /// An expert for each class, and heads of the encoder for classes [default, where names tell classes]
    #[arg(long, conflicts_with_all = ["clusters", "plain"])]
    pub(crate) classes: bool,
    /// An expert for each of so many clusters of abnormal videos; classes are not looked at
    #[arg(long, value_name = "K", conflicts_with = "plain", value_parser = clap::value_parser!(u16).range(1..=256))]
    pub(crate) clusters: Option<u16>,
    /// No experts
    #[arg(long = "no-experts")]
    pub(crate) plain: bool,
    /// Use of peaks of the score curve: labels by Gaussians over time (T), over the score (S), over the video (H),
    /// spikes (L), or nothing
    #[arg(long, value_enum, default_value = "T", ignore_case = true)]
    pub(crate) splat: SplatName,
    /// Steps of the encoder; the other stages follow in proportion [default: 3000, planted 300]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    pub(crate) steps: Option<u32>,
    /// Seed of weights, order and noise
    #[arg(long, value_name = "S", default_value = "0", value_parser = clap::value_parser!(u64).range(..=MOST_SEED))]
    pub(crate) seed: u64,
}

/// Judges a run as the published evaluators do, and writes report.html into it.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver vad eval --run runs/planted
  splatweaver vad eval --run runs/ucf --features UCF-I3D --list UCF_Test.list --annotation UCF_Annotation.txt --json")]
pub(crate) struct VadEval {
    /// Run folder, or a file of weights: that of a run, or UR-DMU's from `splatweaver convert-weights`
    #[arg(long, value_name = "RUN")]
    pub(crate) run: PathBuf,
    /// Folder of .npy features; without it, planted videos
    #[arg(long, value_name = "DIR", requires_all = ["list", "annotation"])]
    pub(crate) features: Option<PathBuf>,
    /// List of feature files
    #[arg(long, value_name = "FILE", requires = "features")]
    pub(crate) list: Option<PathBuf>,
    /// UCF_Annotation.txt, XD-Violence's annotations, or an .npy file of frame labels in the order of the list
    #[arg(long, value_name = "FILE", requires = "features")]
    pub(crate) annotation: Option<PathBuf>,
    /// Frames of a video: 16 for each snippet of its features, or all whole (floor) or begun (ceil) snippets of the
    /// annotated length
    #[arg(long, value_parser = choice(&LENGTHS), default_value = "features")]
    pub(crate) length: Length,
    /// Writes the report here [default: the run folder]
    #[arg(long, value_name = "FILE.html", value_parser = Output::file(&["html", "htm"]))]
    pub(crate) report: Option<Output>,
    /// Prints one line of JSON
    #[arg(long)]
    pub(crate) json: bool,
    #[command(flatten)]
    pub(crate) threads: Threads,
}

/// Scores videos: NAME.npy, NAME.csv and a picture of the curve, NAME.png, for each.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver vad score --run runs/ucf Abuse028_x264__0.npy -o curves
  splatweaver vad score --run urdmu.safetensors *.npy --annotation UCF_Annotation.txt -o curves")]
pub(crate) struct VadScore {
    /// Run folder or file of weights
    #[arg(long, value_name = "RUN")]
    pub(crate) run: PathBuf,
    /// Feature files; crops of one video in several files (NAME__0.npy, NAME__1.npy) count together
    #[arg(required = true, value_name = "FILE.npy")]
    pub(crate) files: Vec<PathBuf>,
    /// Draws what is anomalous by this annotation behind the curves
    #[arg(long, value_name = "FILE")]
    pub(crate) annotation: Option<PathBuf>,
    /// Folder for the results
    #[arg(short, long, value_name = "DIR", value_parser = Output::folder())]
    pub(crate) out: Output,
    /// Prints the result as JSON, and nothing else on standard output
    #[arg(long)]
    pub(crate) json: bool,
    #[command(flatten)]
    pub(crate) threads: Threads,
}

/// Judges scores that are there already.
#[derive(Args, Debug)]
#[command(after_help = "Example:
  splatweaver vad metrics --scores curves --annotation UCF_Annotation.txt --json")]
pub(crate) struct VadMetrics {
    /// Folder of scores, NAME.npy with a number for each snippet
    #[arg(long, value_name = "DIR")]
    pub(crate) scores: PathBuf,
    /// UCF_Annotation.txt, XD-Violence's annotations, or an .npy file of frame labels of the videos in alphabetical
    /// order
    #[arg(long, value_name = "FILE")]
    pub(crate) annotation: PathBuf,
    /// Frames of a video: 16 for each score, or all whole (floor) or begun (ceil) snippets of the annotated length
    #[arg(long, value_parser = choice(&LENGTHS), default_value = "features")]
    pub(crate) length: Length,
    /// Prints one line of JSON
    #[arg(long)]
    pub(crate) json: bool,
}

/// Names of the lengths.
const LENGTHS: [(&str, Length, &str); 3] =
    [("features", Length::Features, ""), ("floor", Length::Floor, ""), ("ceil", Length::Ceil, "")];

/// The networks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
pub(crate) enum EncoderName {
    /// UR-DMU
    Urdmu,
    /// Two convolutions along time
    Convolutions,
    /// DeepMIL, without experts
    Deepmil,
    /// RTFM, without experts
    Rtfm,
}

/// Rules of splatting.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
pub(crate) enum SplatName {
    #[value(name = "T")]
    Time,
    #[value(name = "S")]
    Score,
    #[value(name = "H")]
    Video,
    #[value(name = "L")]
    Literal,
    None,
}

impl SplatName {
    /// The rule, if there is one.
    pub(crate) fn rule(self) -> Option<Rule> {
        match self {
            Self::Time => Some(Rule::Time),
            Self::Score => Some(Rule::Score),
            Self::Video => Some(Rule::Video),
            Self::Literal => Some(Rule::Literal),
            Self::None => None,
        }
    }
}
