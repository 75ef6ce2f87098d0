//! A run under way.

use crate::run::beginning::Beginning;
use crate::run::mixture::{Mixture, bounds};
use crate::run::objective::objective;
use crate::run::optimizer::Optimizer;
use crate::run::views::Views;
use crate::run::{FilmSource, RunError, RunSettings, Stage};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;
use weaver_autograd::{Params, Tape};
use weaver_data::film::Film;
use weaver_io::safetensors::Tensors;
use weaver_kernels::random::Stream;
use weaver_run::state::{put_params, take_params};
use weaver_run::{Folder, Job, Kind, Rhythm, Save, StepReport, advance};
use weaver_splat::Workspace;

/// A mixture in a folder, trained or under way.
#[derive(Debug)]
pub struct Run {
    pub(crate) folder: PathBuf,
    /// The claimed folder of a run under way; a complete run that is only read leaves it unclaimed.
    claimed: Option<Folder>,
    pub(crate) settings: RunSettings,
    pub(crate) film: Film,
    pub(crate) params: Params<f32>,
    pub(crate) mixture: Arc<Mixture>,
    /// The teacher of a distilled expert: the initial parameters of the run.
    teacher: Option<Params<f32>>,
    place: Place,
    /// State of the current stage.
    under_way: Option<UnderWay>,
    /// The state of the current stage's optimizer, from a checkpoint.
    pending: Option<Tensors>,
    /// Seconds of each stage so far.
    pub(crate) seconds: Vec<f64>,
}

/// Position of a run in its stages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// Finished stages.
    pub stage: usize,
    /// Finished steps of the current stage.
    pub step: usize,
}

/// State of a stage.
#[derive(Debug)]
struct UnderWay {
    optimizer: Optimizer,
    tape: Tape<f32>,
    views: Views,
    workspace: Workspace<f32>,
}

const INIT: &str = "init.safetensors";
/// The file of experts and router.
pub const MODEL: &str = "model.safetensors";
const KIND: Kind = Kind { command: "dynamic", settings: "run.json", results: &[INIT, MODEL] };
/// The entry of a checkpoint's metadata with the film's checksum.
const FILM: &str = "film";

impl Run {
    /// Begins a run in a new folder. `init` are initial parameters in place of random ones.
    ///
    /// # Errors
    /// When the film cannot be read, a setting is out of range, the folder holds a run, files of others are in the way,
    /// or it cannot be written; nothing is then left behind.
    pub fn create(folder: &Path, mut settings: RunSettings, init: Option<Tensors>) -> Result<Self, RunError> {
        settings.check()?;
        if let FilmSource::Folder { path, .. } = &mut settings.film {
            *path = std::path::absolute(&path).unwrap_or_else(|_| path.clone());
        }
        let inputs =
            settings.film.path().into_iter().chain(settings.derived_from.as_ref().map(|origin| origin.from.as_path()));
        inputs.clone().try_for_each(|path| weaver_io::path_in_utf8(path).map(drop))?;
        let claimed = Folder::claim(folder, KIND, inputs)?;
        let film = settings.film.open()?;
        let run = Self::of(folder, settings, film, init.as_ref())?;
        if let Some(init) = init {
            init.write(claimed.out().file(INIT)?)?;
        }
        claimed.store(&run.settings)?;
        Ok(Self { claimed: Some(claimed), ..run })
    }

    /// Resumes a run from its last checkpoint, or from the start if there is none.
    ///
    /// # Errors
    /// When there is no run, it is complete or under way elsewhere, its files cannot be read, or the film is another
    /// one.
    pub fn resume(folder: &Path) -> Result<Self, RunError> {
        let settings = Self::read_settings(folder)?;
        if folder.join(MODEL).exists() {
            return Err(weaver_run::Error::complete(folder).into());
        }
        let claimed = Folder::reopen(folder, KIND)?;
        let film = settings.film.open()?;
        let init = folder.join(INIT);
        let init = init.exists().then(|| Tensors::read(init)).transpose()?;
        let mut run = Self::of(folder, settings, film, init.as_ref())?;
        if let Some(state) = claimed.checkpoint()? {
            run.restore(&state)?;
        }
        Ok(Self { claimed: Some(claimed), ..run })
    }

    /// Checks that a checkpoint is of the present film. Checkpoints of an earlier version have no checksum, and pass.
    fn check_film(&self, checkpoint: &Tensors) -> Result<(), RunError> {
        match checkpoint.metadata.get(FILM) {
            Some(began) if *began != self.film.checksum()?.to_string() => Err(RunError::FilmChanged {
                folder: self.folder.clone(),
                film: self
                    .settings
                    .film
                    .path()
                    .map_or_else(|| self.film.name.clone(), |path| path.display().to_string()),
            }),
            _ => Ok(()),
        }
    }

    /// Runs `write` on the folder, claimed meanwhile.
    pub(crate) fn writing<R>(&self, write: impl FnOnce(&Folder) -> Result<R, RunError>) -> Result<R, RunError> {
        match &self.claimed {
            Some(folder) => write(folder),
            None => write(&Folder::reopen(&self.folder, KIND)?),
        }
    }

    /// Opens a complete run for reading.
    ///
    /// # Errors
    /// When there is no run, it is not complete, or its files cannot be read.
    pub fn open(folder: &Path) -> Result<Self, RunError> {
        let settings = Self::read_settings(folder)?;
        let (model, checkpoint) = (folder.join(MODEL), folder.join(Folder::CHECKPOINT));
        if !model.exists() {
            let place = match checkpoint.exists() {
                true => Tensors::read(checkpoint)?.values::<u64>("place", &[2])?.to_vec(),
                false => vec![0, 0],
            };
            let (stage, step) = (place[0] as usize + 1, place[1] as usize);
            return Err(RunError::Incomplete { folder: folder.into(), stage, step });
        }
        let film = settings.film.open()?;
        let tensors = Tensors::read(model)?;
        let mut run = Self::of(folder, settings, film, Some(&tensors))?;
        run.place.stage = run.settings.stages.len();
        run.seconds = tensors.values::<f64>("seconds", &[run.settings.stages.len()])?.to_vec();
        Ok(run)
    }

    /// Reads the settings of the run in a folder.
    ///
    /// # Errors
    /// When there is none, or it cannot be read.
    pub fn read_settings(folder: &Path) -> Result<RunSettings, RunError> {
        let settings: RunSettings = Folder::settings(folder, KIND, "a mixture of moving Gaussians")?;
        settings.check()?;
        Ok(settings)
    }

    fn of(folder: &Path, settings: RunSettings, mut film: Film, init: Option<&Tensors>) -> Result<Self, RunError> {
        let stream = Stream::new(settings.seed, 0, "dynamic.beginning");
        let begin = |(i, label): (usize, &String)| match init {
            // The parameters of the model's file replace these.
            Some(tensors) => Ok(Beginning::blank(tensors.get(&format!("{label}.color"))?.shape[0])),
            None => Beginning::of(&film, settings.gaussians, stream.fork(i as u64)),
        };
        let beginnings: Vec<Beginning> =
            settings.labels().iter().enumerate().map(begin).collect::<Result<_, RunError>>()?;
        // A field keeps the box of its training.
        let bounds = match init {
            Some(tensors) => {
                let sides = tensors.values::<f64>("bounds", &[2, 3])?;
                [0, 3].map(|first| [0, 1, 2].map(|axis| sides[first + axis]))
            }
            None => bounds(&beginnings),
        };
        let mut params = Params::new();
        let mixture = Arc::new(Mixture::new(&mut params, &settings, &film, &beginnings, bounds));
        if let Some(tensors) = init {
            take_params(tensors, "", &mut params)?;
        }
        if settings.all {
            film.remarks.push("trained on all photos: the figures of those that are held out judge nothing".into());
        }
        let distils = settings.stages.iter().any(|stage| matches!(stage, Stage::Distil { .. }));
        let teacher = distils.then(|| params.clone());
        let seconds = vec![0.0; settings.stages.len()];
        let place = Place::default();
        Ok(Self {
            folder: folder.into(),
            claimed: None,
            settings,
            film,
            params,
            mixture,
            teacher,
            place,
            under_way: None,
            pending: None,
            seconds,
        })
    }

    /// The settings of the run.
    pub fn settings(&self) -> &RunSettings {
        &self.settings
    }

    /// The training film.
    pub fn film(&self) -> &Film {
        &self.film
    }

    /// Indices of the training photos.
    pub fn training(&self) -> Vec<usize> {
        if self.settings.all { (0..self.film.shots.len()).collect() } else { self.film.training() }
    }

    /// Experts and router.
    pub fn mixture(&self) -> &Mixture {
        &self.mixture
    }

    /// The parameters of experts and router.
    pub fn params(&self) -> &Params<f32> {
        &self.params
    }

    /// Position of the run in its stages.
    pub fn place(&self) -> Place {
        self.place
    }

    /// Finished steps, and steps of all stages together.
    pub fn steps(&self) -> [usize; 2] {
        let of = |stages: &[Stage]| stages.iter().map(Stage::steps).sum::<usize>();
        let stages = &self.settings.stages;
        [of(&stages[..self.place.stage.min(stages.len())]) + self.place.step, of(stages)]
    }

    /// Lets a page follow the run: [`Folder::follow`].
    pub fn follow(&mut self) {
        self.claimed.iter_mut().for_each(Folder::follow);
    }

    /// Runs to the last step, or until `stop` is set, and leaves a checkpoint, or the model; returns true at the end of
    /// the last stage. `observe` is called after every step.
    ///
    /// # Errors
    /// When the rasterizer refuses, a loss is NaN or infinite, or a file cannot be written; the last checkpoint then
    /// stays as it was.
    pub fn advance(&mut self, stop: &AtomicBool, mut observe: impl FnMut(&StepReport)) -> Result<bool, RunError> {
        let Some(folder) = self.claimed.take() else {
            return Err(weaver_run::Error::complete(&self.folder).into());
        };
        let complete = advance(self, &folder, stop, |report| {
            observe(report);
            Ok(())
        });
        let complete = complete.and_then(|complete| {
            if complete {
                self.tensors().write(folder.out().file(MODEL)?)?;
                folder.forget_checkpoint();
            }
            Ok(complete)
        });
        self.claimed = Some(folder);
        complete
    }

    /// Enters the current stage.
    fn enter(&mut self, stage: Stage) -> Result<UnderWay, RunError> {
        let mut optimizer = match stage {
            Stage::Expert { index, .. } | Stage::Distil { index, .. } => {
                let (label, kind) = (&self.settings.labels()[index], self.settings.experts[index]);
                Optimizer::of_expert(&self.params, label, kind, self.settings.preset, self.film.extent())
            }
            Stage::Router { .. } => Optimizer::of_router(&self.params, self.mixture.rows().1),
        };
        if let Some(tensors) = self.pending.take() {
            optimizer.read(&self.params, &tensors)?;
        }
        self.freeze_all_but(&optimizer);
        Ok(UnderWay { optimizer, tape: Tape::new(), views: Views::default(), workspace: Workspace::new() })
    }

    fn freeze_all_but(&mut self, optimizer: &Optimizer) {
        let trained = optimizer.params();
        for id in self.params.ids().collect::<Vec<_>>() {
            self.params.set_frozen(id, !trained.contains(&id));
        }
    }

    /// One step on one photo.
    fn learn(&mut self, under_way: &mut UnderWay, stage: Stage) -> Result<f32, RunError> {
        let UnderWay { optimizer, tape, views, workspace } = under_way;
        let shots = self.training();
        let Place { stage: at, step } = self.place;
        let stream = Stream::new(self.settings.seed, step as u64, "dynamic.shot").fork(at as u64);
        let number = shots[stream.below(0, shots.len())];
        let shot = &self.film.shots[number];
        let seen = || views.of(number, || self.mixture.see(&self.params, (&shot.camera, shot.time), workspace));
        let loss = {
            let models = (&*self.mixture, &self.params, self.teacher.as_ref());
            let loss = objective(tape, models, &self.settings, stage, shot, seen)?;
            let value = loss.item();
            if value.is_finite() {
                loss.backward();
            }
            value
        };
        self.mixture.check()?;
        if !loss.is_finite() {
            return Err(RunError::Diverged { folder: self.folder.clone(), stage: at + 1, step, loss });
        }
        optimizer.step(&mut self.params, tape, step, stage.steps());
        tape.reset();
        Ok(loss)
    }

    /// All parameters, for a file or as the beginning of another run.
    pub fn tensors(&self) -> Tensors {
        let mut tensors = Tensors::default();
        put_params(&mut tensors, "", &self.params);
        tensors.insert("bounds", &[2, 3], self.mixture.bounds().concat());
        tensors.insert("seconds", &[self.seconds.len()], self.seconds.clone());
        tensors
    }
}

impl Job for Run {
    type Error = RunError;

    fn steps(&self) -> [usize; 2] {
        self.steps()
    }

    fn step(&mut self) -> Result<StepReport, RunError> {
        let stages = &self.settings.stages;
        while self.place.step == stages[self.place.stage].steps() {
            self.place = Place { stage: self.place.stage + 1, step: 0 };
            // The optimizer's state belongs to the finished stage.
            self.pending = None;
        }
        let stage = stages[self.place.stage];
        let mut under_way = match self.under_way.take() {
            Some(under_way) => under_way,
            None => self.enter(stage)?,
        };
        let start = Instant::now();
        let loss = self.learn(&mut under_way, stage);
        self.under_way = Some(under_way);
        let loss = loss?;
        self.place.step += 1;
        self.seconds[self.place.stage] += start.elapsed().as_secs_f64();
        let [step, of] = self.steps();
        if self.place.step == stage.steps() {
            (self.place, self.under_way) = (Place { stage: self.place.stage + 1, step: 0 }, None);
        }
        let stage = stage.name(&self.settings.labels());
        Ok(StepReport { step, of, stage, loss: loss.into(), scalars: Vec::new() })
    }

    fn state(&mut self) -> Result<Tensors, RunError> {
        let mut tensors = self.tensors();
        tensors.insert("place", &[2], vec![self.place.stage as u64, self.place.step as u64]);
        tensors.metadata.insert(FILM.into(), self.film.checksum()?.to_string());
        if let Some(UnderWay { optimizer, .. }) = &self.under_way {
            optimizer.write(&self.params, &mut tensors);
        }
        Ok(tensors)
    }

    fn restore(&mut self, state: &Tensors) -> Result<(), RunError> {
        self.check_film(state)?;
        take_params(state, "", &mut self.params)?;
        let place = state.values::<u64>("place", &[2])?;
        self.place = Place { stage: place[0] as usize, step: place[1] as usize };
        self.seconds = state.values::<f64>("seconds", &[self.settings.stages.len()])?.to_vec();
        self.pending = Some(state.clone());
        Ok(())
    }

    fn rhythm(&self) -> Rhythm {
        Rhythm { save: Save::Seconds(self.settings.save_every), ..Rhythm::default() }
    }
}
