//! The process around the command line: signals, panics and the streams.

use crate::{leave, printable, run};
use std::ffi::OsString;
use std::io::{self, IsTerminal, Write};
use std::panic::{self, AssertUnwindSafe};
use std::process;
use weaver_command::{Console, Interrupt};

static INTERRUPT: Interrupt = Interrupt::new();
/// The exit code that shells report for a process ended by Ctrl-C.
const INTERRUPTED: i32 = 130;

/// Runs one command line as the program of this process, and returns the exit code.
///
/// The process gets a handler of Ctrl-C and of panics, and its standard streams are written to. The binary and the
/// program that the Python package installs are this function.
pub fn process(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    panic::set_hook(Box::new(|panic| {
        let place = panic.location().map_or(String::new(), |l| format!(" at {}:{}", l.file(), l.line()));
        let message = panic.payload_as_str().unwrap_or("no message").replace('\n', " ");
        say(&format!("error: internal error{place}: {message}; please report it"));
    }));
    let handler = || {
        if !INTERRUPT.request() {
            leave();
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
    let mut console = Console::new(&mut stdout, &mut stderr, io::stderr().is_terminal());
    let run = AssertUnwindSafe(|| run(arguments, &mut console, &INTERRUPT));
    panic::catch_unwind(run).unwrap_or(1)
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
    let _ = writeln!(io::stderr(), "{}", printable(line));
}
