//! Logs and checkpoints, written between the steps of a run.

use crate::record::{Mean, read_records};
use crate::{Error, Folder, Log, MetricsLog, Rhythm, Save, StepReport, TensorBoard};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use weaver_io::safetensors::Tensors;

/// Time between two checkpoints over the time that one takes to write, at least.
const SAVING: u32 = 30;

/// Logs steps and writes checkpoints while a run is under way.
///
/// [`Run::advance`](crate::Run::advance) uses one. A loop of another shape, such as one that calls an observer, has one
/// of its own.
#[derive(Debug)]
pub struct Recorder<'a> {
    folder: &'a Folder,
    rhythm: Rhythm,
    stop: &'a AtomicBool,
    log: MetricsLog,
    board: TensorBoard,
    mean: Mean,
    /// Seconds of the steps of earlier sessions.
    before: f64,
    started: Instant,
    saved: Instant,
    /// The least time until the next checkpoint.
    pause: Duration,
}

impl<'a> Recorder<'a> {
    /// Continues the logs of a run after `done` steps: records of later steps, left by an interrupted session, are
    /// dropped. TensorBoard gets a new event file.
    ///
    /// # Errors
    /// When a file cannot be read or written.
    pub fn open(folder: &'a Folder, done: usize, rhythm: Rhythm, stop: &'a AtomicBool) -> Result<Self, Error> {
        let path = folder.out().file(Folder::LOG)?;
        let log = MetricsLog::open(&path, done)?;
        let before = read_records(&path)?.last().and_then(|record| record.value("seconds")).unwrap_or(0.0);
        let board = TensorBoard::create(folder.path().join(Folder::EVENTS))?;
        let (mean, now) = (Mean::default(), Instant::now());
        let rhythm = Rhythm { save: folder.pace(rhythm.save), ..rhythm };
        let pause = match rhythm.save {
            Save::Seconds(seconds) => Duration::from_secs_f64(seconds),
            Save::Steps(_) => Duration::ZERO,
        };
        Ok(Self { folder, rhythm, stop, log, board, mean, before, started: now, saved: now, pause })
    }

    /// Logs a step.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn log(&mut self, report: &StepReport) -> Result<(), Error> {
        let (due, alone) = match self.rhythm.log {
            Log::Every(steps) => (report.step == 1 || report.step.is_multiple_of(steps.max(1)), true),
            Log::Means(records) => {
                (report.step.is_multiple_of(report.of.div_ceil(records.max(1))) || report.step == report.of, false)
            }
        };
        if due || !alone {
            self.mean.add(report);
        }
        if due {
            let seconds = self.before + self.started.elapsed().as_secs_f64();
            let record = self.mean.take(report, seconds);
            self.log.append(&record)?;
            let values: Vec<(&str, f32)> = record.values.iter().map(|(n, v)| (n.as_str(), *v as f32)).collect();
            self.board.scalars(record.step, &values)?;
        }
        Ok(())
    }

    /// True if the run is to end before its last step.
    pub fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// True if a checkpoint is to be written after `step` steps.
    pub fn is_due(&self, step: usize) -> bool {
        match self.rhythm.save {
            Save::Steps(steps) => step.is_multiple_of(steps.max(1)),
            Save::Seconds(_) => self.saved.elapsed() >= self.pause,
        }
    }

    /// Writes a checkpoint.
    ///
    /// # Errors
    /// When there is no state to be had or it cannot be written; the last one then stays as it was.
    pub fn save<E: From<Error>>(&mut self, state: impl FnOnce() -> Result<Tensors, E>) -> Result<(), E> {
        let start = Instant::now();
        self.folder.save(&state()?)?;
        self.saved = Instant::now();
        if let Save::Seconds(seconds) = self.rhythm.save {
            self.pause = Duration::from_secs_f64(seconds).max(start.elapsed() * SAVING);
        }
        Ok(())
    }
}
