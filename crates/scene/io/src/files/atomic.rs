//! Atomic writing of files.

use crate::files::unfinished::UnfinishedFile;
use crate::{Error, Result};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// Writes a file atomically: afterward `path` holds either all that `write` wrote, or what it held before.
///
/// The bytes go to an [unfinished file](UnfinishedFile) in the same folder, which takes the name `path` in one step. When `write` fails,
/// nothing stays, and its error is returned with the path. A folder that is missing is created. A link is followed.
///
/// # Errors
/// When `path` is neither a regular file nor absent: a folder, a device, a named pipe or a link that leads nowhere.
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
    let path = &destination(path)?;
    let mut file = UnfinishedFile::create(folder_of(path))?;
    let mut buffered = BufWriter::new(file.as_file());
    write(&mut buffered)?;
    buffered.flush()?;
    drop(buffered);
    file.persist(path)
}

/// The folder of a file.
fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// The place that a file is written to: where a link leads, else the path itself.
///
/// # Errors
/// When something is there that is no regular file. A rename would replace a device or a pipe by a file.
pub(crate) fn destination(path: &Path) -> io::Result<PathBuf> {
    match path.symlink_metadata() {
        Ok(found) if found.is_symlink() => {
            let place = path.canonicalize()?;
            destination(&place)
        }
        Ok(found) => match kind(&found.file_type()) {
            "a regular file" => Ok(path.into()),
            kind => Err(io::Error::new(
                io::ErrorKind::InvalidInput,
                format!("expected a regular file or none, found {kind}"),
            )),
        },
        Err(_) => Ok(path.into()),
    }
}

/// Name of a kind of file.
pub(crate) fn kind(found: &std::fs::FileType) -> &'static str {
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt;
        if found.is_char_device() || found.is_block_device() {
            return "a device";
        }
        if found.is_fifo() {
            return "a named pipe";
        }
        if found.is_socket() {
            return "a socket";
        }
    }
    match found {
        found if found.is_dir() => "a folder",
        found if found.is_file() => "a regular file",
        found if found.is_symlink() => "a link",
        _ => "something else",
    }
}
