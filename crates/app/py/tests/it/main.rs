//! The tests of Python's side, run on the library as cargo builds it.
//!
//! The environment variable `WEAVER_PYTHON` names an interpreter with numpy, pytest and mypy, and with torch for the tests that need it.

use std::path::{Path, PathBuf};
use std::process::Command;

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

fn run(arguments: &[&str]) {
    let Some(python) = std::env::var_os("WEAVER_PYTHON") else {
        println!("skipped: no python (WEAVER_PYTHON)");
        return;
    };
    let package = package();
    let crate_folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut command = Command::new(python);
    command.current_dir(crate_folder).args(arguments).env("PYTHONPATH", package.path()).env("MYPYPATH", package.path());
    let output = command.env("PYTHONDONTWRITEBYTECODE", "1").output().expect("the interpreter of WEAVER_PYTHON starts");
    let text = String::from_utf8_lossy(&output.stdout);
    println!("{text}");
    assert!(output.status.success(), "{text}\n{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn the_tests_of_python_pass() {
    run(&["-m", "pytest", "-q", "-p", "no:cacheprovider", "tests"]);
}

#[test]
fn the_types_are_right() {
    run(&["-m", "mypy", "--strict", "--cache-dir", "/dev/null", "-p", "splatweaver"]);
}
