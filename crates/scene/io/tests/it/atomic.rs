use proptest::prelude::*;
use std::io::{Error, Write};
use weaver_io::atomic_write;

/// Passes on `room` bytes, then fails as a full disk does.
struct FailsAfter<'a> {
    inner: &'a mut dyn Write,
    room: usize,
}

impl Write for FailsAfter<'_> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        if bytes.len() > self.room {
            return Err(Error::other("disk full"));
        }
        self.room -= bytes.len();
        self.inner.write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.inner.flush()
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 16))]

    #[test]
    fn a_failing_writer_leaves_the_old_file(room in 0usize..40_000) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("precious");
        std::fs::write(&path, b"old").unwrap();
        let result = atomic_write(&path, |inner| {
            let mut w = FailsAfter { inner, room };
            (0..500).try_for_each(|_| w.write_all(&[7; 100]))
        });
        let message = result.unwrap_err().to_string();
        prop_assert!(message.contains("precious") && message.contains("disk full"), "{}", message);
        prop_assert_eq!(std::fs::read(&path).unwrap(), b"old");
        prop_assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "a temporary file was left");
    }
}

#[test]
fn replaces_the_old_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    for content in ["first", "second, longer", "3"] {
        atomic_write(&path, |w| w.write_all(content.as_bytes())).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), content);
    }
}

/// Promise (scenes): a file is written into a folder that is not there yet.
#[test]
fn a_missing_folder_is_created() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("new/ones/file");
    atomic_write(&path, |w| w.write_all(b"whole")).unwrap();
    let below = path.join("below/a/file");
    let error = atomic_write(&below, |_| Ok(())).unwrap_err();
    assert!(error.to_string().contains(&format!("{}: ", below.display())), "{error}");
    assert_eq!(std::fs::read(&path).unwrap(), b"whole");
}

#[cfg(unix)]
#[test]
fn has_the_permissions_of_any_new_file() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let (a, b) = (folder.path().join("a"), folder.path().join("b"));
    std::fs::write(&a, "").unwrap();
    atomic_write(&b, |_| Ok(())).unwrap();
    let mode = |path| std::fs::metadata(path).unwrap().permissions().mode();
    assert_eq!(mode(a), mode(b));
}

/// After any end of a process, nothing of an unfinished file stays: it has no name.
///
/// Promise (files): whatever ends a process, nothing of an unfinished file stays.
#[cfg(target_os = "linux")]
#[test]
fn an_unfinished_file_has_no_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.ply");
    for content in ["first", "second"] {
        let before = std::fs::read_dir(folder.path()).unwrap().count();
        atomic_write(&path, |w| {
            w.write_all(content.as_bytes())?;
            w.flush()?;
            assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), before, "a file is there already");
            Ok(())
        })
        .unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), content);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}

/// A link is followed and stays a link.
///
/// Promise of `outputs_are_regular_files_or_absent`.
#[cfg(unix)]
#[test]
fn a_link_is_written_through() {
    let folder = tempfile::tempdir().unwrap();
    let (file, link) = (folder.path().join("disk/file"), folder.path().join("link"));
    std::fs::create_dir(folder.path().join("disk")).unwrap();
    std::fs::write(&file, "old").unwrap();
    std::os::unix::fs::symlink("disk/file", &link).unwrap();
    atomic_write(&link, |w| w.write_all(b"new")).unwrap();
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "new");
    assert!(link.symlink_metadata().unwrap().is_symlink());
}
