//! Recipes by name, without their types: what a command line needs.

use crate::evaluate::{Matching, Options};
use crate::session::SAMPLES;
use crate::{
    CameraMode, Config, DataConfig, DryRun, Error, Evaluation, LookOf, Observer, Ranks, Recipe, Session, Sources,
    Summary, Targets, TrainingState, evaluate, initial, scenes,
};
use std::fmt::Debug;
use std::marker::PhantomData;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use weaver_autograd::Params;
use weaver_data::{Scene, procedural};
use weaver_inference::{Checkpoint, Density, Predictor, RunFolder, WeightSet};
use weaver_run::{Folder, Kind, StepReport};
use weaver_splat::AnyRasterizer;

/// Where a configuration comes from; later fields win over earlier ones.
#[derive(Clone, Debug, Default)]
pub struct ConfigSource {
    /// The preset to start from.
    pub preset: Option<String>,
    /// A TOML file.
    pub file: Option<PathBuf>,
    /// Settings `key=value`.
    pub settings: Vec<String>,
    /// Folders of captures.
    pub data: Vec<PathBuf>,
    /// A run's folder or checkpoint, or a published one, whose weights training starts from, or `built-in`.
    pub init: Option<PathBuf>,
    /// A published checkpoint that tells cameras and depth of photos without cameras.
    pub teacher: Option<PathBuf>,
    /// The seed.
    pub seed: Option<u64>,
    /// Threads, instead of the configuration's.
    pub threads: Option<usize>,
    /// Steps in all; the stages are rescaled in proportion.
    pub steps: Option<usize>,
}

/// A configuration, resolved and checked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ResolvedConfig {
    /// The model, by name.
    pub architecture: String,
    /// The preset.
    pub preset: String,
    /// Threads; `None` takes one per core.
    pub threads: Option<usize>,
    /// Steps of all stages.
    pub steps: usize,
    /// The folders and files that the run reads.
    pub inputs: Vec<PathBuf>,
    /// All of it.
    pub toml: String,
}

/// A recipe behind a name.
pub trait ModelEntry: Debug + Send + Sync {
    /// The model's name.
    fn name(&self) -> &'static str;

    /// Names of its presets; the first is the default.
    fn presets(&self) -> &'static [&'static str];

    /// Resolves and checks a configuration.
    ///
    /// # Errors
    /// When a file cannot be read, or a key or value is wrong.
    fn resolve(&self, source: &ConfigSource) -> Result<ResolvedConfig, Error>;

    /// Reads the configuration of a run's folder.
    ///
    /// # Errors
    /// When the file cannot be read, or a key or value is wrong.
    fn read(&self, folder: &RunFolder) -> Result<ResolvedConfig, Error>;

    /// The configuration of a preset as TOML, each key with its documentation.
    ///
    /// # Errors
    /// When there is no such preset.
    fn annotated(&self, preset: &str) -> Result<String, Error>;

    /// Starts a run.
    ///
    /// # Errors
    /// When the data cannot be read or has too few views.
    fn start(&self, config: &ResolvedConfig) -> Result<Box<dyn Training>, Error>;

    /// Continues the run of a folder, to so many steps in all if its last stage is to be longer, which is then recorded in the
    /// folder's configuration.
    ///
    /// # Errors
    /// When the folder or the data cannot be read, or do not fit together, or more steps were planned already.
    fn resume(&self, folder: &RunFolder, steps: Option<usize>) -> Result<Box<dyn Training>, Error>;

    /// Opens the averaged weights of a run's folder.
    ///
    /// # Errors
    /// When the folder cannot be read, or its checkpoint is of another model.
    fn open(&self, folder: &RunFolder) -> Result<OpenRun, Error>;
}

/// A training run of some model.
pub trait Training: Send {
    /// Steps done and steps planned.
    fn steps(&self) -> (usize, usize);

    /// A description of the run for people.
    fn plan(&self) -> String;

    /// See [`Session::draw_by`].
    fn draw_by(&mut self, rasterizer: AnyRasterizer<f32>);

    /// See [`Session::trace_to`].
    fn trace_to(&mut self, path: &Path);

    /// See [`Session::share`].
    ///
    /// # Errors
    /// When the processes do not hold the same run, or there are too many.
    fn share(&mut self, ranks: Arc<dyn Ranks>) -> Result<(), Error>;

    /// See [`Session::follow`].
    ///
    /// # Errors
    /// When a loss diverges.
    fn follow(&mut self) -> Result<(), Error>;

    /// See [`Session::dry_run`].
    ///
    /// # Errors
    /// As [`Training::train`].
    fn dry_run(self: Box<Self>, folder: &Folder) -> Result<DryRun, Error>;

    /// See [`Session::train`].
    ///
    /// # Errors
    /// When a loss diverges or something cannot be written.
    fn train(&mut self, folder: &Folder, observer: &mut dyn Observer, stop: &AtomicBool) -> Result<Summary, Error>;

    /// Label of a progress bar beside the step.
    fn labeler(&self) -> fn(&StepReport) -> String;
}

impl<R: Recipe> Training for Session<R> {
    fn steps(&self) -> (usize, usize) {
        self.steps()
    }

    fn plan(&self) -> String {
        self.plan()
    }

    fn draw_by(&mut self, rasterizer: AnyRasterizer<f32>) {
        self.draw_by(rasterizer);
    }

    fn trace_to(&mut self, path: &Path) {
        self.trace_to(path);
    }

    fn share(&mut self, ranks: Arc<dyn Ranks>) -> Result<(), Error> {
        self.share(ranks)
    }

    fn follow(&mut self) -> Result<(), Error> {
        self.follow()
    }

    fn dry_run(self: Box<Self>, folder: &Folder) -> Result<DryRun, Error> {
        Session::dry_run(*self, folder)
    }

    fn train(&mut self, folder: &Folder, observer: &mut dyn Observer, stop: &AtomicBool) -> Result<Summary, Error> {
        self.train(folder, observer, stop)
    }

    fn labeler(&self) -> fn(&StepReport) -> String {
        R::label
    }
}

/// A trained run, ready to be evaluated or used.
#[derive(Debug)]
pub struct OpenRun {
    /// The network with its averaged weights.
    pub predictor: Box<dyn Predictor>,
    /// Steps that the weights were trained for.
    pub step: usize,
    /// Steps that the run was to have, as many where nobody knows.
    pub planned: usize,
    /// The run's seed.
    pub seed: u64,
    /// The run's data.
    pub data: DataConfig,
    /// Source of the cameras, unless a call says otherwise.
    pub cameras: CameraMode,
    /// The captures that the run has learned from, if its checkpoint tells.
    pub sources: Sources,
}

/// Which scenes to evaluate on.
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
    pub cameras: Option<crate::CameraMode>,
    /// Which photos judge.
    pub targets: Targets,
    /// True if depth is brought to the points that the context views see; with given cameras only.
    pub points: bool,
    /// Estimates the cameras of context views from photos of this longest side, pixels, in place of others.
    pub matching: Option<MatchingOverride>,
    /// Which pixels get Gaussians, and how many.
    pub density: Density,
    /// Alignment of held-out views' cameras with their photos, for figures beside the others.
    pub align: Option<crate::Alignment>,
    /// In whose light held-out views are drawn; without it, in that of the first context photo by models that know about light.
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
    /// True if focal lengths are told, as EXIF would.
    pub focal_known: bool,
}

impl OpenRun {
    /// Evaluates the weights; `progress` is told how many views of how many are done.
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
            Source::Unseen => Ok(procedural::default_unseen_set(size[1], size[0])),
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

/// The recipe `R` behind its name.
#[derive(Clone, Copy, Debug, Default)]
struct Named<R>(PhantomData<R>);

impl<R: Recipe> ModelEntry for Named<R> {
    fn name(&self) -> &'static str {
        R::ARCHITECTURE
    }

    fn presets(&self) -> &'static [&'static str] {
        R::PRESETS
    }

    fn resolve(&self, source: &ConfigSource) -> Result<ResolvedConfig, Error> {
        let mut config = Config::<R>::resolve(source.preset.as_deref(), source.file.as_deref(), &source.settings)?;
        if !source.data.is_empty() {
            config.data.folders.clone_from(&source.data);
        }
        if let Some(path) = &source.init {
            let folder = RunFolder::at(path);
            config.init = Some(if path.is_dir() { folder.checkpoint_path() } else { path.clone() });
        }
        if let Some(path) = &source.teacher {
            config.data.teacher = Some(path.clone());
        }
        // The run may be resumed or evaluated from elsewhere.
        let data = &mut config.data;
        let init = config.init.as_mut().filter(|path| *path != Path::new(initial::BUILT_IN));
        for folder in data.folders.iter_mut().chain(init).chain(&mut data.teacher) {
            let absolute = std::path::absolute(&folder);
            *folder = absolute.map_err(|e| Error::Input(format!("{}: {e}", folder.display())))?;
            weaver_io::path_in_utf8(folder)?;
        }
        config.seed = source.seed.unwrap_or(config.seed);
        config.threads = source.threads.or(config.threads);
        if let Some(steps) = source.steps {
            config.rescale(steps);
        }
        config.check()?;
        Ok(resolved(&config))
    }

    fn read(&self, folder: &RunFolder) -> Result<ResolvedConfig, Error> {
        Ok(resolved(&Config::<R>::read(&folder.config_path())?))
    }

    fn annotated(&self, preset: &str) -> Result<String, Error> {
        Ok(Config::<R>::preset(preset)?.to_annotated_toml())
    }

    fn start(&self, config: &ResolvedConfig) -> Result<Box<dyn Training>, Error> {
        Ok(Box::new(Session::<R>::new(Config::from_toml(&config.toml, "configuration")?)?))
    }

    fn resume(&self, folder: &RunFolder, steps: Option<usize>) -> Result<Box<dyn Training>, Error> {
        let mut config = Config::<R>::read(&folder.config_path())?;
        if let Some(steps) = steps {
            config.prolong(steps)?;
        }
        let session = Session::resume(config, &folder.checkpoint_path())?;
        if steps.is_some() {
            // Only now that the run is known to go on.
            weaver_io::write_text(folder.config_path(), &session.config().to_toml())?;
        }
        Ok(Box::new(session))
    }

    fn open(&self, folder: &RunFolder) -> Result<OpenRun, Error> {
        let config = Config::<R>::read(&folder.config_path())?;
        let checkpoint = Checkpoint::read(&folder.checkpoint_path())?;
        TrainingState::check(&checkpoint, &config)?;
        let mut params = Params::new();
        let network = Arc::new(R::build(&config.model, &mut params, config.seed));
        checkpoint.fill(&mut params, WeightSet::Averaged)?;
        Ok(OpenRun {
            predictor: R::predictor(network, params, &config)?,
            step: checkpoint.step,
            planned: config.steps(),
            seed: config.seed,
            data: config.data,
            cameras: R::cameras(&config.evaluation),
            sources: Sources::of_checkpoint(&checkpoint)?.unwrap_or_default(),
        })
    }
}

fn resolved<R: Recipe>(config: &Config<R>) -> ResolvedConfig {
    ResolvedConfig {
        architecture: R::ARCHITECTURE.into(),
        preset: config.preset.clone(),
        threads: config.threads,
        steps: config.steps(),
        inputs: config.data.folders.iter().chain(&config.init).chain(&config.data.teacher).cloned().collect(),
        toml: config.to_toml(),
    }
}

/// Recipes by name: the one place where a name selects a model, be it for training, evaluation or inference.
#[derive(Debug, Default)]
pub struct Registry {
    entries: Vec<Box<dyn ModelEntry>>,
}

impl Registry {
    /// A registry without recipes.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a recipe. The first is the default.
    #[must_use]
    pub fn with<R: Recipe>(mut self) -> Self {
        self.entries.push(Box::new(Named::<R>(PhantomData)));
        self
    }

    /// The recipes, in the order in which they were added.
    pub fn iter(&self) -> impl Iterator<Item = &dyn ModelEntry> {
        self.entries.iter().map(|entry| &**entry)
    }

    /// The recipe with a name, or the first.
    ///
    /// # Errors
    /// When no recipe has that name; the message lists those there are.
    pub fn find(&self, name: Option<&str>) -> Result<&dyn ModelEntry, Error> {
        let found = self.iter().find(|entry| name.is_none_or(|name| entry.name() == name));
        found.ok_or_else(|| {
            let known: Vec<&str> = self.iter().map(|entry| entry.name()).collect();
            Error::Input(format!("model: expected one of {}, found `{}`", known.join(", "), name.unwrap_or("")))
        })
    }

    /// The recipe that the run in a folder was trained with.
    ///
    /// # Errors
    /// When the folder holds no run, or one of an unknown model.
    pub fn of_run(&self, folder: &RunFolder) -> Result<&dyn ModelEntry, Error> {
        let path = folder.config_path();
        let table = weaver_run::settings::read_table(&path)?;
        let source = path.display().to_string();
        let wrong = |message: String| weaver_run::settings::Error::invalid(&source, message);
        let name = table.get("architecture").and_then(weaver_run::settings::Value::as_str);
        let name = name.ok_or_else(|| wrong("architecture: expected the name of a model, found nothing".into()))?;
        Ok(self.find(Some(name)).map_err(|e| wrong(e.to_string()))?)
    }
}

/// The folders of training runs.
const KIND: Kind = Kind { command: "train", settings: "config.toml", results: &[SAMPLES] };

/// Claims the folder of a new run, in which nothing is written yet, and which is the run's alone as long as what is returned lives.
///
/// # Errors
/// When there is a run in it already; as [`Folder::claim`].
pub fn claim_run(path: &Path, config: &ResolvedConfig) -> Result<Folder, Error> {
    Ok(Folder::claim(path, KIND, &config.inputs)?)
}

/// Claims a folder and begins a run in it: [`claim_run`], and the configuration is saved.
///
/// # Errors
/// As [`claim_run`], and when the configuration cannot be written.
pub fn create_run(path: &Path, config: &ResolvedConfig) -> Result<Folder, Error> {
    let folder = claim_run(path, config)?;
    folder.store_text(&config.toml)?;
    Ok(folder)
}

/// Claims the folder of a run that goes on.
///
/// # Errors
/// When it is under way elsewhere, or the folder cannot be written.
pub fn reclaim_run(path: &Path) -> Result<Folder, Error> {
    Ok(Folder::reopen(path, KIND)?)
}
