//! Promises of the command line as a whole: its documents, flags and help.

mod documents;
mod flags;
mod help;
#[allow(dead_code)]
#[path = "../../crates/app/cli/tests/it/in_process.rs"]
mod in_process;
mod serde;
mod walkthrough;
