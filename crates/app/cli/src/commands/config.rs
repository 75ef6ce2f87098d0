//! `splatweaver config`.

use crate::methods;
use clap::Args;
use weaver_command::{Console, Failure};

/// Prints a preset's configuration as TOML, every key with its documentation.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver config > mine.toml
  splatweaver config --preset tiny-published
  splatweaver config --fit > fit.toml")]
pub struct Config {
    /// The preset [default: tiny]
    #[arg(long)]
    pub preset: Option<String>,
    /// The model [default: splatweaver]
    #[arg(long, value_name = "NAME")]
    pub model: Option<String>,
    /// The settings of `fit` instead
    #[arg(long, conflicts_with_all = ["preset", "model"])]
    pub fit: bool,
}

pub fn run(arguments: &Config, console: &mut Console) -> Result<(), Failure> {
    if arguments.fit {
        return console.print(&weaver_run::settings::annotate(&weaver_fit::FitSettings::default())?);
    }
    let registry = methods::models();
    let entry = registry.find_for(arguments.model.as_deref(), arguments.preset.as_deref())?;
    let preset = arguments.preset.as_deref().unwrap_or(entry.presets()[0]);
    console.print(&entry.annotated(preset)?)
}
