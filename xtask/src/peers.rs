//! `bench engine` and its peers on this machine, one after the other.

use crate::tidy;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Rounds of a peer's figure.
const RUNS: &str = "7";
/// MKL takes its path of AVX2 only if it takes the processor for Intel's: what it asks for that, answered with yes.
const INTEL: &str = "int mkl_serv_intel_cpu_true(void) { return 1; }\nint mkl_serv_intel_cpu(void) { return 1; }\n";

/// The figures of a peer: its name, and milliseconds by row.
struct Peer {
    name: &'static str,
    rows: Value,
}

/// Times the rows of `bench engine` by this program and by all peers that are here, and prints them side by side.
pub fn run(arguments: &[String]) -> Result<(), String> {
    let threads = match arguments {
        [] => std::thread::available_parallelism().map_or(1, usize::from),
        [flag, number] if flag == "--threads" => {
            number.parse().map_err(|_| format!("--threads: expected a number, found `{number}`"))?
        }
        _ => return Err("usage: cargo xtask bench-peers [--threads T]".into()),
    };
    let root = tidy::root()?;
    let ours = ours(&root, threads)?;
    let mut peers = Vec::new();
    match pytorch(&root, threads, None) {
        Ok(rows) => peers.push(Peer { name: "PyTorch", rows }),
        Err(why) => println!("skipped: PyTorch: {why}"),
    }
    // What is installed decides by the processor's maker, not by its instructions.
    if !peers.is_empty() {
        match answering(&root).and_then(|library| pytorch(&root, threads, Some(&library))) {
            Ok(rows) => peers.push(Peer { name: "MKL unlocked", rows }),
            Err(why) => println!("skipped: PyTorch with MKL's fast path: {why}"),
        }
    }
    print!("{}", table(&ours, &peers));
    Ok(())
}

/// The output of a command as JSON.
fn json(command: &mut Command, name: &str) -> Result<Value, String> {
    let output = command.output().map_err(|error| format!("{name} could not be started: {error}"))?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        return Err(said.trim().lines().last().unwrap_or("no word").to_string());
    }
    serde_json::from_slice(&output.stdout).map_err(|error| format!("{name}: {error}"))
}

fn ours(root: &Path, threads: usize) -> Result<Value, String> {
    let mut run = Command::new(env!("CARGO"));
    run.current_dir(root).stderr(Stdio::inherit());
    run.args(["run", "--release", "--quiet", "--locked", "--package", "weaver-cli", "--"]);
    json(run.args(["bench", "engine", "--json", "--threads", &threads.to_string()]), "cargo")
}

/// PyTorch's milliseconds by row, with a library in front of its own.
fn pytorch(root: &Path, threads: usize, before: Option<&Path>) -> Result<Value, String> {
    let python = std::env::var("WEAVER_PYTHON").unwrap_or("python3".into());
    let mut run = Command::new(&python);
    run.arg(root.join("xtask/peers/pytorch.py")).args([&threads.to_string(), RUNS]);
    run.envs(before.map(|library| ("LD_PRELOAD", library)));
    json(&mut run, &python)
}

/// A library that answers MKL's questions for the processor.
fn answering(root: &Path) -> Result<PathBuf, String> {
    let folder = root.join("target/peers");
    let (source, library) = (folder.join("intel.c"), folder.join("intel.so"));
    let written = std::fs::create_dir_all(&folder).and_then(|()| std::fs::write(&source, INTEL));
    written.map_err(|error| format!("{}: {error}", source.display()))?;
    let compiled = Command::new("cc").args(["-shared", "-fPIC", "-o"]).args([&library, &source]).status();
    match compiled {
        Ok(status) if status.success() => Ok(library),
        Ok(_) => Err(format!("cc: {} does not compile", source.display())),
        Err(error) => Err(format!("cc could not be started: {error}")),
    }
}

/// Rows with our time, its share of the peak, and our time over each peer's.
fn table(ours: &Value, peers: &[Peer]) -> String {
    let mut text = format!("{:<30}{:>10}{:>9}", "work, f32", "ms", "of peak");
    peers.iter().for_each(|peer| text += &format!("{:>15}", peer.name));
    text += "\n";
    for row in ours["rows"].as_array().into_iter().flatten() {
        let name = row["name"].as_str().unwrap_or_default();
        let number = |key: &str| row[key].as_f64().unwrap_or(f64::NAN);
        text += &format!("{name:<30}{:>10.3}{:>7.0} %", number("ms"), 100.0 * number("fraction_of_peak"));
        for peer in peers {
            let ratio = peer.rows[name].as_f64().map(|theirs| format!("{:.2}", number("ms") / theirs));
            text += &format!("{:>15}", ratio.unwrap_or("-".into()));
        }
        text += "\n";
    }
    let [peak, copy] = ["peak_gflops", "copy_gbs"].map(|key| ours[key].as_f64().unwrap_or(f64::NAN));
    text + &format!(
        "\nMedians on {} threads: milliseconds of this program, and over each peer's. Peaks of this run: {peak:.0} GFLOP/s, \
         {copy:.1} GB/s.\n",
        ours["threads"]
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn times_stand_over_the_peers() {
        let row = json!({ "name": "matmul/512", "ms": 2.0, "fraction_of_peak": 0.5 });
        let ours = json!({ "threads": 2, "peak_gflops": 100.0, "copy_gbs": 20.0, "rows": [row] });
        let peers = [("PyTorch", json!({ "matmul/512": 4.0 })), ("other", json!({}))];
        let text = table(&ours, &peers.map(|(name, rows)| Peer { name, rows }));
        let line: Vec<&str> = text.lines().nth(1).unwrap().split_whitespace().collect();
        assert_eq!(line, ["matmul/512", "2.000", "50", "%", "0.50", "-"]);
    }
}
