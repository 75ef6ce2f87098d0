//! The benchmarks alone, without the rest of the command line.

use clap::Parser;
use std::process::ExitCode;
use weaver_bench::{Bench, run};
use weaver_command::{Console, Interrupt};

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    bench: Bench,
}

fn main() -> ExitCode {
    let (mut stdout, mut stderr) = (std::io::stdout(), std::io::stderr());
    let mut console = Console::new(&mut stdout, &mut stderr, false);
    match run(&Line::parse().bench, &mut console, &Interrupt::new()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            failure.line().into_iter().for_each(|line| eprintln!("error: {line}"));
            failure.exit_code().into()
        }
    }
}
