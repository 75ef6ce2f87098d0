//! `splatweaver info`.

use crate::methods;
use clap::Args;
use std::path::{Path, PathBuf};
use weaver_command::{Console, Failure, device};
use weaver_inference::RunFolder;
use weaver_reconstruct::self_test;
use weaver_run::Folder;
use weaver_run::description::{SETTINGS, describe, describe_table, is_of_results};
use weaver_trainer::describe_results;

/// Describes a file or a folder.
///
/// Files: photos, clips, pictures of `image fit` (.wgi), scenes in every format, safetensors, PyTorch checkpoints, NPY,
/// NPZ, transforms.json, COLMAP, RealEstate10K, scans of lidars (.bin, .pcd), TOML, and JSON of results. Folders: runs
/// of train, fit, reconstruct, lidar, image fit, dynamic, vad and bench compress, COLMAP models, captures, weights,
/// photos.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver info scene.ply
  splatweaver info runs/mine
  splatweaver info runs/mine/checkpoint.safetensors
  splatweaver info model.safetensors
  splatweaver info capture/sparse/0
  splatweaver info --devices
  splatweaver info --report > report.txt")]
pub struct Info {
    /// The file, or the folder of a run, of a capture, of weights or of photos
    #[arg(required_unless_present_any = ["devices", "report"])]
    pub file: Option<PathBuf>,
    /// Lists the devices that Gaussians can be drawn on, for --device of other commands
    #[arg(long, conflicts_with = "file")]
    pub devices: bool,
    /// Prints versions, processor, memory and the timings of ten seconds, to be sent with a report of a fault; nothing
    /// in it is personal
    #[arg(long, conflicts_with_all = ["file", "devices"])]
    pub report: bool,
    /// Prints it as JSON
    #[arg(long, conflicts_with = "file")]
    pub json: bool,
}

pub fn run(arguments: &Info, console: &mut Console) -> Result<(), Failure> {
    match &arguments.file {
        Some(file) => console.print(described(file)?.trim_end()),
        None if arguments.report => console.print(&report(arguments.json)),
        None => device::list(arguments.json, console),
    }
}

/// A report of the program and of the machine.
fn report(json: bool) -> String {
    let mut lines = self_test();
    lines.insert(0, ("splatweaver", env!("CARGO_PKG_VERSION").into()));
    if json {
        return serde_json::Value::from_iter(lines).to_string();
    }
    lines.iter().map(|(name, value)| format!("{name:<13}{value}\n")).collect()
}

/// Files of this program's own, and else those of weaver-io.
fn described(path: &Path) -> Result<String, Failure> {
    let run = RunFolder::at(path);
    if run.config_path().is_file() {
        return Ok(methods::models().describe(&run)?);
    }
    if path.join(SETTINGS).is_file() {
        let summary = Some(path.join(Folder::SUMMARY)).filter(|summary| summary.is_file());
        return Ok(
            describe(path)? + &summary.map(|summary| describe_results(&summary)).transpose()?.unwrap_or_default()
        );
    }
    let name = path.file_name().map_or(String::new(), |name| name.to_string_lossy().to_lowercase());
    match name.rsplit_once('.').map_or("", |(_, extension)| extension) {
        "toml" => Ok(describe_table(path)?),
        "json" if is_of_results(path)? => Ok(describe_results(path)?),
        "wgi" => methods::describe_picture(path),
        _ if path.is_file() && weaver_clip::is_clip(path) => Ok(weaver_clip::info(path)?),
        _ => Ok(weaver_io::info(path)?),
    }
}
