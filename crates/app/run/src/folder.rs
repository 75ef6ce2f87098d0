//! The folder of a run.

use crate::{Error, Page, Record, Save, read_records};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};
use weaver_io::OutputFolder;
use weaver_io::safetensors::Tensors;

/// A kind of run, by the files in its folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Kind {
    /// The command that the record of written files names.
    pub command: &'static str,
    /// The file of settings. A folder that has it holds a run.
    pub settings: &'static str,
    /// Files beside the common files of runs.
    pub results: &'static [&'static str],
}

/// The folder of a run, which is the run's alone for as long as this value lives.
///
/// | file | content |
/// |---|---|
/// | [`Kind::settings`] | the settings |
/// | [`CHECKPOINT`](Self::CHECKPOINT) | everything needed to go on |
/// | [`LOG`](Self::LOG), [`EVENTS`](Self::EVENTS) | logged values, also for TensorBoard |
/// | [`SUMMARY`](Self::SUMMARY), [`REPORT`](Self::REPORT) | the outcome, for programs and for people |
#[derive(Debug)]
pub struct Folder {
    out: OutputFolder,
    kind: Kind,
    followed: bool,
}

/// Seconds between checkpoints of a run that is followed, at least.
const FOLLOWED: f64 = 3.0;

impl Folder {
    /// The file to go on from.
    pub const CHECKPOINT: &str = "checkpoint.safetensors";
    /// A line of JSON for each logged step.
    pub const LOG: &str = "metrics.jsonl";
    /// The folder of TensorBoard's event files.
    pub const EVENTS: &str = "events";
    /// The outcome.
    pub const SUMMARY: &str = "summary.json";
    /// The outcome with curves and pictures, in one file.
    pub const REPORT: &str = "report.html";

    /// The first of `PARENT/NAME-1`, `PARENT/NAME-2`, ... that does not exist: the default folder of a run.
    pub fn free(parent: &Path, name: &str) -> PathBuf {
        let numbered = |number: usize| parent.join(format!("{name}-{number}"));
        (1..).map(numbered).find(|path| !weaver_io::is_taken(path)).expect("one of infinitely many names is free")
    }

    /// Claims a folder for a new run that reads these files and folders. Meant to be called before any other work: a
    /// folder that did not exist is removed again if nothing is written into it.
    ///
    /// # Errors
    /// When the folder holds a run, or as [`OutputFolder::claim`] and [`OutputFolder::check`].
    pub fn claim<P: AsRef<Path>>(path: &Path, kind: Kind, inputs: impl IntoIterator<Item = P>) -> Result<Self, Error> {
        if path.join(kind.settings).exists() || path.join(Self::CHECKPOINT).exists() {
            return Err(Error::run_exists(path));
        }
        let out = OutputFolder::claim(path, kind.command, inputs)?;
        out.check(kind.files())?;
        Ok(Self { out, kind, followed: false })
    }

    /// Claims the folder of a run that goes on.
    ///
    /// # Errors
    /// As [`OutputFolder::reopen`].
    pub fn reopen(path: &Path, kind: Kind) -> Result<Self, Error> {
        Self::reopen_with(path, kind, [])
    }

    /// Claims the folder of a run that goes on and may have further files, beside the files of its kind.
    ///
    /// # Errors
    /// As [`OutputFolder::reopen`].
    pub fn reopen_with(path: &Path, kind: Kind, further: impl IntoIterator<Item = String>) -> Result<Self, Error> {
        let own = kind.files().map(String::from).chain(further);
        Ok(Self { out: OutputFolder::reopen(path, kind.command, own)?, kind, followed: false })
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        self.out.path()
    }

    /// The folder of results, for files beside the common files of runs.
    pub fn out(&self) -> &OutputFolder {
        &self.out
    }

    /// Lets others follow the run by its files: checkpoints that are written by time come every three seconds, or less
    /// often where writing takes too large a share of the time.
    pub fn follow(&mut self) {
        self.followed = true;
    }

    /// The interval of checkpoints, at most three seconds for a followed run that saves by time.
    pub(crate) fn pace(&self, save: Save) -> Save {
        match save {
            Save::Seconds(seconds) if self.followed => Save::Seconds(seconds.min(FOLLOWED)),
            save => save,
        }
    }

    /// Writes the settings as JSON. From here on the folder holds a run.
    ///
    /// # Errors
    /// When they cannot be written.
    ///
    /// # Panics
    /// When they are no plain data.
    pub fn store(&self, settings: &impl Serialize) -> Result<(), Error> {
        let text = serde_json::to_string_pretty(settings).expect("settings are plain data") + "\n";
        self.store_text(&text)
    }

    /// Writes the settings, given as the text of their file.
    ///
    /// # Errors
    /// When they cannot be written.
    pub fn store_text(&self, text: &str) -> Result<(), Error> {
        Ok(weaver_io::write_text(self.out.file(self.kind.settings)?, text)?)
    }

    /// Reads the settings of the run in a folder; `of` names their owner in errors.
    ///
    /// # Errors
    /// When there is no run, or its settings are of another kind.
    pub fn settings<S: DeserializeOwned>(path: &Path, kind: Kind, of: &str) -> Result<S, Error> {
        let path = path.join(kind.settings);
        let invalid = |error: serde_json::Error| weaver_io::Error::Invalid {
            path: path.clone(),
            place: "settings".into(),
            expected: format!("those of {of}"),
            found: error.to_string(),
        };
        Ok(serde_json::from_str(&weaver_io::read_text(&path)?).map_err(invalid)?)
    }

    /// The file to go on from.
    pub fn checkpoint_path(&self) -> PathBuf {
        self.path().join(Self::CHECKPOINT)
    }

    /// The last checkpoint, if there is one.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn checkpoint(&self) -> Result<Option<Tensors>, Error> {
        let path = self.checkpoint_path();
        Ok(path.exists().then(|| Tensors::read(&path)).transpose()?)
    }

    /// Writes a checkpoint, atomically.
    ///
    /// # Errors
    /// When it cannot be written; the last one then stays as it was.
    pub fn save(&self, state: &Tensors) -> Result<(), Error> {
        Ok(state.write(self.out.file(Self::CHECKPOINT)?)?)
    }

    /// Keeps a copy of the last checkpoint under another name, which a later one does not replace.
    ///
    /// # Errors
    /// When there is none, or the copy cannot be written.
    pub fn keep_checkpoint(&self, name: &str) -> Result<(), Error> {
        Ok(Tensors::read(self.checkpoint_path())?.write(self.out.file(name)?)?)
    }

    /// Removes the checkpoint of a complete run, for which it has no use. A failure is ignored, since nothing reads the
    /// file.
    pub fn forget_checkpoint(&self) {
        let _ = self.out.remove(Self::CHECKPOINT);
    }

    /// The records of the log; none where there is no log yet.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn records(&self) -> Result<Vec<Record>, Error> {
        let path = self.path().join(Self::LOG);
        Ok(if path.exists() { read_records(path)? } else { Vec::new() })
    }

    /// Writes the outcome for programs.
    ///
    /// # Errors
    /// When it cannot be written.
    ///
    /// # Panics
    /// When it is no plain data.
    pub fn summarize(&self, summary: &impl Serialize) -> Result<(), Error> {
        let text = serde_json::to_string_pretty(summary).expect("a summary is plain data") + "\n";
        Ok(weaver_io::write_text(self.out.file(Self::SUMMARY)?, &text)?)
    }

    /// Writes the page.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn report(&self, page: &Page) -> Result<(), Error> {
        Ok(page.write(self.out.file(Self::REPORT)?)?)
    }
}

impl Kind {
    /// The files of every run of the kind.
    fn files(self) -> impl Iterator<Item = &'static str> {
        let common = [self.settings, Folder::CHECKPOINT, Folder::LOG, Folder::SUMMARY, Folder::REPORT];
        common.into_iter().chain(self.results.iter().copied())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A followed run that saves by time saves every few seconds; runs that save by steps, or more often, keep their
    /// interval.
    #[test]
    fn a_run_that_is_followed_saves_more_often() {
        let temporary = tempfile::tempdir().unwrap();
        let kind = Kind { command: "count", settings: "run.json", results: &[] };
        let mut folder = Folder::claim(&temporary.path().join("run"), kind, [""; 0]).unwrap();
        let saves = [Save::Seconds(60.0), Save::Seconds(1.0), Save::Steps(7)];
        assert_eq!(saves.map(|save| folder.pace(save)), saves);
        folder.follow();
        assert_eq!(saves.map(|save| folder.pace(save)), [Save::Seconds(FOLLOWED), saves[1], saves[2]]);
    }
}
