//! The long sweeps: the ordinary tests, optimized and without omissions.

use crate::cargo;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

/// Random cases per property; proptest draws 256 of itself. A test that takes long draws a part of them.
const CASES: &str = "8192";
/// Number of kills of a training, and of files for each reader, unless the command names another.
const KILLS: &str = "100";
const FILES: &str = "1000000";
/// A folder that Linux keeps in memory.
const MEMORY: &str = "/dev/shm";
/// Crates with readers of files.
const READERS: [&str; 2] = ["weaver-io", "weaver-trainer"];

pub fn run(arguments: &[String]) -> Result<(), String> {
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments[..] {
        ["kill"] => one(&["weaver-cli"], "killed", ("WEAVER_KILLS", KILLS), None),
        ["kill", times] => one(&["weaver-cli"], "killed", ("WEAVER_KILLS", times), None),
        ["parsers"] => one(&READERS, "mutated", ("WEAVER_MUTATIONS", FILES), None),
        ["parsers", files] => one(&READERS, "mutated", ("WEAVER_MUTATIONS", files), None),
        ["parsers", files, reader] => {
            one(&READERS, "mutated", ("WEAVER_MUTATIONS", files), Some(("WEAVER_READER", reader)))
        }
        _ => all(&arguments),
    }
}

/// One module of some crates' tests, as often as an environment variable says, and with another one.
fn one(
    packages: &[&str],
    module: &str,
    (name, number): (&str, &str),
    other: Option<(&str, &str)>,
) -> Result<(), String> {
    if number.parse::<u64>().is_err() {
        return Err(format!("stress: expected a number of times, found {number}"));
    }
    let mut test = vec!["test", "--release", "--locked", "--test", "it"];
    packages.iter().for_each(|package| test.extend(["-p", package]));
    test.extend([module, "--", "--nocapture"]);
    // Small files are written millions of times: in memory, unless the user says otherwise.
    let memory = std::env::var("TMPDIR").is_err() && Path::new(MEMORY).is_dir();
    let folder = memory.then_some(("TMPDIR", MEMORY));
    let environment: Vec<_> = [(name, number)].into_iter().chain(other).chain(folder).collect();
    cargo(&test, &environment)?;
    println!("stress: fine");
    Ok(())
}

fn all(which: &[&str]) -> Result<(), String> {
    let seed = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_secs()).to_string();
    println!("stress: PROPTEST_RNG_SEED={seed}");
    let which = if which.is_empty() { &["--workspace"] } else { which };
    let test: Vec<&str> = ["test", "--release", "--locked", "--tests"].iter().chain(which).copied().collect();
    let environment = [("WEAVER_STRESS", "1"), ("PROPTEST_RNG_SEED", seed.as_str()), ("PROPTEST_CASES", CASES)];
    cargo(&test, &environment)?;
    println!("stress: fine");
    Ok(())
}
