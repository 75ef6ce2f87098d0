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
    /// The first, and every so many steps, by themselves.
    Every(usize),
    /// About so many records of the whole run, of means over the steps since the last.
    Means(usize),
}

/// When a checkpoint is written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Save {
    /// After every so many steps.
    Steps(usize),
    /// After so many seconds, and so late that writing takes no more than a small share of the time.
    Seconds(f64),
}

impl Default for Rhythm {
    fn default() -> Self {
        Self { log: Log::Means(500), save: Save::Seconds(20.0) }
    }
}
