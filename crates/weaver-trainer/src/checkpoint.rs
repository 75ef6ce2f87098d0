//! Checkpoints: everything that a run needs to go on to the same bits.

use crate::{Config, Error};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use weaver_autograd::{ParamId, Params, Shape};
use weaver_io::checkpoint::Tensors;
use weaver_model::SplatWeaver;
use weaver_nn::{AdamW, Ema, Moments};

/// The format's name and version, in the file's metadata.
const FORMAT: &str = "splatweaver-checkpoint-1";

/// The state of a run after some step.
///
/// Randomness needs no state of its own: it is a function of the seed, which the configuration holds, and the step.
#[derive(Clone, Debug)]
pub struct Checkpoint {
    /// Steps done.
    pub step: usize,
    /// Tensors `param.NAME`, `ema.NAME`, and of those that the optimizer has moved `moment1.NAME`, `moment2.NAME` and
    /// `moment_steps.NAME`.
    tensors: Tensors,
    path: PathBuf,
}

impl Checkpoint {
    /// Writes the state of a run, atomically.
    ///
    /// # Errors
    /// When the file cannot be written; an earlier one is then left as it was.
    pub fn write(
        path: &Path,
        config: &Config,
        step: usize,
        params: &Params<f32>,
        optimizer: &AdamW<f32>,
        ema: &Ema<f32>,
    ) -> Result<(), Error> {
        let mut tensors = Tensors::default();
        let mut note = |key: &str, value: String| tensors.metadata.insert(key.into(), value);
        note("format", FORMAT.into());
        note("preset", config.preset.clone());
        note("step", step.to_string());
        note("ema_step", ema.steps().to_string());
        note("config", config.to_toml());
        let shape_of = |name: &str| params.find(name).map_or(Shape::SCALAR, |id| params.get(id).shape());
        for (_, param) in params.iter() {
            tensors.insert(format!("param.{}", param.name()), param.shape().dims(), param.value().to_vec());
        }
        for (name, average) in ema.state(params) {
            tensors.insert(format!("ema.{name}"), shape_of(name).dims(), average.to_vec());
        }
        for (name, steps, moments) in optimizer.state(params) {
            tensors.insert(format!("moment1.{name}"), shape_of(name).dims(), moments.first.clone());
            tensors.insert(format!("moment2.{name}"), shape_of(name).dims(), moments.second.clone());
            tensors.insert(format!("moment_steps.{name}"), &[1], vec![steps]);
        }
        Ok(tensors.write(path)?)
    }

    /// Reads a checkpoint and checks that it belongs to the configuration's model.
    ///
    /// # Errors
    /// When the file is damaged, of another format or of another preset.
    pub fn read(path: &Path, config: &Config) -> Result<Self, Error> {
        let tensors = Tensors::read(path)?;
        let wrong = |message: String| Error::Checkpoint { path: path.to_path_buf(), message };
        let note = |key: &str| {
            tensors.metadata.get(key).ok_or_else(|| wrong(format!("metadata {key}: expected a value, found nothing")))
        };
        if note("format")? != FORMAT {
            return Err(wrong(format!("metadata format: expected `{FORMAT}`, found `{}`", note("format")?)));
        }
        if *note("preset")? != config.preset {
            return Err(wrong(format!("metadata preset: expected `{}`, found `{}`", config.preset, note("preset")?)));
        }
        let step = note("step")?;
        let step = step.parse().map_err(|_| wrong(format!("metadata step: expected a number, found `{step}`")))?;
        let checkpoint = Self { step, tensors, path: path.to_path_buf() };
        checkpoint.check(config)?;
        Ok(checkpoint)
    }

    /// Checks every parameter's presence and shape, and that there are no others.
    fn check(&self, config: &Config) -> Result<(), Error> {
        let mut params = Params::<f32>::new();
        SplatWeaver::new(config.model.clone(), &mut params, 0);
        for (_, param) in params.iter() {
            for prefix in ["param", "ema"] {
                self.tensors.values::<f32>(&format!("{prefix}.{}", param.name()), param.shape().dims())?;
            }
        }
        let extra =
            self.tensors.tensors.keys().filter_map(|k| k.strip_prefix("param.")).find(|n| params.find(n).is_none());
        match extra {
            Some(name) => Err(Error::Checkpoint {
                path: self.path.clone(),
                message: format!(
                    "tensor param.{name}: expected no such tensor in a model of preset `{}`",
                    config.preset
                ),
            }),
            None => Ok(()),
        }
    }

    /// The model with the averaged weights, which is what is evaluated.
    pub fn evaluated_model(&self, config: &Config) -> (SplatWeaver, Params<f32>) {
        self.model(config, "ema")
    }

    fn model(&self, config: &Config, prefix: &str) -> (SplatWeaver, Params<f32>) {
        let mut params = Params::new();
        let model = SplatWeaver::new(config.model.clone(), &mut params, config.seed);
        self.fill(&mut params, prefix);
        (model, params)
    }

    fn fill(&self, params: &mut Params<f32>, prefix: &str) {
        let ids: Vec<ParamId> = params.iter().map(|(id, _)| id).collect();
        for id in ids {
            let key = format!("{prefix}.{}", params.get(id).name());
            let shape = params.get(id).shape();
            let values = self.tensors.values::<f32>(&key, shape.dims()).expect("checked when the file was read");
            params.value_mut(id).copy_from_slice(values);
        }
    }

    /// Puts the state back into a run.
    ///
    /// # Errors
    /// When the optimizer's state is damaged.
    pub fn restore(
        &self,
        params: &mut Params<f32>,
        optimizer: &mut AdamW<f32>,
        ema: &mut Ema<f32>,
    ) -> Result<(), Error> {
        self.fill(params, "param");
        let wrong = |message: String| Error::Checkpoint { path: self.path.clone(), message };
        let text = self.tensors.metadata.get("ema_step").map_or("", String::as_str);
        let steps = text.parse().map_err(|_| wrong(format!("metadata ema_step: expected a number, found `{text}`")))?;
        let (mut averages, mut state) = (BTreeMap::new(), BTreeMap::new());
        for (_, param) in params.iter() {
            let name = param.name();
            let read = |prefix: &str| self.tensors.values::<f32>(&format!("{prefix}.{name}"), param.shape().dims());
            averages.insert(name.to_string(), read("ema")?.to_vec());
            if self.tensors.tensors.contains_key(&format!("moment1.{name}")) {
                let moments = Moments { first: read("moment1")?.to_vec(), second: read("moment2")?.to_vec() };
                let steps = self.tensors.values::<u64>(&format!("moment_steps.{name}"), &[1])?[0];
                state.insert(name.to_string(), (steps, moments));
            }
        }
        ema.set_state(params, steps, averages).map_err(|e| wrong(e.to_string()))?;
        optimizer.set_state(params, state).map_err(|e| wrong(e.to_string()))
    }
}
