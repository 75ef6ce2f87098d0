//! Commands as units of work that may be started again: `--if-complete skip`.

use crate::commands::{Command, Unit};
use crate::processes::Processes;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use weaver_command::{Console, Failure, Interrupt};
use weaver_io::{Checksum, OutputFolder, read_text, write_text, written};
use weaver_reconstruct::Run;
use weaver_run::Folder;

/// The file that says what a folder holds the results of, and whether they are complete.
const MARK: &str = "unit.json";
/// Folders in that of a unit which have a record of their own: the cameras that it estimated.
const PARTS: [&str; 1] = ["cameras"];
/// Beginnings of names of results that a fit reads: one that goes on cannot make them again.
const READ_BY_FITS: [&str; 2] = ["cameras/", "frames/"];

/// The content of a folder's mark.
#[derive(Deserialize, Serialize)]
struct Mark {
    /// Checksum of inputs and settings.
    unit: String,
    complete: bool,
    /// The files of complete results; none in marks of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    files: Option<Vec<String>>,
}

/// Runs a command. One that is a unit of work is left out where it is complete, goes on where it can, and is marked when it is done.
///
/// `settings` are the words of the command line that have a say in the results.
///
/// # Errors
/// As the command's; when the folder belongs to a unit with other inputs or settings.
pub fn run(command: &Command, settings: &str, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    let Some(unit) = command.unit()? else { return command.run(console, interrupt) };
    let checksum = checksum(settings, &unit.inputs)?;
    let mark = Mark::read(&unit.out)?;
    if let Some(Mark { unit: theirs, .. }) = mark.as_ref().filter(|mark| mark.unit != checksum) {
        return Err(Failure::Usage(format!(
            "{}: expected the unit of work {checksum}, found {theirs}, of other inputs or settings; give another --out",
            unit.out.join(MARK).display()
        )));
    }
    let goes_on = unit.resume.is_some() && unit.out.join(Run::SETTINGS).is_file();
    if mark.is_none() && goes_on && !Processes::follows() {
        // It may have other settings, and would be taken for what was asked.
        return Err(weaver_run::Error::run_exists(&unit.out).into());
    }
    if let Some(mark) = mark.filter(|mark| mark.complete) {
        let gone = mark.gone(&unit)?;
        let Some(first) = gone.first() else { return skipped(&unit, console) };
        console.note(&format!("{}: was complete, and is made again: {first} is gone", unit.out.display()));
        if gone.iter().any(|name| READ_BY_FITS.iter().any(|start| name.starts_with(start))) {
            forget(&unit)?;
        }
    }
    let write = |files: Option<Vec<String>>| -> Result<(), Failure> {
        // The first of several processes alone writes.
        if Processes::follows() {
            return Ok(());
        }
        // A folder that is claimed for the moment of writing is nobody's while the command claims it.
        let folder = OutputFolder::claim(&unit.out, "unit", &unit.inputs)?;
        let mark = Mark { unit: checksum.clone(), complete: files.is_some(), files };
        Ok(write_text(folder.file(MARK)?, &(serde_json::to_string(&mark)? + "\n"))?)
    };
    write(None)?;
    let goes_on = unit.out.join(Run::SETTINGS).is_file();
    match &unit.resume {
        Some(resumed) if goes_on => {
            console.note(&format!("{}: begun before; goes on", unit.out.display()));
            resumed.run(console, interrupt)?;
        }
        resumed => {
            if resumed.is_some() {
                // A checkpoint without the settings that it is of.
                forget(&unit)?;
            }
            command.run(console, interrupt)?;
        }
    }
    // What was stopped goes on when it is started again.
    if interrupt.is_requested() { Ok(()) } else { write(Some(results(&unit.out)?)) }
}

/// Says that there is nothing to do, and prints the figures that were printed when the results were made.
fn skipped(unit: &Unit, console: &mut Console) -> Result<(), Failure> {
    console.note(&format!("{}: complete, nothing to do", unit.out.display()));
    if unit.json && !Processes::follows() { console.print(&read_text(unit.out.join(unit.figures))?) } else { Ok(()) }
}

/// Removes what a fit would go on from, where this program wrote it.
fn forget(unit: &Unit) -> Result<(), Failure> {
    let left = [Run::SETTINGS, Folder::CHECKPOINT].map(|name| (name, unit.out.join(name)));
    if Processes::follows() || !left.iter().any(|(_, path)| path.exists()) {
        return Ok(());
    }
    let folder = OutputFolder::reopen(&unit.out, Run::COMMAND, [] as [&str; 0])?;
    left.iter().try_for_each(|(name, _)| Ok(folder.remove(name)?))
}

impl Mark {
    /// The mark of a folder; `None` without one.
    fn read(out: &Path) -> Result<Option<Self>, Failure> {
        let path = out.join(MARK);
        if !path.is_file() {
            return Ok(None);
        }
        let wrong = |_| Failure::message(format!("{}: expected a unit of work, found something else", path.display()));
        serde_json::from_str(&read_text(&path)?).map(Some).map_err(wrong)
    }

    /// The files of complete results that are not there any more.
    fn gone(self, unit: &Unit) -> Result<Vec<String>, Failure> {
        let mut files = self.files.map_or_else(|| recorded(&unit.out), Ok)?;
        files.extend(unit.json.then(|| unit.figures.to_string()));
        files.retain(|name| !unit.out.join(name).exists());
        Ok(files)
    }
}

/// The results in a folder, by its record: those that are there.
fn results(out: &Path) -> Result<Vec<String>, Failure> {
    let mut files = recorded(out)?;
    files.retain(|name| out.join(name).exists());
    Ok(files)
}

/// The results of a folder, by its record. A checkpoint is none: it may be removed to save space.
fn recorded(out: &Path) -> Result<Vec<String>, Failure> {
    let mut files: Vec<String> = written(out)?.into_keys().collect();
    for part in PARTS {
        files.extend(written(out.join(part))?.into_keys().map(|name| format!("{part}/{name}")));
    }
    files.retain(|name| ![MARK, Folder::CHECKPOINT].contains(&name.as_str()));
    Ok(files)
}

/// Checksum of settings and of the content of all files, with their places in the folders that were named.
fn checksum(settings: &str, inputs: &[PathBuf]) -> Result<String, Failure> {
    let mut sum = Checksum::default();
    sum.bytes(settings.as_bytes());
    for input in inputs {
        let mut files = Vec::new();
        list(input, &mut Vec::new(), &mut files)?;
        files.sort_unstable();
        sum.word(files.len() as u64);
        for file in files {
            let place = file.strip_prefix(input).unwrap_or(&file);
            sum.bytes(place.to_string_lossy().as_bytes());
            sum.file(&file)?;
        }
    }
    Ok(sum.to_string())
}

/// Adds the files in a folder and in its folders, or a file. A pipe or a device has no content to compare. `above` are
/// the folders that lead to this one, without links; one that leads back to them is no folder of its own.
fn list(path: &Path, above: &mut Vec<PathBuf>, files: &mut Vec<PathBuf>) -> Result<(), Failure> {
    // What was named itself has to be there; in a folder there may be links to nowhere.
    let about = match std::fs::metadata(path) {
        Err(_) if !above.is_empty() && path.is_symlink() => return Ok(()),
        about => about.map_err(failed(path))?,
    };
    if about.is_file() {
        files.push(path.into());
    }
    if !about.is_dir() {
        return Ok(());
    }
    let place = path.canonicalize().map_err(failed(path))?;
    if above.contains(&place) {
        return Ok(());
    }
    above.push(place);
    for entry in std::fs::read_dir(path).map_err(failed(path))? {
        list(&entry.map_err(failed(path))?.path(), above, files)?;
    }
    above.pop();
    Ok(())
}

fn failed(path: &Path) -> impl FnOnce(std::io::Error) -> weaver_io::Error {
    let path = path.to_path_buf();
    |source| weaver_io::Error::Io { path, source }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    /// Inputs are compared by their ordinary files, as large as they may be; pipes, and links that lead nowhere or back,
    /// have no say.
    #[cfg(unix)]
    #[test]
    fn inputs_are_compared_by_their_files() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        fs::create_dir_all(path("a/b")).unwrap();
        fs::create_dir(path("elsewhere")).unwrap();
        fs::write(path("elsewhere/d.bin"), [3; 70_001]).unwrap();
        fs::write(path("a/b/c.bin"), [7; 200_003]).unwrap();
        std::os::unix::fs::symlink(path("elsewhere"), path("a/link")).unwrap();
        let of = |inputs: &[PathBuf]| checksum("fit\n", inputs).unwrap();
        let before = of(&[path("a")]);
        // The sum of marks that are there already.
        let mut sum = Checksum::default();
        sum.bytes(b"fit\n");
        sum.word(2);
        for (name, bytes) in [("b/c.bin", vec![7; 200_003]), ("link/d.bin", vec![3; 70_001])] {
            sum.bytes(name.as_bytes());
            sum.bytes(&bytes);
        }
        assert_eq!(before, sum.to_string());
        std::os::unix::fs::symlink(".", path("a/b/here")).unwrap();
        std::os::unix::fs::symlink("..", path("a/b/above")).unwrap();
        std::os::unix::fs::symlink("nowhere", path("a/gone")).unwrap();
        std::os::unix::fs::symlink("itself", path("a/itself")).unwrap();
        let made = std::process::Command::new("mkfifo").arg(path("a/pipe")).status();
        assert!(made.is_ok_and(|status| status.success()));
        assert_eq!(of(&[path("a")]), before);
        fs::write(path("a/b/c.bin"), [8; 200_003]).unwrap();
        assert_ne!(of(&[path("a")]), before);
        assert!(checksum("fit\n", &[path("none")]).is_err());
    }
}
