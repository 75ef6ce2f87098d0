//! The command line of `splatweaver convert`.

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use std::path::PathBuf;
use weaver_io::{SCENE_FORMATS, SceneFormat};

/// Writes a file of Gaussians in another format; the names of both files select the formats.
#[derive(Args, Debug)]
#[command(after_help = after_help())]
pub struct Convert {
    /// The file to read
    #[arg(value_name = "IN")]
    pub from: PathBuf,
    /// The file to write
    #[arg(value_name = "OUT")]
    pub to: PathBuf,
}

fn after_help() -> String {
    let rows = SCENE_FORMATS.iter().map(|f| format!("  {:<11} .{:<15} {}", f.name, f.extension, f.keeps));
    let formats: Vec<String> = rows.collect();
    let examples =
        "Examples:\n  splatweaver convert scene.ply scene.spz\n  splatweaver convert scene.ply scene.compressed.ply";
    format!("Formats, and what they keep:\n{}\n\n{examples}", formats.join("\n"))
}

/// The name of a format.
pub(super) fn scene_format() -> impl TypedValueParser<Value = SceneFormat> {
    PossibleValuesParser::new(SCENE_FORMATS.iter().map(|format| PossibleValue::new(format.name).help(format.keeps)))
        .map(|name| name.parse().expect("a name of the table"))
}
