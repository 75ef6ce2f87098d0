//! Recipes by name, without their types, for a command line.

mod open_run;
mod training;

pub use open_run::{EvalOptions, MatchingOverride, OpenRun, Source};
pub use training::Training;

use crate::photo::PhotoRecipe;
use crate::session::SAMPLES;
use crate::splatweaver::SplatWeaverRecipe;
use crate::{Config, Error, Recipe, Session, Sources, TrainingState, initial};
use std::fmt::Debug;
use std::marker::PhantomData;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use weaver_autograd::Params;
use weaver_inference::{Checkpoint, Predictor, RunFolder, SplatWeaverPredictor, WeightSet, is_of_run};
use weaver_run::{Folder, Kind};

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
    /// A published checkpoint that predicts cameras and depth of photos without cameras.
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

    /// Continues the run of a folder; `steps` prolongs its last stage to this many steps in all, and is then recorded
    /// in the folder's configuration.
    ///
    /// # Errors
    /// When the folder or the data cannot be read, or do not fit together, or more steps were planned already.
    fn resume(&self, folder: &RunFolder, steps: Option<usize>) -> Result<Box<dyn Training>, Error>;

    /// Opens the averaged weights of a run's folder.
    ///
    /// # Errors
    /// When the folder cannot be read, or its checkpoint is of another model.
    fn open(&self, folder: &RunFolder) -> Result<OpenRun, Error>;

    /// Builds the predictor that a checkpoint describes by itself.
    ///
    /// # Errors
    /// When the checkpoint is of another model, or its tensors do not fit.
    fn predictor_of(&self, checkpoint: &Checkpoint) -> Result<Box<dyn Predictor>, Error>;
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
            // Only now that the run has been opened.
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

    fn predictor_of(&self, checkpoint: &Checkpoint) -> Result<Box<dyn Predictor>, Error> {
        R::from_checkpoint(checkpoint)
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

/// Recipes by name: the one place where a name selects a model, be it for training, evaluation or inference. By default
/// it has SplatWeaver's.
#[derive(Debug)]
pub struct Registry {
    entries: Vec<Box<dyn ModelEntry>>,
}

impl Default for Registry {
    fn default() -> Self {
        Self::empty().with::<SplatWeaverRecipe>().with::<PhotoRecipe>()
    }
}

impl Registry {
    /// A registry without recipes.
    pub fn empty() -> Self {
        Self { entries: Vec::new() }
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
    /// When no recipe has that name; the message lists the existing ones.
    pub fn find(&self, name: Option<&str>) -> Result<&dyn ModelEntry, Error> {
        let found = self.iter().find(|entry| name.is_none_or(|name| entry.name() == name));
        found.ok_or_else(|| {
            let known: Vec<&str> = self.iter().map(|entry| entry.name()).collect();
            Error::Input(format!("model: expected one of {}, found `{}`", known.join(", "), name.unwrap_or("")))
        })
    }

    /// The recipe with a name, or without one the first that has a preset of this name, or the first of all.
    ///
    /// # Errors
    /// As [`Registry::find`].
    pub fn find_for(&self, name: Option<&str>, preset: Option<&str>) -> Result<&dyn ModelEntry, Error> {
        let has = |entry: &&dyn ModelEntry| preset.is_some_and(|preset| entry.presets().contains(&preset));
        match (name, self.iter().find(has)) {
            (None, Some(entry)) => Ok(entry),
            _ => self.find(name),
        }
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

    /// Opens the averaged weights of the run in a folder.
    ///
    /// # Errors
    /// As [`of_run`](Self::of_run) and [`ModelEntry::open`].
    pub fn open_run(&self, folder: &RunFolder) -> Result<OpenRun, Error> {
        self.of_run(folder)?.open(folder)
    }

    /// Opens a file of weights, or else the runs in some folders, or else the weights that come with the program; each
    /// with its name.
    ///
    /// # Errors
    /// As [`open_weights`](Self::open_weights) and [`open_run`](Self::open_run).
    pub fn open_all(&self, weights: Option<&Path>, runs: &[PathBuf]) -> Result<Vec<(String, OpenRun)>, Error> {
        if let Some(weights) = weights {
            return Ok(vec![(weights.display().to_string(), self.open_weights(weights)?)]);
        }
        if runs.is_empty() {
            return Ok(vec![("built-in".into(), OpenRun::built_in()?)]);
        }
        let open = |path: &PathBuf| Ok((path.display().to_string(), self.open_run(&RunFolder::at(path))?));
        runs.iter().map(open).collect()
    }

    /// Opens a file of weights as if it were a run's: a run's checkpoint, small weights made of one, or a published
    /// checkpoint that makes Gaussians.
    ///
    /// # Errors
    /// When it cannot be read, is of an unknown model, or makes no Gaussians.
    pub fn open_weights(&self, path: &Path) -> Result<OpenRun, Error> {
        if !is_of_run(path)? {
            return Ok(OpenRun::of_weights(Box::new(SplatWeaverPredictor::open_published(path)?), 0, 0));
        }
        let checkpoint = Checkpoint::read(path)?;
        // The first model refuses the weights of an unknown one by name.
        let entry = self.find(Some(checkpoint.architecture())).or_else(|_| self.find(None))?;
        let predictor = entry.predictor_of(&checkpoint)?;
        Ok(OpenRun::of_weights(predictor, checkpoint.step, checkpoint.defaults().seed))
    }
}

/// The folders of training runs.
const KIND: Kind = Kind { command: "train", settings: "config.toml", results: &[SAMPLES] };

/// Claims the folder of a new run, without writing anything yet. The folder is the run's alone while the returned value
/// lives.
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
