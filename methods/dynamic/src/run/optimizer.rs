//! Optimizers of the stages.

use crate::run::{ExpertKind, Preset};
use weaver_autograd::{ParamId, Params, Tape};
use weaver_io::safetensors::Tensors;
use weaver_nn::{AdamW, Group, RAdam};
use weaver_run::state::{put_optimizer, take_optimizer};

/// Factor on the rate of positions at the end of a stage.
const SLOWER: f64 = 0.01;
/// Factor on the rate of networks and planes at the end of a stage. At its first rate, a field would lose its gains.
const NETWORK_SLOWER: f64 = 0.1;
/// Factor on the rate of the router's weights after this number of steps, in exponential decay, and from then on.
const ROUTER_SLOWER: (f64, f64) = (0.01, 10_000.0);
/// Factor on the rates of networks, planes and paths of the small experts over the published ones, which take ten times
/// the steps.
const TINY: f64 = 10.0;
/// Further factor on the rates of the codes of Gaussians and their network, chosen by the errors on photos after equal
/// steps.
const TINY_CODE: f64 = 4.0;
/// Factor on the rate of means in small experts that move Gaussians by a network.
const TINY_MEANS: f64 = 4.0;
/// Factor on the rate of a path's coefficients over the rate of its middle.
const PATH: f64 = 4.0;

/// The optimizer of a stage with its rates: Adam for experts, rectified Adam for the router.
#[derive(Debug)]
pub(crate) enum Optimizer {
    Expert(AdamW<f32>, Vec<Rate>),
    Router(RAdam<f32>, [ParamId; 2]),
}

/// Learning rate of a group of parameters.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rate {
    first: f64,
    /// Factor on the rate at the end of the stage.
    left: f64,
}

impl Optimizer {
    /// An optimizer of the parameters of one expert, whose names begin with `label`. Rates are published ones; `extent`
    /// is the film's.
    pub fn of_expert(params: &Params<f32>, label: &str, kind: ExpertKind, preset: Preset, extent: f64) -> Self {
        let prefix = format!("{label}.");
        let own = params.iter().filter_map(|(id, param)| param.name().strip_prefix(&prefix).map(|name| (id, name)));
        let (groups, rates) = own
            .map(|(id, name)| {
                let rate = rate(kind, name, preset, extent);
                (Group { params: vec![id], lr_scale: rate.first, weight_decay: 0.0 }, rate)
            })
            .unzip();
        Self::Expert(AdamW::new(groups, 0.9, 0.999, 1e-15), rates)
    }

    /// An optimizer of the router's parameters; `rows` are its weights and the weights of time.
    pub fn of_router(params: &Params<f32>, rows: [ParamId; 2]) -> Self {
        let own = params.iter().filter(|(_, param)| param.name().starts_with("router.")).map(|(id, _)| id);
        Self::Router(RAdam::new(own.collect(), 0.9, 0.999, 1e-8), rows)
    }

    /// The optimized parameters.
    pub fn params(&self) -> Vec<ParamId> {
        match self {
            Self::Expert(adam, _) => adam.groups.iter().flat_map(|group| group.params.clone()).collect(),
            Self::Router(radam, _) => radam.params.clone(),
        }
    }

    /// Step `step` of `steps`, from 0, along the gradients of a tape.
    pub fn step(&mut self, params: &mut Params<f32>, tape: &mut Tape<f32>, step: usize, steps: usize) {
        match self {
            Self::Expert(adam, rates) => {
                for (group, rate) in adam.groups.iter_mut().zip(rates) {
                    group.lr_scale = rate.first * rate.left.powf(step as f64 / steps as f64);
                }
                adam.step(params, tape, 1.0);
            }
            Self::Router(radam, [base, _]) => {
                let (factor, over) = ROUTER_SLOWER;
                let weights = 0.5 * factor.powf((step as f64 / over).min(1.0));
                radam.step(params, tape, |id| if id == *base { weights } else { 0.05 });
            }
        }
    }

    /// Puts the state into a checkpoint.
    pub fn write(&self, params: &Params<f32>, into: &mut Tensors) {
        match self {
            Self::Expert(adam, _) => put_optimizer(into, params, adam),
            Self::Router(radam, _) => put_optimizer(into, params, radam),
        }
    }

    /// Takes the state from a checkpoint.
    pub fn read(&mut self, params: &Params<f32>, from: &Tensors) -> Result<(), weaver_io::Error> {
        match self {
            Self::Expert(adam, _) => take_optimizer(from, params, adam),
            Self::Router(radam, _) => take_optimizer(from, params, radam),
        }
    }
}

/// The rate of an expert's parameter.
fn rate(kind: ExpertKind, name: &str, preset: Preset, extent: f64) -> Rate {
    let tiny = |factor: f64| if preset == Preset::Tiny { factor } else { 1.0 };
    let moves_itself = matches!(kind, ExpertKind::Keys | ExpertKind::Poly);
    let factor = tiny(if moves_itself { TINY } else { TINY_MEANS });
    let place = Rate { first: 1.6e-4 * extent * factor, left: SLOWER };
    let fixed = |first: f64| Rate { first, left: 1.0 };
    let learned = |first: f64| Rate { first: first * tiny(TINY), left: NETWORK_SLOWER };
    match (kind, name) {
        (_, "mean" | "position") => place,
        (_, "color") => fixed(2.5e-3),
        (_, "opacity") => fixed(0.05),
        (_, "scale") => fixed(0.005),
        (_, "quat" | "spin") => fixed(0.001),
        (ExpertKind::Poly, "motion") => Rate { first: PATH * place.first, ..place },
        (ExpertKind::Poly | ExpertKind::Keys, "center") => fixed(1e-3),
        (ExpertKind::Poly | ExpertKind::Keys, "width") => fixed(0.01),
        (ExpertKind::Code, "z") => fixed(2.5e-3 * tiny(TINY_CODE)),
        (ExpertKind::Code, _) => learned(1.6e-4 * tiny(TINY_CODE)),
        (ExpertKind::Field, name) if name.starts_with("plane") => learned(1.6e-3),
        _ => learned(1.6e-4),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_nn::Context;

    /// Step of a parameter under a constant gradient: its rate.
    fn moved(kind: ExpertKind, name: &str, step: usize) -> f64 {
        const STEPS: usize = 1000;
        let mut params = Params::new();
        let label = kind.name();
        let id = params.add(format!("{label}.{name}"), [1], vec![0.0]);
        let mut optimizer = Optimizer::of_expert(&params, label, kind, Preset::Published, 2.0);
        let mut tape = Tape::new();
        Context::new(&tape, &params).param(id).sum().backward();
        optimizer.step(&mut params, &mut tape, step, STEPS);
        -f64::from(params.get(id).value()[0])
    }

    /// Promise of `each_stage_trains_what_it_names`.
    #[test]
    fn published_rates_slow_down_over_a_stage() {
        let all = [
            (ExpertKind::Field, "mean", 3.2e-4, 0.01),
            (ExpertKind::Field, "plane1.xt", 1.6e-3, 0.1),
            (ExpertKind::Field, "trunk.weight", 1.6e-4, 0.1),
            (ExpertKind::Code, "fine.trunk.weight", 1.6e-4, 0.1),
            (ExpertKind::Code, "z", 2.5e-3, 1.0),
            (ExpertKind::Keys, "opacity", 0.05, 1.0),
            (ExpertKind::Poly, "position", 3.2e-4, 0.01),
        ];
        for (kind, name, first, left) in all {
            for (step, expected) in [(0, first), (500, first * f64::sqrt(left)), (1000, first * left)] {
                let found = moved(kind, name, step);
                assert!((found - expected).abs() < 1e-5 * expected, "{kind} {name}, step {step}: {found}");
            }
        }
    }
}
