//! Training that brings back what a change of the scene took away.

use crate::payload::check;
use crate::{CompressError, Schedule, Task};
use weaver_fit::{Density, Fit, FitSettings, Photo, Rates, Rounding, StrategyKind};
use weaver_scene::Gaussians;
use weaver_splat::Renderer;

/// Largest degree that is trained.
const DEGREE: usize = 3;

/// Rates of 3D Gaussian splatting at the end of its run, where a scene is complete.
const MEANS: f64 = 1.6e-6;

/// A scene that is trained and changed in turn.
#[derive(Debug)]
pub(crate) struct Recovery<'a> {
    pub(crate) gaussians: Gaussians,
    task: &'a Task<'a>,
    photos: Vec<Photo>,
    make_rounding: Option<MakeRounding<'a>>,
}

/// Something that makes a rounding for each part of the training.
pub(crate) struct MakeRounding<'a>(Box<dyn Fn() -> Box<dyn Rounding> + 'a>);

impl std::fmt::Debug for MakeRounding<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("MakeRounding")
    }
}

/// A task of a schedule.
pub(crate) type Change<'a> = Box<dyn Fn(&mut Recovery<'a>) -> Result<(), CompressError> + 'a>;

/// Trains for so many steps, with changes where they are due. Without steps all changes are made at once.
pub(crate) fn recover<'a>(
    task: &'a Task<'a>,
    gaussians: Gaussians,
    mut schedule: Schedule<Change<'a>>,
    steps: usize,
) -> Result<Gaussians, CompressError> {
    let photos = if steps == 0 { Vec::new() } else { targets(task)? };
    let mut recovery = Recovery { gaussians, task, photos, make_rounding: None };
    let mut done = 0;
    while let Some(next) = schedule.next_step().filter(|next| *next <= steps) {
        recovery.advance(done, next - done)?;
        done = next;
        for change in schedule.take_due(next) {
            change(&mut recovery)?;
        }
    }
    recovery.advance(done, steps - done)?;
    Ok(recovery.gaussians)
}

impl<'a> Recovery<'a> {
    /// Trains what is drawn rounded from now on.
    pub(crate) fn round(&mut self, make: impl Fn() -> Box<dyn Rounding> + 'a) {
        self.make_rounding = Some(MakeRounding(Box::new(make)));
    }

    /// Trains for so many steps at constant rates.
    fn advance(&mut self, done: usize, steps: usize) -> Result<(), CompressError> {
        if steps == 0 {
            return Ok(());
        }
        let Task { pictures, seed, .. } = *self.task;
        let rates = Rates {
            means: MEANS,
            means_end: 1.0,
            scales: 5e-3,
            quats: 1e-3,
            opacities: 0.025,
            sh: 2.5e-3,
            power: 0.0,
            ..Rates::default()
        };
        let settings = FitSettings {
            steps,
            gaussians: self.gaussians.len(),
            // Another order of photos in each part.
            seed: seed.wrapping_add(done as u64),
            sh_degree: self.gaussians.degree,
            sh_interval: 0.0,
            background: pictures.background,
            coarse_until: 0.0,
            rates,
            density: Density { strategy: StrategyKind::Keep, ..Density::default() },
            ..FitSettings::default()
        };
        let mut fit = Fit::new(self.photos.clone(), &self.gaussians, settings)?;
        fit.set_raster_settings(pictures.settings);
        if let Some(MakeRounding(make)) = &self.make_rounding {
            fit.set_rounding(0.0, make());
        }
        for _ in 0..steps {
            fit.step()?;
        }
        self.gaussians = fit.gaussians();
        Ok(())
    }
}

/// The photos to train with: those that are given, else pictures of the scene.
fn targets(task: &Task<'_>) -> Result<Vec<Photo>, CompressError> {
    if !task.photos.is_empty() {
        return Ok(task.photos.to_vec());
    }
    let (activated, pictures) = (task.gaussians.to_activated(), &task.pictures);
    let mut renderer = Renderer::default();
    let photo = |(number, camera)| {
        let picture = renderer.render(&activated, &[camera], pictures.background, &pictures.settings)?.concat();
        let rgb = picture.iter().map(|x| (255.0 * x.clamp(0.0, 1.0)).round() as u8).collect();
        Ok(Photo { name: format!("picture {number}"), camera, rgb, mask: None })
    };
    pictures.cameras.iter().copied().enumerate().map(photo).collect()
}

/// The scene with harmonics that can be trained, if all its numbers are finite.
pub(crate) fn trainable(gaussians: &Gaussians) -> Result<Gaussians, CompressError> {
    check(gaussians)?;
    Ok(gaussians.with_degree(gaussians.degree.min(DEGREE)))
}
