//! `splatweaver plan`.

use super::{Command, fit};
use crate::command_line::CommandLine;
use crate::flags::CameraChoice;
use clap::Args;
use serde_json::json;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use weaver_command::{Console, Failure, ShellCommand};
use weaver_data::capture::has_cameras;
use weaver_io::list_photos;
use weaver_run::{Work, WorkInput, WorkList};

/// Expands a list of captures into one command a line, each a unit of work for any engine, with the time and memory
/// that it takes.
///
/// The list is a TOML file: `[[work]]` with `command` (reconstruct, fit, cameras or infer), `inputs` (captures or
/// folders of photos; a last part `*` stands for every folder that the command can be given), `out` (each result goes
/// to OUT/NAME) and `flags`. Lines end in a comment with minutes and megabytes where these are known; every command is
/// checked, and nothing is written. Minutes of a fit of so many steps are measured with --measure.
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

/// A unit of work.
struct Unit {
    words: Vec<String>,
    line: ShellCommand,
    minutes: Option<f64>,
    megabytes: Option<f64>,
}

pub fn run(arguments: &Plan, console: &mut Console) -> Result<(), Failure> {
    let path = &arguments.list;
    let list: WorkList = weaver_run::settings::read_table(path)?.try_into().map_err(|error| {
        let lines = error.to_string();
        Failure::Usage(format!("{}: {}", path.display(), lines.split_whitespace().collect::<Vec<_>>().join(" ")))
    })?;
    let units = units(path, list, arguments.measure, console)?;
    if arguments.json {
        let unit = |Unit { words, minutes, megabytes, .. }: &Unit| json!({ "command": words, "minutes": minutes, "megabytes": megabytes });
        return console.print(&serde_json::to_string_pretty(&units.iter().map(unit).collect::<Vec<_>>())?);
    }
    for Unit { line, minutes, megabytes, .. } in &units {
        let minutes = minutes.map(|minutes| format!("{} min", (100.0 * minutes).round() / 100.0));
        let megabytes = megabytes.map(|megabytes| format!("{megabytes:.0} MB"));
        let known: Vec<String> = minutes.into_iter().chain(megabytes).collect();
        console.print(&if known.is_empty() { line.to_string() } else { format!("{line}  # {}", known.join(", ")) })?;
    }
    Ok(())
}

fn units(path: &Path, list: WorkList, measure: bool, console: &mut Console) -> Result<Vec<Unit>, Failure> {
    let wrong = |place: String, told: &str| Failure::Usage(format!("{}: {place}: {told}", path.display()));
    let (mut units, mut outs) = (Vec::new(), BTreeSet::new());
    for (i, work) in list.work.into_iter().enumerate() {
        let inputs = work.expanded();
        let Work { command, out, flags, .. } = work;
        if !["reconstruct", "fit", "cameras", "infer"].contains(&command.as_str()) {
            let expected = format!("expected reconstruct, fit, cameras or infer, found `{command}`");
            return Err(wrong(format!("work.{i}.command"), &expected));
        }
        for WorkInput { path: input, found } in inputs? {
            let out = out.join(input.file_stem().unwrap_or_default());
            let names = [&input, &out].map(|path| path.display().to_string());
            let mut words = ["splatweaver", &command, &names[0], "-o", &names[1], "--if-complete", "skip"]
                .map(String::from)
                .to_vec();
            words.extend(flags.iter().cloned());
            let parsed = CommandLine::of(&words).map_err(|error| {
                let text = error.render().to_string();
                wrong(format!("work.{i}"), text.lines().next().unwrap_or_default().trim_start_matches("error: "))
            })?;
            if let Some(reason) = found.then(|| unfit(&input, &parsed.command)).flatten() {
                console.note(&format!("left out: {:?}: {reason}", names[0]));
                continue;
            }
            let line = words[1..].iter().fold(ShellCommand::new("splatweaver"), ShellCommand::word);
            if !line.is_posix() {
                // Engines take a line for a unit of work.
                let found = words.iter().find(|word| word.contains(char::is_control)).cloned().unwrap_or_default();
                let expected =
                    format!("expected words without line breaks and other control characters, found {found:?}");
                return Err(wrong(format!("work.{i}"), &expected));
            }
            if !outs.insert(out.clone()) {
                let expected =
                    format!("expected inputs of different names, found two whose results go to {}", out.display());
                return Err(wrong(format!("work.{i}.inputs"), &expected));
            }
            let (minutes, megabytes) = estimate(&parsed.command, measure)?;
            units.push(Unit { words, line, minutes, megabytes });
        }
    }
    Ok(units)
}

/// Why a folder that a `*` stands for is nothing that the command can be given; `None` where it is.
fn unfit(input: &Path, command: &Command) -> Option<&'static str> {
    let is_plain = |name: &str| !name.contains(char::is_control);
    if !input.to_str().is_some_and(is_plain) {
        return Some("its name has control characters, or is no UTF-8");
    }
    let cameras = has_cameras(input).unwrap_or(false);
    let photos = [input.to_path_buf(), input.join("images")];
    let photos = || photos.iter().any(|folder| list_photos(folder).is_ok_and(|photos| !photos.is_empty()));
    match command {
        Command::Fit(it) if it.cameras != Some(CameraChoice::Estimated) => {
            (!cameras).then_some("no capture: no file of cameras")
        }
        _ => (!cameras && !photos()).then_some("no capture and no folder of photos"),
    }
}

/// Minutes and megabytes of a command, where they are known before it begins.
fn estimate(command: &Command, measure: bool) -> Result<(Option<f64>, Option<f64>), Failure> {
    Ok(match command {
        Command::Reconstruct(it) => (it.minutes(), None),
        Command::Fit(it) => {
            let (minutes, bytes) = fit::estimate(it, measure)?;
            (minutes, bytes.map(|bytes| bytes as f64 / 1e6))
        }
        _ => (None, None),
    })
}
