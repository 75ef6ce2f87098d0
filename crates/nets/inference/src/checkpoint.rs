//! The checkpoint of a training run, as inference reads it.

use crate::Error;
use half::f16;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use weaver_autograd::{ParamId, ParamValues, Params};
use weaver_io::safetensors::{TensorData, Tensors};

/// The format's name and version, in the file's metadata.
pub const FORMAT: &str = "splatweaver-checkpoint-2";

/// Choice among a checkpoint's weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WeightSet {
    /// The weights that training goes on with, tensors `param.NAME`.
    Trained,
    /// Their exponential moving average, tensors `ema.NAME`, used for evaluation.
    Averaged,
}

impl WeightSet {
    fn prefix(self) -> &'static str {
        match self {
            Self::Trained => "param",
            Self::Averaged => "ema",
        }
    }
}

/// Use of a run's model unless a call says otherwise.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Defaults {
    /// Seed of allocations that draw random numbers.
    pub seed: u64,
    /// Allocation of Gaussians to pixels, by name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub allocation: Option<String>,
    /// Gaussians per pixel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub budget: Option<f64>,
    /// For models with experts: those that training gave pixels to. Empty where that is not known.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub trained_experts: Vec<u8>,
}

/// Parameters that a model took of another's weights, by name.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Partly {
    /// Parameters that were taken.
    pub taken: Vec<String>,
    /// Parameters that were not taken, with the reason: they stay as they were.
    pub fresh: Vec<String>,
    /// Parameters of the checkpoint that the model does not have.
    pub unused: Vec<String>,
}

impl Partly {
    /// Itself, or an error that names the file if nothing was taken.
    pub(crate) fn some(self, path: &Path) -> Result<Self, Error> {
        if self.taken.is_empty() {
            let message =
                "expected weights of parameters that this model has, found none of its names and shapes".into();
            return Err(Error::Checkpoint { path: path.to_path_buf(), message });
        }
        Ok(self)
    }
}

/// A training run's checkpoint: weights, and the configuration of their network.
///
/// | metadata | content |
/// |---|---|
/// | `format` | [`FORMAT`] |
/// | `architecture` | the model's name |
/// | `model` | the model's configuration, JSON |
/// | `defaults` | [`Defaults`], JSON |
/// | `step` | optimizer steps done |
#[derive(Clone, Debug)]
pub struct Checkpoint {
    /// Steps done.
    pub step: usize,
    architecture: String,
    defaults: Defaults,
    tensors: Tensors,
    path: PathBuf,
}

impl Checkpoint {
    /// Reads a checkpoint and its description.
    ///
    /// # Errors
    /// When the file is damaged, is of another format, or lacks an entry.
    pub fn read(path: &Path) -> Result<Self, Error> {
        Self::new(Tensors::read(path)?, path)
    }

    /// The weights that come with the program; `weights/README.md` of this crate describes them.
    ///
    /// # Errors
    /// Never, unless the program is damaged.
    pub fn built_in() -> Result<Self, Error> {
        let bytes = include_bytes!("../weights/tiny-endless.safetensors");
        Self::from_bytes(bytes, Path::new("built-in weights"))
    }

    /// A checkpoint in memory; messages call it `origin`.
    ///
    /// # Errors
    /// As [`Checkpoint::read`].
    pub fn from_bytes(bytes: &[u8], origin: &Path) -> Result<Self, Error> {
        Self::new(Tensors::from_bytes(bytes, origin)?, origin)
    }

    /// A checkpoint of tensors that were read already.
    ///
    /// # Errors
    /// As [`Checkpoint::read`].
    pub fn of(tensors: Tensors) -> Result<Self, Error> {
        let path = tensors.origin().to_path_buf();
        Self::new(tensors, &path)
    }

    fn new(tensors: Tensors, path: &Path) -> Result<Self, Error> {
        let wrong = |message: String| Error::Checkpoint { path: path.to_path_buf(), message };
        let note = |key: &str| {
            tensors.metadata.get(key).ok_or_else(|| wrong(format!("metadata {key}: expected a value, found nothing")))
        };
        if note("format")? != FORMAT {
            return Err(wrong(format!("metadata format: expected `{FORMAT}`, found `{}`", note("format")?)));
        }
        let architecture = note("architecture")?.clone();
        let step = note("step")?;
        let step = step.parse().map_err(|_| wrong(format!("metadata step: expected a number, found `{step}`")))?;
        let defaults = serde_json::from_str(note("defaults")?).map_err(|e| wrong(format!("metadata defaults: {e}")))?;
        Ok(Self { step, architecture, defaults, tensors, path: path.to_path_buf() })
    }

    /// The name of the model.
    pub fn architecture(&self) -> &str {
        &self.architecture
    }

    /// Use of the model unless a call says otherwise.
    pub fn defaults(&self) -> &Defaults {
        &self.defaults
    }

    /// All tensors and metadata of the file.
    pub fn tensors(&self) -> &Tensors {
        &self.tensors
    }

    /// The configuration of the network, for the model called `architecture`.
    ///
    /// # Errors
    /// When the checkpoint is of another model, or its configuration cannot be read.
    pub fn model_config<C: DeserializeOwned>(&self, architecture: &str) -> Result<C, Error> {
        if self.architecture != architecture {
            let found = &self.architecture;
            return Err(self.wrong(format!("metadata architecture: expected `{architecture}`, found `{found}`")));
        }
        let text = self.tensors.metadata.get("model").map_or("", String::as_str);
        serde_json::from_str(text).map_err(|e| self.wrong(format!("metadata model: {e}")))
    }

    /// Fills declared parameters with the checkpoint's weights.
    ///
    /// # Errors
    /// Names the first tensor that is missing, of another shape, or of no parameter.
    pub fn fill(&self, params: &mut Params<f32>, set: WeightSet) -> Result<(), Error> {
        let ids: Vec<ParamId> = params.ids().collect();
        for id in ids {
            let name = params.get(id).name().to_string();
            let shape = params.get(id).shape();
            // A file in which either set is damaged is not to be trusted.
            for checked in [WeightSet::Trained, WeightSet::Averaged] {
                if checked != set && self.is_compact() {
                    continue;
                }
                let values = self.values(&format!("{}.{name}", checked.prefix()), shape.dims())?;
                if checked == set {
                    params.set(id, ParamValues::Owned(Arc::new(values)));
                }
            }
        }
        let prefix = format!("{}.", set.prefix());
        let unknown = |key: &&String| key.strip_prefix(&prefix).is_some_and(|name| params.find(name).is_none());
        match self.tensors.tensors.keys().find(unknown) {
            Some(key) => Err(self.wrong(format!("tensor {key}: expected no such tensor in this model"))),
            None => Ok(()),
        }
    }

    /// Fills those declared parameters that the checkpoint has averaged weights of the same shape for, and leaves the
    /// others.
    ///
    /// # Errors
    /// When none fits.
    pub fn fill_partly(&self, params: &mut Params<f32>) -> Result<Partly, Error> {
        let mut partly = Partly::default();
        let ids: Vec<ParamId> = params.ids().collect();
        for id in ids {
            let name = params.get(id).name().to_string();
            let shape = params.get(id).shape();
            let key = format!("{}.{name}", WeightSet::Averaged.prefix());
            match self.tensors.tensors.get(&key) {
                Some(tensor) if tensor.shape == shape.dims() => {
                    let values = self.values(&key, shape.dims())?;
                    params.set(id, ParamValues::Owned(Arc::new(values)));
                    partly.taken.push(name);
                }
                Some(tensor) => partly.fresh.push(format!("{name} ({shape}, there {:?})", tensor.shape)),
                None => partly.fresh.push(format!("{name} (not there)")),
            }
        }
        let prefix = format!("{}.", WeightSet::Averaged.prefix());
        let of_parameter = self.tensors.tensors.keys().filter_map(|key| key.strip_prefix(&prefix));
        partly.unused = of_parameter.filter(|name| params.find(name).is_none()).map(String::from).collect();
        partly.some(&self.path)
    }

    /// The tensors that are needed to run the network and nothing else: the averaged weights, rounded to 16 bits. An
    /// eighth of a checkpoint.
    ///
    /// # Errors
    /// When a weight is beyond the range of 16 bits.
    pub fn compact(&self) -> Result<Tensors, Error> {
        let mut compact = Tensors::default();
        for key in ["format", "architecture", "model", "defaults", "step"] {
            let value = self.tensors.metadata.get(key).cloned().unwrap_or_default();
            compact.metadata.insert(key.into(), value);
        }
        for key in self.tensors.tensors.keys().filter(|key| key.starts_with(WeightSet::Averaged.prefix())) {
            let shape = &self.tensors.tensors[key].shape;
            let values: Vec<f16> = self.values(key, shape)?.into_iter().map(f16::from_f32).collect();
            if values.iter().any(|x| !x.is_finite()) {
                return Err(self.wrong(format!("tensor {key}: expected numbers of at most 65504, found a larger one")));
            }
            compact.insert(key, shape, values);
        }
        Ok(compact)
    }

    /// True if these are weights that training cannot go on with.
    fn is_compact(&self) -> bool {
        let trained = WeightSet::Trained.prefix();
        !self.tensors.tensors.keys().any(|key| key.split('.').next() == Some(trained))
    }

    /// The numbers of a tensor. A network with a weight that is not finite would run, and its figures would mean
    /// nothing.
    fn values(&self, key: &str, shape: &[usize]) -> Result<Vec<f32>, Error> {
        let is_half = self.tensors.tensors.get(key).is_some_and(|t| matches!(t.data, TensorData::F16(_)));
        let values: Vec<f32> = if is_half {
            self.tensors.values::<f16>(key, shape)?.iter().map(|x| x.to_f32()).collect()
        } else {
            self.tensors.values::<f32>(key, shape)?.to_vec()
        };
        match values.iter().find(|x| !x.is_finite()) {
            Some(found) => Err(self.wrong(format!("tensor {key}: expected finite numbers, found {found}"))),
            None => Ok(values),
        }
    }

    /// An error that names this file.
    pub fn wrong(&self, message: impl Into<String>) -> Error {
        Error::Checkpoint { path: self.path.clone(), message: message.into() }
    }
}
