//! JSON files of results.

use serde_json::Value;
use std::fmt::Write;
use std::path::Path;
use weaver_command::Failure;
use weaver_io::read_text;
use weaver_run::description::entries;
use weaver_trainer::Summary;

/// The outcome of a training run, or the entries of whatever else the file has.
pub fn of_json(path: &Path) -> Result<String, Failure> {
    let wrong = |e: serde_json::Error| Failure::message(format!("{}: {e}", path.display()));
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
