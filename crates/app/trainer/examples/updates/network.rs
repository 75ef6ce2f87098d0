//! The network that corrects Gaussians: its features, its layers, and the decoding of its outputs.

use crate::place::{NEIGHBORS, NUMBERS, Place, STATE, WIDTHS};
use weaver_autograd::ops::{Activation, concat};
use weaver_autograd::{Params, Var};
use weaver_kernels::{Real, simd};
use weaver_nn::{Builder, Context, Linear, WeightInit};

/// Numbers that a Gaussian shows beside its state.
pub const FEATURES: usize = 3 * NUMBERS + 3 + 4 + 2 + 3 + 6 + 6 + 6 + 1 + 3 + 1 + 1;
/// Three gains for each kind, a change of each number, a state.
pub const OUTPUTS: usize = 3 * 6 + NUMBERS + STATE;
const HIDDEN: usize = 32;
const KEYS: usize = 8;

/// Parts that are left out, as ablations.
#[derive(Clone, Copy, Debug, Default)]
pub struct Without {
    /// Attention to the hidden features of the neighbors.
    pub attention: bool,
    /// [`attention`](Self::attention), and the mean of Adam's directions over the neighbors.
    pub neighbors: bool,
    /// Features of gradients: parameters and state remain.
    pub gradients: bool,
    /// The state that is passed on.
    pub state: bool,
}

#[derive(Debug)]
pub struct Network {
    first: Linear,
    query: Linear,
    key: Linear,
    second: Linear,
    last: Linear,
    pub without: Without,
}

impl Network {
    pub fn new(params: &mut Params<f32>, seed: u64, without: Without) -> Self {
        let mut builder = Builder::new(params, seed);
        let init = WeightInit::FanIn;
        Self {
            first: Linear::new(builder.scope("first"), FEATURES + STATE, HIDDEN, init),
            query: Linear::without_bias(builder.scope("query"), HIDDEN, KEYS, init),
            key: Linear::without_bias(builder.scope("key"), HIDDEN, KEYS, init),
            second: Linear::new(builder.scope("second"), 2 * HIDDEN, HIDDEN, init),
            last: Linear::new(builder.scope("last"), HIDDEN, OUTPUTS, WeightInit::Zero),
            without,
        }
    }

    /// Numbers of the head `[N, OUTPUTS]`.
    pub fn forward<'t>(&self, cx: Context<'t, '_, f32>, features: Var<'t>, state: Var<'t>, nearest: &[u32]) -> Var<'t> {
        let n = features.shape().dims()[0];
        let hidden = self.first.forward_with(cx, concat(&[features, state], 1), Activation::Gelu);
        let around = if self.without.attention || self.without.neighbors {
            hidden
        } else {
            // Scaled dot products of a query with the keys of the neighbors.
            let keys = self.key.forward(cx, hidden).gather_rows(nearest).reshape([n, NEIGHBORS, KEYS]);
            let query = self.query.forward(cx, hidden).reshape([n, 1, KEYS]).expand([n, NEIGHBORS, KEYS]);
            let scores = (keys * query).sum_axis(2).reshape([n, NEIGHBORS]) * (1.0 / (KEYS as f64).sqrt());
            let weights = scores.softmax(1).reshape([n, NEIGHBORS, 1]).expand([n, NEIGHBORS, HIDDEN]);
            let values = hidden.gather_rows(nearest).reshape([n, NEIGHBORS, HIDDEN]);
            (values * weights).sum_axis(1).reshape([n, HIDDEN])
        };
        let hidden = self.second.forward_with(cx, concat(&[hidden, around], 1), Activation::Gelu);
        self.last.forward(cx, hidden)
    }
}

/// Numbers that a step sees of its Gaussians.
#[derive(Debug, Default)]
pub struct Seen {
    /// `[N, FEATURES]`.
    pub features: Vec<f32>,
    /// Adam's directions, their means over neighbors, and directions of the last gradient alone, `[N, 23]` each.
    directions: [Vec<f32>; 3],
    rates: [f32; 6],
}

impl Seen {
    /// The features of a place after a look.
    pub fn of(place: &mut Place, without: &Without) -> Self {
        if !without.neighbors {
            place.search();
        }
        let n = place.population.len();
        let mut directions: [Vec<f32>; 3] = std::array::from_fn(|_| vec![0.0; n * NUMBERS]);
        let mut features = vec![0.0; n * FEATURES];
        simd::dispatch(
            #[inline(always)]
            || fill(place, &mut directions, &mut features),
        );
        // Sizes of gradients, relative to all Gaussians.
        for kind in 0..6 {
            let at = SIZES + kind;
            let mean = features.iter().skip(at).step_by(FEATURES).sum::<f32>() / n as f32;
            let beside = |x: &mut f32| *x = ((*x - mean) * 0.5).clamp(-3.0, 3.0);
            features.iter_mut().skip(at).step_by(FEATURES).for_each(beside);
        }
        if !without.neighbors {
            let nearest = place.neighbors.clone();
            for i in 0..n {
                let mut mean = [0.0f32; NUMBERS];
                for near in &nearest[i * NEIGHBORS..][..NEIGHBORS] {
                    let row = &directions[0][*near as usize * NUMBERS..][..NUMBERS];
                    mean.iter_mut().zip(row).for_each(|(m, x)| *m += x * (1.0 / NEIGHBORS as f32));
                }
                directions[1][i * NUMBERS..][..NUMBERS].copy_from_slice(&mean);
                let to = &mut features[i * FEATURES + NUMBERS..][..NUMBERS];
                to.iter_mut().zip(mean).for_each(|(to, x)| *to = x.clamp(-4.0, 4.0));
            }
        }
        if without.gradients {
            for row in features.chunks_exact_mut(FEATURES) {
                row[..3 * NUMBERS].fill(0.0);
                row[SIZES..SIZES + 19].fill(0.0);
            }
        }
        Self { features, directions, rates: place.rates() }
    }

    /// Changes `[N, 23]`, decoded from the head's numbers.
    pub fn changes(&self, head: &[f32]) -> Vec<f32> {
        let mut changes = vec![0.0; self.directions[0].len()];
        simd::dispatch(
            #[inline(always)]
            || {
                for (i, (changes, head)) in
                    changes.chunks_exact_mut(NUMBERS).zip(head.chunks_exact(OUTPUTS)).enumerate()
                {
                    let [u, around, last] = [0, 1, 2].map(|d: usize| &self.directions[d][i * NUMBERS..][..NUMBERS]);
                    let mut own = [0.0f32; NUMBERS];
                    let given = &head[18..18 + NUMBERS];
                    own.iter_mut().zip(given).for_each(|(o, x)| *o = tamed(*x));
                    let mut first = 0;
                    for (kind, width) in WIDTHS.into_iter().enumerate() {
                        let [g, b, c] = [gain(head[kind]), head[6 + kind], head[12 + kind]];
                        for at in first..first + width {
                            let step = g * bounded(u[at]) + b * bounded(around[at]) + c * bounded(last[at]) + own[at];
                            changes[at] = self.rates[kind] * step;
                        }
                        first += width;
                    }
                }
            },
        );
        changes
    }

    /// Gradients with respect to the head's numbers, of gradients with respect to the Gaussians' numbers after the
    /// changes `[N, 23]`.
    pub fn pull_back(&self, head: &[f32], slopes: &[f32]) -> Vec<f32> {
        let mut to = vec![0.0; head.len()];
        self.each(|at, [kind, number], head_at, rate| {
            let [u, around, last] = self.at(at);
            let (head, to) = (&head[head_at..], &mut to[head_at..]);
            // Numbers go down by the change.
            let slope = -rate * slopes[at];
            let bent = gain(head[kind]);
            let bend = (bent.ln() / REACH).powi(2);
            to[kind] += slope * u * bent * REACH * (1.0 - bend);
            to[6 + kind] += slope * around;
            to[12 + kind] += slope * last;
            let x = tamed(head[18 + number]) / FARTHEST;
            to[18 + number] += slope * (1.0 - x * x);
        });
        to
    }

    fn at(&self, at: usize) -> [f32; 3] {
        [0, 1, 2].map(|d: usize| bounded(self.directions[d][at]))
    }

    fn each(&self, mut f: impl FnMut(usize, [usize; 2], usize, f32)) {
        let n = self.directions[0].len() / NUMBERS;
        for i in 0..n {
            let mut number = 0;
            for (kind, width) in WIDTHS.into_iter().enumerate() {
                for _ in 0..width {
                    f(i * NUMBERS + number, [kind, number], i * OUTPUTS, self.rates[kind]);
                    number += 1;
                }
            }
        }
    }
}

/// Logarithm of the largest gain.
const REACH: f32 = 1.5;
/// Rates that a change of one number goes beside Adam's direction, at most.
const FARTHEST: f32 = 3.0;

fn gain(x: f32) -> f32 {
    Real::exp(REACH * Real::tanh(x))
}

fn tamed(x: f32) -> f32 {
    FARTHEST * Real::tanh(x * (1.0 / FARTHEST))
}

fn bounded(x: f32) -> f32 {
    x.clamp(-8.0, 8.0)
}

/// First of the features of gradients: for each kind the logarithm of their root mean square, the size of Adam's
/// direction, the agreement of the last gradient with their mean; then whether the photo saw the Gaussian.
const SIZES: usize = 3 * NUMBERS + 12;

#[inline(always)]
fn fill(place: &Place, directions: &mut [Vec<f32>; 3], features: &mut [f32]) {
    let population = &place.population;
    let t = place.step as f32 + 1.0;
    let over = [1.0 / (1.0 - 0.9f32.powf(t)), 1.0 / (1.0 - 0.999f32.powf(t))];
    let steps = place.settings.steps as f32;
    let pixel = 1.0 / place.context[0].camera.intrinsics.fx as f32;
    let shared = [
        place.step as f32 / steps,
        steps.ln() / 6.0,
        t.ln() / 6.0,
        (place.mse.max(1e-6).ln() * 0.2) as f32 + 1.0,
        place.per_pixel,
    ];
    let room = population.sh.width();
    let fields = [
        &population.means,
        &population.log_scales,
        &population.quats,
        &population.logits,
        &population.sh,
        &population.sh,
    ];
    let rows: [usize; 6] = [3, 3, 4, 1, room, room];
    let from: [usize; 6] = [0, 0, 0, 0, 0, 3];
    for (i, row) in features.chunks_exact_mut(FEATURES).enumerate() {
        let (mut m, mut v, mut g) = ([0.0f32; NUMBERS], [0.0f32; NUMBERS], [0.0f32; NUMBERS]);
        let mut first = 0;
        for (kind, width) in WIDTHS.into_iter().enumerate() {
            let at = i * rows[kind] + from[kind];
            m[first..first + width].copy_from_slice(&fields[kind].first[at..at + width]);
            v[first..first + width].copy_from_slice(&fields[kind].second[at..at + width]);
            g[first..first + width].copy_from_slice(&place.gradients[kind][i * width..(i + 1) * width]);
            first += width;
        }
        let (mut u, mut r) = ([0.0f32; NUMBERS], [0.0f32; NUMBERS]);
        for c in 0..NUMBERS {
            let root = 1.0 / ((v[c] * over[1]).sqrt() + 1e-15);
            u[c] = m[c] * over[0] * root;
            r[c] = g[c] * root;
        }
        directions[0][i * NUMBERS..][..NUMBERS].copy_from_slice(&u);
        directions[2][i * NUMBERS..][..NUMBERS].copy_from_slice(&r);
        for c in 0..NUMBERS {
            row[c] = u[c].clamp(-4.0, 4.0);
            row[2 * NUMBERS + c] = r[c].clamp(-4.0, 4.0);
        }
        let mut first = 0;
        let mut visible = 0.0;
        for (kind, width) in WIDTHS.into_iter().enumerate() {
            let (mut mm, mut gg, mut mg, mut vv) = (0.0f32, 0.0f32, 0.0f32, 0.0f32);
            for c in first..first + width {
                mm += m[c] * m[c];
                gg += g[c] * g[c];
                mg += m[c] * g[c];
                vv += v[c] * over[1];
            }
            row[SIZES + kind] = Real::ln(vv.sqrt() + 1e-12);
            row[SIZES + 6 + kind] = (mm.sqrt() * over[0] / (vv.sqrt() + 1e-15)).min(3.0);
            row[SIZES + 12 + kind] = mg / ((mm * gg).sqrt() + 1e-20);
            visible = if gg > 0.0 { 1.0 } else { visible };
            first += width;
        }
        row[SIZES + 18] = visible;
        // Camera 0 stands at the origin.
        let depth = population.means.row(i)[2].max(0.05);
        let size = Real::ln(pixel * depth);
        let own = &mut row[3 * NUMBERS..SIZES];
        for (to, s) in own.iter_mut().zip(population.log_scales.row(i)) {
            *to = (s - size).clamp(-4.0, 4.0) * 0.5;
        }
        let q = population.quats.row(i);
        let length = 1.0 / q.iter().map(|x| x * x).sum::<f32>().sqrt().max(1e-12);
        own[3..7].iter_mut().zip(q).for_each(|(to, x)| *to = x * length);
        let logit = population.logits.values[i];
        own[7] = 1.0 / (1.0 + Real::exp(-logit));
        own[8] = logit * 0.2;
        own[9..12].iter_mut().zip(population.sh.row(i)).for_each(|(to, x)| *to = x * 0.282);
        row[SIZES + 19..].copy_from_slice(&shared);
    }
}

/// The state of each Gaussian `[N, STATE]`, decoded from the head's numbers.
pub fn state_of(head: &[f32]) -> Vec<f32> {
    head.chunks_exact(OUTPUTS).flat_map(|row| row[OUTPUTS - STATE..].iter().map(|x| Real::tanh(*x))).collect()
}
