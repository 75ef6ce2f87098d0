//! A console that watches the work of a library.

use crate::{Console, Interrupt, Progress};
use std::ops::ControlFlow;
use weaver_io::{Observe, Part, Stage};

/// Shows notes, warnings and progress on a console, and passes on a Ctrl-C.
#[derive(Debug)]
pub struct ConsoleObserver<'a, 'c> {
    console: &'a mut Console<'c>,
    interrupt: Option<&'a Interrupt>,
    progress: Option<Progress>,
}

impl<'a, 'c> ConsoleObserver<'a, 'c> {
    /// An observer of work that leaves nothing when it is stopped.
    pub fn new(console: &'a mut Console<'c>) -> Self {
        Self { console, interrupt: None, progress: None }
    }

    /// An observer of work with a stage that [leaves results](Stage::stops_after) when it is stopped.
    pub fn interruptible(console: &'a mut Console<'c>, interrupt: &'a Interrupt) -> Self {
        Self { console, interrupt: Some(interrupt), progress: None }
    }

    /// Removes the bar of a stage that has ended.
    fn end_stage(&mut self) {
        if let Some(progress) = self.progress.take() {
            progress.finish();
        }
    }
}

impl Observe for ConsoleObserver<'_, '_> {
    fn note(&mut self, text: &str) {
        self.end_stage();
        self.console.note(text);
    }

    fn warning(&mut self, text: &str) {
        self.end_stage();
        self.console.warning(text);
    }

    fn begin(&mut self, stage: &Stage) {
        self.end_stage();
        if let (Some(interrupt), Some(part)) = (self.interrupt, stage.stops_after) {
            interrupt.watch_after(part);
        }
        self.progress = Some(Progress::new(stage.label, stage.done, stage.total, self.console));
    }

    fn progress(&mut self, part: &Part) -> ControlFlow<()> {
        match &mut self.progress {
            Some(progress) => progress.at(part.done, part.total, || part.note.clone(), self.console),
            // A stage of one part has no bar.
            None => self.console.tell(|| part.clone()),
        }
        match self.interrupt {
            Some(interrupt) if interrupt.is_requested() => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        }
    }
}

impl Drop for ConsoleObserver<'_, '_> {
    fn drop(&mut self) {
        self.end_stage();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stop_is_watched_where_it_leaves_results() {
        let (mut out, mut err) = (Vec::new(), Vec::new());
        let mut console = Console::new(&mut out, &mut err, false);
        let interrupt = Interrupt::new();
        let mut observer = ConsoleObserver::interruptible(&mut console, &interrupt);
        let part = Part { label: "fit", done: 1, total: 2, note: String::new() };
        let stage = Stage { label: "clip", done: 0, total: 2, stops_after: None };
        observer.begin(&stage);
        assert_eq!(interrupt.awaited(), None);
        observer.begin(&Stage { label: "fit", stops_after: Some("this step"), ..stage });
        assert!(observer.progress(&part).is_continue());
        assert!(interrupt.request() && observer.progress(&part).is_break());
        assert_eq!(interrupt.awaited(), Some("this step"));
        observer.warning("b");
        drop(observer);
        assert_eq!(String::from_utf8(err).unwrap(), "warning: b\n");
    }
}
