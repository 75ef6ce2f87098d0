//! The `splatweaver` binary: the process around [`weaver_cli::run`].

use std::io::{self, IsTerminal, Write};
use std::panic::{self, AssertUnwindSafe};
use std::process::{self, ExitCode};
use weaver_cli::{Console, Interrupt};

static INTERRUPT: Interrupt = Interrupt::new();
/// The exit code that shells report for a process ended by Ctrl-C.
const INTERRUPTED: i32 = 130;

fn main() -> ExitCode {
    panic::set_hook(Box::new(|panic| {
        let place = panic.location().map_or(String::new(), |l| format!(" at {}:{}", l.file(), l.line()));
        let message = panic.payload_as_str().unwrap_or("no message").replace('\n', " ");
        say(&format!("error: internal error{place}: {message}; please report it"));
    }));
    let handler = || {
        if !INTERRUPT.request() {
            weaver_cli::leave();
            process::exit(INTERRUPTED);
        }
        let after = INTERRUPT.awaited().map_or(String::new(), |part| format!(" after {part}"));
        say(&format!("stopping{after}; again to stop at once"));
    };
    if let Err(error) = ctrlc::set_handler(handler) {
        say(&format!("note: Ctrl-C will not save anything: {error}"));
    }
    #[cfg(unix)]
    handle_file_size_limit();
    let (mut stdout, mut stderr) = (io::stdout(), io::stderr());
    let terminal = stderr.is_terminal();
    let mut console = Console::new(&mut stdout, &mut stderr, terminal);
    let run = AssertUnwindSafe(|| weaver_cli::run(std::env::args_os(), &mut console, &INTERRUPT));
    ExitCode::from(panic::catch_unwind(run).unwrap_or(1))
}

/// Turns a file beyond the shell's size limit (`ulimit -f`) into an ordinary error of writing that names the file.
/// Without a handler, the signal would end the process silently.
#[cfg(unix)]
fn handle_file_size_limit() {
    let heard = std::sync::Arc::default();
    if let Err(error) = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, heard) {
        say(&format!("note: a file beyond the shell's limit will end this process: {error}"));
    }
}

/// A line on standard error; not `eprintln!`, which panics when standard error is closed.
fn say(line: &str) {
    let _ = writeln!(io::stderr(), "{}", weaver_cli::printable(line));
}
