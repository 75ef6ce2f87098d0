//! All tests, and a list of tests that could not run here.

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

/// Prefix of the line of a skipped test; the reason follows.
const SKIPPED: &str = "skipped: ";

/// All tests: unit tests, too, except of targets declared without any. Examples are left out: no test runs them, and
/// `check` compiles them.
const ALL: [&[&str]; 2] = [
    &["--workspace", "--features", "weaver-cli/gpu", "--tests"],
    &["--workspace", "--features", "weaver-cli/gpu", "--doc"],
];

pub fn run(arguments: &[String]) -> Result<(), String> {
    let mut summary = Summary::default();
    let passed = if arguments.is_empty() {
        // One failure must not hide others.
        ALL.iter().try_fold(true, |passed, which| Ok::<_, String>(passed & tests(which, &mut summary)?))?
    } else {
        tests(&arguments.iter().map(String::as_str).collect::<Vec<_>>(), &mut summary)?
    };
    println!("{}", summary.text());
    if passed { Ok(()) } else { Err("tests failed".into()) }
}

/// Runs the tests that arguments of `cargo test` choose; true if all passed.
fn tests(which: &[&str], summary: &mut Summary) -> Result<bool, String> {
    let line = [&["test", "--locked", "--no-fail-fast"], which, &["--", "--show-output"]].concat();
    println!("cargo {}", line.join(" "));
    let failed = |e: std::io::Error| format!("cargo could not be run: {e}");
    let mut child = Command::new(env!("CARGO")).args(&line).stdout(Stdio::piped()).spawn().map_err(failed)?;
    for line in BufReader::new(child.stdout.take().expect("a pipe was asked for")).lines() {
        if let Some(line) = summary.told(&line.map_err(failed)?) {
            println!("{line}");
        }
    }
    Ok(child.wait().map_err(failed)?.success())
}

/// Summary of the tests' output so far.
#[derive(Debug, Default)]
struct Summary {
    /// True while lines are output of passed tests.
    of_passed: bool,
    /// Reasons of skipped tests, each with the number of tests.
    skipped: std::collections::BTreeMap<String, usize>,
}

impl Summary {
    /// Takes a line in; returns it if its reader should see it.
    fn told<'a>(&mut self, line: &'a str) -> Option<&'a str> {
        if line == "successes:" {
            self.of_passed = true;
        } else if line == "failures:" || line.starts_with("test result:") {
            self.of_passed = false;
        }
        // A test's first line may follow the harness's output about another test.
        if let Some((_, why)) = line.split_once(SKIPPED).filter(|_| self.of_passed) {
            *self.skipped.entry(why.to_string()).or_default() += 1;
        }
        (!self.of_passed).then_some(line)
    }

    fn text(&self) -> String {
        let reasons: String = self.skipped.iter().map(|(why, count)| format!("\n  {count} x {why}")).collect();
        format!("skipped: {}{reasons}", self.skipped.values().sum::<usize>())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn skips_are_counted_and_what_passed_is_silent() {
        let output = "running 3 tests\ntest a ... ok\n\nsuccesses:\n\n---- a stdout ----\nskipped: no data (fox)\nsome figures\n\n\
                      ---- b stdout ----\nskipped: no data (fox)\n\nsuccesses:\n    a\n\nfailures:\n\n---- c stdout ----\nskipped: not this\n\n\
                      test result: FAILED. 2 passed; 1 failed\n";
        let mut summary = Summary::default();
        let seen: Vec<&str> = output.lines().filter_map(|line| summary.told(line)).collect();
        assert_eq!(summary.text(), "skipped: 2\n  2 x no data (fox)");
        assert!(seen.contains(&"test a ... ok") && seen.contains(&"---- c stdout ----"), "{seen:?}");
        assert!(!seen.contains(&"some figures") && seen.last().unwrap().starts_with("test result"), "{seen:?}");
        assert_eq!(Summary::default().text(), "skipped: 0");
    }
}
