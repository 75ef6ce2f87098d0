//! The tests of Python's side, run on the library as cargo builds it.
//!
//! The environment variable `WEAVER_PYTHON` names an interpreter with numpy, pytest and mypy, and with torch for the
//! tests that need it.

// Python imports the library; this module of it needs no interpreter.
#[path = "../../src/failure_kind.rs"]
mod failure_kind;
mod failures;

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;
use weaver_cli::{Console, Interrupt};

/// The package as an interpreter imports it: Python's files, and the library under the name that they import.
fn package() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let package = folder.path().join("splatweaver");
    let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("python/splatweaver");
    std::fs::create_dir(&package).expect("a folder");
    for entry in std::fs::read_dir(&sources).expect("the package") {
        let from = entry.expect("an entry").path();
        if from.is_file() {
            std::fs::copy(&from, package.join(from.file_name().expect("a name"))).expect("a copy");
        }
    }
    std::fs::copy(library(), package.join("_splatweaver.abi3.so")).expect("a copy");
    folder
}

/// The library, beside the binary of these tests.
fn library() -> PathBuf {
    let name = format!("{}_splatweaver{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    let folder = std::env::current_exe().expect("a path").parent().expect("a folder").to_path_buf();
    let places = [folder.join(&name), folder.join("..").join(&name)];
    places.into_iter().find(|path| path.exists()).unwrap_or_else(|| panic!("{name}: not built"))
}

/// Runs the interpreter in the crate's folder; false if there is none.
fn run(arguments: &[&str]) -> bool {
    let Some(python) = std::env::var_os("WEAVER_PYTHON") else {
        println!("skipped: no python (WEAVER_PYTHON)");
        return false;
    };
    let package = package();
    let crate_folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut command = Command::new(python);
    command.current_dir(crate_folder).args(arguments).env("PYTHONPATH", package.path()).env("MYPYPATH", package.path());
    let output = command.env("PYTHONDONTWRITEBYTECODE", "1").output().expect("the interpreter of WEAVER_PYTHON starts");
    let text = String::from_utf8_lossy(&output.stdout);
    println!("{text}");
    assert!(output.status.success(), "{text}\n{}", String::from_utf8_lossy(&output.stderr));
    true
}

#[test]
fn the_tests_of_python_pass() {
    run(&["-m", "pytest", "-q", "-rs", "-p", "no:cacheprovider", "tests"]);
}

#[test]
fn the_types_are_right() {
    let config = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../pyproject.toml");
    // mypy's results on numpy stay from run to run.
    let cache = concat!(env!("CARGO_TARGET_TMPDIR"), "/mypy");
    run(&["-m", "mypy", "--strict", "--config-file", config, "--cache-dir", cache, "-p", "splatweaver"]);
}

/// Makes a capture and fits it.
const FIT: &str = "
import sys
from pathlib import Path
sys.path.insert(0, 'tests')
from capture import write_capture
import splatweaver
folder = Path(sys.argv[1])
write_capture(folder / 'capture')
splatweaver.fit(folder / 'capture', folder / 'python', steps=20, gaussians=200, background=(0.2, 0.4, 0.6), no_html=True)
";

#[test]
fn a_fit_has_the_bits_of_the_command_line() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    if !run(&["-c", FIT, folder.path().to_str().expect("a plain path")]) {
        return;
    }
    let flags = ["--steps", "20", "--gaussians", "200", "--background", "0.2,0.4,0.6", "--no-html", "-o"];
    let mut line: Vec<OsString> = ["splatweaver", "fit"].into_iter().chain(flags).map(OsString::from).collect();
    line.extend([path("rust").into(), path("capture").into()]);
    let (mut printed, mut told) = (Vec::new(), Vec::new());
    let code = weaver_cli::run(line, &mut Console::new(&mut printed, &mut told, false), &Interrupt::new());
    assert_eq!(code, 0, "{}", String::from_utf8_lossy(&told));
    let scene = |run: &str| std::fs::read(path(run).join("scene.ply")).expect("a scene");
    assert!(scene("python") == scene("rust"));
}
