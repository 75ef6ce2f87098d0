//! Checkpoints: everything that a run needs to go on to the same bits.

use crate::sources::{self, Sources};
use crate::{Config, Error, Recipe};
use weaver_autograd::Params;
use weaver_inference::{Checkpoint, FORMAT, WeightSet};
use weaver_io::safetensors::Tensors;
use weaver_nn::{AdamW, Ema};
use weaver_run::state;

/// State that changes while a run trains: parameters, moments and averages.
///
/// A checkpoint holds it as tensors `param.NAME`, `ema.NAME`, and, of parameters that the optimizer has moved,
/// `moment1.NAME`, `moment2.NAME`, `moment_steps.NAME`. Randomness needs no state of its own: it is a function of the
/// seed and the step.
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
    /// The state after `step` steps, and everything needed for inference.
    pub(crate) fn tensors<R: Recipe>(&self, config: &Config<R>, step: usize, sources: &Sources) -> Tensors {
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
        state::put_params(&mut tensors, "param.", params);
        state::put_average(&mut tensors, "ema.", params, ema);
        state::put_optimizer(&mut tensors, params, optimizer);
        tensors
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

    /// Checks that a checkpoint is of a run with this preset and network.
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
        state::take_average(tensors, "ema.", params, steps, ema)?;
        Ok(state::take_optimizer(tensors, params, optimizer)?)
    }
}
