//! The identity of inputs, by their content.

use super::checksum::Checksum;
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// Checksum of settings and of the content of all files, with their places in the folders that were named.
///
/// # Errors
/// When a file cannot be read.
pub fn input_checksum(settings: &str, inputs: &[PathBuf]) -> Result<String> {
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
fn list(path: &Path, above: &mut Vec<PathBuf>, files: &mut Vec<PathBuf>) -> Result<()> {
    // What was named itself has to be there; in a folder there may be links to nowhere.
    let about = match std::fs::metadata(path) {
        Err(_) if !above.is_empty() && path.is_symlink() => return Ok(()),
        about => about.map_err(Error::io(path))?,
    };
    if about.is_file() {
        files.push(path.into());
    }
    if !about.is_dir() {
        return Ok(());
    }
    let place = path.canonicalize().map_err(Error::io(path))?;
    if above.contains(&place) {
        return Ok(());
    }
    above.push(place);
    for entry in std::fs::read_dir(path).map_err(Error::io(path))? {
        list(&entry.map_err(Error::io(path))?.path(), above, files)?;
    }
    above.pop();
    Ok(())
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::fs;

    /// Inputs are compared by their ordinary files, as large as they may be; pipes, and links that lead nowhere or
    /// back, have no say.
    ///
    /// Promise (files): inputs are compared by their ordinary files, a part at a time; pipes, broken links and
    /// circular links do not count.
    /// Promise (files): a unit of work is of all files that it reads: photos, `--config`, `--init`, `--weights`, a
    /// run's checkpoint, `--cameras`.
    #[test]
    fn inputs_are_compared_by_their_files() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        fs::create_dir_all(path("a/b")).unwrap();
        fs::create_dir(path("elsewhere")).unwrap();
        fs::write(path("elsewhere/d.bin"), [3; 70_001]).unwrap();
        fs::write(path("a/b/c.bin"), [7; 200_003]).unwrap();
        std::os::unix::fs::symlink(path("elsewhere"), path("a/link")).unwrap();
        let of = |inputs: &[PathBuf]| input_checksum("fit\n", inputs).unwrap();
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
        assert!(input_checksum("fit\n", &[path("none")]).is_err());
    }
}
