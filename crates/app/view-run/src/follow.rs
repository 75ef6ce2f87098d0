//! Runs that are under way, as their folders have them.

use crate::Error;
use serde_json::{Map, Value, json};
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};
use weaver_io::Image;
use weaver_io::safetensors::Tensors;
use weaver_run::{Folder, Record, read_records};
use weaver_scene::Gaussians;

/// Makes the scene of a checkpoint.
pub type SceneOf<'a> = &'a (dyn Fn(&Tensors) -> weaver_io::Result<Gaussians> + Sync);

/// Makes the scene of a checkpoint at a time, 0 to 1.
pub type FilmOf<'a> = &'a (dyn Fn(&Tensors, f64) -> weaver_io::Result<Gaussians> + Sync);

/// Draws a picture of a checkpoint.
pub type DrawingOf<'a> = &'a (dyn Fn(&Tensors) -> weaver_io::Result<Image> + Sync);

/// A part of a run that a page shows beside its curves.
#[derive(Clone, Copy)]
pub enum LiveView<'a> {
    /// The scene of its last checkpoint.
    Scene(SceneOf<'a>),
    /// The scene of its last checkpoint, which moves.
    Film(FilmOf<'a>),
    /// The last by name of the PNG pictures in a folder, which need not exist yet.
    Pictures(&'a Path),
    /// A picture that is drawn of its last checkpoint.
    Drawing(DrawingOf<'a>),
    /// Nothing.
    Curves,
}

impl fmt::Debug for LiveView<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Scene(_) => f.write_str("Scene"),
            Self::Film(_) => f.write_str("Film"),
            Self::Pictures(folder) => f.debug_tuple("Pictures").field(folder).finish(),
            Self::Drawing(_) => f.write_str("Drawing"),
            Self::Curves => f.write_str("Curves"),
        }
    }
}

/// A run whose log and checkpoints a page follows. The run itself does nothing for it: files are read on requests of
/// the page.
#[derive(Clone, Copy, Debug)]
pub struct LiveRun<'a> {
    /// The run's folder.
    pub folder: &'a Path,
    /// Steps of the whole run.
    pub steps: usize,
    /// Readable names of its curves, by their names in the log.
    pub names: &'a [(&'a str, &'a str)],
    /// The part that is shown beside the curves.
    pub showing: LiveView<'a>,
    /// Ends the run after its step where it is set, as Ctrl-C does.
    pub stop: &'a AtomicBool,
}

impl LiveRun<'_> {
    /// Version of the shown file: the time of its last change, milliseconds; 0 where there is none yet.
    pub fn version(&self) -> u64 {
        let since = self.shown().and_then(|(written, _)| written.duration_since(UNIX_EPOCH).ok());
        since.map_or(0, |since| since.as_millis() as u64)
    }

    /// The file with the shown scene or picture, and the time of its last change.
    fn shown(&self) -> Option<(SystemTime, PathBuf)> {
        let dated = |path: PathBuf| Some((path.metadata().ok()?.modified().ok()?, path));
        match self.showing {
            LiveView::Scene(_) | LiveView::Film(_) | LiveView::Drawing(_) => {
                dated(self.folder.join(Folder::CHECKPOINT))
            }
            LiveView::Pictures(folder) => dated(weaver_io::list_files(folder, &["png"]).ok()?.pop()?),
            LiveView::Curves => None,
        }
    }

    /// The scene of the last checkpoint, at a time if it moves; none where there is no checkpoint, or no scene to the
    /// run.
    ///
    /// # Errors
    /// When the checkpoint cannot be read or holds no scene.
    pub fn gaussians(&self, time: f64) -> Result<Option<Gaussians>, Error> {
        let Some((_, path)) = self.shown() else { return Ok(None) };
        Ok(match self.showing {
            LiveView::Scene(scene) => Some(scene(&Tensors::read(&path)?)?),
            LiveView::Film(film) => Some(film(&Tensors::read(&path)?, time)?),
            LiveView::Pictures(_) | LiveView::Drawing(_) | LiveView::Curves => None,
        })
    }

    /// The newest picture, a PNG file; none where there is none yet, or the run shows none.
    ///
    /// # Errors
    /// When it cannot be read or drawn.
    pub fn picture(&self) -> Result<Option<Vec<u8>>, Error> {
        let Some((_, path)) = self.shown() else { return Ok(None) };
        Ok(match self.showing {
            LiveView::Pictures(_) => Some(weaver_io::read_bytes(&path)?),
            LiveView::Drawing(drawing) => Some(drawing(&Tensors::read(&path)?)?.to_png()),
            LiveView::Scene(_) | LiveView::Film(_) | LiveView::Curves => None,
        })
    }

    /// Records after a step, the progress of the run, and the [version](Self::version) of the shown file.
    ///
    /// # Errors
    /// When the log cannot be read.
    pub fn progress(&self, since: usize) -> Result<Value, Error> {
        let log = self.folder.join(Folder::LOG);
        let records = if log.is_file() { read_records(log)? } else { Vec::new() };
        let step = records.last().map_or(0, |record| record.step);
        let later: Vec<Value> =
            records.iter().filter(|record| record.step > since).map(|record| self.json(record)).collect();
        Ok(json!({
            "step": step,
            "of": self.steps,
            "records": later,
            "version": self.version(),
            "finished": step >= self.steps || self.stop.load(Ordering::Relaxed),
        }))
    }

    /// Makes the run end after its step and save.
    pub fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// A record; in a run with several stages the name of the loss includes the stage, since each stage defines it
    /// differently.
    fn json(&self, record: &Record) -> Value {
        let named = |name: &str| {
            let better = self.names.iter().find(|(key, _)| *key == name);
            let name = better.map_or(name.replace('_', " "), |(_, better)| (*better).into());
            if name == "loss" && !record.stage.is_empty() { format!("loss, {}", record.stage) } else { name }
        };
        let values: Map<String, Value> =
            record.values.iter().map(|(name, value)| (named(name), json!(value))).collect();
        json!({ "step": record.step, "values": values })
    }
}
