//! `splatweaver split`.

use clap::Args;
use serde_json::json;
use std::path::PathBuf;
use weaver_command::{Console, Failure, Output, fraction, number};
use weaver_data::OutputFolder;
use weaver_data::capture::HoldOut;
use weaver_reconstruct::blocks::{BlockCount, BlockFile, SplitOptions, split};

/// Cuts a capture that is too large for one fit into blocks, each a capture of its own.
///
/// Upright planes cut the points into blocks of equally many; a block has the photos that see enough of it, and
/// the points that these see. Prints the command that fits each block, one a line, for any machine that sees the
/// photos; `splatweaver merge` joins the fits.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver split street --blocks 4 -o blocks
  splatweaver split street --memory 4 --gaussians 4000000 --long-side 1600 -o blocks
  splatweaver split street --blocks 4 -o blocks | sh
  splatweaver merge blocks -o scene.ply")]
pub struct Split {
    /// The capture, with points
    #[arg(value_name = "CAPTURE")]
    pub capture: PathBuf,
    /// Number of blocks
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000), required_unless_present = "memory", conflicts_with = "memory")]
    pub blocks: Option<u16>,
    /// As few blocks as take so many gigabytes each
    #[arg(long, value_name = "GB", value_parser = number(1e-3..=1e6, "expected gigabytes above 0"))]
    pub memory: Option<f64>,
    /// Folder for the blocks
    #[arg(short, long, value_name = "DIR", value_parser = Output::folder())]
    pub out: Output,
    /// Part of the points that a photo sees which makes it the block's where they lie in it
    #[arg(long, value_name = "SHARE", default_value_t = SHARE, value_parser = fraction())]
    pub share: f64,
    /// Gaussians of the whole scene [default: for each block as many as `fit` takes]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub gaussians: Option<u32>,
    /// Longest side of the photos in pixels; larger ones are shrunk [default: as they are]
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(16..=65_536))]
    pub long_side: Option<u32>,
    /// Which photos are held out: those that the capture lists, or every eighth where it lists none; no photo; or every
    /// so many [default: listed]
    #[arg(long, value_name = "listed|none|N")]
    pub hold_out: Option<HoldOut>,
    /// Leaves out pixels that are black in masks: mask_path of transforms.json, a file in masks/ named as the photo, or
    /// its alpha
    #[arg(long)]
    pub masks: bool,
    /// Prints the blocks as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
}

/// Part of the points that a photo sees which makes it a block's where they lie in it.
const SHARE: f64 = 0.05;

pub fn run(arguments: &Split, console: &mut Console) -> Result<(), Failure> {
    let is_plain = |name: &str| !name.contains(char::is_control);
    if !arguments.out.to_str().is_some_and(is_plain) {
        // Shells and engines take a line for a command.
        let expected = "expected a name of UTF-8 without line breaks and other control characters";
        return Err(Failure::Usage(format!("--out: {expected}, found {:?}", arguments.out)));
    }
    let out = OutputFolder::claim(&arguments.out, "split", [&arguments.capture])?;
    let count = match (arguments.blocks, arguments.memory) {
        (Some(blocks), _) => BlockCount::Exactly(blocks.into()),
        (None, size) => BlockCount::Memory((size.unwrap_or(f64::INFINITY) * 1e9) as u64),
    };
    let options = SplitOptions {
        capture: arguments.capture.clone(),
        count,
        share: arguments.share,
        gaussians: arguments.gaussians.map(|gaussians| gaussians as usize),
        long_side: arguments.long_side.map(|side| side as usize),
        hold_out: arguments.hold_out.unwrap_or_default(),
        masks: arguments.masks,
    };
    let found = split(&options, &out)?;
    found.remarks.iter().for_each(|remark| console.warning(remark));
    for block in &found.blocks {
        let BlockFile { photos, held_out, points, own_points, gaussians, memory, .. } = block;
        console.note(&format!(
            "{}: {photos} photos, {held_out} held out; {points} points, {own_points} its own; {gaussians} Gaussians, {:.1} MB",
            block.folder(),
            *memory as f64 / 1e6
        ));
    }
    let figures = json!({"blocks": found.blocks, "background": found.background});
    let command = |block| found.fit_command(block, &arguments.out, &options).to_string();
    let commands: Vec<String> = found.blocks.iter().map(command).collect();
    console.answer(arguments.json, &[&arguments.out], figures, &commands.join("\n"))
}
