//! Runs that are under way, as their folders have them.

use crate::Error;
use serde_json::{Map, Value, json};
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};
use weaver_io::safetensors::Tensors;
use weaver_run::{Folder, Record, read_records};
use weaver_scene::Gaussians;

/// Makes the scene of a checkpoint.
pub type SceneOf<'a> = &'a (dyn Fn(&Tensors) -> weaver_io::Result<Gaussians> + Sync);

/// Makes the scene of a checkpoint at a time, 0 to 1.
pub type FilmOf<'a> = &'a (dyn Fn(&Tensors, f64) -> weaver_io::Result<Gaussians> + Sync);

/// A part of a run that a page shows beside its curves.
#[derive(Clone, Copy)]
pub enum Showing<'a> {
    /// The scene of its last checkpoint.
    Scene(SceneOf<'a>),
    /// The scene of its last checkpoint, which moves.
    Film(FilmOf<'a>),
    /// The last by name of the PNG pictures in a folder, which need not exist yet.
    Pictures(&'a Path),
}

impl fmt::Debug for Showing<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Scene(_) => f.write_str("Scene"),
            Self::Film(_) => f.write_str("Film"),
            Self::Pictures(folder) => f.debug_tuple("Pictures").field(folder).finish(),
        }
    }
}

/// A run whose log and checkpoints a page follows. The run itself does nothing for it: files are read when a page asks.
#[derive(Clone, Copy, Debug)]
pub struct Followed<'a> {
    /// The run's folder.
    pub folder: &'a Path,
    /// Steps of the whole run.
    pub steps: usize,
    /// The part that is shown beside the curves.
    pub showing: Showing<'a>,
    /// Ends the run after its step where it is set, as Ctrl-C does.
    pub stop: &'a AtomicBool,
}

impl Followed<'_> {
    /// The number of what is shown: when it was written, milliseconds; 0 where there is nothing yet.
    pub fn version(&self) -> u64 {
        let since = self.shown().and_then(|(written, _)| written.duration_since(UNIX_EPOCH).ok());
        since.map_or(0, |since| since.as_millis() as u64)
    }

    /// The file of what is shown, and when it was written.
    fn shown(&self) -> Option<(SystemTime, PathBuf)> {
        let dated = |path: PathBuf| Some((path.metadata().ok()?.modified().ok()?, path));
        match self.showing {
            Showing::Scene(_) | Showing::Film(_) => dated(self.folder.join(Folder::CHECKPOINT)),
            Showing::Pictures(folder) => dated(weaver_io::list_files(folder, &["png"]).ok()?.pop()?),
        }
    }

    /// The scene of the last checkpoint, at a time if it moves; none where there is no checkpoint, or no scene to the run.
    ///
    /// # Errors
    /// When the checkpoint cannot be read or holds no scene.
    pub fn gaussians(&self, time: f64) -> Result<Option<Gaussians>, Error> {
        if let Showing::Pictures(_) = self.showing {
            return Ok(None);
        }
        let Some((_, path)) = self.shown() else { return Ok(None) };
        let state = Tensors::read(&path)?;
        Ok(match self.showing {
            Showing::Scene(scene) => Some(scene(&state)?),
            Showing::Film(film) => Some(film(&state, time)?),
            Showing::Pictures(_) => None,
        })
    }

    /// The newest picture, a PNG file; none where there is none yet, or the run shows its scene.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn picture(&self) -> Result<Option<Vec<u8>>, Error> {
        let Showing::Pictures(_) = self.showing else { return Ok(None) };
        Ok(self.shown().map(|(_, path)| weaver_io::read_bytes(&path)).transpose()?)
    }

    /// Records after a step, how far the run is, and the number of what is shown.
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

/// A record; the loss of a run with several stages, which mean different things by it, is one of its stage.
fn record_json(record: &Record) -> Value {
    let named = |name: &str| match record.stage.as_str() {
        stage if name == "loss" && !stage.is_empty() => format!("loss, {stage}"),
        _ => name.to_string(),
    };
    let values: Map<String, Value> = record.values.iter().map(|(name, value)| (named(name), json!(value))).collect();
    json!({ "step": record.step, "values": values })
}
