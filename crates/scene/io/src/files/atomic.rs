//! Atomic writing of files.

use crate::files::unfinished::UnfinishedFile;
use crate::{Error, Result};
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// Writes a file atomically: afterward `path` holds either everything that `write` wrote, or its old content.
///
/// The bytes go to an [unfinished file](UnfinishedFile) in the same folder, which takes the name `path` in one step.
/// When `write` fails, nothing stays, and its error is returned with the path. A folder that is missing is created. A
/// link is followed.
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
    atomic_write_checked(path, |w| write(w).map_err(Error::io(path)), |_| Ok(()))
}

/// The same for writers with other errors, too, which are returned unchanged. `check` reads the file before it takes
/// its name: where it fails, `path` keeps its old content.
pub(crate) fn atomic_write_checked<T>(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> Result<()>,
    check: impl FnOnce(&Path) -> Result<T>,
) -> Result<T> {
    let failed = |error| Error::io(path)(error);
    let mut file = UnfinishedFile::begin(path).map_err(failed)?;
    FirstError::pass(BufWriter::new(file.as_file()), path, write)?;
    let checked = check(&file.place())?;
    file.persist().map_err(failed)?;
    Ok(checked)
}

/// A writer that keeps its first error: encoders wrap errors, and lose the kind that separates a full disk from a fault
/// of the input.
struct FirstError<W> {
    inner: W,
    error: Option<io::Error>,
}

impl<W: Write> FirstError<W> {
    /// Writes all to `inner`; an error of `inner` is returned even if `write` hides it.
    fn pass(inner: W, path: &Path, write: impl FnOnce(&mut dyn Write) -> Result<()>) -> Result<()> {
        let mut w = Self { inner, error: None };
        let written = write(&mut w);
        let written = written.and_then(|()| w.flush().map_err(Error::io(path)));
        w.error.take().map_or(written, |error| Err(Error::io(path)(error)))
    }

    fn kept<T>(&mut self, done: io::Result<T>) -> io::Result<T> {
        done.map_err(|error| {
            let kind = error.kind();
            // Whoever writes tries again.
            if kind != io::ErrorKind::Interrupted {
                self.error.get_or_insert(error);
            }
            kind.into()
        })
    }
}

impl<W: Write> Write for FirstError<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let done = self.inner.write(bytes);
        self.kept(done)
    }

    fn flush(&mut self) -> io::Result<()> {
        let done = self.inner.flush();
        self.kept(done)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disk without room.
    struct Full;

    impl Write for Full {
        fn write(&mut self, _: &[u8]) -> io::Result<usize> {
            Err(io::ErrorKind::StorageFull.into())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    /// The error of a full disk keeps its kind, even if an encoder wraps it.
    ///
    /// Promise (files): a full disk is distinguished from a fault of the input, whatever an encoder makes of it.
    #[test]
    fn an_encoder_does_not_hide_a_full_disk() {
        let hidden = crate::pictures::image::encode_png(&mut Full, 2, 2, &[0; 12]).unwrap_err();
        assert_eq!(hidden.kind(), io::ErrorKind::Other, "an encoder that hides it");
        let encode = |w: &mut dyn Write| {
            crate::pictures::image::encode_png(w, 2, 2, &[0; 12]).map_err(Error::io("a.png".as_ref()))
        };
        let failed = FirstError::pass(Full, "a.png".as_ref(), encode).unwrap_err();
        let Error::Io { source, .. } = failed else { panic!("{failed}") };
        assert_eq!(source.kind(), io::ErrorKind::StorageFull);
    }
}
