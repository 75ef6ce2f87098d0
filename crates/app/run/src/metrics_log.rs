//! Logs of JSON lines: one object per logged step.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::path::Path;
use weaver_io::{Appender, Result};

/// A file of JSON lines to which a run appends one record after another.
///
/// A record is anything that serializes to an object with a whole number `step`. A run that goes on from an earlier
/// step drops the records that it is about to write again.
#[derive(Debug)]
pub struct MetricsLog {
    file: Appender,
}

/// The step of a record; its other keys are ignored.
#[derive(Deserialize)]
struct Position {
    step: u64,
}

fn step_of(line: &[u8]) -> Option<u64> {
    serde_json::from_slice(line).ok().map(|Position { step }| step)
}

impl MetricsLog {
    /// Continues the log after `step` steps: lines of later steps, left by an interrupted run, are dropped, and so is
    /// an incomplete last line, as after a crash. The lines that stay keep their bytes.
    ///
    /// # Errors
    /// When the file cannot be read or written.
    pub fn open(path: impl AsRef<Path>, step: usize) -> Result<Self> {
        let path = path.as_ref();
        if path.exists() {
            // Bytes: the file may be cut off within a character.
            let bytes = weaver_io::read_bytes(path)?;
            let kept = lines(&bytes).filter(|line| step_of(line).is_some_and(|at| at <= step as u64));
            let kept: Vec<u8> = kept.flat_map(|line| [line, b"\n"].concat()).collect();
            weaver_io::atomic_write(path, |w| w.write_all(&kept))?;
        }
        Ok(Self { file: Appender::open(path)? })
    }

    /// Appends a record, in a single write. Numbers that are not finite become `null`.
    ///
    /// # Errors
    /// When the file cannot be written, for instance because the disk is full.
    ///
    /// # Panics
    /// When the record is no object with a whole number `step`.
    pub fn append(&mut self, record: &impl Serialize) -> Result<()> {
        let mut line = serde_json::to_string(record).expect("a record is plain data");
        assert!(step_of(line.as_bytes()).is_some(), "expected a record with a whole number `step`, found {line}");
        line.push('\n');
        self.file.append(line.as_bytes())
    }
}

/// Reads the records of a log; lines that are none, such as an incomplete last one after a crash, are skipped.
///
/// # Errors
/// When the file cannot be read.
pub fn read_metrics<T: DeserializeOwned>(path: impl AsRef<Path>) -> Result<Vec<T>> {
    let bytes = weaver_io::read_bytes(path)?;
    Ok(lines(&bytes).filter_map(|line| serde_json::from_slice(line).ok()).collect())
}

fn lines(bytes: &[u8]) -> impl Iterator<Item = &[u8]> {
    bytes.split(|byte| *byte == b'\n')
}
