//! The wheel: Python's files, the library that is also the program, and licenses.

use super::{Release, clear, copy, create, entries, read, write};
use crate::wheel::call;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The most bytes of a wheel.
const MOST: u64 = 25_000_000;

/// Packs the wheel into a folder.
pub fn make(release: &Release, licenses: &str, out: &Path) -> Result<(), String> {
    let folder = release.work.join("wheel");
    clear(&folder)?;
    let package = folder.join("splatweaver");
    create(&package)?;
    for file in entries(&release.root.join("crates/app/py/python/splatweaver"))?.iter().filter(|path| path.is_file()) {
        copy(file, &package.join(file.file_name().unwrap_or_default()))?;
    }
    let (built, imported) = release.platform.extension();
    let library = package.join(imported);
    copy(&release.platform.built(&release.work).join(built), &library)?;
    let description = described(release, &folder)?;
    let texts = description.join("licenses");
    create(&texts)?;
    release.add_licenses(&texts, licenses)?;
    name_licenses(&description, &texts)?;
    let mut wheel = String::from("Wheel-Version: 1.0\nGenerator: xtask\nRoot-Is-Purelib: false\n");
    for tag in release.platform.tags(&library)? {
        wheel += &format!("Tag: cp39-abi3-{tag}\n");
    }
    write(&description.join("WHEEL"), &wheel)?;
    plain_modes(&folder)?;
    let packed = release.work.join("packed");
    clear(&packed)?;
    create(&packed)?;
    let mut pack = Command::new(&release.python);
    pack.args(["-m", "wheel", "pack", "--dest-dir"]).arg(&packed).arg(&folder);
    call(release.dated(&mut pack))?;
    let wheel = entries(&packed)?.pop().ok_or("wheel pack: expected a wheel, found none")?;
    let bytes = std::fs::metadata(&wheel).map_or(0, |file| file.len());
    if bytes > MOST {
        return Err(format!("{}: expected at most {MOST} bytes, found {bytes}", wheel.display()));
    }
    copy(&wheel, &out.join(wheel.file_name().unwrap_or_default()))
}

/// The folder with the description of the package, written by maturin from pyproject.toml.
fn described(release: &Release, folder: &Path) -> Result<PathBuf, String> {
    let mut describe = Command::new(&release.python);
    describe.current_dir(&release.root).args(["-m", "maturin", "pep517", "write-dist-info", "--metadata-directory"]);
    call(release.dated(describe.arg(folder)))?;
    let ends = |path: &PathBuf| path.extension().is_some_and(|extension| extension == "dist-info");
    let found = entries(folder)?.into_iter().find(ends).ok_or("maturin: expected a folder .dist-info, found none")?;
    // Packing lists the files anew.
    let _ = std::fs::remove_file(found.join("RECORD"));
    Ok(found)
}

/// Names each license in the description, as installers show them.
fn name_licenses(description: &Path, texts: &Path) -> Result<(), String> {
    let path = description.join("METADATA");
    let text = read(&path)?;
    let (head, body) = text.split_once("\n\n").ok_or("METADATA: expected a head and a text")?;
    let mut lines: Vec<String> =
        head.lines().filter(|line| !line.starts_with("License-File:")).map(Into::into).collect();
    for file in entries(texts)? {
        lines.push(format!("License-File: {}", file.file_name().unwrap_or_default().to_string_lossy()));
    }
    write(&path, &format!("{}\n\n{body}", lines.join("\n")))
}

/// Gives all files one mode: an archive has it, and it should not depend on a mask.
fn plain_modes(folder: &Path) -> Result<(), String> {
    #[cfg(unix)]
    for file in super::archive::files(folder)? {
        let mode = std::os::unix::fs::PermissionsExt::from_mode(0o644);
        std::fs::set_permissions(&file, mode).map_err(|error| format!("{}: {error}", file.display()))?;
    }
    let _ = folder;
    Ok(())
}
