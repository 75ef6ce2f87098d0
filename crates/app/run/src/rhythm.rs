//! When a run is logged and saved.

/// Intervals of logging and saving.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rhythm {
    /// Which steps have a record.
    pub log: Log,
    /// When a checkpoint is written.
    pub save: Save,
}

/// Which steps have a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Log {
    /// The first step and every n-th, each by itself.
    Every(usize),
    /// About this many records of the whole run, with means over the steps since the last record.
    Means(usize),
}

/// When a checkpoint is written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Save {
    /// After every n-th step.
    Steps(usize),
    /// After this many seconds, and so late that writing takes no more than a small share of the time.
    Seconds(f64),
}

impl Default for Rhythm {
    fn default() -> Self {
        Self { log: Log::Means(500), save: Save::Seconds(20.0) }
    }
}
