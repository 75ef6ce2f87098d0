//! A command of one's own: counts to a number, with progress and a result.

use clap::Parser;
use std::process::ExitCode;
use weaver_command::{Console, Failure, Progress, Threads, in_pool};

/// Counts.
#[derive(Parser)]
struct Count {
    /// Length of the range.
    #[arg(default_value_t = 20)]
    to: usize,
    #[command(flatten)]
    threads: Threads,
}

fn main() -> ExitCode {
    let arguments = Count::parse();
    let (mut stdout, mut stderr) = (std::io::stdout(), std::io::stderr());
    let mut console = Console::new(&mut stdout, &mut stderr, false);
    match in_pool(arguments.threads.count(), || count(&arguments, &mut console)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            failure.line().into_iter().for_each(|line| eprintln!("error: {line}"));
            failure.exit_code().into()
        }
    }
}

fn count(arguments: &Count, console: &mut Console) -> Result<(), Failure> {
    let mut progress = Progress::new("count", 0, arguments.to, console);
    for done in 1..=arguments.to {
        std::thread::sleep(std::time::Duration::from_millis(20));
        progress.at(done, arguments.to, String::new, console);
    }
    progress.finish();
    console.print(&arguments.to.to_string())
}
