//! `splatweaver reconstruct`.

use super::fit;
use crate::flags::{CompleteFlag, EstimateFlags, MaskedFlag, level, minutes};
use clap::Args;
use clap::builder::ArgPredicate;
use std::path::PathBuf;
use weaver_command::{Console, ConsoleObserver, Failure, Interrupt, LiveFlag, Output, Threads, choice};
use weaver_data::capture::HoldOut;
use weaver_reconstruct::{Photos, Quality, Request, reconstruct};
use weaver_view_run::Listener;

/// Heading of the flags of a fit.
const FIT: &str = "Fit";

/// A scene from a folder of photos, or a video, and nothing else.
///
/// A capture's own cameras are taken where there are any; else they are estimated. Then Gaussians are fitted to the
/// photos. Writes scene.ply, cameras, summary.json and report.html, and with estimated cameras the folder `cameras` as
/// `splatweaver cameras` does. Photos overlap best when each place is seen in three of them or more, from places that
/// are apart. Of a clip (MP4, MOV, MKV, WebM, AVI and others that ffmpeg reads) sharp frames become photos, as many
/// steps of the camera apart; they are written to the folder `frames`.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver reconstruct --demo -o scene                      photos that come with the program
  splatweaver reconstruct photos -o scene
  splatweaver reconstruct photos -o sketch --quality draft
  splatweaver reconstruct clip.mp4 -o scene
  splatweaver reconstruct a.jpg b.jpg c.jpg d.jpg -o scene --minutes 1
  splatweaver reconstruct photos -o scene --hold-out 8         how good it is from elsewhere")]
pub struct Reconstruct {
    /// Photos (JPEG, PNG, TIFF, WebP, HEIC, AVIF), folders of photos, clips, or one capture
    #[arg(required_unless_present = "demo")]
    pub photos: Vec<PathBuf>,
    /// Photos that come with the program, for a first look: half a minute, unless a quality or a time is given
    #[arg(long, conflicts_with = "photos")]
    pub demo: bool,
    /// Folder for the results
    #[arg(short, long, value_name = "DIR", value_parser = Output::folder())]
    pub out: Output,
    /// Time for all of it, and size of the photos; a fit ends early once it has used each photo 200 times, or 40 times
    /// where they are larger than the least. It takes longer where matching leaves less than a quarter of the time,
    /// which the fit gets all the same, or where 200 steps do
    #[arg(long, value_parser = choice(&QUALITIES), default_value = "normal", default_value_if("demo", ArgPredicate::Equals("true".into()), "draft"), help_heading = FIT)]
    pub quality: Quality,
    /// Time for all of it, matching included, which is used up; the fit gets at least a quarter of it and 200 steps,
    /// whatever matching took [default: the quality's]
    #[arg(long, value_name = "M", value_parser = minutes(), help_heading = FIT)]
    pub minutes: Option<f64>,
    /// The most Gaussians there may be [default: as many as the time can put in place, at most 0.4 for each pixel of a
    /// photo]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000_000), help_heading = FIT)]
    pub gaussians: Option<u32>,
    /// Which photos are not shown to the fit, which is judged by them: none; those that a capture lists, or every
    /// eighth where none are listed; or every so many
    #[arg(long, value_name = "listed|none|N", default_value = "none", help_heading = FIT)]
    pub hold_out: HoldOut,
    /// Seed of everything that is drawn at random
    #[arg(long, value_name = "S", default_value_t = 0, help_heading = FIT)]
    pub seed: u64,
    /// Prints the result as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
    /// Also writes scene.wsz, at a level from 0, the finest, to 3, and fits the last fifth of the run with its rounding
    /// in place, without Gaussians that are not worth their bits
    #[arg(long, value_name = "LEVEL", num_args = 0..=1, require_equals = true, default_missing_value = "0.25", value_parser = level())]
    pub compress: Option<f64>,
    /// Writes no view.html, the page to look at the scene
    #[arg(long)]
    pub no_html: bool,
    /// Keeps Gaussians that no photo needs; else they are removed at the end
    #[arg(long, help_heading = FIT)]
    pub keep_all: bool,
    /// Fits depth as well, for meshes: by depth_file_path of a transforms.json, else as photos agree about it
    #[arg(long, help_heading = FIT)]
    pub surfaces: bool,
    #[command(flatten)]
    pub live: LiveFlag,
    #[command(flatten)]
    pub estimate: EstimateFlags,
    #[command(flatten)]
    pub masked: MaskedFlag,
    #[command(flatten)]
    pub complete: CompleteFlag,
    #[command(flatten)]
    pub threads: Threads,
}

/// Purposes of a reconstruction.
const QUALITIES: [(&str, Quality, &str); 4] = [
    ("draft", Quality::Draft, "A look: half a minute for up to some 50 photos, longer for more, at most 384 pixels"),
    ("normal", Quality::Normal, "Five minutes, 800 to 1600 pixels, as time allows"),
    ("fine", Quality::Fine, "Twenty minutes, 800 to 1600 pixels, as time allows"),
    (
        "best",
        Quality::Best,
        "As long as held-out photos gain from twice the steps and Gaussians, hours if need be; up to 1600 pixels. Every eighth photo is held out for that, or every sixteenth of 64 and more, unless --hold-out chooses",
    ),
];

impl Reconstruct {
    /// Minutes of all of it, if they are bounded.
    pub fn minutes(&self) -> Option<f64> {
        self.minutes.or(self.quality.minutes())
    }
}

pub fn run(arguments: &Reconstruct, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    let photos = if arguments.demo { Photos::Demo } else { Photos::at(&arguments.photos) };
    if let Photos::Capture(_) = photos {
        arguments.estimate.check_unused("a capture with cameras of its own")?;
    }
    let request = Request {
        quality: arguments.quality,
        minutes: arguments.minutes,
        gaussians: arguments.gaussians.map(|gaussians| gaussians as usize),
        hold_out: arguments.hold_out,
        seed: arguments.seed,
        compress: arguments.compress,
        html: !arguments.no_html,
        clean: !arguments.keep_all,
        surfaces: arguments.surfaces,
        frames: arguments.estimate.clip.most(),
        matching: arguments.estimate.matching.into(),
        placing: (&arguments.estimate.placing).into(),
        masks: arguments.estimate.masks.options(),
        masked: arguments.masked.masked.unwrap_or_default(),
        live: Listener::of(arguments.live)?,
        ..Request::new(&*arguments.out)
    };
    let outcome = reconstruct(&photos, &request, &mut ConsoleObserver::interruptible(console, interrupt))?;
    fit::conclude(&outcome, interrupt);
    fit::print(&outcome, &arguments.out, arguments.json, console)
}
