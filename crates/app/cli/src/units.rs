//! Commands as units of work that may be started again: `--if-complete skip`.

use crate::commands::{Command, Unit};
use crate::processes::Processes;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use weaver_command::{Console, Failure, Interrupt};
use weaver_io::{Checksum, OutputFolder, read_text, write_text};

/// The file that says what a folder holds the results of, and whether they are complete.
const MARK: &str = "unit.json";

/// Runs a command. One that is a unit of work is left out where it is complete, goes on where it can, and is marked when it is done.
///
/// `settings` are the words of the command line that have a say in the results.
///
/// # Errors
/// As the command's; when the folder belongs to a unit with other inputs or settings.
pub fn run(command: &Command, settings: &str, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    let Some(Unit { out, inputs, resume }) = command.unit()? else { return command.run(console, interrupt) };
    let checksum = checksum(settings, &inputs)?;
    let written = mark(&out)?;
    if let Some((theirs, _)) = written.as_ref().filter(|(theirs, _)| *theirs != checksum) {
        return Err(Failure::Usage(format!(
            "{}: expected the unit of work {checksum}, found {theirs}, of other inputs or settings; give another --out",
            out.join(MARK).display()
        )));
    }
    if written.is_some_and(|(_, complete)| complete) {
        console.note(&format!("{}: complete, nothing to do", out.display()));
        return Ok(());
    }
    // A folder that is claimed for the moment of writing is nobody's while the command claims it.
    let write = |complete: bool| -> Result<(), Failure> {
        // The first of several processes alone writes.
        if Processes::follows() {
            return Ok(());
        }
        let folder = OutputFolder::claim(&out, "unit", &inputs)?;
        let text = json!({ "unit": checksum, "complete": complete }).to_string() + "\n";
        Ok(write_text(folder.file(MARK)?, &text)?)
    };
    write(false)?;
    match resume.filter(|_| out.join("run.json").is_file()) {
        Some(resumed) => {
            console.note(&format!("{}: begun before; goes on", out.display()));
            resumed.run(console, interrupt)?;
        }
        None => command.run(console, interrupt)?,
    }
    // What was stopped goes on when it is started again.
    if interrupt.is_requested() { Ok(()) } else { write(true) }
}

/// The checksum in a folder's mark, and whether its results are complete; `None` without a mark.
fn mark(out: &Path) -> Result<Option<(String, bool)>, Failure> {
    let path = out.join(MARK);
    if !path.is_file() {
        return Ok(None);
    }
    let value: Value = serde_json::from_str(&read_text(&path)?).unwrap_or_default();
    let found = value["unit"].as_str().map(String::from).zip(value["complete"].as_bool());
    let wrong = || Failure::message(format!("{}: expected a unit of work, found something else", path.display()));
    found.map(Some).ok_or_else(wrong)
}

/// Checksum of settings and of the content of all files, with their places in the folders that were named.
fn checksum(settings: &str, inputs: &[PathBuf]) -> Result<String, Failure> {
    let mut sum = Checksum::default();
    sum.bytes(settings.as_bytes());
    for input in inputs {
        let mut files = Vec::new();
        list(input, &mut files)?;
        files.sort_unstable();
        sum.word(files.len() as u64);
        for file in files {
            let place = file.strip_prefix(input).unwrap_or(&file);
            sum.bytes(place.to_string_lossy().as_bytes());
            sum.bytes(&std::fs::read(&file).map_err(failed(&file))?);
        }
    }
    Ok(sum.to_string())
}

/// Adds the files in a folder and those in it, or a file.
fn list(path: &Path, files: &mut Vec<PathBuf>) -> Result<(), Failure> {
    if !path.is_dir() {
        files.push(path.into());
        return Ok(());
    }
    for entry in std::fs::read_dir(path).map_err(failed(path))? {
        list(&entry.map_err(failed(path))?.path(), files)?;
    }
    Ok(())
}

fn failed(path: &Path) -> impl FnOnce(std::io::Error) -> weaver_io::Error {
    let path = path.to_path_buf();
    |source| weaver_io::Error::Io { path, source }
}
