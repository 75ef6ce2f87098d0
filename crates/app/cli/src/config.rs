//! `splatweaver config`.

use crate::arguments::Config;
use weaver_command::{Console, Failure};

pub fn run(arguments: &Config, console: &mut Console) -> Result<(), Failure> {
    if arguments.fit {
        return console.print(&weaver_run::settings::annotate(&weaver_fit::FitSettings::default())?);
    }
    let registry = weaver_recipes::registry();
    let architecture = registry.find(arguments.model.as_deref())?;
    let preset = arguments.preset.as_deref().unwrap_or(architecture.presets()[0]);
    console.print(&architecture.annotated(preset)?)
}
