//! `splatweaver merge`.

use clap::Args;
use serde_json::json;
use std::path::PathBuf;
use weaver_command::{Console, Failure, Output};
use weaver_io::{SceneFormat, write_scene};
use weaver_reconstruct::blocks::{Merged, merge};

/// Joins the fits of the blocks that `splatweaver split` made: of each the Gaussians in its block.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver merge blocks -o scene.ply
  splatweaver merge blocks -o scene.spz")]
pub struct Merge {
    /// Folder of the blocks, each with its fit in `fit`
    #[arg(value_name = "BLOCKS")]
    pub blocks: PathBuf,
    /// The file to write, in the format of its name
    #[arg(short, long, value_name = "FILE", value_parser = Output::file(&[]))]
    pub out: Output,
    /// Prints the result as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
}

pub fn run(arguments: &Merge, console: &mut Console) -> Result<(), Failure> {
    let out = &arguments.out;
    SceneFormat::of(out)?;
    let Merged { gaussians, drawing, background, fitted, remarks } = merge(&arguments.blocks)?;
    remarks.iter().for_each(|remark| console.warning(remark));
    write_scene(out, &gaussians, drawing)?;
    let ([r, g, b], gaussians, file) = (background, gaussians.len(), out.display().to_string());
    let text = format!("{gaussians} of {fitted} Gaussians stay, background {r:.3},{g:.3},{b:.3}: {file}");
    let figures = json!({"output": file, "gaussians": gaussians, "fitted": fitted, "background": background});
    console.answer(arguments.json, &[out], figures, &text)
}
