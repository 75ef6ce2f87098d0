//! The output streams of a command.

use crate::failure::Failure;
use std::io::Write;

/// The two streams of a command.
pub struct Console<'a> {
    /// For results.
    pub stdout: &'a mut (dyn Write + Send),
    /// For progress, notes and errors.
    pub stderr: &'a mut (dyn Write + Send),
    /// True if the standard error of the process is a terminal, on which a progress bar can be drawn.
    pub terminal: bool,
    /// Told of each part of a job that is done, in place of a bar or of lines.
    pub watcher: Option<&'a mut (dyn FnMut(&Part) + Send + 'a)>,
}

/// A part of a job that is done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Part {
    /// Name of the job.
    pub label: &'static str,
    /// Parts that are done.
    pub done: usize,
    /// Parts of the whole job, as far as it is known.
    pub total: usize,
    /// Remark of the job about its state.
    pub note: String,
}

impl<'a> Console<'a> {
    /// The two streams; progress is a bar on a `terminal`, lines elsewhere.
    pub fn new(stdout: &'a mut (dyn Write + Send), stderr: &'a mut (dyn Write + Send), terminal: bool) -> Self {
        Self { stdout, stderr, terminal, watcher: None }
    }

    /// Prints a line of the result on standard output.
    pub fn print(&mut self, text: &str) -> Result<(), Failure> {
        let written = writeln!(self.stdout, "{}", text.trim_end()).and_then(|()| self.stdout.flush());
        written.map_err(Failure::output)
    }

    /// Tells the watcher, where there is one, of a part of a job that is done.
    pub fn tell(&mut self, part: impl FnOnce() -> Part) {
        if let Some(watcher) = &mut self.watcher {
            watcher(&part());
        }
    }

    /// Prints a line on standard error. A failure to write it is ignored: the work goes on.
    pub fn note(&mut self, text: &str) {
        let _ = writeln!(self.stderr, "{text}");
    }
}

impl std::fmt::Debug for Console<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Console").field("terminal", &self.terminal).finish_non_exhaustive()
    }
}
