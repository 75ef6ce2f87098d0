//! The output streams of a command.

use crate::failure::Failure;
use crate::printable::printable;
use serde_json::Value;
use std::io::Write;
use std::path::Path;
use weaver_io::Part;

/// The two streams of a command. Its methods print [printable] text alone.
pub struct Console<'a> {
    /// For results.
    pub stdout: &'a mut (dyn Write + Send),
    /// For progress, notes and errors.
    pub stderr: &'a mut (dyn Write + Send),
    /// True if the standard error of the process is a terminal, on which a progress bar can be drawn.
    pub terminal: bool,
    /// Receives each finished part of a job, in place of a bar or of lines.
    pub watcher: Option<&'a mut (dyn FnMut(&Part) + Send + 'a)>,
    /// Warnings that were printed.
    warnings: Vec<String>,
}

impl<'a> Console<'a> {
    /// The two streams; progress is a bar on a `terminal`, lines elsewhere.
    pub fn new(stdout: &'a mut (dyn Write + Send), stderr: &'a mut (dyn Write + Send), terminal: bool) -> Self {
        Self { stdout, stderr, terminal, watcher: None, warnings: Vec::new() }
    }

    /// Prints a line of the result on standard output.
    pub fn print(&mut self, text: &str) -> Result<(), Failure> {
        let written = writeln!(self.stdout, "{}", printable(text.trim_end())).and_then(|()| self.stdout.flush());
        written.map_err(Failure::output)
    }

    /// Prints the answer of a command that has made files or folders: `text`, or in place of it an object of JSON, its
    /// `figures` beside the paths of the `outputs` and the `warnings` that were printed.
    ///
    /// # Errors
    /// When standard output cannot be written.
    ///
    /// # Panics
    /// When `figures` is no object.
    pub fn answer(
        &mut self,
        json: bool,
        outputs: &[impl AsRef<Path>],
        mut figures: Value,
        text: &str,
    ) -> Result<(), Failure> {
        if !json {
            return self.print(text);
        }
        figures["outputs"] = outputs.iter().map(|path| path.as_ref().display().to_string()).collect();
        figures["warnings"] = std::mem::take(&mut self.warnings).into();
        self.print(&serde_json::to_string_pretty(&figures)?)
    }

    /// Prints a warning on standard error, which an [`answer`](Self::answer) repeats.
    pub fn warning(&mut self, text: &str) {
        self.note(&format!("warning: {text}"));
        self.warnings.push(text.into());
    }

    /// Passes a finished part of a job to the watcher, if any.
    pub fn tell(&mut self, part: impl FnOnce() -> Part) {
        if let Some(watcher) = &mut self.watcher {
            watcher(&part());
        }
    }

    /// Prints a line on standard error. A failure to write it is ignored: the work goes on.
    pub fn note(&mut self, text: &str) {
        let _ = writeln!(self.stderr, "{}", printable(text));
    }
}

impl std::fmt::Debug for Console<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Console").field("terminal", &self.terminal).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_name_outputs_and_warnings() {
        let (mut out, mut err) = (Vec::new(), Vec::new());
        let mut console = Console::new(&mut out, &mut err, false);
        let figures = serde_json::json!({ "gaussians": 3 });
        console.answer(false, &["a.ply"], figures.clone(), "3 Gaussians: a.ply").unwrap();
        console.warning("few photos");
        console.answer(true, &["a.ply", "b"], figures, "3 Gaussians: a.ply").unwrap();
        let [out, err] = [out, err].map(|bytes| String::from_utf8(bytes).unwrap());
        assert_eq!(err, "warning: few photos\n");
        let json = out.strip_prefix("3 Gaussians: a.ply\n").unwrap();
        assert_eq!(
            serde_json::from_str::<Value>(json).unwrap(),
            serde_json::json!({ "gaussians": 3, "outputs": ["a.ply", "b"], "warnings": ["few photos"] })
        );
    }

    /// Control characters of file names do not reach the terminal, and JSON stays the same JSON.
    ///
    /// Promise (files): control characters of file names do not reach the terminal; JSON stays the same JSON; an
    /// error is one line.
    #[test]
    fn names_do_not_steer_the_terminal() {
        let (mut out, mut err) = (Vec::new(), Vec::new());
        let mut console = Console::new(&mut out, &mut err, true);
        let name = "a\u{1b}]0;title\u{7}\u{9b}2J\r\u{7f}.ply";
        console.note(&format!("warning: {name}\n\tsecond line"));
        console.print(&format!("{name}\n")).unwrap();
        console.print(&serde_json::json!({ "file": name }).to_string()).unwrap();
        let [out, err] = [out, err].map(|bytes| String::from_utf8(bytes).unwrap());
        let escaped = r"a\u001b]0;title\u0007\u009b2J\u000d\u007f.ply";
        assert_eq!(err, format!("warning: {escaped}\n\tsecond line\n"));
        let (text, json) = out.trim_end().split_once('\n').unwrap();
        assert_eq!(text, escaped);
        assert!(!json.contains(char::is_control), "{json:?}");
        assert_eq!(serde_json::from_str::<serde_json::Value>(json).unwrap()["file"], name);
    }
}
