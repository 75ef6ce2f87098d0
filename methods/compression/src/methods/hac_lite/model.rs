//! Anchors, networks and hash grid, on the tape.

use crate::{HashGrid, HashLevel, binary_through, gaussian_bits};
use std::sync::Arc;
use weaver_autograd::ops::{self, Activation, concat};
use weaver_autograd::{ParamId, Params, Tape, Var};
use weaver_geometry::sh;
use weaver_kernels::random::Stream;
use weaver_nn::{Builder, Context, Init, Linear, WeightInit};
use weaver_splat::GaussianVars;

/// Gaussians of an anchor.
pub(super) const OFFSETS: usize = 5;
/// Features of an anchor, and the width of hidden layers.
pub(super) const FEATURES: usize = 32;
pub(super) const HIDDEN: usize = 32;
/// Logarithms of an anchor's sizes: of its offsets, and of its Gaussians.
pub(super) const SCALINGS: usize = 6;
/// Coded numbers of an anchor.
pub(super) const NUMBERS: usize = FEATURES + SCALINGS + 3 * OFFSETS;
/// Groups of these numbers, and the middle of each group's range of steps.
pub(super) const STEPS: [(usize, f64); 3] = [(FEATURES, 1.0), (SCALINGS, 0.05), (3 * OFFSETS, 0.2)];
/// Predicted numbers of an anchor: means and logarithms of deviations, and the place of the three steps in their
/// ranges.
pub(super) const PREDICTED: usize = 2 * NUMBERS + STEPS.len();
/// Largest magnitudes of a logarithm, and of the place of a step.
pub(super) const LOGARITHM: f64 = 12.0;
pub(super) const PLACE: f64 = 4.0;
/// Numbers of a row of the hash grid's tables.
pub(super) const WIDTH: usize = 4;
/// Least sigmoid of a drawn Gaussian's mask.
pub(super) const SHOWN: f32 = 0.01;
/// Initial deviation of features, in middles of their steps: networks see them divided by it.
pub(super) const SPREAD: f64 = 4.0;
/// Weights of the volumes and of the masks in the loss.
const VOLUMES: f64 = 0.01;
const MASKS: f64 = 5e-4;
/// Most rows of a table.
const MOST_ROWS: usize = 1 << 13;
/// Numbers of a Gaussian's shape from the networks: a logit, three scales and a rotation.
pub(super) const SHAPE: usize = 7;

/// The networks: name and outputs.
pub(super) fn networks(degree: usize) -> [(&'static str, usize, usize); 4] {
    [
        ("opacity", FEATURES, OFFSETS),
        ("shape", FEATURES, SHAPE * OFFSETS),
        ("color", FEATURES, 3 * sh::coefficients(degree) * OFFSETS),
        ("context", levels(1).len() * WIDTH, PREDICTED),
    ]
}

/// Levels of the hash grid for a number of anchors: space, and the three planes.
pub(super) fn levels(anchors: usize) -> Vec<HashLevel> {
    let rows = (anchors / 4).next_power_of_two().clamp(16, MOST_ROWS);
    let level = |axes: &[usize], resolution| HashLevel { axes: axes.to_vec(), resolution, rows };
    let space = [18, 31, 52, 89, 151, 257].map(|resolution| level(&[0, 1, 2], resolution));
    let planes = [[0, 1], [0, 2], [1, 2]];
    space
        .into_iter()
        .chain(planes.iter().flat_map(|axes| [130, 514].map(|resolution| level(axes, resolution))))
        .collect()
}

/// All trained parameters.
#[derive(Debug)]
pub(super) struct Model {
    pub params: Params<f32>,
    /// `[A, 3]`, constant.
    pub anchors: Vec<f32>,
    pub grid: Arc<HashGrid>,
    pub degree: usize,
}

/// Output of the networks for Gaussians.
pub(super) struct Made<'t> {
    /// Logits `[A, K]`.
    pub logits: Var<'t, f32>,
    /// Three numbers whose sigmoids are shares of the anchor's size, and a quaternion, `[A, K, 7]`.
    pub shapes: Var<'t, f32>,
    /// Harmonics, `[A K, C, 3]`.
    pub colors: Var<'t, f32>,
}

/// Gaussians for drawing, and the further terms of the loss.
pub(super) struct Drawn<'t> {
    pub gaussians: GaussianVars<'t, f32>,
    pub penalty: Var<'t, f32>,
}

/// Parts of a step beside drawing.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stage {
    /// True to add noise in place of rounding.
    pub noise: bool,
    /// Weight of bits; `None` leaves them out.
    pub rate: Option<f64>,
    /// Stream of the noise.
    pub stream: Stream,
}

impl Model {
    /// A model before any training, of anchors `[A, 3]` at places in the unit cube.
    pub fn new(anchors: Vec<f32>, places: &[[f64; 3]], degree: usize, seed: u64) -> Self {
        let count = places.len();
        let grid = Arc::new(HashGrid::new(&levels(count), places));
        let mut params = Params::new();
        let mut builder = Builder::new(&mut params, seed);
        builder.add("features", [count, FEATURES], Init::Normal(0.5 * SPREAD));
        builder.add("scalings", [count, SCALINGS], Init::Constant(0.0));
        builder.add("offsets", [count, 3 * OFFSETS], Init::Constant(0.0));
        builder.add("masks", [count, OFFSETS], Init::Constant(1.0));
        builder.add("table", [grid.rows(), WIDTH], Init::Uniform(0.1));
        for (name, inputs, outputs) in networks(degree) {
            let mut own = builder.scope(name);
            Linear::new(own.scope("fc1"), inputs, HIDDEN, WeightInit::FanIn);
            Linear::new(own.scope("fc2"), HIDDEN, outputs, WeightInit::FanIn);
        }
        Self { params, anchors, grid, degree }
    }

    pub fn count(&self) -> usize {
        self.anchors.len() / 3
    }

    pub fn id(&self, name: &str) -> ParamId {
        self.params.find(name).expect("a parameter of the model")
    }

    pub fn values(&self, name: &str) -> &[f32] {
        self.params.get(self.id(name)).value()
    }

    fn param<'t>(&self, tape: &'t Tape<f32>, name: &str) -> Var<'t, f32> {
        tape.param(&self.params, self.id(name))
    }

    fn network<'t>(&self, x: Var<'t, f32>, name: &str) -> Var<'t, f32> {
        let cx = Context::new(x.tape(), &self.params);
        let layer = |layer: &str, x, activation| {
            let [weight, bias] = ["weight", "bias"].map(|part| cx.param(self.id(&format!("{name}.{layer}.{part}"))));
            ops::linear(x, weight, Some(bias), activation)
        };
        layer("fc2", layer("fc1", x, Activation::Relu), Activation::None)
    }

    /// Output of the networks for features `[A, F]`.
    pub fn made<'t>(&self, features: Var<'t, f32>) -> Made<'t> {
        let (count, features) = (self.count(), features * (1.0 / SPREAD));
        Made {
            logits: self.network(features, "opacity"),
            shapes: self.network(features, "shape").reshape([count, OFFSETS, SHAPE]),
            colors: self.network(features, "color").reshape([count * OFFSETS, sh::coefficients(self.degree), 3]),
        }
    }

    /// Gaussians to draw, and the rest of the loss: volumes, masks and bits.
    pub fn drawn<'t>(&self, tape: &'t Tape<f32>, stage: Stage) -> Drawn<'t> {
        let count = self.count();
        let parts = ["features", "scalings", "offsets"].map(|name| self.param(tape, name));
        let mut numbers = concat(&parts, 1);
        let masks = self.param(tape, "masks").sigmoid();
        let shown: Vec<f32> = masks.value().iter().map(|x| f32::from(u8::from(*x > SHOWN))).collect();
        let shown = ops::straight_through(masks, tape.constant(&shown, [count, OFFSETS]));
        let mut penalty = masks.mean() * MASKS;
        if stage.noise {
            let table = binary_through(self.param(tape, "table"));
            let predicted = self.network(self.grid.look_up(table), "context");
            let places = predicted.slice(1, 2 * NUMBERS, STEPS.len()).clamp(-PLACE, PLACE).tanh();
            let group = |(k, (width, middle)): (usize, (usize, f64))| {
                ((places.slice(1, k, 1) + 1.0) * middle).expand([count, width])
            };
            let steps: Vec<Var<'t, f32>> = STEPS.into_iter().enumerate().map(group).collect();
            let steps = concat(&steps, 1);
            let noise = tape.constant_with([count, NUMBERS], |noise| {
                noise.iter_mut().zip(0..).for_each(|(u, i)| *u = stage.stream.uniform::<f32>(i) - 0.5);
            });
            numbers = numbers + noise * steps;
            if let Some(rate) = stage.rate {
                let deviations = predicted.slice(1, NUMBERS, NUMBERS).clamp(-LOGARITHM, LOGARITHM).exp();
                let bits = gaussian_bits(numbers, predicted.slice(1, 0, NUMBERS), deviations, steps);
                let anchors = bits.slice(1, 0, FEATURES + SCALINGS).sum();
                let three = shown.reshape([count, OFFSETS, 1]).expand([count, OFFSETS, 3]);
                let offsets = bits.slice(1, FEATURES + SCALINGS, 3 * OFFSETS).reshape([count, OFFSETS, 3]) * three;
                // A row of the table is one of two signs: the bits are the entropy of their shares.
                let share = (table.mean() * 0.5 + 0.5).clamp(1e-6, 1.0 - 1e-6);
                let rest = share * -1.0 + 1.0;
                let entropy = (share * share.ln() + rest * rest.ln()) * (-std::f64::consts::LOG2_E);
                let signs = (self.grid.rows() * WIDTH) as f64;
                let sum = anchors + offsets.sum() + (entropy * signs).reshape(anchors.shape());
                penalty = penalty + sum.reshape(penalty.shape()) * (rate / (count * NUMBERS) as f64);
            }
        }
        let gaussians = self.gaussians(numbers, shown);
        let scales = gaussians.scales;
        let column = |k: usize| scales.slice(1, k, 1);
        let volumes = column(0) * column(1) * column(2);
        Drawn { gaussians, penalty: penalty + volumes.mean().reshape(penalty.shape()) * VOLUMES }
    }

    /// The Gaussians of numbers `[A, NUMBERS]`; only the `shown` ones `[A, K]` have a size.
    fn gaussians<'t>(&self, numbers: Var<'t, f32>, shown: Var<'t, f32>) -> GaussianVars<'t, f32> {
        let (count, all, tape) = (self.count(), self.count() * OFFSETS, numbers.tape());
        let scalings = numbers.slice(1, FEATURES, SCALINGS).clamp(-LOGARITHM, LOGARITHM).exp();
        let three = |first: usize| scalings.slice(1, first, 3).reshape([count, 1, 3]).expand([count, OFFSETS, 3]);
        let anchors = tape.constant(&self.anchors, [count, 1, 3]).expand([count, OFFSETS, 3]);
        let offsets = numbers.slice(1, FEATURES + SCALINGS, 3 * OFFSETS).reshape([count, OFFSETS, 3]);
        let made = self.made(numbers.slice(1, 0, FEATURES));
        let shares = made.shapes.slice(2, 0, 3).sigmoid();
        let visible = shown.reshape([count, OFFSETS, 1]).expand([count, OFFSETS, 3]);
        GaussianVars {
            means: (anchors + offsets * three(0)).reshape([all, 3]),
            quats: made.shapes.slice(2, 3, 4).reshape([all, 4]),
            scales: (shares * three(3) * visible).reshape([all, 3]),
            opacities: (made.logits.sigmoid() * shown).reshape([all]),
            colors: made.colors,
        }
    }
}
