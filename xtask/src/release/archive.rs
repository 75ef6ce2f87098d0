//! Archives and checksums whose bytes depend on the content alone.

use flate2::{Compression, GzBuilder};
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};

/// Names of files that can be started.
const PROGRAMS: &[&str] = &["splatweaver", "splatweaver.exe"];

/// Writes the files below a folder as a `.tar.gz`, in the order of their names, with one time, owner and mode.
pub fn pack(folder: &Path, inside: &str, time: u64, to: &Path) -> Result<(), String> {
    let failed = |error: std::io::Error| format!("{}: {error}", to.display());
    // The head of gzip has no name, no time and no system.
    let packed = GzBuilder::new().operating_system(255).write(Vec::new(), Compression::best());
    let mut archive = tar::Builder::new(packed);
    for path in files(folder)? {
        let bytes = std::fs::read(&path).map_err(|error| format!("{}: {error}", path.display()))?;
        let name = path.strip_prefix(folder).unwrap_or(&path).to_string_lossy().replace('\\', "/");
        let mut head = tar::Header::new_ustar();
        head.set_size(bytes.len() as u64);
        head.set_mtime(time);
        head.set_mode(if PROGRAMS.contains(&name.as_str()) { 0o755 } else { 0o644 });
        head.set_uid(0);
        head.set_gid(0);
        archive.append_data(&mut head, format!("{inside}/{name}"), bytes.as_slice()).map_err(failed)?;
    }
    let bytes = archive.into_inner().and_then(|packed| packed.finish()).map_err(failed)?;
    std::fs::write(to, bytes).map_err(failed)
}

/// Unpacks a `.tar.gz` into a folder.
pub fn unpack(archive: &Path, folder: &Path) -> Result<(), String> {
    let file = std::fs::File::open(archive).map_err(|error| format!("{}: {error}", archive.display()))?;
    let unpacked = tar::Archive::new(flate2::read::GzDecoder::new(file)).unpack(folder);
    unpacked.map_err(|error| format!("{}: {error}", archive.display()))
}

/// The files below a folder in the order of their names.
pub fn files(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let mut found = Vec::new();
    for path in super::entries(folder)? {
        if path.is_dir() { found.extend(files(&path)?) } else { found.push(path) }
    }
    Ok(found)
}

/// The lines of `SHA256SUMS` about the files of a folder, in the order of their names.
pub fn checksums(folder: &Path) -> Result<String, String> {
    let mut lines = String::new();
    for path in super::entries(folder)?.iter().filter(|path| path.is_file()) {
        let bytes = std::fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        lines += &format!("{}  {name}\n", sha256(&bytes));
    }
    Ok(lines)
}

/// SHA-256 in hexadecimal digits.
pub fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;

    #[test]
    fn equal_content_has_equal_bytes() {
        let work = std::env::temp_dir().join(format!("xtask-archive-{}", std::process::id()));
        let (one, two) = (work.join("one"), work.join("two"));
        for (folder, order) in [(&one, ["splatweaver", "b/c"]), (&two, ["b/c", "splatweaver"])] {
            std::fs::create_dir_all(folder.join("b")).unwrap();
            for name in order {
                std::fs::write(folder.join(name), name).unwrap();
            }
            pack(folder, "x-1.0", 1_700_000_000, &folder.with_extension("tar.gz")).unwrap();
        }
        let [first, second] = [one, two].map(|folder| std::fs::read(folder.with_extension("tar.gz")).unwrap());
        let sums = checksums(&work).unwrap();
        std::fs::remove_dir_all(&work).unwrap();
        assert!(first == second);
        assert_eq!(sums, format!("{0}  one.tar.gz\n{0}  two.tar.gz\n", sha256(&first)));
        let mut archive = tar::Archive::new(flate2::read::GzDecoder::new(first.as_slice()));
        let mut found = Vec::new();
        for entry in archive.entries().unwrap() {
            let mut entry = entry.unwrap();
            let mut text = String::new();
            entry.read_to_string(&mut text).unwrap();
            let head = entry.header();
            found.push((
                entry.path().unwrap().display().to_string(),
                text,
                head.mode().unwrap(),
                head.mtime().unwrap(),
            ));
        }
        let expected = [("x-1.0/b/c", "b/c", 0o644), ("x-1.0/splatweaver", "splatweaver", 0o755)];
        assert_eq!(found, expected.map(|(name, text, mode)| (name.into(), text.into(), mode, 1_700_000_000)));
    }

    #[test]
    fn sums_are_those_of_sha256sum() {
        assert_eq!(sha256(b"abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    }
}
