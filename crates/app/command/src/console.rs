//! The output streams of a command.

use crate::failure::Failure;
use crate::printable::printable;
use crate::progress_form::ProgressForm;
use serde::Serialize;
use serde_json::json;
use std::io::Write;
use std::path::Path;
use weaver_io::Part;

/// The two streams of a command. Its methods print [printable] text alone.
pub struct Console<'a> {
    /// For results.
    pub stdout: &'a mut (dyn Write + Send),
    /// For progress, notes and errors.
    pub stderr: &'a mut (dyn Write + Send),
    /// The form of progress on standard error; [`Json`](ProgressForm::Json) makes every line of it an object.
    pub progress: ProgressForm,
    /// Receives each finished part of a job, in place of a bar or of lines.
    pub watcher: Option<&'a mut (dyn FnMut(&Part) + Send + 'a)>,
    /// Warnings that were printed.
    warnings: Vec<String>,
}

impl<'a> Console<'a> {
    /// The two streams; progress is a bar on a `terminal`, lines elsewhere.
    pub fn new(stdout: &'a mut (dyn Write + Send), stderr: &'a mut (dyn Write + Send), terminal: bool) -> Self {
        let progress = if terminal { ProgressForm::Bar } else { ProgressForm::Lines };
        Self { stdout, stderr, progress, watcher: None, warnings: Vec::new() }
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
    /// When standard output cannot be written, or `figures` is neither a struct nor a map.
    pub fn answer(
        &mut self,
        json: bool,
        outputs: &[impl AsRef<Path>],
        figures: impl Serialize,
        text: &str,
    ) -> Result<(), Failure> {
        if !json {
            return self.print(text);
        }
        let outputs = outputs.iter().map(|path| path.as_ref().display().to_string()).collect();
        let answer = Answer { figures, outputs, warnings: std::mem::take(&mut self.warnings) };
        self.print(&serde_json::to_string_pretty(&answer)?)
    }

    /// Prints a warning on standard error, which an [`answer`](Self::answer) repeats.
    pub fn warning(&mut self, text: &str) {
        self.line("warning", text);
        self.warnings.push(text.into());
    }

    /// Prints the reason for which a command fails on standard error.
    pub fn error(&mut self, text: &str) {
        self.line("error", text);
    }

    /// Prints a line on standard error. A failure to write it is ignored: the work goes on.
    pub fn note(&mut self, text: &str) {
        self.line("note", text);
    }

    /// A line of standard error; the others than notes begin with their kind.
    fn line(&mut self, kind: &str, text: &str) {
        if self.progress == ProgressForm::Json {
            return self.event(&json!({ kind: text }));
        }
        let prefix = if kind == "note" { String::new() } else { format!("{kind}: ") };
        let _ = writeln!(self.stderr, "{prefix}{}", printable(text));
    }

    /// Writes an object of JSON as a line of standard error, for programs.
    pub(crate) fn event(&mut self, event: &serde_json::Value) {
        let _ = writeln!(self.stderr, "{}", printable(&event.to_string()));
    }

    /// Passes a finished part of a job to the watcher, if any.
    pub fn tell(&mut self, part: impl FnOnce() -> Part) {
        if let Some(watcher) = &mut self.watcher {
            watcher(&part());
        }
    }
}

/// An answer for programs.
#[derive(Serialize)]
struct Answer<F> {
    #[serde(flatten)]
    figures: F,
    outputs: Vec<String>,
    warnings: Vec<String>,
}

impl std::fmt::Debug for Console<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Console").field("progress", &self.progress).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_name_outputs_and_warnings() {
        let (mut out, mut err) = (Vec::new(), Vec::new());
        let mut console = Console::new(&mut out, &mut err, false);
        let figures = json!({ "gaussians": 3 });
        console.answer(false, &["a.ply"], &figures, "3 Gaussians: a.ply").unwrap();
        console.warning("few photos");
        console.answer(true, &["a.ply", "b"], &figures, "3 Gaussians: a.ply").unwrap();
        // A list has no place for them.
        assert!(console.answer(true, &["a.ply"], [1, 2], "").is_err());
        let [out, err] = [out, err].map(|bytes| String::from_utf8(bytes).unwrap());
        assert_eq!(err, "warning: few photos\n");
        let json = out.strip_prefix("3 Gaussians: a.ply\n").unwrap();
        assert_eq!(
            serde_json::from_str::<serde_json::Value>(json).unwrap(),
            json!({ "gaussians": 3, "outputs": ["a.ply", "b"], "warnings": ["few photos"] })
        );
    }

    #[test]
    fn lines_for_programs_are_objects() {
        let (mut out, mut err) = (Vec::new(), Vec::new());
        let mut console = Console::new(&mut out, &mut err, true);
        console.progress = ProgressForm::Json;
        console.note("3 photos");
        console.warning("few photos");
        console.error("a.ply: \u{1b}");
        let lines = String::from_utf8(err).unwrap();
        let expected = [r#"{"note":"3 photos"}"#, r#"{"warning":"few photos"}"#, r#"{"error":"a.ply: \u001b"}"#];
        assert_eq!(lines.lines().collect::<Vec<_>>(), expected);
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
        console.print(&json!({ "file": name }).to_string()).unwrap();
        let [out, err] = [out, err].map(|bytes| String::from_utf8(bytes).unwrap());
        let escaped = r"a\u001b]0;title\u0007\u009b2J\u000d\u007f.ply";
        assert_eq!(err, format!("warning: {escaped}\n\tsecond line\n"));
        let (text, json) = out.trim_end().split_once('\n').unwrap();
        assert_eq!(text, escaped);
        assert!(!json.contains(char::is_control), "{json:?}");
        assert_eq!(serde_json::from_str::<serde_json::Value>(json).unwrap()["file"], name);
    }
}
