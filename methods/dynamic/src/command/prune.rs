//! `splatweaver dynamic prune`.

use super::train::derive;
use crate::run::{KeepBy, Run, Stage};
use clap::Args;
use std::path::PathBuf;
use weaver_command::{Console, Failure, Interrupt, LiveFlag, Output, Progress, Threads};
use weaver_view_run::Listener;

/// Leaves out the Gaussians that are worth least, trains the router on, and writes a new run folder.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver dynamic prune --run runs/film --keep 0.45 --out runs/smaller
  splatweaver dynamic prune --run runs/film --keep 0.25 --by sensitivity --out runs/as-published")]
pub struct DynamicPrune {
    /// Folder of the run
    #[arg(long, value_name = "RUN")]
    pub run: PathBuf,
    /// The share of Gaussians that stays, above 0, at most 1
    #[arg(long, value_name = "SHARE")]
    pub keep: f64,
    /// The score of Gaussians: contribution (to the pictures, times the gate), sensitivity (of the gate, as published),
    /// chance
    #[arg(long, value_name = "SCORE", default_value_t)]
    pub by: KeepBy,
    /// Steps of the router afterwards
    #[arg(long, value_name = "N", default_value = "500", value_parser = clap::value_parser!(u32).range(0..=10_000_000))]
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

pub fn run(arguments: &DynamicPrune, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    let live = Listener::of(arguments.live)?;
    let run = Run::open(&arguments.run)?;
    let mut progress = Progress::new("prune", 0, run.training().len(), console);
    let observe = |done, all| progress.at(done, all, String::new, console);
    let tensors = run.pruned(arguments.keep, arguments.by, observe)?;
    progress.finish();
    let stages = vec![Stage::Router { steps: arguments.steps as usize }];
    let by = format!("keeping {} of the Gaussians by {}", arguments.keep, arguments.by);
    derive(&run, &arguments.run, (stages, by), (&arguments.out, live, arguments.json), tensors, (console, interrupt))
}
