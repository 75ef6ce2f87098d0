//! `splatweaver dynamic`.

mod eval;
mod render;
mod train;

use crate::arguments::DynamicCommand;
use crate::{Console, Interrupt, in_pool};
use weaver_command::Failure;

pub fn run(command: &DynamicCommand, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    match command {
        DynamicCommand::Train(arguments) => {
            in_pool(arguments.threads.count(), || train::run(arguments, console, interrupt))
        }
        DynamicCommand::Eval(arguments) => in_pool(arguments.threads.count(), || eval::run(arguments, console)),
        DynamicCommand::Render(arguments) => in_pool(arguments.threads.count(), || render::run(arguments, console)),
        DynamicCommand::Prune(arguments) => {
            in_pool(arguments.threads.count(), || train::prune(arguments, console, interrupt))
        }
        DynamicCommand::Distil(arguments) => {
            in_pool(arguments.threads.count(), || train::distil(arguments, console, interrupt))
        }
    }
}
