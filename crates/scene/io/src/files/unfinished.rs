//! Files that have no name until they are complete.

use std::collections::BTreeSet;
use std::fs::{File, FileType};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use tempfile::Builder;

/// Unfinished files that have a name of their own, since the system has no files without one.
static NAMED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
/// Beginning of such a name.
const PREFIX: &str = ".weaver-";
/// Permissions that any new file gets, before those that the user takes away.
#[cfg(unix)]
const PERMISSIONS: u32 = 0o666;

/// A file that takes its name when it is complete, and is gone if it never is.
///
/// On Linux it has no name in the meantime (`O_TMPFILE`), so that nothing stays after any end of the process.
/// Elsewhere, and on file systems without such files, it has a hidden one: removed when this value is dropped, and by
/// [`remove_unfinished`].
///
/// ```
/// use std::io::Write;
/// use weaver_io::UnfinishedFile;
///
/// let folder = tempfile::tempdir()?;
/// let mut file = UnfinishedFile::begin(&folder.path().join("note.txt"))?;
/// file.as_file().write_all(b"whole")?;
/// file.persist()?;
/// assert_eq!(std::fs::read(folder.path().join("note.txt"))?, b"whole");
/// # Ok::<(), std::io::Error>(())
/// ```
#[derive(Debug)]
pub struct UnfinishedFile {
    file: File,
    /// Its hidden name, if it has one. It goes after the file: an open one may hold its place.
    name: Option<HiddenName>,
    /// The path that it takes.
    path: PathBuf,
}

/// The name of an unfinished file, which is removed with this value unless it was given up or removed before.
#[derive(Debug)]
struct HiddenName(PathBuf);

impl Drop for HiddenName {
    fn drop(&mut self) {
        let mut names = named_files();
        if names.remove(&self.0) {
            // A file that another process removed needs no removing.
            let _ = std::fs::remove_file(&self.0);
        }
    }
}

impl UnfinishedFile {
    /// Creates a file that is to take this path, or the place where it leads if it is a link. Its folder is created as
    /// well if it is missing.
    ///
    /// # Errors
    /// When the folder cannot be written to, or something is there that is no regular file.
    pub fn begin(path: &Path) -> io::Result<Self> {
        let path = destination(path)?;
        std::fs::create_dir_all(folder_of(&path))?;
        match nameless(folder_of(&path)) {
            Some(file) => Ok(Self { file, name: None, path }),
            None => Self::named(path),
        }
    }

    fn named(to: PathBuf) -> io::Result<Self> {
        // Locked before it has a name, so that a concurrent removal of unfinished files sees the lock.
        let mut names = named_files();
        let (file, name) = builder().tempfile_in(folder_of(&to))?.into_parts();
        let name = name.keep().map_err(|error| error.error)?;
        names.insert(name.clone());
        Ok(Self { file, name: Some(HiddenName(name)), path: to })
    }

    /// The file, to be written.
    pub fn as_file(&mut self) -> &File {
        &self.file
    }

    /// The hidden name of a file that has one.
    pub fn name(&self) -> Option<&Path> {
        self.name.as_ref().map(|name| name.0.as_path())
    }

    /// The path at which this process can open it.
    pub fn place(&self) -> PathBuf {
        self.name().map_or_else(|| place(&self.file), Into::into)
    }

    /// Flushes the file to the disk.
    ///
    /// # Errors
    /// When the disk is full, for instance.
    pub fn flush(&mut self) -> io::Result<()> {
        self.file.sync_all()
    }

    /// Flushes the file to the disk and gives it its path, in place of a file that has it.
    ///
    /// # Errors
    /// When it cannot be flushed, or cannot have that path.
    pub fn persist(mut self) -> io::Result<()> {
        self.flush()?;
        let Some(name) = self.name() else { return link(&self.file, &self.path) };
        let mut names = named_files();
        // Where the process ends, it is gone.
        if !names.contains(name) {
            return Err(io::ErrorKind::NotFound.into());
        }
        std::fs::rename(name, &self.path)?;
        names.remove(name);
        Ok(())
    }
}

/// Removes all unfinished files that have a name: to be called before the process ends without unwinding.
pub fn remove_unfinished() {
    for path in std::mem::take(&mut *named_files()) {
        // The process ends: an error could not be reported any more.
        let _ = std::fs::remove_file(path);
    }
}

/// The folder of a file.
fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// The place that a file is written to: where a link leads, else the path itself.
///
/// # Errors
/// When something is there that is no regular file. A rename would replace a device or a pipe by a file.
fn destination(path: &Path) -> io::Result<PathBuf> {
    match path.symlink_metadata() {
        Ok(found) if found.is_symlink() => destination(&path.canonicalize()?),
        Ok(found) if !found.is_file() => Err(io::Error::new(
            io::ErrorKind::InvalidInput,
            format!("expected a regular file or none, found {}", kind(&found.file_type())),
        )),
        _ => Ok(path.into()),
    }
}

/// Name of a kind of file.
pub(crate) fn kind(found: &FileType) -> &'static str {
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

fn named_files() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    NAMED.lock().unwrap_or_else(PoisonError::into_inner)
}

fn builder() -> Builder<'static, 'static> {
    let mut builder = Builder::new();
    builder.prefix(PREFIX);
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(PERMISSIONS));
    builder
}

/// A file without a name in a folder, where the system and the file system have such files.
#[cfg(target_os = "linux")]
fn nameless(folder: &Path) -> Option<File> {
    use rustix::fs::{Mode, OFlags, open};

    let flags = OFlags::TMPFILE | OFlags::RDWR | OFlags::CLOEXEC;
    let file: File = open(folder, flags, Mode::from_raw_mode(PERMISSIONS)).ok()?.into();
    // Without it the file could not be named in the end.
    place(&file).exists().then_some(file)
}

#[cfg(not(target_os = "linux"))]
fn nameless(_: &Path) -> Option<File> {
    None
}

/// Gives a file without a name this one, in place of a file that has it.
#[cfg(target_os = "linux")]
fn link(file: &File, path: &Path) -> io::Result<()> {
    use rustix::fs::{AtFlags, CWD, linkat};

    let named = |path: &Path| -> io::Result<()> { Ok(linkat(CWD, place(file), CWD, path, AtFlags::SYMLINK_FOLLOW)?) };
    match named(path) {
        // A link does not replace a file; a rename does.
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
            let linked: tempfile::NamedTempFile<()> = builder().make_in(folder_of(path), named)?;
            linked.into_temp_path().persist(path).map_err(|error| error.error)
        }
        linked => linked,
    }
}

#[cfg(not(target_os = "linux"))]
fn link(_: &File, _: &Path) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

/// The place at which an open file of this process can be linked and opened again.
#[cfg(target_os = "linux")]
fn place(file: &File) -> PathBuf {
    use std::os::fd::AsRawFd;
    format!("/proc/self/fd/{}", file.as_raw_fd()).into()
}

#[cfg(not(target_os = "linux"))]
fn place(_: &File) -> PathBuf {
    PathBuf::new()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    /// Files with a hidden name replace others, and are removed when they are dropped or the process ends.
    ///
    /// Promise of `an_unfinished_file_has_no_name`.
    #[test]
    fn named_files_take_their_place_or_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        let names = || std::fs::read_dir(folder.path()).unwrap().count();
        for content in ["first", "second"] {
            let mut file = UnfinishedFile::named(path.clone()).unwrap();
            file.as_file().write_all(content.as_bytes()).unwrap();
            file.persist().unwrap();
            assert_eq!((std::fs::read_to_string(&path).unwrap().as_str(), names()), (content, 1));
        }
        drop(UnfinishedFile::named(path.clone()).unwrap());
        assert_eq!(names(), 1);
        let left = UnfinishedFile::named(path.clone()).unwrap();
        assert_eq!(names(), 2);
        remove_unfinished();
        assert!(left.persist().is_err());
        assert_eq!(names(), 1);
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "second");
    }
}
