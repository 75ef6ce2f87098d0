//! The workspace for other systems: as far as it can be compiled, linked and run on this one.

use std::process::{Command, Stdio};

/// Another system, and what a Linux computer has for it.
struct System {
    target: &'static str,
    /// Links programs for it. Without one, code is checked alone.
    linker: Option<&'static str>,
    /// Runs them.
    runner: Option<&'static str>,
    /// Packages whose tests are run: those with code of its own for the system or its processor.
    tested: &'static [&'static str],
}

const SYSTEMS: &[System] = &[
    System {
        target: "x86_64-pc-windows-gnu",
        linker: Some("x86_64-w64-mingw32-gcc"),
        runner: Some("wine"),
        tested: &["weaver-io", "weaver-data", "weaver-run", "weaver-view"],
    },
    System {
        target: "aarch64-unknown-linux-gnu",
        linker: Some("aarch64-linux-gnu-gcc"),
        runner: Some("qemu-aarch64"),
        tested: &["weaver-kernels", "weaver-splat", "weaver-stereo"],
    },
    System { target: "aarch64-apple-darwin", linker: None, runner: None, tested: &[] },
];

/// Where Debian has the libraries that qemu loads for programs of the other processor.
const ARM_LIBRARIES: &str = "/usr/aarch64-linux-gnu";

/// Checks, builds and tests for all systems, or for those whose targets have one of these words in their names.
pub fn run(words: &[String]) -> Result<(), String> {
    let mut failed = Vec::new();
    for system in SYSTEMS {
        if !words.is_empty() && !words.iter().any(|word| system.target.contains(word)) {
            continue;
        }
        if let Err(message) = system.run() {
            failed.push(message);
        }
    }
    if failed.is_empty() { Ok(()) } else { Err(format!("cross:\n  {}", failed.join("\n  "))) }
}

impl System {
    fn run(&self) -> Result<(), String> {
        let target = self.target;
        if !has_standard_library(target)? {
            println!("skipped: no standard library (rustup target add {target})");
            return Ok(());
        }
        self.cargo(&["clippy", "--workspace", "--all-targets", "--locked"], &["--", "-D", "warnings"])?;
        let Some(linker) = self.linker else {
            println!("{target}: checked; nothing links or runs it here");
            return Ok(());
        };
        if !starts(linker) {
            println!("skipped: no {linker} (build and tests for {target})");
            return Ok(());
        }
        self.cargo(&["build", "--package", "weaver-cli", "--bins", "--locked"], &[])?;
        match self.runner.filter(|runner| starts(runner)) {
            Some(_) => {
                let packages: Vec<&str> = self.tested.iter().flat_map(|package| ["--package", package]).collect();
                self.cargo(&[&["test", "--tests", "--no-fail-fast", "--locked"], &packages[..]].concat(), &[])
            }
            None => {
                println!("skipped: no {} (tests for {target})", self.runner.unwrap_or("program that runs it"));
                Ok(())
            }
        }
    }

    /// Runs cargo for this system.
    fn cargo(&self, arguments: &[&str], rest: &[&str]) -> Result<(), String> {
        let line = [arguments, &["--target", self.target], rest].concat();
        println!("cargo {}", line.join(" "));
        let mut command = Command::new(env!("CARGO"));
        command.args(&line).env("QEMU_LD_PREFIX", ARM_LIBRARIES).env("WINEDEBUG", "-all");
        let name = self.target.to_uppercase().replace('-', "_");
        for (key, program) in [("LINKER", self.linker), ("RUNNER", self.runner)] {
            if let Some(program) = program {
                command.env(format!("CARGO_TARGET_{name}_{key}"), program);
            }
        }
        let status = command.status().map_err(|error| format!("cargo could not be started: {error}"))?;
        if status.success() { Ok(()) } else { Err(format!("`cargo {}` failed", line.join(" "))) }
    }
}

/// True if the compiler has the standard library of a target.
fn has_standard_library(target: &str) -> Result<bool, String> {
    let done = Command::new("rustc")
        .args(["--print", "target-libdir", "--target", target])
        .output()
        .map_err(|error| format!("rustc could not be started: {error}"))?;
    Ok(std::path::Path::new(String::from_utf8_lossy(&done.stdout).trim()).is_dir())
}

/// True if a program is here.
fn starts(program: &str) -> bool {
    Command::new(program).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok()
}
