//! Studies: trainings and evaluations too long for a test, which write the tables of docs/results.

mod density;
mod own_photos;

use crate::cargo;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

pub fn run(arguments: &[String]) -> Result<(), String> {
    // Arguments behind -- are for every training.
    let (own, more) = match arguments.iter().position(|argument| argument == "--") {
        Some(at) => (&arguments[..at], &arguments[at + 1..]),
        None => (arguments, &[][..]),
    };
    let (own, lpips) = match own {
        [own @ .., flag, weights] if flag == "--lpips" => (own, Some(weights.as_str())),
        own => (own, None),
    };
    match own.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["density", out, ref captures @ ..] if !captures.is_empty() => {
            density::run(Path::new(out), captures, lpips, more)
        }
        ["own-photos", out, ref captures @ ..] if !captures.is_empty() => {
            own_photos::run(Path::new(out), captures, lpips, more)
        }
        ["density" | "own-photos", ..] => Err("study: expected a folder for its runs and at least one capture".into()),
        _ => Err(format!("study: expected density or own-photos, found {arguments:?}")),
    }
}

/// The optimized program, and the folder of a study's runs. Complete runs are not repeated.
struct Study {
    program: PathBuf,
    out: PathBuf,
    /// Weights of LPIPS, which evaluations then report as well.
    lpips: Option<String>,
}

impl Study {
    fn new(out: &Path, lpips: Option<&str>) -> Result<Self, String> {
        cargo(&["build", "--release", "--locked", "-p", "weaver-cli"], &[])?;
        std::fs::create_dir_all(out).map_err(|e| format!("{}: {e}", out.display()))?;
        let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| "target".into(), PathBuf::from);
        let lpips = lpips.map(String::from);
        Ok(Self { program: target.join("release/splatweaver"), out: out.to_path_buf(), lpips })
    }

    /// Trains, or goes on with an unfinished run, in a folder of this name.
    fn train(&self, name: &str, arguments: &[String]) -> Result<PathBuf, String> {
        let run = self.out.join(name);
        let begun = run.join("checkpoint.safetensors").exists();
        // The report is the last thing that a run writes.
        if !run.join("report.html").exists() || !begun {
            let run = run.display().to_string();
            let resumed = ["--resume".to_string(), run.clone()];
            let fresh = [arguments, &["--out".to_string(), run]].concat();
            self.call("train", if begun { &resumed } else { &fresh }, Stdio::inherit())?;
        }
        Ok(run)
    }

    /// An evaluation as JSON, which is kept in a file.
    fn evaluate(&self, file: &Path, arguments: &[String]) -> Result<Value, String> {
        if !file.exists() {
            let lpips = self.lpips.iter().flat_map(|weights| ["--lpips".to_string(), weights.clone()]);
            let arguments: Vec<String> = arguments.iter().cloned().chain(lpips).collect();
            let text = self.call("eval", &arguments, Stdio::piped())?;
            let part = file.with_extension("part");
            std::fs::write(&part, text)
                .and_then(|()| std::fs::rename(&part, file))
                .map_err(|e| format!("{}: {e}", file.display()))?;
        }
        let text = std::fs::read_to_string(file).map_err(|e| format!("{}: {e}", file.display()))?;
        serde_json::from_str(&text).map_err(|e| format!("{}: {e}", file.display()))
    }

    fn call(&self, command: &str, arguments: &[String], stdout: Stdio) -> Result<Vec<u8>, String> {
        println!("splatweaver {command} {}", arguments.join(" "));
        let child = Command::new(&self.program).arg(command).args(arguments).stdout(stdout).spawn();
        let done = child.and_then(std::process::Child::wait_with_output);
        let done = done.map_err(|e| format!("{}: {e}", self.program.display()))?;
        if done.status.success() { Ok(done.stdout) } else { Err(format!("{command} failed")) }
    }
}

/// Mean and, of several, standard deviation.
fn mean_and_spread(values: &[f64]) -> (f64, Option<f64>) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares = values.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>();
    (mean, (values.len() > 1).then(|| (squares / (n - 1.0)).sqrt()))
}
