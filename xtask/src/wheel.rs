//! The Python package as a wheel: built, installed where nothing else is, and tested there.

use crate::tidy;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Folder of the crate.
const CRATE: &str = "crates/app/py";
/// The interpreter by which others are made.
const PYTHON: &str = if cfg!(windows) { "python" } else { "python3" };

/// Builds a wheel into a folder, `target/wheels` unless another is named, and runs its tests on it.
pub fn run(arguments: &[String]) -> Result<(), String> {
    let root = tidy::root()?;
    let work = root.join("target/python");
    let out = arguments.first().map_or_else(|| root.join("target/wheels"), PathBuf::from);
    if !has_venv() {
        println!("skipped: no python3 with venv (wheel)");
        return Ok(());
    }
    let builder = venv(&work.join("build"), &["maturin>=1.16,<2"])?;
    let wheels = work.join("wheels");
    clear(&wheels)?;
    let build = ["-m", "maturin", "build", "--release", "--locked", "--out"];
    call(Command::new(&builder).current_dir(&root).args(build).arg(&wheels))?;
    let wheel = only_wheel(&wheels)?;
    let clean = work.join("clean");
    clear(&clean)?;
    let python = venv(&clean, &["pytest", "mypy", "typing_extensions", &wheel.display().to_string()])?;
    let empty = work.join("empty");
    clear(&empty)?;
    std::fs::create_dir_all(&empty).map_err(|error| format!("{}: {error}", empty.display()))?;
    let tests = root.join(CRATE).join("tests");
    let config = root.join("pyproject.toml");
    let pytest = ["-m", "pytest", "-q", "-p", "no:cacheprovider", "-c"];
    call(Command::new(&python).current_dir(&empty).args(pytest).arg(&config).arg("--rootdir").arg(&empty).arg(&tests))?;
    let mypy = ["-m", "mypy", "--strict", "--config-file"];
    call(Command::new(&python).current_dir(&empty).args(mypy).arg(&config).args(["-p", "splatweaver"]))?;
    std::fs::create_dir_all(&out).map_err(|error| format!("{}: {error}", out.display()))?;
    let to = out.join(wheel.file_name().unwrap_or_default());
    std::fs::copy(&wheel, &to).map_err(|error| format!("{}: {error}", to.display()))?;
    let bytes = std::fs::metadata(&to).map_or(0, |file| file.len());
    println!("wheel: {:.1} MB, {}", bytes as f64 / 1e6, to.display());
    Ok(())
}

fn has_venv() -> bool {
    let asked = Command::new(PYTHON).args(["-c", "import venv, ensurepip"]).stderr(Stdio::null()).status();
    asked.is_ok_and(|status| status.success())
}

/// The interpreter of a virtual environment with these packages, made if it is not there.
pub fn venv(folder: &Path, packages: &[&str]) -> Result<PathBuf, String> {
    let python = folder.join(if cfg!(windows) { "Scripts/python.exe" } else { "bin/python" });
    if !python.exists() {
        call(Command::new(PYTHON).args(["-m", "venv"]).arg(folder))?;
    }
    let pip = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check"];
    call(Command::new(&python).args(pip).args(packages))?;
    Ok(python)
}

pub fn clear(folder: &Path) -> Result<(), String> {
    if !folder.exists() {
        return Ok(());
    }
    std::fs::remove_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))
}

fn only_wheel(folder: &Path) -> Result<PathBuf, String> {
    let entries = std::fs::read_dir(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let wheels = entries.filter_map(|entry| entry.ok().map(|entry| entry.path()));
    let mut wheels = wheels.filter(|path| path.extension().is_some_and(|extension| extension == "whl"));
    wheels.next().ok_or_else(|| format!("{}: expected a wheel, found none", folder.display()))
}

/// Prints a command, and runs it.
pub fn call(command: &mut Command) -> Result<(), String> {
    println!("{command:?}");
    let status = command.status().map_err(|error| format!("{command:?}: {error}"))?;
    if status.success() { Ok(()) } else { Err(format!("{command:?} failed")) }
}
