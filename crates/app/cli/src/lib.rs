//! The `splatweaver` command line: arguments in, exit code out.
//!
//! [`run`] is the whole program except for signals and panics, so that tests can call it.

mod advice;
mod align;
mod arguments;
mod clip;
mod compare;
mod completions;
mod config;
mod convert;
mod convert_weights;
mod dynamic;
mod estimate;
mod eval;
mod ffmpeg;
mod fit;
mod image;
mod infer;
mod info;
mod old_names;
mod reconstruct;
mod refine;
mod render;
mod train;
mod video;

pub use ffmpeg::end_all as end_programs;
pub use weaver_command::{Console, Interrupt};

pub use arguments::{Flag, flags};

use arguments::{Command, CommandLine};
use std::ffi::OsString;
use weaver_command::{Failure, in_pool};
use weaver_kernels::simd;

/// Runs one command line, whose first argument is the program's name, and returns the exit code: 0 for success, 1 for an
/// error, 2 for wrong usage.
pub fn run(arguments: impl IntoIterator<Item = OsString>, console: &mut Console, interrupt: &Interrupt) -> u8 {
    let (arguments, notes) = old_names::current(arguments.into_iter().collect());
    notes.iter().for_each(|note| console.note(note));
    let result = match CommandLine::of(arguments) {
        Ok(line) => {
            simd::requested_level().map_err(Failure::Usage).and_then(|_| dispatch(line.command, console, interrupt))
        }
        Err(error) if error.use_stderr() => {
            console.note(error.render().to_string().trim_end());
            return 2;
        }
        // `--help` and `--version`.
        Err(error) => console.print(&error.render().to_string()),
    };
    let Err(failure) = result else { return 0 };
    let explained = advice::explained(&failure);
    let code = explained.as_ref().map_or(failure.exit_code(), |(code, _)| *code);
    if let Some(line) = explained.map(|(_, line)| line).or_else(|| failure.line()) {
        console.note(&format!("error: {line}"));
    }
    code
}

/// Checks the words of one command line, whose first is the program's name, without running it.
///
/// Returns the message of wrong usage otherwise. `--help` and `--version` are accepted.
pub fn parses(arguments: impl IntoIterator<Item = OsString>) -> Result<(), String> {
    match CommandLine::of(arguments) {
        Err(error) if error.use_stderr() => Err(error.render().to_string()),
        _ => Ok(()),
    }
}

fn dispatch(command: Command, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    match command {
        Command::Reconstruct(arguments) => {
            in_pool(arguments.threads.count(), || reconstruct::run(&arguments, console, interrupt))
        }
        Command::Cameras(arguments) => in_pool(arguments.threads.count(), || estimate::run(&arguments, console)),
        Command::Train(arguments) => train::run(&arguments, console, interrupt),
        Command::Eval(arguments) => in_pool(arguments.threads.count(), || eval::run(&arguments, console)),
        Command::Infer(arguments) => in_pool(arguments.threads.count(), || infer::run(&arguments, console, interrupt)),
        Command::Fit(arguments) => {
            in_pool(arguments.threads.map(usize::from), || fit::run(&arguments, console, interrupt))
        }
        Command::Compare(arguments) => in_pool(arguments.threads.count(), || compare::run(&arguments, console)),
        Command::Render(arguments) => in_pool(arguments.threads.count(), || render::run(&arguments, console)),
        Command::Lift(arguments) => weaver_lift_run::lift(&arguments, console),
        Command::Align(arguments) => in_pool(arguments.threads.count(), || align::run(&arguments, console)),
        Command::Query(arguments) => weaver_lift_run::query(&arguments, console),
        Command::Dynamic(arguments) => dynamic::run(&arguments.command, console, interrupt),
        Command::Vad(arguments) => weaver_vad_run::run(&arguments, console, interrupt),
        Command::Lidar(arguments) => weaver_lidar_run::run(&arguments, console, interrupt),
        Command::Mesh(arguments) => weaver_lidar_run::mesh(&arguments, console),
        Command::EvalMesh(arguments) => weaver_lidar_run::eval_mesh(&arguments, console),
        Command::EvalTrajectory(arguments) => weaver_lidar_run::eval_trajectory(&arguments, console),
        Command::Image(arguments) => image::run(&arguments.command, console, interrupt),
        Command::Info(arguments) => info::run(&arguments, console),
        Command::Convert(arguments) => convert::run(&arguments, console),
        Command::ConvertWeights(arguments) => convert_weights::run(&arguments, console, interrupt),
        Command::Config(arguments) => config::run(&arguments, console),
        Command::Bench(arguments) => weaver_bench::run(&arguments, console),
        Command::Completions(arguments) => completions::run(&arguments, console),
    }
}
