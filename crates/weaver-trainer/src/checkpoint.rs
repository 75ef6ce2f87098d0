//! Checkpoints: everything that a run needs to go on to the same bits.

use crate::sources::{self, Sources};
use crate::{Config, Error, Recipe};
use std::collections::BTreeMap;
use std::path::Path;
use weaver_autograd::{Params, Shape};
use weaver_inference::{Checkpoint, FORMAT, WeightSet};
use weaver_io::safetensors::Tensors;
use weaver_nn::{AdamW, Ema, Moments};

/// What changes while a run trains: parameters, moments and averages.
///
/// A checkpoint holds it as tensors `param.NAME`, `ema.NAME`, and, of parameters that the optimizer has moved,
/// `moment1.NAME`, `moment2.NAME`, `moment_steps.NAME` and, after steps of some rows only, `moment_row_steps.NAME`.
/// Randomness needs no state of its own: it is a function of the seed and the step.
#[derive(Clone, Copy, Debug)]
pub struct TrainingState<'a> {
    /// The parameters.
    pub params: &'a Params<f32>,
    /// The optimizer.
    pub optimizer: &'a AdamW<f32>,
    /// The averages of the parameters.
    pub ema: &'a Ema<f32>,
}

impl TrainingState<'_> {
    /// Writes the state after `step` steps, and all that inference needs to know, atomically.
    ///
    /// # Errors
    /// When the file cannot be written; an earlier one is then left as it was.
    pub(crate) fn write<R: Recipe>(
        &self,
        path: &Path,
        config: &Config<R>,
        step: usize,
        sources: &Sources,
    ) -> Result<(), Error> {
        let Self { params, optimizer, ema } = *self;
        let json = |value: serde_json::Result<String>| value.expect("a configuration is plain data");
        let mut tensors = Tensors::default();
        let mut note = |key: &str, value: String| tensors.metadata.insert(key.into(), value);
        note("format", FORMAT.into());
        note("architecture", R::ARCHITECTURE.into());
        note("model", json(serde_json::to_string(&config.model)));
        note("defaults", json(serde_json::to_string(&R::defaults(config))));
        note("preset", config.preset.clone());
        note("step", step.to_string());
        note("ema_step", ema.steps().to_string());
        note("config", config.to_toml());
        note(sources::ENTRY, sources.to_json());
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
            if !moments.row_steps.is_empty() {
                let rows = moments.row_steps.len();
                tensors.insert(format!("moment_row_steps.{name}"), &[rows], moments.row_steps.clone());
            }
        }
        Ok(tensors.write(path)?)
    }

    /// Checks that a run with this configuration goes on from a checkpoint as it began.
    ///
    /// # Errors
    /// Names the key that differs.
    pub fn check_resumed<R: Recipe>(checkpoint: &Checkpoint, config: &Config<R>) -> Result<(), Error> {
        Self::check(checkpoint, config)?;
        let text = checkpoint.tensors().metadata.get("config").map_or("", String::as_str);
        let earlier = Config::from_toml(text, "metadata config").map_err(|e| checkpoint.wrong(e.to_string()))?;
        match config.difference(&earlier) {
            None => Ok(()),
            Some((key, found, expected)) => {
                let message = format!(
                    "the run began with another configuration: {key}: expected {expected}, found {found} in config.toml"
                );
                Err(checkpoint.wrong(message).into())
            }
        }
    }

    /// Checks that a checkpoint is one of a run with this preset and network.
    ///
    /// # Errors
    /// Names the entry that differs.
    pub fn check<R: Recipe>(checkpoint: &Checkpoint, config: &Config<R>) -> Result<(), Error> {
        let found = checkpoint.tensors().metadata.get("preset").map_or("", String::as_str);
        if found != config.preset {
            let expected = &config.preset;
            return Err(checkpoint.wrong(format!("metadata preset: expected `{expected}`, found `{found}`")).into());
        }
        let model: R::Model = checkpoint.model_config(R::ARCHITECTURE)?;
        match config.difference(&Config { model, ..config.clone() }) {
            None => Ok(()),
            Some((key, expected, found)) => {
                let message =
                    format!("metadata {key}: expected {expected}, as the run's configuration says, found {found}");
                Err(checkpoint.wrong(message).into())
            }
        }
    }

    /// Puts the state of a checkpoint back into a run.
    ///
    /// # Errors
    /// When a tensor is missing, of another shape, or unknown, or the optimizer's state is damaged.
    pub fn restore(
        checkpoint: &Checkpoint,
        params: &mut Params<f32>,
        optimizer: &mut AdamW<f32>,
        ema: &mut Ema<f32>,
    ) -> Result<(), Error> {
        checkpoint.fill(params, WeightSet::Trained)?;
        let tensors = checkpoint.tensors();
        let text = tensors.metadata.get("ema_step").map_or("", String::as_str);
        let number = |_| checkpoint.wrong(format!("metadata ema_step: expected a number, found `{text}`"));
        let steps = text.parse().map_err(number)?;
        let (mut averages, mut state) = (BTreeMap::new(), BTreeMap::new());
        for (_, param) in params.iter() {
            let name = param.name();
            let read = |prefix: &str| tensors.values::<f32>(&format!("{prefix}.{name}"), param.shape().dims());
            averages.insert(name.to_string(), read("ema")?.to_vec());
            if tensors.tensors.contains_key(&format!("moment1.{name}")) {
                let (shape, row_steps) = (param.shape(), format!("moment_row_steps.{name}"));
                let row_steps = match shape.dims().first().filter(|_| tensors.tensors.contains_key(&row_steps)) {
                    Some(rows) => tensors.values::<u64>(&row_steps, &[*rows])?.to_vec(),
                    None => Vec::new(),
                };
                let (first, second) = (read("moment1")?.to_vec(), read("moment2")?.to_vec());
                let moments = Moments { first, second, row_steps };
                let steps = tensors.values::<u64>(&format!("moment_steps.{name}"), &[1])?[0];
                state.insert(name.to_string(), (steps, moments));
            }
        }
        ema.set_state(params, steps, averages).map_err(|e| checkpoint.wrong(e.to_string()))?;
        optimizer.set_state(params, state).map_err(|e| checkpoint.wrong(e.to_string()))?;
        Ok(())
    }
}
