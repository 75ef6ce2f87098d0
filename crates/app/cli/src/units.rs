//! Commands as units of work that may be started again: `--if-complete skip`.

use crate::commands::{Command, Unit};
use weaver_command::{Console, Failure, Interrupt};
use weaver_io::{OutputFolder, input_checksum, read_text};
use weaver_ranks::Processes;
use weaver_reconstruct::Run;
use weaver_run::Folder;
use weaver_run::unit::{MARK, Mark, results};

/// Beginnings of names of results that a fit reads: one that goes on cannot make them again.
const READ_BY_FITS: [&str; 3] = ["cameras/", "frames/", "converted/"];

/// Runs a command. One that is a unit of work is left out where it is complete, goes on where it can, and is marked
/// when it is done.
///
/// `settings` are the words of the command line that affect the results.
///
/// # Errors
/// As the command's; when the folder belongs to a unit with other inputs or settings.
pub fn run(command: &Command, settings: &str, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    let Some(unit) = command.unit()? else { return command.run(console, interrupt) };
    let checksum = input_checksum(settings, &unit.inputs)?;
    let mark = Mark::read(&unit.out)?;
    if let Some(Mark { unit: theirs, .. }) = mark.as_ref().filter(|mark| mark.unit != checksum) {
        return Err(Failure::Usage(format!(
            "{}: expected the unit of work {checksum}, found {theirs}, of other inputs or settings; give another --out",
            unit.out.join(MARK).display()
        )));
    }
    let goes_on = unit.resume.is_some() && unit.out.join(Run::SETTINGS).is_file();
    if mark.is_none() && goes_on && !Processes::follows() {
        // The run there may have other settings, and would be taken for the requested one.
        return Err(weaver_run::Error::run_exists(&unit.out).into());
    }
    if let Some(mark) = mark.filter(|mark| mark.complete) {
        let gone = mark.gone(&unit.out, unit.json.then_some(unit.figures))?;
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
        let mark = Mark { unit: checksum.clone(), complete: files.is_some(), files };
        Ok(mark.write(&unit.out, &unit.inputs)?)
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
    // A stopped unit goes on when it is started again.
    if interrupt.is_requested() { Ok(()) } else { write(Some(results(&unit.out)?)) }
}

/// Says that there is nothing to do, and prints the figures that were printed when the results were made.
fn skipped(unit: &Unit, console: &mut Console) -> Result<(), Failure> {
    console.note(&format!("{}: complete, nothing to do", unit.out.display()));
    if unit.json && !Processes::follows() { console.print(&read_text(unit.out.join(unit.figures))?) } else { Ok(()) }
}

/// Removes the settings and the checkpoint that a fit would go on from, where this program wrote them.
fn forget(unit: &Unit) -> Result<(), Failure> {
    let left = [Run::SETTINGS, Folder::CHECKPOINT].map(|name| (name, unit.out.join(name)));
    if Processes::follows() || !left.iter().any(|(_, path)| path.exists()) {
        return Ok(());
    }
    let folder = OutputFolder::reopen(&unit.out, Run::COMMAND, [] as [&str; 0])?;
    left.iter().try_for_each(|(name, _)| Ok(folder.remove(name)?))
}
