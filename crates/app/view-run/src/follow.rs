//! Runs that are under way, as their folders have them.

use crate::Error;
use serde_json::{Map, Value, json};
use std::fmt;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::UNIX_EPOCH;
use weaver_io::safetensors::Tensors;
use weaver_run::{Folder, Record, read_records};
use weaver_scene::Gaussians;

/// Makes the scene of a checkpoint.
pub type SceneOf<'a> = &'a (dyn Fn(&Tensors) -> weaver_io::Result<Gaussians> + Sync);

/// A run whose log and checkpoints a page follows. The run itself does nothing for it: files are read when a page asks.
#[derive(Clone, Copy)]
pub struct Followed<'a> {
    /// The run's folder.
    pub folder: &'a Path,
    /// Steps of the whole run.
    pub steps: usize,
    /// Makes the scene of a checkpoint.
    pub scene: SceneOf<'a>,
    /// Ends the run after its step where it is set, as Ctrl-C does.
    pub stop: &'a AtomicBool,
}

impl fmt::Debug for Followed<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Followed").field("folder", &self.folder).field("steps", &self.steps).finish_non_exhaustive()
    }
}

impl Followed<'_> {
    /// The number of the last checkpoint: when it was written, milliseconds; 0 where there is none.
    pub fn version(&self) -> u64 {
        let written = || self.folder.join(Folder::CHECKPOINT).metadata().ok()?.modified().ok();
        let since = written().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
        since.map_or(0, |since| since.as_millis() as u64)
    }

    /// The scene of the last checkpoint; none where there is no checkpoint.
    ///
    /// # Errors
    /// When the checkpoint cannot be read or holds no scene.
    pub fn gaussians(&self) -> Result<Option<Gaussians>, Error> {
        let path = self.folder.join(Folder::CHECKPOINT);
        if !path.is_file() {
            return Ok(None);
        }
        Ok(Some((self.scene)(&Tensors::read(&path)?)?))
    }

    /// Records after a step, how far the run is, and the number of its last checkpoint.
    ///
    /// # Errors
    /// When the log cannot be read.
    pub fn progress(&self, since: usize) -> Result<Value, Error> {
        let log = self.folder.join(Folder::LOG);
        let records = if log.is_file() { read_records(log)? } else { Vec::new() };
        let step = records.last().map_or(0, |record| record.step);
        let later: Vec<Value> = records.iter().filter(|record| record.step > since).map(record_json).collect();
        Ok(json!({
            "step": step,
            "of": self.steps,
            "records": later,
            "version": self.version(),
            "finished": step >= self.steps || self.stop.load(Ordering::Relaxed),
        }))
    }

    /// Asks the run to end after its step and to save.
    pub fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

fn record_json(record: &Record) -> Value {
    let values: Map<String, Value> = record.values.iter().map(|(name, value)| (name.clone(), json!(value))).collect();
    json!({ "step": record.step, "values": values })
}
