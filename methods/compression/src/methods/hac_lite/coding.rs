//! Files of HAC-lite, and Gaussians from these alone.

use super::model::{
    FEATURES, HIDDEN, LOGARITHM, Model, NUMBERS, OFFSETS, PLACE, PREDICTED, SCALINGS, SHAPE, SHOWN, SPREAD, STEPS,
    WIDTH, levels, networks,
};
use super::start::{DEPTH, Groups, places};
use crate::payload::{Reader, Writer, broken};
use crate::{CompressionError, HashGrid};
use weaver_codec::{Coder, GaussianModel, RangeEncoder, binary, exact};
use weaver_scene::Gaussians;

/// Steps of a weight within the deviation of its layer.
const FINE: f64 = 32.0;
/// Largest magnitude of a decoded number; broken streams could have any.
const LARGEST: f64 = 1e30;

/// A network of two layers with decoded weights.
struct Network {
    /// Weights and biases of a layer.
    layers: [[Vec<f64>; 2]; 2],
}

impl Network {
    /// The output for an input: sums in a fixed order, the same bits on every machine.
    fn of(&self, input: &[f64]) -> Vec<f64> {
        let layer = |[weights, biases]: &[Vec<f64>; 2], x: &[f64]| -> Vec<f64> {
            let row = |(row, bias): (&[f64], &f64)| row.iter().zip(x).fold(*bias, |sum, (w, x)| sum + w * x);
            weights.chunks_exact(x.len()).zip(biases).map(row).collect()
        };
        let hidden: Vec<f64> = layer(&self.layers[0], input).into_iter().map(|x| x.max(0.0)).collect();
        layer(&self.layers[1], &hidden)
    }
}

/// Codes the layers of all networks; an encoder passes their weights, a decoder none.
fn code_networks(
    coder: &mut impl Coder,
    degree: usize,
    deviations: &[f32],
    weight: impl Fn(&str, usize, usize, usize) -> f32,
) -> Vec<Network> {
    let mut deviations = deviations.iter();
    let networks = networks(degree).map(|(name, inputs, outputs)| {
        let sizes = [[inputs * HIDDEN, HIDDEN], [HIDDEN * outputs, outputs]];
        let mut layers = [const { [const { Vec::new() }; 2] }; 2];
        for (layer, part) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let step = f64::from(*deviations.next().expect("a deviation for each")) / FINE;
            let model = GaussianModel::new(0.0, exact::ln(FINE));
            layers[layer][part] = (0..sizes[layer][part])
                .map(|i| {
                    let number = (f64::from(weight(name, layer, part, i)) / step).round();
                    f64::from(model.code(coder, number as i32)) * step
                })
                .collect();
        }
        Network { layers }
    });
    networks.into()
}

/// Deviations of the parts of all networks.
const PARTS: usize = 16;

/// Anchors, and the context of their numbers.
struct Anchors<'a> {
    /// Places in the unit cube, `[A, 3]`.
    places: &'a [[f64; 3]],
    /// Signs of the hash grid's tables, and the predicting network.
    table: &'a [f64],
    context: &'a Network,
    /// Mask of existing Gaussians, `[A, K]`.
    shown: &'a [bool],
}

/// Anchors whose corners in the hash grid are in memory at a time.
const CHUNK: usize = 256;

impl Anchors<'_> {
    /// Codes all numbers by the context's predictions, except offsets of absent Gaussians, and hands them over rounded,
    /// an anchor at a time. An encoder passes the numbers, a decoder none.
    fn code(
        &self,
        coder: &mut impl Coder,
        number: impl Fn(usize) -> f32,
        mut each: impl FnMut(usize, &[f64; NUMBERS]),
    ) {
        let (levels, width) = (levels(self.places.len()), levels(1).len() * WIDTH);
        for (chunk, places) in self.places.chunks(CHUNK).enumerate() {
            let mut features = vec![0.0; places.len() * width];
            HashGrid::new(&levels, places).features(self.table, &mut features);
            for (anchor, features) in (CHUNK * chunk..).zip(features.chunks_exact(width)) {
                // A broken stream ends here, without invented numbers.
                if coder.exhausted() {
                    return;
                }
                each(anchor, &self.one(coder, anchor, &self.context.of(features), &number));
            }
        }
    }

    fn one(
        &self,
        coder: &mut impl Coder,
        anchor: usize,
        predicted: &[f64],
        number: &impl Fn(usize) -> f32,
    ) -> [f64; NUMBERS] {
        debug_assert_eq!(predicted.len(), PREDICTED);
        let (mut rounded, mut at) = ([0.0; NUMBERS], 0);
        for (group, (width, middle)) in STEPS.into_iter().enumerate() {
            // 1 + tanh(x) = 2 - 2 / (exp(2x) + 1).
            let place = predicted[2 * NUMBERS + group].clamp(-PLACE, PLACE);
            let step = middle * (2.0 - 2.0 / (exact::exp(2.0 * place) + 1.0));
            let logarithm = exact::ln(step);
            for k in at..at + width {
                let offset = k.checked_sub(FEATURES + SCALINGS);
                if offset.is_some_and(|k| !self.shown[anchor * OFFSETS + k / 3]) {
                    continue;
                }
                let deviation = predicted[NUMBERS + k].clamp(-LOGARITHM, LOGARITHM) - logarithm;
                let model = GaussianModel::new(predicted[k] / step, deviation);
                let symbol = (f64::from(number(anchor * NUMBERS + k)) / step).round() as i32;
                rounded[k] = f64::from(model.code(coder, symbol)) * step;
            }
            at += width;
        }
        rounded
    }
}

/// The bytes of a model.
pub(super) fn write(model: &Model, groups: &Groups) -> Result<Vec<u8>, CompressionError> {
    let mut writer = Writer::default();
    let order: Vec<(u64, usize)> = groups.codes.iter().copied().zip(0..).collect();
    writer.positions(&groups.grid, &order)?;
    let signs: Vec<f64> = model.values("table").iter().map(|x| binary(f64::from(*x))).collect();
    let symbols: Vec<u32> = signs.iter().map(|sign| u32::from(*sign > 0.0)).collect();
    writer.symbols(b"hash", 2, &symbols, 1);
    let part = |name: &str, layer: usize, part: usize| {
        model.values(&format!("{name}.fc{}.{}", layer + 1, ["weight", "bias"][part]))
    };
    let deviation = |values: &[f32]| {
        let square = values.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>() / values.len() as f64;
        square.sqrt().max(1e-6) as f32
    };
    let parts = [(0, 0), (0, 1), (1, 0), (1, 1)];
    let all = networks(model.degree).map(|(name, ..)| parts.map(|(layer, k)| deviation(part(name, layer, k))));
    writer.floats(b"devi", all.as_flattened());
    let mut encoder = RangeEncoder::default();
    let weight = |name: &str, layer: usize, k: usize, i: usize| part(name, layer, k)[i];
    let networks = code_networks(&mut encoder, model.degree, all.as_flattened(), weight);
    writer.coded(b"nets", weights(model.degree), encoder);
    let mut shown: Vec<bool> = model.values("masks").iter().map(|mask| 1.0 / (1.0 + (-mask).exp()) > SHOWN).collect();
    if !shown.contains(&true) {
        shown[0] = true;
    }
    let masks: Vec<u32> = shown.iter().map(|shown| u32::from(*shown)).collect();
    writer.symbols(b"mask", 2, &masks, OFFSETS);
    let [features, scalings, offsets] = ["features", "scalings", "offsets"].map(|name| model.values(name));
    let number = |i: usize| {
        let (anchor, k) = (i / NUMBERS, i % NUMBERS);
        match k {
            0..FEATURES => features[anchor * FEATURES + k],
            _ if k < FEATURES + SCALINGS => scalings[anchor * SCALINGS + k - FEATURES],
            _ => offsets[anchor * 3 * OFFSETS + k - FEATURES - SCALINGS],
        }
    };
    let mut encoder = RangeEncoder::default();
    let places = places(&groups.codes);
    let anchors = Anchors { places: &places, table: &signs, context: &networks[3], shown: &shown };
    anchors.code(&mut encoder, number, |_, _| {});
    writer.coded(b"numb", model.count() * NUMBERS, encoder);
    Ok(writer.finish(model.count(), model.degree))
}

/// Number of weights and biases of all networks.
fn weights(degree: usize) -> usize {
    networks(degree).iter().map(|(_, inputs, outputs)| (inputs + 1) * HIDDEN + (HIDDEN + 1) * outputs).sum()
}

/// The Gaussians of a file.
pub(super) fn read(bytes: &[u8]) -> Result<Gaussians, CompressionError> {
    let mut reader = Reader::new(bytes)?;
    let (count, degree) = (reader.gaussians(), reader.degree()?);
    let (grid, codes) = reader.positions(DEPTH)?;
    let rows: usize = levels(count).iter().map(|level| level.rows).sum();
    let signs = reader.symbols(b"hash", 2, rows * WIDTH, 1)?;
    let table: Vec<f64> = signs.into_iter().map(|sign| 2.0 * f64::from(sign) - 1.0).collect();
    let deviations = reader.floats(b"devi", PARTS)?;
    if !deviations.iter().all(|x| x.is_finite() && *x > 0.0) {
        return Err(broken("stream devi", "positive numbers", format!("{deviations:?}")));
    }
    let networks = reader
        .coded(b"nets", weights(degree), |decoder| code_networks(decoder, degree, &deviations, |_, _, _, _| 0.0))?;
    let shown: Vec<bool> = reader.symbols(b"mask", 2, count, OFFSETS)?.into_iter().map(|it| it == 1).collect();
    let places = places(&codes);
    let anchors = Anchors { places: &places, table: &table, context: &networks[3], shown: &shown };
    let mut gaussians = Gaussians { degree, ..Gaussians::default() };
    reader.coded(b"numb", count * NUMBERS, |decoder| {
        anchors.code(
            decoder,
            |_| 0.0,
            |anchor, numbers| {
                let shown = &shown[anchor * OFFSETS..][..OFFSETS];
                add(&mut gaussians, grid.mean(codes[anchor]), numbers, shown, &networks);
            },
        );
    })?;
    Ok(gaussians)
}

/// Adds the Gaussians that networks make from the numbers of an anchor.
fn add(to: &mut Gaussians, anchor: [f32; 3], numbers: &[f64; NUMBERS], shown: &[bool], networks: &[Network]) {
    let finite = |x: f64| if x.is_nan() { 0.0 } else { x.clamp(-LARGEST, LARGEST) as f32 };
    let features = std::array::from_fn::<f64, FEATURES, _>(|k| numbers[k] / SPREAD);
    let [logits, shapes, colors] = [0, 1, 2].map(|net| networks[net].of(&features));
    let scaling = |k: usize| numbers[FEATURES + k].clamp(-LOGARITHM, LOGARITHM);
    let width = 3 * to.coefficients();
    for k in (0..OFFSETS).filter(|k| shown[*k]) {
        let offset = |axis: usize| numbers[FEATURES + SCALINGS + 3 * k + axis] * scaling(axis).exp();
        to.means.push([0, 1, 2].map(|axis| finite(f64::from(anchor[axis]) + offset(axis))));
        let shape = &shapes[SHAPE * k..][..SHAPE];
        // ln σ(x).
        let share = |x: f64| -(1.0 + (-x).exp()).ln();
        to.log_scales.push([0, 1, 2].map(|axis| finite(scaling(3 + axis) + share(shape[axis].max(-300.0)))));
        to.quats.push([3, 4, 5, 6].map(|at| finite(shape[at])));
        to.opacity_logits.push(finite(logits[k]));
        to.sh.extend(colors[width * k..][..width].iter().map(|x| finite(*x)));
    }
}
