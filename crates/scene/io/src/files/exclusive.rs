//! Files that one process writes and others may read meanwhile.

use std::fs::{File, OpenOptions};
use std::io;
use std::path::Path;

/// Opens a file, which is made if it is missing, for this process alone to write; `None` while another process has it.
/// On a file system without locks it is nobody's alone.
#[cfg(not(windows))]
pub(crate) fn open_exclusive(path: &Path) -> io::Result<Option<File>> {
    use std::fs::TryLockError;
    loop {
        let file = OpenOptions::new().read(true).append(true).create(true).open(path)?;
        match file.try_lock() {
            // Whoever had the lock before may have removed the file.
            Ok(()) if !path.exists() => {}
            Ok(()) | Err(TryLockError::Error(_)) => return Ok(Some(file)),
            Err(TryLockError::WouldBlock) => return Ok(None),
        }
    }
}

/// Opens a file, which is made if it is missing, for this process alone to write; `None` while another process has it.
/// Nobody else may open it for writing: a lock would keep others from reading, too.
#[cfg(windows)]
pub(crate) fn open_exclusive(path: &Path) -> io::Result<Option<File>> {
    use std::os::windows::fs::OpenOptionsExt;
    /// Others may read and remove: `FILE_SHARE_READ | FILE_SHARE_DELETE`.
    const SHARED: u32 = 1 | 4;
    const SHARING_VIOLATION: i32 = 32;
    // Without `append`, by which a file could not be shortened.
    let mut options = OpenOptions::new();
    options.read(true).write(true).create(true).truncate(false).share_mode(SHARED);
    match options.open(path) {
        Err(error) if error.raw_os_error() == Some(SHARING_VIOLATION) => Ok(None),
        opened => opened.map(Some),
    }
}
