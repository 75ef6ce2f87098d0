//! `splatweaver dynamic distil`.

use super::train::derive;
use crate::run::{Run, Stage};
use clap::Args;
use std::path::PathBuf;
use weaver_command::{Console, Failure, Interrupt, LiveFlag, Output, Threads};
use weaver_view_run::Listener;

/// Trains one expert on: by photos where the gate believes it, by the mixture elsewhere; writes a new run folder.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver dynamic distil --run runs/film --expert keys --out runs/keys
  splatweaver dynamic distil --run runs/film --expert keys --photos-alone --out runs/keys-plain")]
pub struct DynamicDistil {
    /// Folder of the run
    #[arg(long, value_name = "RUN")]
    pub run: PathBuf,
    /// Name of the expert
    #[arg(long, value_name = "NAME")]
    pub expert: String,
    /// The share of photos in the loss, 0 to 1; the rest is the mixture's
    #[arg(long, value_name = "L", default_value = "0.5", conflicts_with = "photos_alone")]
    pub lambda: f64,
    /// Learns from photos alone: what distillation is compared with
    #[arg(long)]
    pub photos_alone: bool,
    /// Steps
    #[arg(long, value_name = "N", default_value = "1500", value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    pub steps: u32,
    /// Folder of the new run
    #[arg(short, long, value_name = "DIR", value_parser = Output::folder())]
    pub out: Output,
    /// Prints the result as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub live: LiveFlag,
    #[command(flatten)]
    pub threads: Threads,
}

pub fn run(arguments: &DynamicDistil, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    let live = Listener::of(arguments.live)?;
    let run = Run::open(&arguments.run)?;
    let index = run.settings().expert(&arguments.expert)?;
    let steps = arguments.steps as usize;
    let (stage, how) = match arguments.photos_alone {
        true => (Stage::Expert { index, steps }, "photos alone".to_string()),
        false => (Stage::Distil { index, steps, lambda: arguments.lambda }, format!("lambda {}", arguments.lambda)),
    };
    let by = format!("training the expert {} on, {how}", arguments.expert);
    let tensors = run.tensors();
    derive(
        &run,
        &arguments.run,
        (vec![stage], by),
        (&arguments.out, live, arguments.json),
        tensors,
        (console, interrupt),
    )
}
