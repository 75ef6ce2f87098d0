//! The long sweeps: the ordinary tests, optimized and told to leave nothing out.

use crate::cargo;
use std::time::{SystemTime, UNIX_EPOCH};

/// Random cases per property; proptest draws 256 of itself. A test that takes long draws a part of them.
const CASES: &str = "8192";

pub fn run(arguments: &[String]) -> Result<(), String> {
    let seed = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_secs()).to_string();
    println!("stress: PROPTEST_RNG_SEED={seed}");
    let which = if arguments.is_empty() { vec!["--workspace"] } else { arguments.iter().map(String::as_str).collect() };
    let test: Vec<&str> = ["test", "--release", "--locked", "--tests"].into_iter().chain(which).collect();
    let environment = [("WEAVER_STRESS", "1"), ("PROPTEST_RNG_SEED", seed.as_str()), ("PROPTEST_CASES", CASES)];
    cargo(&test, &environment)?;
    println!("stress: fine");
    Ok(())
}
