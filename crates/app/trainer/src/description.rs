//! Descriptions of training runs for people.

use crate::{Error, Registry, Summary};
use serde_json::Value;
use std::fmt::Write;
use std::path::Path;
use weaver_inference::{Checkpoint, RunFolder};
use weaver_io::read_text;
use weaver_run::description::entries;

impl Registry {
    /// Describes the run of a folder: its model, its checkpoint, its summary.
    ///
    /// # Errors
    /// When the folder holds no run, or a file of it cannot be read.
    pub fn describe(&self, run: &RunFolder) -> Result<String, Error> {
        let config = self.of_run(run)?.read(run)?;
        let mut text = format!("run of {}, preset {}\n", config.architecture, config.preset);
        if run.checkpoint_path().is_file() {
            let checkpoint = Checkpoint::read(&run.checkpoint_path())?;
            let _ = writeln!(text, "checkpoint.safetensors: {} of {} steps", checkpoint.step, config.steps);
        } else {
            text.push_str("no checkpoint\n");
        }
        if run.summary_path().is_file() {
            text.push_str(&describe_results(&run.summary_path())?);
        }
        Ok(text)
    }
}

/// Describes a JSON file of results: the outcome of a training run, or the entries of any other one.
///
/// # Errors
/// When the file cannot be read, or is no JSON.
pub fn describe_results(path: &Path) -> Result<String, Error> {
    let wrong = |e: serde_json::Error| Error::Input(format!("{}: {e}", path.display()));
    let value: Value = serde_json::from_str(&read_text(path)?).map_err(wrong)?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    if let Ok(Summary { steps, planned, parameters, seconds, checksum, evaluation, seed, .. }) =
        serde_json::from_value(value.clone())
    {
        let mut text = format!("{name}: {steps} of {planned} steps, seed {seed}, {parameters} parameters\n");
        let _ = writeln!(text, "last session: {seconds:.0} s; checksum of the weights: {checksum}");
        let _ = writeln!(text, "{}", evaluation.map_or("not evaluated yet".into(), |evaluation| evaluation.table()));
        return Ok(text);
    }
    Ok(format!("{name}\n{}", entries(&value)))
}
