//! Long work that is watched: remarks, progress, and a wish to stop.

use std::ops::ControlFlow;

/// A stage of long work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stage {
    /// Name of the stage, as `fit`.
    pub label: &'static str,
    /// Parts that were done before.
    pub done: usize,
    /// Parts of the whole stage, as far as it is known.
    pub total: usize,
    /// The part after which a stop leaves results, as `this step`; `None` of stages that leave nothing.
    pub stops_after: Option<&'static str>,
}

/// A part of a stage that is done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Part {
    /// Name of the stage.
    pub label: &'static str,
    /// Parts that are done.
    pub done: usize,
    /// Parts of the whole stage, as far as it is known.
    pub total: usize,
    /// Remark about the state of the work.
    pub note: String,
}

/// Watches long work. Every method does nothing unless it is written.
///
/// ```
/// use std::ops::ControlFlow;
/// use weaver_io::{Observe, Part};
///
/// struct Lines;
///
/// impl Observe for Lines {
///     fn progress(&mut self, part: &Part) -> ControlFlow<()> {
///         println!("{} {}/{}  {}", part.label, part.done, part.total, part.note);
///         ControlFlow::Continue(())
///     }
/// }
/// ```
pub trait Observe {
    /// A remark.
    fn note(&mut self, _text: &str) {}

    /// A remark about a doubtful input or result.
    fn warning(&mut self, _text: &str) {}

    /// A stage begins.
    fn begin(&mut self, _stage: &Stage) {}

    /// A part of a stage is done. [`ControlFlow::Break`] ends a stage that [leaves results](Stage::stops_after), and
    /// has no effect on others.
    fn progress(&mut self, _part: &Part) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

/// An observer for work that nobody watches.
impl Observe for () {}

/// A duration in seconds, minutes or hours.
///
/// ```
/// use weaver_io::duration;
/// assert_eq!([5.0, 600.0, 36000.0].map(duration), ["5 s", "10 min", "10.0 h"]);
/// ```
pub fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 90.0 => format!("{s:.0} s"),
        s if s < 5400.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}
