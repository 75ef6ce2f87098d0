//! Automation for the workspace.
//!
//! `cargo xtask check` is the definition of green: formatting, lints, documentation, and the invariants of
//! docs/architecture.md (`cargo xtask tidy`).

mod audit;
mod cross;
mod dial;
mod embed;
mod peers;
mod release;
mod scripts;
mod site;
mod stress;
mod study;
mod test;
mod tidy;
mod valgrind;
mod wheel;

use std::path::PathBuf;
use std::process::{Command, ExitCode};

const USAGE: &str = "usage: cargo xtask <command>

  check           fmt, clippy, rustdoc, dependencies and public interfaces where cargo-deny and cargo-semver-checks are here, scripts and
                  tidy: what must hold before a change lands
  test            [-p CRATE ...]: all tests, and how many could not run here, and why
  tidy            the crates' edges and the other invariants of docs/architecture.md; with UPDATE_PAGES=1 it writes
                  the page of promises, docs/contribute/tests.md
  parity          DIR [--json] [--strict]: every module against the files of reference numbers in DIR
  random-weights  --preset NAME FILE: a checkpoint of the published names and types, drawn at random
  stress          [-p CRATE ...]: the tests with every sweep in full; before a release
  stress kill     [TIMES]: training killed at random moments and out of disk, then resumed: the same bits
  stress parsers  [FILES [READER]]: so many mutated files for each reader, or for those with this in their names: no panic, little memory
  study density   DIR CAPTURE ... [--lpips WEIGHTS] [-- FLAGS]: what adaptive density is worth, trained (with more flags) in DIR, where it goes on
                  after an interruption
  study own-photos  DIR CAPTURE ... [--lpips WEIGHTS] [-- FLAGS]: what lens distortion, orientation and masks cost, trained in the same way
  dial            the picture of the README's dial, drawn anew from its table in docs/results/density.md
  bench-peers     [--threads T]: `bench engine` beside PyTorch, as installed and with MKL's fast path, as far as they are here
  cross           [WORD ...]: lints, a build and tests for Windows, Linux on ARM and macOS, as far as they can be compiled, linked and
                  run here (wine, qemu); targets with one of the words in their names
  embed           the examples of tests/embedding, in a package outside of the workspace
  valgrind        the tests of kernels and tape under memcheck, by portable code and by AVX2
  wheel           [DIR]: the Python package built by maturin, installed where nothing else is, and tested there
  release         [DIR]: a wheel with the program in it, an archive of the program with its manual, completions and licenses,
                  sources, the list of packages and checksums; equal commits give equal bytes
  site            [DIR] [--scene FILE.html]: the documents as HTML with links checked, the scene of the demonstration on the first page
  walk            --out DIR [--photos N] [--size PIXELS] [--seed N] [--facade]: photos along a generated street that comes back past its
                  beginning, or along a building whose windows repeat, with exact cameras";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (command, rest) = arguments.split_first().map_or(("", &[][..]), |(first, rest)| (first.as_str(), rest));
    let done = match command {
        "check" => check(),
        "tidy" => tidy::run(),
        "parity" | "random-weights" => forward(command, rest),
        "test" => test::run(rest),
        "stress" => stress::run(rest),
        "study" => study::run(rest),
        "dial" => dial::run(),
        "cross" => cross::run(rest),
        "embed" => embed::run(),
        "bench-peers" => peers::run(rest),
        "walk" => cargo_run(&["--release", "--package", "weaver-procedural", "--example", "walk"], rest),
        "valgrind" => valgrind::run(),
        "wheel" => wheel::run(rest),
        "release" => release::run(rest),
        "site" => site::run(rest),
        _ => Err(USAGE.into()),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            if !message.is_empty() {
                eprintln!("{message}");
            }
            ExitCode::FAILURE
        }
    }
}

fn check() -> Result<(), String> {
    cargo(&["fmt", "--all", "--check"], &[])?;
    let lints = ["--locked", "--", "-D", "warnings"];
    cargo(&[&["clippy", "--workspace", "--all-targets", "--features", "weaver-cli/gpu"], &lints[..]].concat(), &[])?;
    // A fit is embedded without files, too.
    cargo(&[&["clippy", "-p", "weaver-fit", "--no-default-features"], &lints[..]].concat(), &[])?;
    // The product is built without the methods, too.
    let product = ["clippy", "-p", "weaver-cli", "--no-default-features", "--all-targets"];
    cargo(&[&product, &lints[..]].concat(), &[])?;
    // As it is built by default, too. The whole workspace again: crates without the feature are checked already.
    cargo(&[&["clippy", "--workspace", "--all-targets"], &lints[..]].concat(), &[])?;
    cargo(&["doc", "--workspace", "--no-deps", "--locked"], &[("RUSTDOCFLAGS", "-D warnings")])?;
    audit::run()?;
    scripts::check(&tidy::root()?)?;
    tidy::run()?;
    println!("check: fine");
    Ok(())
}

/// Runs a binary of the package that links the model.
fn forward(binary: &str, arguments: &[String]) -> Result<(), String> {
    // The binary has printed the reason of its failure.
    cargo_run(&["--package", "weaver-parity", "--bin", binary], arguments).map_err(|_| String::new())
}

fn cargo_run(which: &[&str], arguments: &[String]) -> Result<(), String> {
    let mut run = vec!["run", "--quiet", "--locked"];
    run.extend(which);
    run.push("--");
    run.extend(arguments.iter().map(String::as_str));
    finish(&run, &[])
}

/// The folder in which cargo keeps what it fetches; none without a home.
fn cargo_home() -> Option<PathBuf> {
    std::env::var_os("CARGO_HOME").map(PathBuf::from).or_else(|| {
        let home = std::env::var_os(if cfg!(windows) { "USERPROFILE" } else { "HOME" })?;
        Some(PathBuf::from(home).join(".cargo"))
    })
}

/// Prints a command of cargo, and runs it.
fn cargo(arguments: &[&str], environment: &[(&str, &str)]) -> Result<(), String> {
    println!("cargo {}", arguments.join(" "));
    finish(arguments, environment)
}

fn finish(arguments: &[&str], environment: &[(&str, &str)]) -> Result<(), String> {
    let status = Command::new(env!("CARGO"))
        .args(arguments)
        .envs(environment.iter().copied())
        .status()
        .map_err(|e| format!("cargo could not be started: {e}"))?;
    if status.success() { Ok(()) } else { Err(format!("`cargo {}` failed", arguments.join(" "))) }
}
