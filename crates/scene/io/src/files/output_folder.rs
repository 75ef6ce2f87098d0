//! Folders of results; a command replaces only its own files in them.

use crate::files::exclusive::open_exclusive;
use crate::files::folder::{canonical, followed};
use crate::files::unfinished::kind;
use crate::files::written::{RECORD, entry};
use crate::{Advice, Error, Result, atomic_write, check_writable, is_taken, list_photos, read_bytes};
use serde_json::json;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Files that mark a folder of results, also one from before there was a record: settings of runs are the others.
const RESULTS: [&str; 3] = [RECORD, "run.json", "config.toml"];

/// A folder that a command writes its results into. It is the command's alone for as long as this value lives.
///
/// A file is replaced only if the record in the folder, `written.jsonl`, says that the same command wrote it. So
/// results can be made anew in their place, and all other files there are safe: photos, a user's cameras, the results
/// of other commands. A folder that did not exist is removed again if nothing was written into it.
///
/// ```
/// use weaver_io::{OutputFolder, write_text};
///
/// let parent = tempfile::tempdir().unwrap();
/// let folder = parent.path().join("result");
/// let inputs: [&str; 0] = [];
/// let out = OutputFolder::claim(&folder, "example", inputs)?;
/// assert!(OutputFolder::claim(&folder, "example", inputs).is_err(), "it is in use");
/// write_text(out.file("figures/psnr.txt")?, "31.4")?;
/// drop(out);
///
/// std::fs::write(folder.join("notes.txt"), "mine").unwrap();
/// let again = OutputFolder::claim(&folder, "example", inputs)?;
/// again.check(["figures/psnr.txt"])?;
/// assert!(again.check(["notes.txt"]).is_err());
/// # Ok::<(), weaver_io::Error>(())
/// ```
#[derive(Debug)]
pub struct OutputFolder {
    path: PathBuf,
    command: String,
    /// Inputs of the command, without links.
    inputs: Vec<PathBuf>,
    record: Mutex<Record>,
}

/// A record of the files in a folder.
#[derive(Debug)]
struct Record {
    /// This process's alone to write, as long as it is open.
    file: File,
    /// Names of files, and the command that wrote each.
    written: BTreeMap<String, String>,
    /// The record's path, if it is to be removed unless a file is listed.
    unlisted: Option<PathBuf>,
    /// Goes after the file: an open one may hold its place.
    _made: Made,
}

/// The folders that were made, the deepest first. Those that are empty go with this value.
#[derive(Debug)]
struct Made(Vec<PathBuf>);

impl Drop for Made {
    fn drop(&mut self) {
        for folder in &self.0 {
            let _ = std::fs::remove_dir(folder);
        }
    }
}

impl Drop for Record {
    fn drop(&mut self) {
        // Before the lock ends: whoever has it next must find a record that stays. Should this fail, an empty record
        // stays, which does no harm.
        if let Some(path) = &self.unlisted {
            let _ = std::fs::remove_file(path);
        }
    }
}

impl OutputFolder {
    /// Makes a folder, if it does not exist, and claims it for a command with these inputs: files and folders that it
    /// reads.
    ///
    /// # Errors
    /// When it is one of the inputs or lies in one; when it holds photos that this program did not write; when another
    /// command is writing into it; and when it cannot be written.
    pub fn claim<P: AsRef<Path>>(
        path: impl Into<PathBuf>,
        command: &str,
        inputs: impl IntoIterator<Item = P>,
    ) -> Result<Self> {
        let path = path.into();
        let inputs = existing(inputs);
        refuse_inputs(&path, &inputs)?;
        check_writable(&path)?;
        let made: Vec<PathBuf> =
            path.ancestors().take_while(|p| !p.as_os_str().is_empty() && !p.exists()).map(Into::into).collect();
        let mut claimed = Self::open(path, command, inputs, made)?;
        let written = &claimed.record.get_mut().unwrap_or_else(PoisonError::into_inner).written;
        let is_photo = |photo: &PathBuf| {
            let name = photo.file_name().unwrap_or_default().to_string_lossy();
            !written.contains_key(name.as_ref())
        };
        if let Some(photo) = list_photos(&claimed.path)?.into_iter().find(is_photo) {
            return Err(refused(&photo, "a folder for results, apart from photos", "a photo"));
        }
        Ok(claimed)
    }

    /// Claims the folder of a run that goes on. `own` are the files of such a run, for folders from before there was a
    /// record.
    ///
    /// # Errors
    /// When another command is writing into it, and when it cannot be written.
    pub fn reopen<S: AsRef<str>>(
        path: impl Into<PathBuf>,
        command: &str,
        own: impl IntoIterator<Item = S>,
    ) -> Result<Self> {
        let path = path.into();
        check_writable(&path)?;
        let mut claimed = Self::open(path, command, Vec::new(), Vec::new())?;
        let (folder, command) = (claimed.path.clone(), claimed.command.clone());
        let record = claimed.record.get_mut().unwrap_or_else(PoisonError::into_inner);
        if record.written.is_empty() {
            own.into_iter().try_for_each(|name| record.add(&folder, name.as_ref(), &command))?;
        }
        Ok(claimed)
    }

    fn open(path: PathBuf, command: &str, inputs: Vec<PathBuf>, made: Vec<PathBuf>) -> Result<Self> {
        std::fs::create_dir_all(&path).map_err(Error::io(&path))?;
        // From here on, new folders are removed when something goes wrong.
        let record = Record::open(&path.join(RECORD), Made(made))?;
        Ok(Self { path, command: command.into(), inputs, record: Mutex::new(record) })
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Checks that files of these names, relative to the folder, can be written: to be called before long work.
    ///
    /// # Errors
    /// Names the first file that is there and was not written by the same command.
    pub fn check<S: AsRef<str>>(&self, names: impl IntoIterator<Item = S>) -> Result<()> {
        let record = self.record();
        names.into_iter().try_for_each(|name| self.allow(&record, name.as_ref()))
    }

    /// The path of a file that is about to be written, which goes into the record. Folders in its name are made. A name
    /// that ends with a slash is a folder, all of whose files are the command's.
    ///
    /// # Errors
    /// As [`check`](Self::check); when the record cannot be written.
    pub fn file(&self, name: impl AsRef<str>) -> Result<PathBuf> {
        let name = name.as_ref();
        let mut record = self.record();
        self.allow(&record, name)?;
        record.add(&self.path, name, &self.command)?;
        let path = self.path.join(name);
        let folder = if name.ends_with('/') { Some(path.as_path()) } else { path.parent() };
        folder.map_or(Ok(()), crate::create_folder)?;
        Ok(path)
    }

    /// Writes a file, and returns its name: the given one or, where a file of other content has it or it is among those
    /// `taken`, one with a number behind it. Files that earlier results name thus stay until
    /// [`remove_others`](Self::remove_others).
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn keep(&self, name: &str, bytes: &[u8], taken: &[String]) -> Result<String> {
        let (stem, extension) = name.rsplit_once('.').unwrap_or((name, ""));
        let names = std::iter::once(name.to_string()).chain((2..).map(|i| format!("{stem}-{i}.{extension}")));
        for name in names.filter(|name| !taken.contains(name)) {
            let path = self.path.join(&name);
            if !is_taken(&path) {
                atomic_write(self.file(&name)?, |w| w.write_all(bytes))?;
                return Ok(name);
            }
            // A link that leads nowhere is somebody's, too.
            if path.is_file() && read_bytes(&path)? == bytes {
                return Ok(name);
            }
        }
        unreachable!("one of infinitely many names is free")
    }

    /// The path of a folder in it, into which files of these names are about to be written, as [`file`](Self::file)
    /// does.
    ///
    /// # Errors
    /// As [`file`](Self::file).
    pub fn files<const N: usize>(&self, folder: &str, names: [&str; N]) -> Result<PathBuf> {
        names.iter().try_for_each(|name| self.file(format!("{folder}/{name}")).map(drop))?;
        Ok(self.path.join(folder))
    }

    /// Removes a file that the same command wrote, if it is there.
    ///
    /// # Errors
    /// As [`check`](Self::check), and when it cannot be removed.
    pub fn remove(&self, name: impl AsRef<str>) -> Result<()> {
        self.allow(&self.record(), name.as_ref())?;
        let path = self.path.join(name.as_ref());
        if path.exists() { std::fs::remove_file(&path).map_err(Error::io(&path)) } else { Ok(()) }
    }

    /// Removes the files that the same command wrote into a subfolder, now or before, but for files of these names,
    /// relative to this folder.
    ///
    /// # Errors
    /// When a file cannot be removed.
    pub fn remove_others<S: AsRef<str>>(&self, folder: &str, kept: &[S]) -> Result<()> {
        let kept: BTreeSet<&str> = kept.iter().map(AsRef::as_ref).collect();
        let record = self.record();
        let own = record.written.iter().filter(|(_, command)| **command == self.command).map(|(name, _)| name);
        let within = |name: &&String| name.strip_prefix(folder).is_some_and(|rest| rest.starts_with('/'));
        for path in own.filter(within).filter(|name| !kept.contains(name.as_str())).map(|name| self.path.join(name)) {
            if path.is_file() {
                self.refuse_outside(&path)?;
                refuse_inputs(&path, &self.inputs)?;
                std::fs::remove_file(&path).map_err(Error::io(&path))?;
            }
        }
        Ok(())
    }

    fn record(&self) -> MutexGuard<'_, Record> {
        self.record.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Refuses a file behind a link out of the folder: its record does not cover that place.
    fn refuse_outside(&self, path: &Path) -> Result<()> {
        let (file, folder) = (place(path), place(&self.path));
        if file.starts_with(&folder) {
            return Ok(());
        }
        Err(refused(path, "a file in the folder of the results", format!("a link to {}", file.display())))
    }

    fn allow(&self, record: &Record, name: &str) -> Result<()> {
        let path = self.path.join(name);
        refuse_inputs(&path, &self.inputs)?;
        self.refuse_outside(&path)?;
        // A link that leads nowhere is a user's, too.
        if path.symlink_metadata().is_err() {
            return Ok(());
        }
        if !name.ends_with('/') {
            refuse_irregular(&path)?;
        }
        match record.written.get(name) {
            Some(command) if *command == self.command => Ok(()),
            Some(command) => Err(refused(
                &path,
                format!("no file, or one that `{}` wrote", self.command),
                format!("one that `{command}` wrote"),
            )),
            None => {
                let expected =
                    format!("no file, or one that {RECORD} beside the results lists as written by this program");
                Err(refused(&path, expected, "another one"))
            }
        }
    }
}

impl Record {
    fn open(path: &Path, made: Made) -> Result<Self> {
        // A record that came along with a folder may be a link to a file of the user, or a pipe that is never ready.
        if let Some(found) = path.symlink_metadata().ok().filter(|found| !found.is_file()) {
            return Err(refused(path, "the record of what this program wrote", kind(&found.file_type())));
        }
        let Some(mut file) = open_exclusive(path).map_err(Error::io(path))? else {
            let folder = path.parent().unwrap_or(path);
            return Err(refused(folder, "a folder that nothing else writes into now", "one in use by another run"));
        };
        let mut text = String::new();
        file.read_to_string(&mut text).map_err(Error::io(path))?;
        // Without the line that a kill cut short.
        let whole = text.rfind('\n').map_or(0, |end| end + 1);
        if whole < text.len() {
            file.set_len(whole as u64).map_err(Error::io(path))?;
            file.seek(SeekFrom::End(0)).map_err(Error::io(path))?;
        }
        let written: Option<BTreeMap<_, _>> = text[..whole].lines().map(entry).collect();
        let written = written.ok_or_else(|| refused(path, "the record of what this program wrote", "another file"))?;
        let unlisted = written.is_empty().then(|| path.into());
        Ok(Self { file, written, unlisted, _made: made })
    }

    fn add(&mut self, folder: &Path, name: &str, command: &str) -> Result<()> {
        if self.written.get(name).is_some_and(|by| by == command) {
            return Ok(());
        }
        let line = format!("{}\n", json!({ "file": name, "by": command }));
        self.file.write_all(line.as_bytes()).map_err(Error::io(&folder.join(RECORD)))?;
        self.written.insert(name.into(), command.into());
        self.unlisted = None;
        Ok(())
    }
}

/// Checks before long work that a file can be written at its place, and is none that a command reads.
///
/// A file that is there will be replaced, unless it is one of the inputs or lies in one that is a folder.
///
/// # Errors
/// When it is a folder, a device, a pipe, a link that leads nowhere or an input, and when its folder cannot be written.
pub fn check_output_file<P: AsRef<Path>>(path: impl AsRef<Path>, inputs: impl IntoIterator<Item = P>) -> Result<()> {
    let path = path.as_ref();
    if path.symlink_metadata().is_ok() {
        refuse_irregular(path)?;
        refuse_inputs(path, &existing(inputs))?;
    }
    check_writable(path.parent().unwrap_or(Path::new("")))
}

/// Checks before long work that results may go into a folder: it is no input, and lies in no folder of photos or of
/// another's files that is one.
///
/// It may lie in a folder of results that is read, such as a run: the run's own files are safe from a folder within,
/// which has a record of its own.
///
/// # Errors
/// Names the folder, and the input that it is or lies in.
pub fn check_output_folder<P: AsRef<Path>>(path: impl AsRef<Path>, inputs: impl IntoIterator<Item = P>) -> Result<()> {
    let path = path.as_ref();
    let place = place(path);
    let holds_results = |input: &PathBuf| *input != place && RESULTS.iter().any(|name| input.join(name).is_file());
    let inputs: Vec<PathBuf> = existing(inputs).into_iter().filter(|input| !holds_results(input)).collect();
    refuse_inputs(path, &inputs)
}

/// Paths that exist, without links.
fn existing<P: AsRef<Path>>(paths: impl IntoIterator<Item = P>) -> Vec<PathBuf> {
    paths.into_iter().filter_map(|path| canonical(path.as_ref()).ok()).collect()
}

/// A path without links, as far as it exists.
fn place(path: &Path) -> PathBuf {
    std::path::absolute(path).map_or_else(|_| path.into(), |path| followed(&path))
}

/// Refuses to replace anything but a regular file.
fn refuse_irregular(path: &Path) -> Result<()> {
    // Through links, as the file is written.
    let found = match path.metadata() {
        Ok(found) if found.is_file() => return Ok(()),
        Ok(found) => kind(&found.file_type()),
        Err(_) => "a link that leads nowhere",
    };
    Err(refused(path, "the name of a file", found))
}

/// Refuses a path that is an input, or lies in an input folder.
fn refuse_inputs(path: &Path, inputs: &[PathBuf]) -> Result<()> {
    let output = place(path);
    let Some(input) = inputs.iter().find(|input| output.starts_with(input)) else { return Ok(()) };
    let found = match output == *input {
        true => "what is read".into(),
        false => format!("a place in {}, which is read", input.display()),
    };
    Err(refused(path, "a place apart from what is read", found))
}

/// Refusal to write, which other places for results remedy.
pub(crate) fn refused(path: &Path, expected: impl Into<String>, found: impl Into<String>) -> Error {
    let (expected, found) = (expected.into(), found.into());
    Error::Output { path: path.into(), expected, found, source: Advice::OtherOutput }
}
