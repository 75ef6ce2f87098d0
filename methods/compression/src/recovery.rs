//! Training that restores the quality after a change of the scene.

use crate::payload::{broken, check};
use crate::{CompressionError, Schedule, Task, Training};
use std::fmt::{self, Debug, Formatter};
use weaver_fit::{Density, Fit, FitSettings, Photo, Rates, Rounding, StrategyKind, gaussians_of};
use weaver_io::safetensors::Tensors;
use weaver_scene::Gaussians;
use weaver_splat::Renderer;

/// Largest trained degree of harmonics.
const DEGREE: usize = 3;

/// Rates of 3D Gaussian splatting at the end of its run, for complete scenes.
const MEANS: f64 = 1.6e-6;

/// A scene that is trained and changed in turn: a fit by weaver-fit between any two changes.
pub(crate) struct Recovery<'a> {
    task: &'a Task<'a>,
    /// The scene after the last change.
    gaussians: Gaussians,
    schedule: Schedule<Change<'a>>,
    make_rounding: Option<Box<dyn Fn() -> Box<dyn Rounding> + 'a>>,
    write: Write<'a>,
    /// Finished steps, and all of them.
    steps: [usize; 2],
    part: Option<Part>,
}

/// A scheduled change; returns the scene for the next part of the training.
pub(crate) type Change<'a> = Box<dyn Fn(&Gaussians) -> Result<Gaussians, CompressionError> + 'a>;

/// The bytes of the trained scene.
type Write<'a> = Box<dyn FnOnce(&Gaussians) -> Result<Vec<u8>, CompressionError> + 'a>;

/// The training between two changes.
#[derive(Debug)]
struct Part {
    fit: Fit,
    /// Finished steps before it.
    start: usize,
}

/// Key in a state of the finished steps, and of the steps before the part under way.
const STEPS: &str = "recovery.steps";

impl Debug for Recovery<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.debug_struct("Recovery").field("steps", &self.steps).field("part", &self.part).finish_non_exhaustive()
    }
}

impl<'a> Recovery<'a> {
    /// A training of `steps` steps with scheduled changes; without steps all changes are made at once.
    pub(crate) fn new(
        task: &'a Task<'a>,
        gaussians: Gaussians,
        schedule: Schedule<Change<'a>>,
        steps: usize,
        write: impl FnOnce(&Gaussians) -> Result<Vec<u8>, CompressionError> + 'a,
    ) -> Self {
        Self { task, gaussians, schedule, make_rounding: None, write: Box::new(write), steps: [0, steps], part: None }
    }

    /// Trains rounded Gaussians; `make` creates a rounding for each part.
    pub(crate) fn rounded(self, make: impl Fn() -> Box<dyn Rounding> + 'a) -> Self {
        Self { make_rounding: Some(Box::new(make)), ..self }
    }

    /// Makes the changes that are due.
    fn change(&mut self) -> Result<(), CompressionError> {
        let due = self.schedule.take_due(self.steps[0]);
        if let Some(part) = self.part.take_if(|_| !due.is_empty()) {
            self.gaussians = part.fit.gaussians();
        }
        for change in due {
            self.gaussians = change(&self.gaussians)?;
        }
        Ok(())
    }

    /// The part from this step to the next change, at its beginning, with constant rates.
    fn part(&self, start: usize) -> Result<Part, CompressionError> {
        let [_, last] = self.steps;
        let end = self.schedule.next_step().unwrap_or(last).min(last);
        let Task { pictures, seed, .. } = *self.task;
        let rates = Rates {
            means: MEANS,
            means_end: 1.0,
            scales: 5e-3,
            quats: 1e-3,
            opacities: 0.025,
            sh: 2.5e-3,
            power: 0.0,
            end: 1.0,
            ..Rates::default()
        };
        let settings = FitSettings {
            steps: end - start,
            gaussians: self.gaussians.len(),
            // Another order of photos in each part.
            seed: seed.wrapping_add(start as u64),
            sh_degree: self.gaussians.degree,
            sh_interval: 0.0,
            background: pictures.background,
            coarse_until: 0.0,
            rates,
            density: Density { strategy: StrategyKind::Keep, ..Density::default() },
            ..FitSettings::default()
        };
        let mut fit = Fit::new(targets(self.task)?, &self.gaussians, settings)?;
        fit.set_raster_settings(pictures.settings);
        if let Some(make) = &self.make_rounding {
            fit.set_rounding(0.0, make());
        }
        Ok(Part { fit, start })
    }
}

impl Training for Recovery<'_> {
    fn steps(&self) -> [usize; 2] {
        self.steps
    }

    fn step(&mut self) -> Result<f64, CompressionError> {
        self.change()?;
        let mut part = match self.part.take() {
            Some(part) => part,
            None => self.part(self.steps[0])?,
        };
        let report = part.fit.step()?;
        self.part = Some(part);
        self.steps[0] += 1;
        Ok(report.loss)
    }

    fn state(&self) -> Tensors {
        // Before the first part, no step is done.
        let (mut state, start) = match &self.part {
            Some(part) => (part.fit.state(), part.start),
            None => (Tensors::default(), 0),
        };
        state.insert(STEPS, &[2], vec![self.steps[0] as u64, start as u64]);
        state
    }

    fn restore(&mut self, state: &Tensors) -> Result<(), CompressionError> {
        let found = state.values::<u64>(STEPS, &[2])?;
        let [done, start] = [0, 1].map(|i| found[i] as usize);
        if done > self.steps[1] || start > done {
            return Err(broken(STEPS, format!("up to {} steps", self.steps[1]), format!("{found:?}")));
        }
        if done == 0 {
            return Ok(());
        }
        self.schedule.go_on(done);
        self.gaussians = gaussians_of(state)?;
        let mut part = self.part(start)?;
        part.fit.restore(state)?;
        (self.steps[0], self.part) = (done, Some(part));
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<Vec<u8>, CompressionError> {
        self.change()?;
        let gaussians = match &self.part {
            Some(part) => part.fit.gaussians(),
            None => self.gaussians,
        };
        (self.write)(&gaussians)
    }
}

/// The training photos: the task's, else pictures of the scene.
pub(crate) fn targets(task: &Task<'_>) -> Result<Vec<Photo>, CompressionError> {
    if !task.photos.is_empty() {
        return Ok(task.photos.to_vec());
    }
    let (activated, pictures) = (task.gaussians.to_activated(), &task.pictures);
    let mut renderer = Renderer::default();
    let photo = |(number, camera)| {
        let picture = renderer.render(&activated, &[camera], pictures.background, &pictures.settings)?.concat();
        let rgb = picture.iter().map(|x| (255.0 * x.clamp(0.0, 1.0)).round() as u8).collect();
        Ok(Photo { name: format!("picture {number}"), camera, rgb, mask: None, lens: None })
    };
    pictures.cameras.iter().copied().enumerate().map(photo).collect()
}

/// The scene with harmonics of a trainable degree, if all its numbers are finite.
pub(crate) fn trainable(gaussians: &Gaussians) -> Result<Gaussians, CompressionError> {
    check(gaussians)?;
    Ok(gaussians.with_degree(gaussians.degree.min(DEGREE)))
}
