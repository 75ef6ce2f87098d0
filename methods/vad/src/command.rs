//! `splatweaver vad`: detectors of anomalies in videos, trained in a folder, evaluated by the published metrics, and
//! applied.
//!
//! Network, training and evaluators are the library's; here are the run, the files around it and the report.
//!
//! ```no_run
//! use clap::Parser;
//! use weaver_command::{Console, Interrupt};
//! use weaver_vad::command::{Vad, run};
//!
//! #[derive(Parser)]
//! struct Line {
//!     #[command(flatten)]
//!     vad: Vad,
//! }
//!
//! let line = Line::parse_from(["vad", "train", "--steps", "30", "--out", "runs/planted"]);
//! let (mut out, mut notes) = (std::io::stdout(), std::io::stderr());
//! let mut console = Console::new(&mut out, &mut notes, false);
//! if let Err(failure) = run(&line.vad, &mut console, &Interrupt::new()) {
//!     eprintln!("{}", failure.line().unwrap_or_default());
//! }
//! ```

mod arguments;
mod checkpoint;
mod judge;
mod judged;
mod metrics;
mod report;
mod score;
mod train;

pub use arguments::Vad;

use crate::Detector;
use arguments::VadCommand;
use std::path::{Path, PathBuf};
use weaver_command::{Console, Failure, Interrupt, in_pool};

/// Runs one of the commands.
///
/// Fails where files cannot be read or do not belong together, where training diverges, and where results cannot be
/// written.
pub fn run(arguments: &Vad, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    match &arguments.command {
        VadCommand::Train(arguments) => {
            in_pool(arguments.threads.count(), || train::run(arguments, console, interrupt))
        }
        VadCommand::Eval(arguments) => in_pool(arguments.threads.count(), || judge::run(arguments, console)),
        VadCommand::Score(arguments) => in_pool(arguments.threads.count(), || score::run(arguments, console)),
        VadCommand::Metrics(arguments) => metrics::run(arguments, console),
    }
}

/// The file of weights in a run folder.
const MODEL: &str = "model.safetensors";

/// The detector of a run folder or a file of weights, the file, and the metadata beside the weights.
fn open(run: &Path) -> Result<(Detector, PathBuf, String), Failure> {
    let path = if run.is_dir() { run.join(MODEL) } else { run.to_path_buf() };
    let (detector, metadata) = Detector::read(&path)?;
    Ok((detector, path, metadata))
}

/// Fails unless features have the width that a detector takes.
fn check_width(detector: &Detector, width: usize, of: &str, model: &Path) -> Result<(), Failure> {
    let expected = detector.kind().features();
    if width == expected {
        return Ok(());
    }
    let model = model.display();
    Err(Failure::message(format!(
        "{of}: expected {expected} features for each snippet, as {model} takes, found {width}"
    )))
}
