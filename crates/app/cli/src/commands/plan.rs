//! `splatweaver plan`.

use super::{Command, fit};
use crate::command_line::CommandLine;
use clap::Args;
use serde::Deserialize;
use serde_json::json;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use weaver_command::{Console, Failure, quoted};

/// Expands a list of captures into one command a line, each a unit of work for any engine, with the time and memory that it takes.
///
/// The list is a TOML file: `[[work]]` with `command` (reconstruct, fit, cameras or infer), `inputs` (captures or folders of photos; a last part `*`
/// stands for every folder), `out` (each result goes to OUT/NAME) and `flags`. Lines end in a comment with minutes and megabytes where these are known;
/// every command is checked, and nothing is written. Minutes of a fit of so many steps are measured with --measure.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver plan list.toml
  splatweaver plan list.toml | parallel -j 2
  splatweaver plan list.toml --measure --json

A list:
  [[work]]
  command = \"fit\"
  inputs = [\"captures/*\"]
  out = \"scenes\"
  flags = [\"--steps\", \"5000\", \"--long-side\", \"800\"]")]
pub struct Plan {
    /// The list
    #[arg(value_name = "LIST.toml")]
    pub list: PathBuf,
    /// Measures each fit whose steps are given by a rehearsal of it on this machine, some seconds each
    #[arg(long)]
    pub measure: bool,
    /// Prints the commands as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
}

/// A list of work.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct List {
    work: Vec<Work>,
}

/// One command for many inputs.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Work {
    command: String,
    inputs: Vec<PathBuf>,
    out: PathBuf,
    #[serde(default)]
    flags: Vec<String>,
}

/// A unit of work.
struct Unit {
    words: Vec<String>,
    minutes: Option<f64>,
    megabytes: Option<f64>,
}

pub fn run(arguments: &Plan, console: &mut Console) -> Result<(), Failure> {
    let path = &arguments.list;
    let list: List = weaver_run::settings::read_table(path)?.try_into().map_err(|error| {
        let lines = error.to_string();
        Failure::Usage(format!("{}: {}", path.display(), lines.split_whitespace().collect::<Vec<_>>().join(" ")))
    })?;
    let units = units(path, list, arguments.measure)?;
    if arguments.json {
        let unit = |Unit { words, minutes, megabytes }: &Unit| json!({ "command": words, "minutes": minutes, "megabytes": megabytes });
        return console.print(&serde_json::to_string_pretty(&units.iter().map(unit).collect::<Vec<_>>())?);
    }
    for Unit { words, minutes, megabytes } in &units {
        let line = words.iter().map(quoted).collect::<Vec<_>>().join(" ");
        let minutes = minutes.map(|minutes| format!("{} min", (100.0 * minutes).round() / 100.0));
        let megabytes = megabytes.map(|megabytes| format!("{megabytes:.0} MB"));
        let known: Vec<String> = minutes.into_iter().chain(megabytes).collect();
        console.print(&if known.is_empty() { line } else { format!("{line}  # {}", known.join(", ")) })?;
    }
    Ok(())
}

fn units(path: &Path, list: List, measure: bool) -> Result<Vec<Unit>, Failure> {
    let wrong = |place: String, told: &str| Failure::Usage(format!("{}: {place}: {told}", path.display()));
    let (mut units, mut outs) = (Vec::new(), BTreeSet::new());
    for (i, Work { command, inputs, out, flags }) in list.work.into_iter().enumerate() {
        if !["reconstruct", "fit", "cameras", "infer"].contains(&command.as_str()) {
            let expected = format!("expected reconstruct, fit, cameras or infer, found `{command}`");
            return Err(wrong(format!("work.{i}.command"), &expected));
        }
        for input in expanded(&inputs)? {
            let out = out.join(input.file_stem().unwrap_or_default());
            if !outs.insert(out.clone()) {
                let expected =
                    format!("expected inputs of different names, found two whose results go to {}", out.display());
                return Err(wrong(format!("work.{i}.inputs"), &expected));
            }
            let [input, out] = [&input, &out].map(|path| path.display().to_string());
            let mut words =
                ["splatweaver", &command, &input, "-o", &out, "--if-complete", "skip"].map(String::from).to_vec();
            words.extend(flags.iter().cloned());
            let parsed = CommandLine::of(&words).map_err(|error| {
                let text = error.render().to_string();
                wrong(format!("work.{i}"), text.lines().next().unwrap_or_default().trim_start_matches("error: "))
            })?;
            let (minutes, megabytes) = estimate(&parsed.command, measure)?;
            units.push(Unit { words, minutes, megabytes });
        }
    }
    Ok(units)
}

/// The inputs, in order; a last part `*` stands for every folder there.
fn expanded(inputs: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let mut all = Vec::new();
    for input in inputs {
        let Some(parent) = input.to_str().and_then(|text| text.strip_suffix('*')).map(Path::new) else {
            all.push(input.clone());
            continue;
        };
        let entries =
            std::fs::read_dir(parent).map_err(|source| weaver_io::Error::Io { path: parent.into(), source })?;
        let mut folders: Vec<PathBuf> = entries.filter_map(Result::ok).map(|entry| entry.path()).collect();
        folders.retain(|path| path.is_dir());
        folders.sort();
        all.append(&mut folders);
    }
    Ok(all)
}

/// Minutes and megabytes of a command, where they are known before it begins.
fn estimate(command: &Command, measure: bool) -> Result<(Option<f64>, Option<f64>), Failure> {
    Ok(match command {
        Command::Reconstruct(it) => (Some(it.minutes.unwrap_or(it.quality.effort().0)), None),
        Command::Fit(it) => {
            let (minutes, bytes) = fit::estimate(it, measure)?;
            (minutes, bytes.map(|bytes| bytes as f64 / 1e6))
        }
        _ => (None, None),
    })
}
