//! `splatweaver reconstruct`.

use super::fit;
use crate::estimate::{estimated_capture, minutes_of_fit, note_share};
use crate::flags::{ClipFlags, CompleteFlag, MatchingFlags, hold_out, level, minutes};
use crate::{clip, demo};
use clap::builder::ArgPredicate;
use clap::{Args, ValueEnum};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::time::Instant;
use weaver_command::{Console, Failure, Interrupt, LiveFlag, Output, ShellCommand, Threads, in_pool};
use weaver_data::capture::HoldOut;
use weaver_fit::FitSettings;
use weaver_fit_run::{ByPhotos, Outcome, Pace, Run, RunError, RunSettings, plan};
use weaver_view_run::Listener;

/// Heading of the flags of a fit.
const FIT: &str = "Fit";

/// A scene from a folder of photos, or a video, and nothing else.
///
/// A capture's own cameras are taken where there are any; else they are estimated. Then Gaussians are fitted to the photos. Writes
/// scene.ply, cameras, summary.json and report.html, and with estimated cameras the folder `cameras` as `splatweaver cameras` does.
/// Photos overlap best when each place is seen in three of them or more, from places that are apart. Of a clip (MP4, MOV, MKV, WebM, AVI
/// and what else ffmpeg reads) sharp frames become photos, as many steps of the camera apart; they are written to the folder `frames`.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver reconstruct --demo -o scene                      photos that come with the program
  splatweaver reconstruct photos -o scene
  splatweaver reconstruct photos -o sketch --quality draft
  splatweaver reconstruct clip.mp4 -o scene
  splatweaver reconstruct a.jpg b.jpg c.jpg d.jpg -o scene --minutes 1
  splatweaver reconstruct photos -o scene --hold-out 8         how good it is from elsewhere")]
pub struct Reconstruct {
    /// Photos (JPEG, PNG, TIFF, WebP), folders of photos, clips, or one capture
    #[arg(required_unless_present = "demo")]
    pub photos: Vec<PathBuf>,
    /// Photos that come with the program, for a first look: half a minute, unless a quality or a time is given
    #[arg(long, conflicts_with = "photos")]
    pub demo: bool,
    /// Folder for the results
    #[arg(short, long, value_name = "DIR", value_parser = Output::folder())]
    pub out: Output,
    /// Time for all of it, and size of the photos; a fit ends early once it has used each photo 200 times, or 40 times where they are larger than the least. It takes longer where matching leaves less than half of the time, which the fit gets all the same, or where 200 steps do
    #[arg(long, value_enum, default_value_t = Quality::Normal, default_value_if("demo", ArgPredicate::IsPresent, "draft"), help_heading = FIT)]
    pub quality: Quality,
    /// Time for all of it, matching included, which is used up; the fit gets at least half of it and 200 steps, whatever matching took [default: the quality's]
    #[arg(long, value_name = "M", value_parser = minutes, help_heading = FIT)]
    pub minutes: Option<f64>,
    /// The most Gaussians there may be [default: 0.4 for each pixel of a photo, 5000 to 1000000]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000_000), help_heading = FIT)]
    pub gaussians: Option<u32>,
    /// Which photos are not shown to the fit, which is judged by them: none; those that a capture lists, or every eighth where none are
    /// listed; or every so many
    #[arg(long, value_name = "listed|none|N", value_parser = hold_out, default_value = "none", help_heading = FIT)]
    pub hold_out: HoldOut,
    /// Seed of everything that is drawn at random
    #[arg(long, value_name = "S", default_value_t = 0, help_heading = FIT)]
    pub seed: u64,
    /// Prints the result as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
    /// Also writes scene.wsz, at a level from 0, the finest, to 3, and fits the last fifth of the run with its rounding in place, without Gaussians that are not worth their bits
    #[arg(long, value_name = "LEVEL", num_args = 0..=1, require_equals = true, default_missing_value = "0.25", value_parser = level)]
    pub compress: Option<f64>,
    /// Writes no view.html, the page to look at the scene
    #[arg(long)]
    pub no_html: bool,
    #[command(flatten)]
    pub live: LiveFlag,
    #[command(flatten)]
    pub clip: ClipFlags,
    #[command(flatten)]
    pub matching: MatchingFlags,
    #[command(flatten)]
    pub complete: CompleteFlag,
    #[command(flatten)]
    pub threads: Threads,
}

/// The purpose of a reconstruction.
#[derive(Clone, Copy, Debug, Eq, PartialEq, ValueEnum)]
pub enum Quality {
    /// A look: half a minute for some 15 photos, longer for more, at most 384 pixels
    Draft,
    /// Five minutes, 800 to 1600 pixels, as time allows
    Normal,
    /// Twenty minutes, 800 to 1600 pixels, as time allows
    Fine,
}

impl Quality {
    /// Minutes, and the longest side that photos have at least and at most, if they are as large.
    pub fn effort(self) -> (f64, RangeInclusive<usize>) {
        match self {
            Self::Draft => (0.5, 384..=384),
            Self::Normal => (5.0, 800..=1600),
            Self::Fine => (20.0, 800..=1600),
        }
    }
}

/// The most passes through the photos in the time of a quality, by docs/results/photos.md: held-out photos gain nothing from more.
const MOST_ROUNDS: usize = 200;
/// Passes through photos that are larger than the least: time for more of them is better spent on larger photos, by the same page, and more gain nothing.
const ENOUGH_ROUNDS: usize = 40;

pub fn run(arguments: &Reconstruct, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    in_pool(arguments.threads.count(), || reconstruct(arguments, console, interrupt))
}

fn reconstruct(arguments: &Reconstruct, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    let start = Instant::now();
    let live = Listener::of(arguments.live)?;
    let out = match Run::claim(&arguments.out, &arguments.photos) {
        Err(RunError::Run(weaver_run::Error::RunExists { folder, .. })) => return Err(exists(&folder)),
        claimed => claimed?,
    };
    let demo = arguments.demo.then(|| demo::write(out.out())).transpose()?;
    let (capture, hold_out) = match demo.as_ref().map_or(arguments.photos.as_slice(), std::slice::from_ref) {
        [one] if is_capture(one) => {
            arguments.matching.check_unused("a capture with cameras of its own")?;
            arguments.clip.check_unused("a capture with cameras of its own")?;
            console.note(&format!("cameras: those of {}", one.display()));
            (one.clone(), arguments.hold_out)
        }
        paths => {
            let photos = clip::photos(paths, arguments.clip, out.out(), console)?;
            let capture = estimated_capture(&photos, arguments.hold_out, arguments.matching, out.out(), console)?;
            (capture, fit::listed(arguments.hold_out))
        }
    };
    let (minutes, sides) = arguments.quality.effort();
    let minutes = arguments.minutes.unwrap_or(minutes);
    note_share(minutes, start, console);
    let left = minutes_of_fit(minutes, start);
    let mut settings = RunSettings {
        minutes: Some(left),
        most_rounds: arguments.minutes.is_none().then_some(MOST_ROUNDS),
        hold_out,
        by_photos: ByPhotos::ALL,
        compress: arguments.compress,
        html: !arguments.no_html,
        ..RunSettings::new(capture, FitSettings::default())
    };
    let means = fit::Means::usual(live)?;
    let least_side = *sides.start();
    let size = Pace::long_side(&settings, sides, (left, ENOUGH_ROUNDS), means.rasterizer.clone())?;
    if size > least_side {
        settings.most_rounds = settings.most_rounds.map(|_| ENOUGH_ROUNDS);
    }
    let left = minutes_of_fit(minutes, start);
    (settings.long_side, settings.minutes) = (Some(size), Some(left));
    let usual = plan(&settings)?.usual();
    let gaussians = arguments.gaussians.map_or(usual.gaussians, |gaussians| gaussians as usize);
    settings.fit = FitSettings { gaussians, seed: arguments.seed, ..usual };
    settings.fit.check()?;
    let capture = settings.capture.display();
    console.note(&format!("fit: {capture}, {left:.2} minutes, photos of at most {size} pixels"));
    let outcome = fit::begin(settings, means, out, console, interrupt)?;
    fit::note_excess(Some(minutes), start, console);
    fit::print(&outcome, &arguments.out, arguments.json, console)
}

/// Why nothing is made in a folder with a run, and how to go on with one that did not come to its end.
fn exists(folder: &Path) -> Failure {
    let path = folder.display();
    let outcome = weaver_io::read_text(folder.join("summary.json")).ok();
    let outcome = outcome.and_then(|text| serde_json::from_str::<Outcome>(&text).ok());
    Failure::Usage(if outcome.is_some_and(|outcome| outcome.steps >= outcome.planned) {
        format!("{path}: a finished scene is there already; give another --out")
    } else {
        let resume = ShellCommand::new("splatweaver fit --resume").path(folder);
        format!("{path}: a fit was begun there and did not come to its end; to go on: {resume}")
    })
}

/// True if a folder or file tells its cameras.
fn is_capture(path: &Path) -> bool {
    let files = [
        "transforms.json",
        "transforms_train.json",
        "sparse",
        "cams",
        "cameras_sphere.npz",
        "cameras.npz",
        "cameras.txt",
    ];
    path.is_file() && path.extension().is_some_and(|e| e == "json")
        || files.iter().any(|name| weaver_io::is_taken(path.join(name)))
}
