//! `splatweaver dynamic`: trainings of a mixture, its figures and pictures, and derived runs with fewer Gaussians or
//! single experts.

mod distil;
mod eval;
mod film;
mod prune;
mod render;
mod train;

use clap::{Args, Subcommand};
use distil::DynamicDistil;
use eval::DynamicEval;
pub use film::film;
use prune::DynamicPrune;
use render::DynamicRender;
use train::DynamicTrain;
use weaver_command::{Console, Failure, Interrupt, in_pool};

/// Scenes that move: several models of moving Gaussians, and a router that says which to believe, pixel by pixel
/// (MoE-GS).
///
/// Films are folders as D-NeRF, Neural 3D Video or HyperNeRF have them. Without any, a film is generated.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver dynamic train --out runs/film
  splatweaver dynamic eval --run runs/film
  splatweaver dynamic render --run runs/film --times 0:1:60 --gate -o frames
  splatweaver dynamic prune --run runs/film --keep 0.45 --out runs/smaller
  splatweaver dynamic distil --run runs/film --expert keys --out runs/keys
  splatweaver dynamic train --data flame_steak --experts field,keys,poly --out runs/steak")]
pub struct Dynamic {
    #[command(subcommand)]
    command: DynamicCommand,
}

/// The commands.
#[derive(Debug, Subcommand)]
enum DynamicCommand {
    Train(DynamicTrain),
    Eval(DynamicEval),
    Render(DynamicRender),
    Prune(DynamicPrune),
    Distil(DynamicDistil),
}

/// Runs one of the commands. Videos are encoded by the surrounding program.
///
/// Fails on unreadable or inconsistent files, on a diverging training, and on results that cannot be written.
pub fn run(arguments: &Dynamic, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    match &arguments.command {
        DynamicCommand::Train(it) => in_pool(it.threads.count(), || train::run(it, console, interrupt)),
        DynamicCommand::Eval(it) => in_pool(it.threads.count(), || eval::run(it, console)),
        DynamicCommand::Render(it) => in_pool(it.threads.count(), || render::run(it, console)),
        DynamicCommand::Prune(it) => in_pool(it.threads.count(), || prune::run(it, console, interrupt)),
        DynamicCommand::Distil(it) => in_pool(it.threads.count(), || distil::run(it, console, interrupt)),
    }
}
