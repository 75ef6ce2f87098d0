//! Progress of a command: a bar on a terminal, a line every few seconds elsewhere, or objects of JSON for a program.

use crate::printable::printable;
use crate::{Console, Part, ProgressForm};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use serde_json::json;
use std::fmt::Write;
use std::time::{Duration, Instant};
use weaver_io::duration;

/// Time between lines where there is no terminal.
const PAUSE: Duration = Duration::from_secs(5);
/// Time between objects of JSON.
const SHORT_PAUSE: Duration = Duration::from_millis(200);
const BAR: &str = "{prefix} {wide_bar} {pos}/{len}  {rate}  {eta} left  {msg}";

/// Counts the parts of a job that are done.
#[derive(Debug)]
pub struct Progress {
    label: &'static str,
    bar: Option<ProgressBar>,
    /// Time of the last line, and the number of parts done by then.
    mark: (Instant, usize),
}

impl Progress {
    /// Starts at part `done` of `total` of the job called `label`.
    pub fn new(label: &'static str, done: usize, total: usize, console: &Console) -> Self {
        let bar = (console.progress == ProgressForm::Bar && console.watcher.is_none()).then(|| {
            let bar = ProgressBar::with_draw_target(Some(total as u64), ProgressDrawTarget::stderr_with_hz(8));
            let style = ProgressStyle::with_template(BAR).expect("a template that indicatif knows");
            let style = style.progress_chars("=> ").with_key("rate", rate);
            let bar = bar.with_style(style).with_prefix(label);
            bar.set_position(done as u64);
            bar.reset_eta();
            bar
        });
        Self { label, bar, mark: (Instant::now(), done) }
    }

    /// Shows `done` of `total` parts as done; `note` is called only when something is shown.
    pub fn at(&mut self, done: usize, total: usize, note: impl FnOnce() -> String, console: &mut Console) {
        if let Some(watcher) = &mut console.watcher {
            return watcher(&Part { label: self.label, done, total, note: note() });
        }
        if let Some(bar) = &self.bar {
            bar.set_length(total as u64);
            bar.set_message(printable(&note()).into_owned());
            bar.set_position(done as u64);
            return;
        }
        let elapsed = self.mark.0.elapsed();
        if console.progress == ProgressForm::Json {
            if elapsed >= SHORT_PAUSE || done == total {
                console.event(&json!({ "progress": self.label, "done": done, "total": total, "note": note() }));
                self.mark = (Instant::now(), done);
            }
            return;
        }
        if elapsed >= PAUSE && done > self.mark.1 {
            // Measured over the last interval, since the stages of a run differ in cost.
            let rate = (done - self.mark.1) as f64 / elapsed.as_secs_f64();
            let left = duration(total.saturating_sub(done) as f64 / rate);
            console.note(&format!("{} {done}/{total}, {rate:.2}/s, {left} left  {}", self.label, note()));
            self.mark = (Instant::now(), done);
        }
    }

    /// Removes the bar.
    pub fn finish(self) {
        if let Some(bar) = self.bar {
            bar.finish_and_clear();
        }
    }
}

fn rate(state: &ProgressState, out: &mut dyn Write) {
    // Writing to a string cannot fail.
    let _ = write!(out, "{:.2}/s", state.per_sec());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_come_only_after_a_while() {
        let (mut out, mut err) = (Vec::new(), Vec::new());
        let mut console = Console::new(&mut out, &mut err, false);
        let mut progress = Progress::new("render", 10, 30, &console);
        progress.at(11, 30, String::new, &mut console);
        progress.mark.0 -= 2 * PAUSE;
        progress.at(20, 30, || "loss 1".into(), &mut console);
        progress.finish();
        let text = String::from_utf8(err).unwrap();
        assert_eq!(text.lines().count(), 1, "{text}");
        assert!(text.starts_with("render 20/30, 1.00/s, 10 s left"), "{text}");
        assert!(text.contains("loss 1") && out.is_empty());
    }

    #[test]
    fn programs_read_objects() {
        let (mut out, mut err) = (Vec::new(), Vec::new());
        let mut console = Console::new(&mut out, &mut err, true);
        console.progress = ProgressForm::Json;
        let mut progress = Progress::new("render", 0, 3, &console);
        // The first two come too soon after the beginning; the end is always told.
        (1..=3).for_each(|done| progress.at(done, 3, || format!("part {done}"), &mut console));
        progress.finish();
        let told = r#"{"done":3,"note":"part 3","progress":"render","total":3}"#;
        assert_eq!(String::from_utf8(err).unwrap(), format!("{told}\n"));
    }

    #[test]
    fn a_watcher_is_told_of_every_part() {
        let (mut out, mut err, mut told) = (Vec::new(), Vec::new(), Vec::new());
        let mut watch = |part: &Part| told.push(format!("{} {}/{} {}", part.label, part.done, part.total, part.note));
        let mut console = Console::new(&mut out, &mut err, true);
        console.watcher = Some(&mut watch);
        let mut progress = Progress::new("render", 0, 2, &console);
        (1..=2).for_each(|done| progress.at(done, 2, || format!("part {done}"), &mut console));
        progress.finish();
        assert_eq!(told, ["render 1/2 part 1", "render 2/2 part 2"]);
        assert!(err.is_empty());
    }
}
