//! Forms of progress.

/// The form in which a command tells of its progress.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum ProgressForm {
    /// A bar, for a terminal.
    Bar,
    /// A line every five seconds.
    Lines,
    /// An object of JSON a line, for programs: `{"progress":"fit","done":3,"total":40,"note":""}` at most five times a
    /// second, `{"note":""}`, `{"warning":""}` and `{"error":""}`.
    Json,
}
