//! Several pictures as a job in steps: one fit after the other, each resumable.

use crate::command::read::{failure, read};
use crate::command::results::{Judged, Method, Row};
use crate::command::state::{all, drawn, insert, is_under_way, refused, stored, under_way};
use crate::{Fit, FitState, Picture, decode};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use weaver_command::{Console, Failure};
use weaver_io::safetensors::Tensors;
use weaver_io::{Checksum, Image, atomic_write, path_in_utf8, read_bytes};
use weaver_run::{Folder, Job, Kind, Scalar, StepReport};

/// The folders of these runs.
pub const KIND: Kind = Kind { command: "image fit", settings: "run.json", results: &[] };
/// Name of the fitted pictures in a checkpoint's metadata.
const ROWS: &str = "rows";
/// The encoded file of a finished picture that is not written yet.
const FINISHED: &str = "finished";

/// Settings of a run.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Settings {
    /// The pictures, and checksums of their files.
    pictures: Vec<(PathBuf, String)>,
    /// Method of the fits.
    #[serde(flatten)]
    pub method: Method,
}

impl Settings {
    /// Settings for these pictures, as they are now.
    pub fn new(pictures: Vec<PathBuf>, method: Method) -> Result<Self, Failure> {
        let mut known: Vec<(PathBuf, String)> = Vec::new();
        for path in pictures {
            let path = std::path::absolute(path)?;
            path_in_utf8(&path)?;
            // Disks that take no notice of case would hold one file of both.
            let one_file = |other: &Path| name(other).to_lowercase() == name(&path).to_lowercase();
            if let Some((other, _)) = known.iter().find(|(other, _)| one_file(other)) {
                let (path, other) = (path.display(), other.display());
                return Err(Failure::message(format!("{path}: expected a name of its own, found that of {other}")));
            }
            let sum = checksum(&path)?;
            known.push((path, sum));
        }
        Ok(Self { pictures: known, method })
    }

    /// The files of the results.
    pub fn names(&self) -> Vec<String> {
        self.pictures.iter().map(|(path, _)| name(path)).collect()
    }

    /// The picture of a checkpoint: the one under way, else the one finished last.
    pub fn drawn(&self, state: &Tensors, folder: &Path) -> weaver_io::Result<Image> {
        let rows = rows(state).map_err(|found| refused(state, &found))?;
        if let Some((picture, _)) = self.pictures.get(rows.len()).filter(|_| is_under_way(state)) {
            return under_way(state, picture, &self.method);
        }
        let last = rows.last().ok_or_else(|| refused(state, &"none"))?;
        let bytes = match state.tensors.contains_key(FINISHED) {
            true => all(state, FINISHED)?,
            false => read_bytes(folder.join(name(&last.picture)))?,
        };
        let coded = decode(&bytes).map_err(|error| refused(state, &error))?;
        drawn(&coded.fitted, [last.width, last.height]).map_err(|error| refused(state, &error))
    }
}

/// Figures of the pictures finished before a checkpoint, or the fault of its metadata.
fn rows(state: &Tensors) -> Result<Vec<Row>, String> {
    let rows = state.metadata.get(ROWS).ok_or("no rows")?;
    serde_json::from_str(rows).map_err(|error| error.to_string())
}

fn name(picture: &Path) -> String {
    format!("{}.wgi", picture.file_stem().unwrap_or_default().to_string_lossy())
}

fn checksum(path: &Path) -> Result<String, Failure> {
    let mut sum = Checksum::default();
    sum.bytes(&read_bytes(path)?);
    Ok(sum.to_string())
}

/// The pictures of a run, some of them finished, at most one under way.
pub struct PicturesJob {
    settings: Settings,
    rows: Vec<Row>,
    /// Number of `rows` from before this session.
    before: usize,
    /// Wanted numbers of Gaussians of the pictures finished in this session.
    asked: Vec<usize>,
    current: Option<(Picture, Fit)>,
    /// State of the interrupted fit.
    left: Option<FitState>,
    finished: Option<Vec<u8>>,
}

impl PicturesJob {
    /// A job at its beginning.
    pub fn new(settings: Settings) -> Result<Self, Failure> {
        settings.method.check()?;
        let (rows, asked) = (Vec::new(), Vec::new());
        Ok(Self { settings, rows, before: 0, asked, current: None, left: None, finished: None })
    }

    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Figures of the pictures that are finished.
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// The pictures finished in this session, with their wanted numbers of Gaussians.
    pub fn take_news(&mut self) -> Vec<(Row, usize)> {
        self.rows[self.before..].iter().cloned().zip(std::mem::take(&mut self.asked)).collect()
    }

    /// Writes the file of a finished picture.
    pub fn write(&mut self, folder: &Folder) -> Result<(), Failure> {
        if let (Some(bytes), Some(row)) = (&self.finished, self.rows.last()) {
            let path = folder.out().file(name(&row.picture))?;
            atomic_write(path, |to| to.write_all(bytes))?;
            self.finished = None;
        }
        Ok(())
    }

    /// The next picture and its fit, at its start or at its interrupted state.
    fn open(&mut self, path: &Path) -> Result<(Picture, Fit), Failure> {
        let known = &self.settings.pictures[self.rows.len()].1;
        let found = checksum(path)?;
        if found != *known {
            return Err(Failure::message(format!(
                "{}: expected the picture that the run began with, found another",
                path.display()
            )));
        }
        // Notes on the picture were printed at the beginning of the run, or are in the report.
        let mut quiet = (std::io::sink(), std::io::sink());
        let mut console = Console::new(&mut quiet.0, &mut quiet.1, false);
        let picture = read(path, &mut console)?;
        let settings = self.settings.method.settings(self.settings.method.count(&picture));
        let fit = match self.left.take() {
            Some(state) => Fit::at(&picture, &settings, state),
            None => Fit::new(&picture, &settings),
        };
        let fit = fit.map_err(|error| failure(path, &error))?;
        Ok((picture, fit))
    }
}

impl Job for PicturesJob {
    type Error = Failure;

    fn steps(&self) -> [usize; 2] {
        let steps = self.settings.method.steps;
        let under_way = match (&self.current, &self.left) {
            (Some((_, fit)), _) => fit.state().step as usize,
            (None, Some(state)) => state.step as usize,
            (None, None) => 0,
        };
        [self.rows.len() * steps + under_way, self.settings.pictures.len() * steps]
    }

    fn step(&mut self) -> Result<StepReport, Failure> {
        let path = self.settings.pictures[self.rows.len()].0.clone();
        let named = |error| failure(&path, &error);
        let (picture, mut fit) = match self.current.take() {
            Some(current) => current,
            None => self.open(&path)?,
        };
        let progress = fit.step(&picture).map_err(named)?;
        if fit.is_done() {
            let judged = fit.finish(&picture).and_then(|fitted| Judged::new(&path, &picture, &fitted));
            let judged = judged.map_err(named)?;
            self.asked.push(self.settings.method.count(&picture));
            self.rows.push(judged.row);
            self.finished = Some(judged.bytes);
        } else {
            self.current = Some((picture, fit));
        }
        let [step, of] = self.steps();
        let stage = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let scalars = vec![Scalar::last("gaussians", progress.gaussians as f64)];
        Ok(StepReport { step, of, stage, loss: progress.loss, scalars })
    }

    fn state(&mut self) -> Result<Tensors, Failure> {
        let mut tensors = Tensors::default();
        let rows = serde_json::to_string(&self.rows)?;
        tensors.metadata.insert(ROWS.into(), rows);
        if let Some(bytes) = &self.finished {
            tensors.insert(FINISHED, &[bytes.len()], bytes.clone());
        }
        let state = self.current.as_ref().map(|(_, fit)| fit.state()).or(self.left.as_ref());
        if let Some(state) = state {
            insert(state, &mut tensors);
        }
        Ok(tensors)
    }

    fn restore(&mut self, state: &Tensors) -> Result<(), Failure> {
        let origin = state.origin().display().to_string();
        let other =
            |found: String| Failure::message(format!("{origin}: expected the state of this run, found {found}"));
        self.rows = rows(state).map_err(other)?;
        if self.rows.len() > self.settings.pictures.len() {
            return Err(other(format!("{} pictures of {}", self.rows.len(), self.settings.pictures.len())));
        }
        self.before = self.rows.len();
        self.finished = match state.tensors.contains_key(FINISHED) {
            true => Some(all::<u8>(state, FINISHED)?),
            false => None,
        };
        self.left = stored(state)?;
        Ok(())
    }

    fn stepped(&mut self, folder: &Folder) -> Result<(), Failure> {
        self.write(folder)
    }
}
