//! Parameters, averages and optimizers as tensors of a checkpoint.
//!
//! | tensor | content |
//! |---|---|
//! | `PREFIX` `NAME` | values of a parameter, or their averages |
//! | `moment1.NAME`, `moment2.NAME` | an optimizer's moments of a parameter that has taken a step |
//! | `moment_steps.NAME` `[1]` | the steps that it has taken |

use std::collections::BTreeMap;
use weaver_autograd::Params;
use weaver_io::safetensors::Tensors;
use weaver_io::{Error, Result};
use weaver_nn::{Ema, Moments, Optimizer};

/// Puts the values of parameters into tensors `PREFIX` `NAME`.
pub fn put_params(into: &mut Tensors, prefix: &str, params: &Params<f32>) {
    for (_, param) in params.iter() {
        into.insert(format!("{prefix}{}", param.name()), param.shape().dims(), param.value().to_vec());
    }
}

/// Gives parameters the values of tensors `PREFIX` `NAME`.
///
/// # Errors
/// When one is missing or of another shape, or a value is not finite: results of such parameters have meaningless
/// figures.
pub fn take_params(from: &Tensors, prefix: &str, params: &mut Params<f32>) -> Result<()> {
    for id in params.ids().collect::<Vec<_>>() {
        let (name, shape) = (format!("{prefix}{}", params.get(id).name()), params.get(id).shape());
        let values = from.values::<f32>(&name, shape.dims())?;
        if let Some(value) = values.iter().find(|value| !value.is_finite()) {
            let (path, place) = (from.origin().into(), format!("tensor {name}"));
            return Err(Error::Invalid { path, place, expected: "finite numbers".into(), found: value.to_string() });
        }
        params.value_mut(id).copy_from_slice(values);
    }
    Ok(())
}

/// Puts averages of parameters into tensors `PREFIX` `NAME`.
pub fn put_average(into: &mut Tensors, prefix: &str, params: &Params<f32>, average: &Ema<f32>) {
    for ((name, values), (_, param)) in average.state(params).zip(params.iter()) {
        into.insert(format!("{prefix}{name}"), param.shape().dims(), values.to_vec());
    }
}

/// Gives averages the values of tensors `PREFIX` `NAME` and a number of steps.
///
/// # Errors
/// When one is missing or of another shape.
pub fn take_average(
    from: &Tensors,
    prefix: &str,
    params: &Params<f32>,
    steps: u64,
    average: &mut Ema<f32>,
) -> Result<()> {
    let mut averages = BTreeMap::new();
    for (_, param) in params.iter() {
        let values = from.values::<f32>(&format!("{prefix}{}", param.name()), param.shape().dims())?;
        averages.insert(param.name().to_string(), values.to_vec());
    }
    average.set_state(params, steps, averages).map_err(misfit(from, "averages"))
}

/// Puts the state of an optimizer into tensors.
pub fn put_optimizer(into: &mut Tensors, params: &Params<f32>, optimizer: &impl Optimizer<f32>) {
    for (name, steps, moments) in optimizer.state(params) {
        let shape = params.find(name).map_or(vec![moments.first.len()], |id| params.get(id).shape().dims().to_vec());
        into.insert(format!("{FIRST}{name}"), &shape, moments.first.clone());
        into.insert(format!("{SECOND}{name}"), &shape, moments.second.clone());
        into.insert(format!("{STEPS}{name}"), &[1], vec![steps]);
    }
}

/// Gives an optimizer the state of tensors; parameters without any begin anew.
///
/// # Errors
/// When a tensor is of another size or kind, or of an unknown parameter.
pub fn take_optimizer(from: &Tensors, params: &Params<f32>, optimizer: &mut impl Optimizer<f32>) -> Result<()> {
    optimizer.set_state(params, optimizer_state(from)?).map_err(misfit(from, "optimizer"))
}

/// The state of an optimizer in tensors: steps and moments by the names of parameters. Checkpoints of earlier versions
/// are read, too.
///
/// # Errors
/// When a tensor is missing or of another kind.
pub fn optimizer_state(from: &Tensors) -> Result<BTreeMap<String, (u64, Moments<f32>)>> {
    let mut state = BTreeMap::new();
    let own = |prefix: &'static str| from.tensors.keys().filter_map(move |key| key.strip_prefix(prefix));
    for name in own(FIRST) {
        let steps = from.values::<u64>(&format!("{STEPS}{name}"), &[1])?[0];
        let [first, second] = [FIRST, SECOND].map(|prefix| numbers(from, &format!("{prefix}{name}")));
        state.insert(name.to_string(), (steps, Moments { first: first?, second: second? }));
    }
    for name in own(EARLIER[0]) {
        let [first, second] = [EARLIER[0], EARLIER[1]].map(|prefix| numbers(from, &format!("{prefix}{name}")));
        let moments = Moments { first: first?, second: second? };
        state.insert(name.to_string(), (earlier_steps(from, name)?, moments));
    }
    Ok(state)
}

/// True if a tensor is part of an optimizer's state, by this version's names or earlier ones.
pub fn is_of_optimizer(key: &str) -> bool {
    [FIRST, SECOND, STEPS, "optimizer."].iter().any(|prefix| key.starts_with(prefix))
}

const FIRST: &str = "moment1.";
const SECOND: &str = "moment2.";
const STEPS: &str = "moment_steps.";
/// Names that checkpoints of moving scenes and of detectors of anomalies had in earlier versions.
const EARLIER: [&str; 3] = ["optimizer.first.", "optimizer.second.", "optimizer.steps."];
/// Metadata with the steps in earlier checkpoints of detectors: `NAME=STEPS`, separated by commas.
const EARLIER_METADATA: &str = "vad.optimizer.steps";

/// All numbers of a tensor.
fn numbers<T: weaver_io::safetensors::Element>(from: &Tensors, key: &str) -> Result<Vec<T>> {
    let shape = from.get(key)?.shape.clone();
    Ok(from.values::<T>(key, &shape)?.to_vec())
}

fn earlier_steps(from: &Tensors, name: &str) -> Result<u64> {
    let Some(list) = from.metadata.get(EARLIER_METADATA) else {
        return Ok(from.values::<u64>(&format!("{}{name}", EARLIER[2]), &[1])?[0]);
    };
    let entry = list.split(',').filter_map(|entry| entry.rsplit_once('=')).find(|(other, _)| *other == name);
    let steps = entry.and_then(|(_, steps)| steps.parse().ok());
    steps.ok_or_else(|| misfit(from, EARLIER_METADATA)(format!("no steps of {name}")))
}

/// An error about a part of a checkpoint.
fn misfit<E: ToString>(from: &Tensors, place: &'static str) -> impl Fn(E) -> Error + use<E> {
    let path = from.origin().to_path_buf();
    move |found| Error::Invalid {
        path: path.clone(),
        place: place.into(),
        expected: "the state of these parameters".into(),
        found: found.to_string(),
    }
}
