//! Trained networks of any model, and their evaluation.

use crate::evaluate::{Matching, Options};
use crate::{Alignment, CameraMode, DataConfig, Error, Evaluation, LookOf, Sources, Targets, evaluate, scenes};
use std::path::PathBuf;
use weaver_data::Scene;
use weaver_inference::{Checkpoint, Density, Predictor, SplatWeaverPredictor};

/// A trained run, ready to be evaluated or used.
#[derive(Debug)]
pub struct OpenRun {
    /// The network with its averaged weights.
    pub predictor: Box<dyn Predictor>,
    /// Steps that the weights were trained for.
    pub step: usize,
    /// Planned steps of the run; where unknown, the steps done.
    pub planned: usize,
    /// The run's seed.
    pub seed: u64,
    /// The run's data.
    pub data: DataConfig,
    /// Source of the cameras, unless a call says otherwise.
    pub cameras: CameraMode,
    /// The captures that the run has learned from, if its checkpoint lists them.
    pub sources: Sources,
}

/// The scenes of an evaluation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Source {
    /// The data of the run.
    Run,
    /// Folders of captures.
    Folders(Vec<PathBuf>),
    /// The built-in procedural scenes that are never trained on.
    Unseen,
}

/// Options of an evaluation that differ from the run's configuration.
#[derive(Clone, Debug, Default)]
pub struct EvalOptions {
    /// Context views for each held-out view.
    pub context_views: Option<usize>,
    /// Source of the cameras.
    pub cameras: Option<CameraMode>,
    /// The photos that judge.
    pub targets: Targets,
    /// True if depth is brought to the points that the context views see; with given cameras only.
    pub points: bool,
    /// Estimates the cameras of context views from photos of this longest side, pixels, in place of others.
    pub matching: Option<MatchingOverride>,
    /// Which pixels get Gaussians, and how many.
    pub density: Density,
    /// Alignment of held-out views' cameras with their photos, for figures beside the others.
    pub align: Option<Alignment>,
    /// The photo in whose light held-out views are drawn; `None` is the first context photo, for models with light.
    pub look: Option<LookOf>,
    /// True if photos are left as they were taken, where the run's were given light and passers-by.
    pub plain: bool,
    /// True if photos have masks, as [`DataConfig::masks`] says; so they are where the run's do.
    pub masks: bool,
    /// File with the weights of LPIPS, to measure that, too.
    pub lpips: Option<PathBuf>,
}

/// Options of estimating cameras for an evaluation.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct MatchingOverride {
    /// Longest side of the photos while they are matched, pixels; at least the network's.
    pub long_side: usize,
    /// True if focal lengths are given, as by EXIF.
    pub focal_known: bool,
}

impl OpenRun {
    /// The weights that come with the program, as if they were a run's. They are for cameras that are given or
    /// estimated.
    ///
    /// # Errors
    /// Never, unless the program is damaged.
    ///
    /// ```
    /// let run = weaver_trainer::OpenRun::built_in()?;
    /// assert_eq!(run.predictor.image_size(), [48, 64]);
    /// # Ok::<(), weaver_trainer::Error>(())
    /// ```
    pub fn built_in() -> Result<Self, Error> {
        let checkpoint = Checkpoint::built_in()?;
        let predictor = Box::new(SplatWeaverPredictor::from_checkpoint(&checkpoint)?);
        let run = Self::of_weights(predictor, checkpoint.step, checkpoint.defaults().seed);
        Ok(Self { cameras: CameraMode::Given, ..run })
    }

    /// A predictor without its run.
    pub(super) fn of_weights(predictor: Box<dyn Predictor>, step: usize, seed: u64) -> Self {
        Self {
            predictor,
            step,
            planned: step,
            seed,
            data: DataConfig::default(),
            cameras: CameraMode::Predicted,
            sources: Sources::default(),
        }
    }

    /// Evaluates the weights; `progress` receives the numbers of views done and of all views.
    ///
    /// # Errors
    /// When the data cannot be read, or the options do not suit the model.
    pub fn evaluate(
        &mut self,
        source: &Source,
        choices: &EvalOptions,
        progress: &mut dyn FnMut(usize, usize),
    ) -> Result<Evaluation, Error> {
        let size = self.predictor.image_size();
        let procedural = *source == Source::Unseen || *source == Source::Run && self.data.folders.is_empty();
        if choices.masks && procedural {
            return Err(Error::Input("masks: expected captures, found procedural scenes, which have none".into()));
        }
        let data = DataConfig { masks: choices.masks || self.data.masks, ..self.data.clone() };
        let load = |size: [usize; 2]| match source {
            Source::Run => scenes::load(&data, size),
            Source::Folders(folders) => scenes::load_captures(folders, &data, size),
            Source::Unseen => Ok(weaver_procedural::default_unseen_set(size[1], size[0])),
        };
        let scenes = load(size)?;
        let matching = match choices.matching {
            Some(MatchingOverride { long_side, focal_known }) => {
                let scale = (long_side as f64 / size[0].max(size[1]) as f64).max(1.0);
                let larger = size.map(|side| (side as f64 * scale).round() as usize);
                let larger = load(larger)?;
                same_views(&scenes, &larger)?;
                Some(Matching { scenes: larger, focal_known })
            }
            None => None,
        };
        let lpips = evaluate::lpips_for(choices.lpips.as_deref(), size)?;
        let options = Options {
            context_views: choices.context_views.unwrap_or(self.data.context_views),
            cameras: choices.cameras.unwrap_or(self.cameras),
            targets: choices.targets,
            points: choices.points,
            matching,
            density: choices.density,
            align: choices.align,
            planted: self.data.looks.clone().filter(|_| !choices.plain),
            look: choices.look,
            seed: self.seed,
            step: self.step,
        };
        let mut evaluation = evaluate::evaluate(&mut *self.predictor, &scenes, &options, lpips.as_ref(), progress)?;
        if *source == Source::Run && data.masks == self.data.masks {
            let changed = self.sources.changed(&scenes).filter_map(|i| data.folders.get(i));
            let remark = |folder: &PathBuf| {
                format!("{}: other photos, cameras or points than the run began with", folder.display())
            };
            evaluation.remarks.extend(changed.map(remark));
        }
        Ok(evaluation)
    }
}

/// Checks that scenes of two sizes have the same views: a mask may leave nothing of a photo in the smaller one alone.
fn same_views(small: &[Scene], large: &[Scene]) -> Result<(), Error> {
    for (small, large) in small.iter().zip(large) {
        let [few, all] = [small, large].map(|scene| scene.views.iter().map(|view| &view.name));
        if let Some(name) = all.clone().find(|name| !few.clone().any(|other| other == *name)) {
            let expected = "expected masks that leave something of each photo at the network's size";
            return Err(Error::Input(format!("scene {}: {name}: {expected}, found none of this one", small.name)));
        }
    }
    Ok(())
}
