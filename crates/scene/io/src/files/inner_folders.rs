//! Folders in a folder of results.

use crate::{Error, OutputFolder, Result};

impl OutputFolder {
    /// Checks that a folder in it holds nothing but files of the same command, if it is there: to be called before long
    /// work whose results, of names that are not known yet, are written into it.
    ///
    /// # Errors
    /// Names the first file that the same command did not write; the folder's name where that is a file.
    pub fn check_folder(&self, name: &str) -> Result<()> {
        let folder = self.path().join(name);
        if !folder.is_dir() {
            return self.check([name]);
        }
        let mut names = Vec::new();
        for entry in std::fs::read_dir(&folder).map_err(Error::io(&folder))? {
            let file = entry.map_err(Error::io(&folder))?.file_name();
            names.push(format!("{name}/{}", file.to_string_lossy()));
        }
        names.sort();
        self.check(names)
    }
}
