//! The commands of this crate as a small program:
//! `cargo run --release -p weaver-lidar --features command --example lidar -- lidar SCANS -o RUN`.

use clap::{Parser, Subcommand};
use std::process::ExitCode;
use weaver_command::{Console, Interrupt};
use weaver_lidar::command::{EvalMesh, EvalTrajectory, Lidar, eval_mesh, eval_trajectory, run};

#[derive(Parser)]
struct Line {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Lidar(Box<Lidar>),
    EvalTrajectory(EvalTrajectory),
    EvalMesh(EvalMesh),
}

fn main() -> ExitCode {
    let (mut out, mut notes) = (std::io::stdout(), std::io::stderr());
    let mut console = Console::new(&mut out, &mut notes, false);
    let done = match Line::parse().command {
        Command::Lidar(arguments) => run(&arguments, &mut console, &Interrupt::new()),
        Command::EvalTrajectory(arguments) => eval_trajectory(&arguments, &mut console),
        Command::EvalMesh(arguments) => eval_mesh(&arguments, &mut console),
    };
    let Err(failure) = done else { return ExitCode::SUCCESS };
    failure.line().into_iter().for_each(|line| console.note(&format!("error: {line}")));
    failure.exit_code().into()
}
