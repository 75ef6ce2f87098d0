//! Results that are there already.

use clap::{Args, ValueEnum};

/// Choice where results are complete.
#[derive(Args, Clone, Copy, Debug, Default)]
pub struct CompleteFlag {
    /// Makes the command a unit of work that may be started again: complete results of the same inputs and settings are
    /// left as they are, unfinished work goes on, and the folder is marked (unit.json)
    #[arg(long, value_enum, value_name = "skip")]
    pub if_complete: Option<IfComplete>,
}

/// Choices where results are complete.
#[derive(Clone, Copy, Debug, Eq, PartialEq, ValueEnum)]
pub enum IfComplete {
    /// Nothing
    Skip,
}
