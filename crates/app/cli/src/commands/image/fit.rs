//! `splatweaver image fit`.

use super::{failure, read};
use clap::{ArgGroup, Args};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use weaver_command::{Console, Failure, Interrupt, MOST_SEED, Progress, Threads};
use weaver_image::{FitSettings, ImageError, Picture, decode, encode, fit, metrics};
use weaver_io::{atomic_write, check_output_file};

/// Fits Gaussians to a picture and writes them as a .wgi file.
///
/// Alpha is composited over black; numbers of 16 bits are taken to 8. Ctrl-C ends the fit, and what there is is written.
#[derive(Args, Debug)]
#[command(group(ArgGroup::new("size").args(["ratio", "gaussians", "bytes", "psnr"])))]
#[command(after_help = "Examples:
  splatweaver image fit photo.jpg -o photo.wgi
  splatweaver image fit photo.jpg -o photo.wgi --ratio 100 --steps 1000
  splatweaver image fit photo.jpg -o photo.wgi --psnr 30
  splatweaver image fit photo.jpg -o photo.wgi --published --steps 3000")]
pub struct ImageFit {
    /// The picture
    #[arg(value_name = "PICTURE")]
    pub picture: PathBuf,
    /// The file to write
    #[arg(short, long, value_name = "FILE")]
    pub out: PathBuf,
    /// Compression ratio that the number of Gaussians is for, 56 bits each; files take about half of that [default: 50]
    #[arg(long, value_name = "RATIO")]
    pub ratio: Option<f64>,
    /// Number of Gaussians
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub gaussians: Option<u32>,
    /// Length of the file at most; fits several times
    #[arg(long, value_name = "BYTES", value_parser = clap::value_parser!(u32).range(128..))]
    pub bytes: Option<u32>,
    /// Decibels at least; fits several times
    #[arg(long, value_name = "DECIBELS")]
    pub psnr: Option<f64>,
    /// Optimization steps
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = clap::value_parser!(u32).range(1..))]
    pub steps: u32,
    /// Seed of what is drawn at random
    #[arg(long, value_name = "S", default_value_t = 0, value_parser = clap::value_parser!(u64).range(..=MOST_SEED))]
    pub seed: u64,
    /// SmartSplat's published start, loss and rates in place of ours
    #[arg(long)]
    pub published: bool,
    #[command(flatten)]
    pub threads: Threads,
}

/// Fits that look for a number of bytes or decibels, at most.
const TRIALS: usize = 6;
/// Bits of a Gaussian in a file, about.
const BITS: f64 = 29.0;
/// Decibels that doubling the Gaussians brings, about.
const DOUBLING: f64 = 1.5;

/// A fit, as its file shows it.
struct Trial {
    gaussians: usize,
    bytes: Vec<u8>,
    decibels: f64,
    reset: usize,
}

pub fn run(arguments: &ImageFit, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    check_output_file(&arguments.out, [&arguments.picture])?;
    if let Some(ratio) = arguments.ratio.filter(|ratio| !(*ratio > 0.0 && ratio.is_finite())) {
        return Err(Failure::Usage(format!("--ratio: expected a number above 0, found {ratio}")));
    }
    let picture = read(&arguments.picture, console)?;
    let mut run = Run { arguments, picture: &picture, console, interrupt };
    let trial = match (arguments.bytes, arguments.psnr) {
        (Some(bytes), _) => run.within(bytes as usize)?,
        (_, Some(decibels)) => run.reaching(decibels)?,
        _ => {
            let count = arguments.gaussians.map(|n| n as usize);
            run.trial(count.unwrap_or_else(|| picture.gaussians_for(arguments.ratio.unwrap_or(50.0))))?
        }
    };
    atomic_write(&arguments.out, |to| to.write_all(&trial.bytes))?;
    if trial.reset > 0 {
        console.note(&format!("Gaussians that left the numbers and were reset: {}", trial.reset));
    }
    let bits = 8.0 * trial.bytes.len() as f64 / picture.pixels() as f64;
    let (count, bytes, decibels) = (trial.gaussians, trial.bytes.len(), trial.decibels);
    let out = arguments.out.display();
    console.print(&format!("{count} Gaussians, {bytes} bytes, {bits:.3} bits a pixel, {decibels:.2} dB: {out}"))
}

struct Run<'a, 'b> {
    arguments: &'a ImageFit,
    picture: &'a Picture,
    console: &'a mut Console<'b>,
    interrupt: &'a Interrupt,
}

impl Run<'_, '_> {
    fn stopped(&self) -> bool {
        self.interrupt.watch().load(Ordering::Relaxed)
    }

    fn trial(&mut self, count: usize) -> Result<Trial, Failure> {
        let steps = self.arguments.steps as usize;
        let mut settings = match self.arguments.published {
            true => FitSettings::published(count, steps),
            false => FitSettings::new(count, steps),
        };
        (settings.seed, settings.coded) = (self.arguments.seed, true);
        let mut progress = Progress::new("fit", 0, steps, self.console);
        let (console, interrupt) = (&mut *self.console, self.interrupt);
        let fitted = fit(self.picture, &settings, &mut |at| {
            let note = || match self.arguments.published {
                true => format!("{} Gaussians, loss {:.4}", at.gaussians, at.loss),
                false => format!("{} Gaussians, {:.2} dB", at.gaussians, -10.0 * at.loss.log10()),
            };
            progress.at(at.step, steps, note, console);
            match interrupt.watch().load(Ordering::Relaxed) {
                true => ControlFlow::Break(()),
                false => ControlFlow::Continue(()),
            }
        });
        progress.finish();
        self.judged(fitted.and_then(|fitted| {
            let (width, height) = (self.picture.width(), self.picture.height());
            let bytes = encode(&fitted, width, height)?;
            let drawn = decode(&bytes)?.fitted.draw(width, height)?;
            let decibels = metrics::psnr(&drawn, self.picture.colors());
            Ok(Trial { gaussians: fitted.gaussians.len(), bytes, decibels, reset: fitted.reset })
        }))
    }

    fn judged(&self, trial: Result<Trial, ImageError>) -> Result<Trial, Failure> {
        let path: &Path = &self.arguments.picture;
        trial.map_err(|error| failure(path, &error))
    }

    /// The largest trial of at most so many bytes.
    fn within(&mut self, bytes: usize) -> Result<Trial, Failure> {
        let mut best: Option<Trial> = None;
        let mut count = 8.0 * bytes as f64 / BITS;
        for _ in 0..TRIALS {
            let trial = self.trial(self.bounded(count))?;
            let found = trial.bytes.len();
            // Two parts in a thousand below, so that the next one is not above again.
            count = trial.gaussians as f64 * 0.998 * bytes as f64 / found as f64;
            let fits = found <= bytes;
            if fits && best.as_ref().is_none_or(|best| best.bytes.len() < found) {
                best = Some(trial);
            }
            if self.stopped() || (fits && found as f64 > 0.99 * bytes as f64) {
                break;
            }
        }
        best.ok_or_else(|| Failure::message(format!("--bytes {bytes}: expected a length that a fit has, found none")))
    }

    /// The smallest trial of at least so many decibels.
    fn reaching(&mut self, decibels: f64) -> Result<Trial, Failure> {
        let mut best: Option<Trial> = None;
        let (mut count, mut highest) = (self.picture.gaussians_for(50.0) as f64, f64::NEG_INFINITY);
        for _ in 0..TRIALS {
            let trial = self.trial(self.bounded(count))?;
            let missing = decibels - trial.decibels;
            highest = highest.max(trial.decibels);
            count = trial.gaussians as f64 * ((missing + 0.05) / DOUBLING).clamp(-3.0, 3.0).exp2();
            let reached = missing <= 0.0;
            if reached && best.as_ref().is_none_or(|best| trial.bytes.len() < best.bytes.len()) {
                best = Some(trial);
            }
            if self.stopped() || (reached && missing > -0.1) {
                break;
            }
        }
        best.ok_or_else(|| {
            Failure::message(format!(
                "--psnr {decibels}: expected a fit that reaches it, found {highest:.2} dB at most"
            ))
        })
    }

    fn bounded(&self, count: f64) -> usize {
        (count as usize).clamp(1, self.picture.pixels())
    }
}
