//! `splatweaver info`.

use clap::Args;
use serde_json::Value;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use weaver_command::{Console, Failure, device};
use weaver_inference::{Checkpoint, RunFolder};
use weaver_io::TorchCheckpoint;
use weaver_trainer::Summary;

/// Describes a file: images, files of Gaussians, safetensors, PyTorch checkpoints, transforms.json, COLMAP, RealEstate10K, TOML,
/// summary.json, and folders of runs.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver info scene.ply
  splatweaver info runs/mine
  splatweaver info runs/mine/checkpoint.safetensors
  splatweaver info model.safetensors
  splatweaver info capture/sparse/0
  splatweaver info --devices")]
pub struct Info {
    /// The file, a run's folder, or a folder with a COLMAP model
    #[arg(required_unless_present = "devices")]
    pub file: Option<PathBuf>,
    /// Lists what Gaussians can be drawn on, for --device of other commands
    #[arg(long, conflicts_with = "file")]
    pub devices: bool,
    /// Lists it as JSON
    #[arg(long, requires = "devices")]
    pub json: bool,
}

pub fn run(arguments: &Info, console: &mut Console) -> Result<(), Failure> {
    match &arguments.file {
        Some(file) => console.print(described(file)?.trim_end()),
        None => device::list(arguments.json, console),
    }
}

/// Files of this program's own, and else what weaver-io knows.
fn described(path: &Path) -> Result<String, Failure> {
    let run = RunFolder::at(path);
    if run.config_path().is_file() {
        return of_run(&run);
    }
    let name = path.file_name().map_or(String::new(), |name| name.to_string_lossy().to_lowercase());
    match name.rsplit_once('.').map_or("", |(_, extension)| extension) {
        "toml" => of_toml(path),
        "ckpt" | "pt" | "pth" => of_torch(path),
        "bin" if !["cameras.bin", "images.bin", "points3d.bin"].contains(&name.as_str()) => of_torch(path),
        "json" if name == "summary.json" => of_summary(path),
        _ => Ok(weaver_io::info(path)?),
    }
}

fn of_run(run: &RunFolder) -> Result<String, Failure> {
    let config = weaver_recipes::registry().of_run(run)?.read(run)?;
    let mut text = format!("run of {}, preset {}\n", config.architecture, config.preset);
    if run.checkpoint_path().is_file() {
        let checkpoint = Checkpoint::read(&run.checkpoint_path())?;
        let _ = writeln!(text, "checkpoint.safetensors: {} of {} steps", checkpoint.step, config.steps);
    } else {
        text.push_str("no checkpoint\n");
    }
    if run.summary_path().is_file() {
        text.push_str(&of_summary(&run.summary_path())?);
    }
    Ok(text)
}

/// A configuration, checked where it is one of a run, else the tables and keys of the file.
fn of_toml(path: &Path) -> Result<String, Failure> {
    let table = weaver_run::settings::read_table(path)?;
    let mut text = format!("TOML, {} keys\n", table.len());
    for (key, value) in &table {
        let value = match value {
            weaver_run::settings::Value::Table(inner) => format!("{} keys", inner.len()),
            weaver_run::settings::Value::Array(list) if list.iter().any(|entry| entry.is_table()) => {
                format!("{} tables", list.len())
            }
            value => value.to_string(),
        };
        let _ = writeln!(text, "{key}: {value}");
    }
    Ok(text)
}

/// Tensors that are listed.
const SHOWN: usize = 30;

fn of_torch(path: &Path) -> Result<String, Failure> {
    let checkpoint = TorchCheckpoint::open(path)?;
    let tensors = checkpoint.tensors()?;
    let bytes: usize = tensors.iter().map(|tensor| tensor.bytes()).sum();
    let mut text = format!("PyTorch checkpoint, {} tensors, {:.3} MB\n", tensors.len(), bytes as f64 / 1e6);
    for tensor in tensors.iter().take(SHOWN) {
        let _ = writeln!(text, "{} {} {:?}", tensor.name, tensor.dtype, tensor.shape);
    }
    if tensors.len() > SHOWN {
        let _ = writeln!(text, "and {} others", tensors.len() - SHOWN);
    }
    for remark in checkpoint.remarks() {
        let _ = writeln!(text, "{remark}");
    }
    Ok(text)
}

/// The outcome of a training run, or of whatever else writes such a file.
fn of_summary(path: &Path) -> Result<String, Failure> {
    let wrong = |e: serde_json::Error| Failure::message(format!("{}: {e}", path.display()));
    let value: Value = serde_json::from_str(&weaver_io::read_text(path)?).map_err(wrong)?;
    if let Ok(Summary { steps, planned, parameters, seconds, checksum, evaluation, seed, .. }) =
        serde_json::from_value(value.clone())
    {
        let mut text = format!("summary.json: {steps} of {planned} steps, seed {seed}, {parameters} parameters\n");
        let _ = writeln!(text, "last session: {seconds:.0} s; checksum of the weights: {checksum}");
        let _ = writeln!(text, "{}", evaluation.map_or("not evaluated yet".into(), |evaluation| evaluation.table()));
        return Ok(text);
    }
    let keys = value.as_object().into_iter().flatten();
    Ok(keys.fold("summary.json\n".to_string(), |text, (key, value)| format!("{text}{key}: {value}\n")))
}
