//! The tests of the crates that touch memory by hand, under valgrind's memcheck: no read or write beyond allocations,
//! no branch on memory that was never written.
//!
//! Valgrind executes the portable and the AVX2 code; it does not support AVX-512. Reads and writes that a kernel makes
//! unchecked are checked once more by `debug_assert!`, since this is the dev profile.

use serde_json::Value;
use std::process::{Command, Stdio};
use std::time::Instant;

const PACKAGES: &[&str] = &["weaver-kernels", "weaver-autograd"];
const INSTRUCTION_SETS: &[&str] = &["portable", "avx2"];

/// Parts of the names of skipped tests: with a hundred thousand cases in place of a few, with processes of their own,
/// or with measurements of the machine, which differs under valgrind.
const SKIPPED: &[&str] = &["every_size", "whole_range", "f32_is_accurate", "instruction_sets", "peak::"];

/// Exit code of memcheck when it has found something.
const FOUND: i32 = 99;

pub fn run() -> Result<(), String> {
    let version = Command::new("valgrind").arg("--version").output().map_err(|e| {
        format!(
            "valgrind could not be started ({e}); it comes with most Linux distributions, as the package `valgrind`"
        )
    })?;
    println!("{}", String::from_utf8_lossy(&version.stdout).trim());
    let tests = executables()?;
    let mut faults = Vec::new();
    for (name, executable) in &tests {
        for set in INSTRUCTION_SETS {
            let started = Instant::now();
            let what = format!("{name}, {set}");
            match memcheck(executable, set)? {
                Some(0) => println!("{what}: fine, {:.0} s", started.elapsed().as_secs_f64()),
                Some(FOUND) => faults.push(format!("{what}: memcheck found errors, see above")),
                Some(code) => faults.push(format!("{what}: a test failed, exit status {code}")),
                None => faults.push(format!("{what}: killed")),
            }
        }
    }
    if faults.is_empty() { Ok(()) } else { Err(format!("valgrind:\n  {}", faults.join("\n  "))) }
}

/// Names and paths of the test executables, built here.
fn executables() -> Result<Vec<(String, String)>, String> {
    let mut build = Command::new(env!("CARGO"));
    build.args(["test", "--no-run", "--locked", "--message-format", "json"]).stderr(Stdio::inherit());
    build.args(PACKAGES.iter().flat_map(|package| ["-p", package]));
    let output = build.output().map_err(|e| format!("cargo could not be started: {e}"))?;
    if !output.status.success() {
        return Err("the tests do not compile".into());
    }
    let messages = String::from_utf8_lossy(&output.stdout).into_owned();
    let found: Vec<_> = messages.lines().filter_map(executable).collect();
    if found.is_empty() { Err("cargo built no test".into()) } else { Ok(found) }
}

/// The test executable in a message of cargo.
fn executable(message: &str) -> Option<(String, String)> {
    let message: Value = serde_json::from_str(message).ok()?;
    let path = message["executable"].as_str()?;
    let package = PACKAGES.iter().find(|p| message["package_id"].as_str().is_some_and(|id| id.contains(*p)))?;
    let test = message["profile"]["test"] == true;
    test.then(|| (format!("{package} {}", message["target"]["name"].as_str().unwrap_or_default()), path.to_string()))
}

fn memcheck(executable: &str, set: &str) -> Result<Option<i32>, String> {
    let mut run = Command::new("valgrind");
    run.args(["--quiet", "--tool=memcheck", &format!("--error-exitcode={FOUND}"), executable]);
    run.args(["--quiet", "--test-threads=1"]);
    run.args(SKIPPED.iter().flat_map(|part| ["--skip", part]));
    // Two threads are enough to share work; few random cases, as each takes fifty times as long as usual.
    let run = run.env("WEAVER_SIMD", set).env("RAYON_NUM_THREADS", "2").env("PROPTEST_CASES", "20");
    run.status().map(|status| status.code()).map_err(|e| format!("valgrind could not be started: {e}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn test_executables_are_found_in_cargos_messages() {
        let line = |test: bool, path: &str| {
            let message = serde_json::json!({
                "reason": "compiler-artifact", "package_id": "path+file:///x/crates/engine/kernels#weaver-kernels@0.1.0",
                "target": {"name": "it"}, "profile": {"test": test}, "executable": path,
            });
            message.to_string()
        };
        assert_eq!(executable(&line(true, "/t/it")), Some(("weaver-kernels it".into(), "/t/it".into())));
        assert_eq!(executable(&line(false, "/t/it")), None);
        assert_eq!(executable("   Compiling x"), None);
    }
}
