//! Atomic writing of files.

use crate::{Error, Result};
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// Writes a file atomically: afterward `path` holds either all that `write` wrote, or what it held before.
///
/// The bytes go to a temporary file in the same folder, are flushed to the disk, and take the name `path` in one
/// rename. When `write` fails, the temporary file is removed and its error is returned with the path. A folder that is missing is created.
///
/// ```
/// let folder = tempfile::tempdir().unwrap();
/// let path = folder.path().join("note.txt");
/// weaver_io::atomic_write(&path, |w| w.write_all(b"whole")).unwrap();
/// assert_eq!(std::fs::read(&path).unwrap(), b"whole");
/// ```
pub fn atomic_write(path: impl AsRef<Path>, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<()> {
    let path = path.as_ref();
    replace(path, write).map_err(Error::io(path))
}

/// The same for what fails in other ways, too, which it says as they are.
pub(crate) fn atomic_write_checked(path: &Path, write: impl FnOnce(&mut dyn Write) -> Result<()>) -> Result<()> {
    let mut failed = None;
    let done = replace(path, |w| {
        write(w).map_err(|error| {
            failed = Some(error);
            io::Error::other("not written")
        })
    });
    failed.map_or(done.map_err(Error::io(path)), Err)
}

fn replace(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let folder = match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    };
    std::fs::create_dir_all(folder)?;
    let mut builder = tempfile::Builder::new();
    builder.prefix(".weaver-");
    // Temporary files are private by default; a finished file has the permissions any new file gets.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let mut file = builder.tempfile_in(folder)?;
    let mut buffered = BufWriter::new(file.as_file_mut());
    write(&mut buffered)?;
    buffered.flush()?;
    drop(buffered);
    file.as_file().sync_all()?;
    file.persist(path)?;
    Ok(())
}
