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
    atomic_write_checked(path, |w| write(w).map_err(Error::io(path)), |_| Ok(()))
}

/// The same for what fails in other ways, too, which it says as they are. `check` looks at the file before it takes its name: where it
/// fails, `path` holds what it held before.
pub(crate) fn atomic_write_checked<T>(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> Result<()>,
    check: impl FnOnce(&Path) -> Result<T>,
) -> Result<T> {
    let folder = match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    };
    std::fs::create_dir_all(folder).map_err(Error::io(path))?;
    let mut builder = tempfile::Builder::new();
    builder.prefix(".weaver-");
    // Temporary files are private by default; a finished file has the permissions any new file gets.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let mut file = builder.tempfile_in(folder).map_err(Error::io(path))?;
    FirstError::pass(BufWriter::new(file.as_file_mut()), path, write)?;
    let checked = check(file.path())?;
    file.as_file().sync_all().map_err(Error::io(path))?;
    file.persist(path).map_err(|error| Error::io(path)(error.error))?;
    Ok(checked)
}

/// A writer that keeps its first error: encoders wrap errors, and lose the kind that tells a full disk from a fault of the input.
struct FirstError<W> {
    inner: W,
    error: Option<io::Error>,
}

impl<W: Write> FirstError<W> {
    /// Writes all to `inner`; an error of `inner` is what is returned, whatever `write` makes of it.
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

    /// The error of a full disk keeps its kind, whatever an encoder makes of it.
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
