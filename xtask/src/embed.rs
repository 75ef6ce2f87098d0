//! The examples of tests/embedding, built and run in a package outside of the workspace, like the package of a user who
//! embeds a crate.

use crate::cargo_run;
use crate::tidy::{folders, root};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The crates that the examples name.
const CRATES: &[&str] =
    &["weaver-autograd", "weaver-inference", "weaver-io", "weaver-pose", "weaver-scene", "weaver-splat"];

/// Examples, each with its arguments: the folder of a training run, and a folder to write to.
const EXAMPLES: &[(&str, &[Argument])] = &[
    ("custom_op", &[]),
    ("formats", &[Argument::Out]),
    ("raster", &[]),
    ("predict_to_folder", &[Argument::Run, Argument::Out]),
];

#[derive(Clone, Copy)]
enum Argument {
    Run,
    Out,
}

pub fn run() -> Result<(), String> {
    let root = root()?;
    let folder = std::env::temp_dir().join(format!("weaver-embedding-{}", std::process::id()));
    let done = examples(&root, &folder);
    let _ = fs::remove_dir_all(&folder);
    done
}

fn examples(root: &Path, folder: &Path) -> Result<(), String> {
    let at = |path: &Path, e: std::io::Error| format!("{}: {e}", path.display());
    let (sources, out, run) = (folder.join("src/bin"), folder.join("out"), folder.join("run"));
    for path in [&sources, &out] {
        fs::create_dir_all(path).map_err(|e| at(path, e))?;
    }
    let copy = |from: &Path, to: &Path| fs::copy(from, to).map(drop).map_err(|e| at(from, e));
    for (name, _) in EXAMPLES {
        let file = format!("{name}.rs");
        copy(&root.join("tests/embedding").join(&file), &sources.join(&file))?;
    }
    // The same versions as the workspace has, so that nothing is fetched.
    copy(&root.join("Cargo.lock"), &folder.join("Cargo.lock"))?;
    copy(&root.join("rust-toolchain.toml"), &folder.join("rust-toolchain.toml"))?;
    let manifest = folder.join("Cargo.toml");
    fs::write(&manifest, self::manifest(&folders()?)).map_err(|e| at(&manifest, e))?;

    println!("a run of two steps");
    let train = ["train", "--preset", "micro", "--steps", "2", "--out", &run.to_string_lossy()].map(String::from);
    cargo_run(&["--package", "weaver-cli"], &train)?;
    for (name, arguments) in EXAMPLES {
        let path = |argument: &Argument| match argument {
            Argument::Run => &run,
            Argument::Out => &out,
        };
        let status = Command::new(env!("CARGO"))
            .args(["run", "--quiet", "--bin", name, "--"])
            .args(arguments.iter().map(path))
            .current_dir(folder)
            .env("CARGO_TARGET_DIR", root.join("target/embedding"))
            .status()
            .map_err(|e| format!("cargo could not be started: {e}"))?;
        if !status.success() {
            return Err(format!("embed: {name} failed"));
        }
    }
    println!("embed: fine");
    Ok(())
}

/// A package that depends on crates of the workspace by path. Its own `[workspace]` keeps cargo from looking for
/// another.
fn manifest(folders: &BTreeMap<String, PathBuf>) -> String {
    let dependency = |name: &&str| Some(format!("{name} = {{ path = {:?} }}\n", folders.get(*name)?));
    let dependencies: String = CRATES.iter().filter_map(dependency).collect();
    format!(
        "[package]\nname = \"embedding\"\nversion = \"0.0.0\"\nedition = \"2024\"\n\n[workspace]\n\n\
         [dependencies]\n{dependencies}\n\
         [profile.dev]\nopt-level = 1\ndebug = false\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_manifest_names_every_crate_by_its_path() {
        let manifest = manifest(&folders().unwrap());
        let splat = manifest.lines().find(|line| line.starts_with("weaver-splat = { path = ")).unwrap();
        assert!(splat.ends_with("crates/scene/splat\" }"), "{manifest}");
        assert_eq!(manifest.matches("path = ").count(), CRATES.len());
    }
}
