//! A model initialized from the given scene.

use super::model::{FEATURES, Model, NUMBERS, OFFSETS, SCALINGS, SPREAD, STEPS};
use crate::payload::Grid;
use crate::views::contributions;
use crate::{CompressionError, Task};
use weaver_autograd::Tape;
use weaver_codec::from_morton3;
use weaver_geometry::glam::{DMat3, DQuat};
use weaver_nn::{AdamW, Group};
use weaver_scene::Gaussians;

/// Levels of the anchors' octree.
pub(super) const DEPTH: u32 = 13;
/// Steps of the networks and features toward the numbers of the scene, and their first rate.
const ROUNDS: usize = 800;
const RATE: f64 = 0.01;
/// Mask of an absent Gaussian.
const ABSENT: f32 = -10.0;
/// Largest target of a logit.
const LOGIT: f32 = 8.0;

/// Gaussians by anchors.
#[derive(Debug)]
pub(super) struct Groups {
    pub grid: Grid,
    /// Codes of the anchors in Morton order.
    pub codes: Vec<u64>,
    /// The Gaussians of each anchor; the last group may be smaller.
    members: Vec<Vec<usize>>,
}

impl Groups {
    /// Groups of neighbors in Morton order, each with the voxel of its mean.
    pub fn new(gaussians: &Gaussians) -> Self {
        let (_, order) = Grid::about(&gaussians.means, DEPTH);
        let numbers: Vec<usize> = order.into_iter().map(|(_, i)| i).collect();
        let mean = |members: &[usize]| {
            let sum = |axis: usize| members.iter().map(|&i| f64::from(gaussians.means[i][axis])).sum::<f64>();
            [0, 1, 2].map(|axis| (sum(axis) / members.len() as f64) as f32)
        };
        let means: Vec<[f32; 3]> = numbers.chunks(OFFSETS).map(mean).collect();
        let (grid, order) = Grid::about(&means, DEPTH);
        let group = |&(_, group): &(u64, usize)| {
            let mut members = numbers[OFFSETS * group..numbers.len().min(OFFSETS * (group + 1))].to_vec();
            // Similar Gaussians have the same index in their groups.
            let size = |i: usize| gaussians.log_scales[i].iter().sum::<f32>();
            members.sort_by(|&a, &b| size(b).total_cmp(&size(a)).then(a.cmp(&b)));
            members
        };
        Self { grid, members: order.iter().map(group).collect(), codes: order.iter().map(|(code, _)| *code).collect() }
    }

    /// A model of these anchors before any training.
    pub fn model(&self, degree: usize, seed: u64) -> Model {
        let anchors = self.codes.iter().flat_map(|code| self.grid.mean(*code)).collect();
        Model::new(anchors, &places(&self.codes), degree, seed)
    }

    /// Initializes the anchors from the Gaussians: offsets directly, features and networks by fitting the other
    /// numbers.
    pub fn begin(&self, model: &mut Model, gaussians: &Gaussians, task: &Task<'_>) -> Result<(), CompressionError> {
        self.place(model, gaussians);
        let targets = self.targets(model, gaussians, &contributions(gaussians, &task.pictures)?);
        let named = |name: &str, rate: f64| Group {
            params: model.params.iter().filter(|(_, it)| it.name().starts_with(name)).map(|(id, _)| id).collect(),
            lr_scale: rate,
            weight_decay: 0.0,
        };
        let groups = [("features", SPREAD), ("opacity.", 1.0), ("shape.", 1.0), ("color.", 1.0)];
        let groups = groups.map(|(name, rate)| named(name, rate)).into();
        let mut optimizer = AdamW::new(groups, 0.9, 0.99, 1e-8);
        let mut tape = Tape::new();
        for round in 0..ROUNDS {
            targets.loss(model, &tape).backward();
            let rate = RATE * 0.1_f64.powf(round as f64 / ROUNDS as f64);
            optimizer.step(&mut model.params, &mut tape, rate);
            tape.reset();
        }
        spread(model);
        Ok(())
    }

    /// Offsets and scalings.
    fn place(&self, model: &mut Model, gaussians: &Gaussians) {
        let (mut offsets, mut scalings, mut masks) = (Vec::new(), Vec::new(), Vec::new());
        for (members, anchor) in self.members.iter().zip(model.anchors.as_chunks::<3>().0) {
            let apart = |i: usize| [0, 1, 2].map(|axis| gaussians.means[i][axis] - anchor[axis]);
            let sizes = [0, 1, 2].map(|axis| {
                let square = members.iter().map(|&i| apart(i)[axis].powi(2)).sum::<f32>() / members.len() as f32;
                square.sqrt().max(1e-5)
            });
            let largest = members.iter().flat_map(|&i| gaussians.log_scales[i]).fold(f32::NEG_INFINITY, f32::max);
            scalings.extend(sizes.map(f32::ln));
            // Half of an anchor's size for the largest Gaussian, which leaves it room to grow.
            scalings.extend([largest + 2.0_f32.ln(); 3]);
            for k in 0..OFFSETS {
                let own = members.get(k).map(|&i| apart(i));
                masks.push(if own.is_some() { 1.0 } else { ABSENT });
                offsets.extend([0, 1, 2].map(|axis| own.map_or(0.0, |own| own[axis] / sizes[axis])));
            }
        }
        for (name, values) in [("offsets", offsets), ("scalings", scalings), ("masks", masks)] {
            let id = model.id(name);
            model.params.value_mut(id).copy_from_slice(&values);
        }
    }

    fn targets(&self, model: &Model, gaussians: &Gaussians, weights: &[f32]) -> Targets {
        let mut targets = Targets::default();
        let mean = (weights.iter().sum::<f32>() / weights.len() as f32).max(f32::MIN_POSITIVE);
        let width = 3 * gaussians.coefficients();
        for (members, scalings) in self.members.iter().zip(model.values("scalings").chunks_exact(SCALINGS)) {
            for k in 0..OFFSETS {
                let i = members.get(k).copied();
                let (scales, quat) = i.map_or(([0.0; 3], [1.0, 0.0, 0.0, 0.0]), |i| sorted(gaussians, i));
                targets.weights.push(i.map_or(0.0, |i| (weights[i] / mean).clamp(0.05, 4.0)));
                let logit = i.map_or(0.0, |i| gaussians.opacity_logits[i].clamp(-LOGIT, LOGIT));
                targets.opacities.push(1.0 / (1.0 + (-logit).exp()));
                targets.shares.extend([0, 1, 2].map(|axis| (scales[axis] - scalings[3 + axis]).max(-LOGIT)));
                targets.quats.extend(quat);
                match i {
                    Some(i) => targets.colors.extend(&gaussians.sh[width * i..][..width]),
                    None => targets.colors.extend(std::iter::repeat_n(0.0, width)),
                }
            }
        }
        targets
    }
}

/// Places of anchors in the unit cube.
pub(super) fn places(codes: &[u64]) -> Vec<[f64; 3]> {
    let side = f64::from(1_u32 << DEPTH);
    codes.iter().map(|code| from_morton3(*code).map(|x| f64::from(x) / side)).collect()
}

/// Log scales in descending order, and the rotation of axes in this order.
fn sorted(gaussians: &Gaussians, i: usize) -> ([f32; 3], [f32; 4]) {
    let [w, x, y, z] = gaussians.quats[i].map(f64::from);
    let quat = DQuat::from_xyzw(x, y, z, w);
    let turn = DMat3::from_quat(if quat.length_squared() > 0.0 { quat.normalize() } else { DQuat::IDENTITY });
    let scales = gaussians.log_scales[i];
    let mut axes = [0, 1, 2];
    axes.sort_by(|&a, &b| scales[b].total_cmp(&scales[a]));
    let [a, b, c] = axes.map(|axis| turn.col(axis));
    let last = if DMat3::from_cols(a, b, c).determinant() < 0.0 { -c } else { c };
    let quat = DQuat::from_mat3(&DMat3::from_cols(a, b, last)).normalize();
    (axes.map(|axis| scales[axis]), [quat.w, quat.x, quat.y, quat.z].map(|x| x as f32))
}

/// Targets of the networks for Gaussians, `[A K]` each, and the weight of each Gaussian.
#[derive(Default)]
struct Targets {
    weights: Vec<f32>,
    opacities: Vec<f32>,
    /// Log scales relative to the anchor's.
    shares: Vec<f32>,
    quats: Vec<f32>,
    colors: Vec<f32>,
}

impl Targets {
    /// Weighted squares of the errors of opacities, log scales, rotations and harmonics.
    fn loss<'t>(&self, model: &Model, tape: &'t Tape<f32>) -> weaver_autograd::Var<'t, f32> {
        let all = self.weights.len();
        let made = model.made(tape.param(&model.params, model.id("features")));
        let weights = tape.constant(&self.weights, [all, 1]);
        let opacities = (made.logits.sigmoid().reshape([all, 1]) - tape.constant(&self.opacities, [all, 1])).square();
        // ln σ(x) = -softplus(-x).
        let logs = -(-made.shapes.slice(2, 0, 3)).softplus().reshape([all, 3]);
        let scales = (logs - tape.constant(&self.shares, [all, 3])).square().sum_axis(1).reshape([all, 1]);
        let quats = made.shapes.slice(2, 3, 4).reshape([all, 4]).normalize_rows(1e-6);
        // Either sign of a quaternion is the same rotation.
        let cosines = (quats * tape.constant(&self.quats, [all, 4])).sum_axis(1).reshape([all, 1]);
        let turns = cosines.square() * -1.0 + 1.0;
        let width = self.colors.len() / all;
        let colors = made.colors.reshape([all, width]) - tape.constant(&self.colors, [all, width]);
        let colors = colors.square().sum_axis(1).reshape([all, 1]);
        ((opacities * 4.0 + scales * 0.3 + turns + colors) * weights).mean()
    }
}

/// Gives each feature a mean of 0 and the deviation that fits its steps; the networks' first layers compensate.
fn spread(model: &mut Model) {
    let features = model.values("features");
    let count = model.count().max(1) as f32;
    let mean: Vec<f32> =
        (0..FEATURES).map(|k| features.iter().skip(k).step_by(FEATURES).sum::<f32>() / count).collect();
    let square = |k: usize| features.iter().skip(k).step_by(FEATURES).map(|x| (x - mean[k]).powi(2)).sum::<f32>();
    let scale: Vec<f32> = (0..FEATURES).map(|k| SPREAD as f32 / (square(k) / count).sqrt().max(1e-3)).collect();
    let id = model.id("features");
    for row in model.params.value_mut(id).chunks_exact_mut(FEATURES) {
        row.iter_mut().enumerate().for_each(|(k, x)| *x = (*x - mean[k]) * scale[k]);
    }
    for net in ["opacity", "shape", "color"] {
        let [weight, bias] = ["weight", "bias"].map(|part| model.id(&format!("{net}.fc1.{part}")));
        let mut more = Vec::new();
        for row in model.params.value_mut(weight).chunks_exact_mut(FEATURES) {
            more.push(row.iter().zip(&mean).map(|(w, mean)| w * mean / SPREAD as f32).sum::<f32>());
            row.iter_mut().zip(&scale).for_each(|(w, scale)| *w /= scale);
        }
        model.params.value_mut(bias).iter_mut().zip(more).for_each(|(b, more)| *b += more);
    }
}

/// Initializes the context with the mean and the deviation of each number over all anchors.
pub(super) fn begin_context(model: &mut Model) {
    let count = model.count().max(1) as f64;
    let groups = [("features", FEATURES), ("scalings", SCALINGS), ("offsets", 3 * OFFSETS)];
    let (mut means, mut logs) = (Vec::with_capacity(NUMBERS), Vec::with_capacity(NUMBERS));
    for ((name, width), (_, step)) in groups.into_iter().zip(STEPS) {
        for k in 0..width {
            let column = || model.values(name).iter().skip(k).step_by(width).map(|x| f64::from(*x));
            let mean = column().sum::<f64>() / count;
            let square = column().map(|x| (x - mean).powi(2)).sum::<f64>() / count;
            means.push(mean as f32);
            logs.push(square.sqrt().max(0.5 * step).ln() as f32);
        }
    }
    let bias = model.id("context.fc2.bias");
    let values = model.params.value_mut(bias);
    values[..NUMBERS].copy_from_slice(&means);
    values[NUMBERS..2 * NUMBERS].copy_from_slice(&logs);
    values[2 * NUMBERS..].fill(0.0);
    let weight = model.id("context.fc2.weight");
    model.params.value_mut(weight).iter_mut().for_each(|w| *w *= 0.1);
}
