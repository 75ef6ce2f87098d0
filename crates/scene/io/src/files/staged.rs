//! Results of several files that replace the earlier ones together.

use crate::{Error, OutputFolder, Result, create_folder};
use std::path::PathBuf;

/// The folder that files are written into first.
const FOLDER: &str = ".staged/";

/// Files of a folder of results that are written elsewhere in it first, and then take their places together.
///
/// At whatever moment the program stops, the folder holds the old results or the new ones, or none that a reader takes
/// for whole.
///
/// ```
/// use weaver_io::{OutputFolder, write_text};
///
/// let folder = tempfile::tempdir().unwrap();
/// let out = OutputFolder::claim(folder.path().join("result"), "example", [""; 0])?;
/// let mut staged = out.staged()?;
/// write_text(staged.file("data/values.txt")?, "1 2 3")?;
/// write_text(staged.file("index.txt")?, "values.txt")?;
/// assert!(!out.path().join("data").exists());
/// staged.commit(&["index.txt"])?;
/// assert_eq!(std::fs::read(out.path().join("data/values.txt")).unwrap(), b"1 2 3");
/// # Ok::<(), weaver_io::Error>(())
/// ```
#[derive(Debug)]
pub struct Staged<'a> {
    out: &'a OutputFolder,
    names: Vec<String>,
}

impl OutputFolder {
    /// Begins results that will replace the earlier ones together.
    ///
    /// # Errors
    /// When a place for them cannot be made.
    pub fn staged(&self) -> Result<Staged<'_>> {
        let folder = self.file(FOLDER)?;
        // Remnants of a run that was killed at this point.
        std::fs::remove_dir_all(&folder).map_err(Error::io(&folder))?;
        create_folder(&folder)?;
        Ok(Staged { out: self, names: Vec::new() })
    }
}

impl Staged<'_> {
    /// The path at which to write the file of this name. Folders in its name are made.
    ///
    /// # Errors
    /// As [`OutputFolder::check`].
    pub fn file(&mut self, name: impl Into<String>) -> Result<PathBuf> {
        let name = name.into();
        self.out.check([&name])?;
        let path = self.out.path().join(FOLDER).join(&name);
        path.parent().map_or(Ok(()), create_folder)?;
        self.names.push(name);
        Ok(path)
    }

    /// The path of a folder into which to write files of these names, as [`file`](Self::file).
    ///
    /// # Errors
    /// As [`file`](Self::file).
    pub fn files<const N: usize>(&mut self, folder: &str, names: [&str; N]) -> Result<PathBuf> {
        names.iter().try_for_each(|name| self.file(format!("{folder}/{name}")).map(drop))?;
        Ok(self.out.path().join(FOLDER).join(folder))
    }

    /// Moves all files to their places. `marks` are those without which no reader takes the folder for results: the
    /// ones that are there go first, and the new ones come last, in this order.
    ///
    /// # Errors
    /// When a file cannot be replaced or moved.
    pub fn commit(self, marks: &[&str]) -> Result<()> {
        for name in &self.names {
            let path = self.out.file(name)?;
            if path.is_dir() {
                return Err(Error::invalid(&path, "output", "a file, or nothing", "a folder"));
            }
        }
        marks.iter().try_for_each(|mark| self.out.remove(mark))?;
        let is_mark = |name: &&String| marks.contains(&name.as_str());
        let others = self.names.iter().filter(|name| !is_mark(name));
        let last = marks.iter().filter_map(|mark| self.names.iter().find(|name| name == mark));
        for name in others.chain(last) {
            let path = self.out.path().join(name);
            std::fs::rename(self.out.path().join(FOLDER).join(name), &path).map_err(Error::io(&path))?;
        }
        Ok(())
    }
}

impl Drop for Staged<'_> {
    fn drop(&mut self) {
        // Should this fail, the next results remove it.
        let _ = std::fs::remove_dir_all(self.out.path().join(FOLDER));
    }
}
