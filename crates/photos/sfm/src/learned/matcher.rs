//! LighterGlue: a transformer that looks at the keypoints of two photos together.

use super::assignment::{Side, assigned};
use super::weights::{Reader, WeightsFault};
use super::{LEARNED_DESCRIPTOR, LearnedFeatures, LearnedMatch};
use weaver_kernels::attention::{AttentionInputs, AttentionShape, Strides, attention_forward};
use weaver_kernels::gelu::gelu_forward;
use weaver_kernels::gemm::{Mat, MatMut, gemm};
use weaver_kernels::layer_norm::layer_norm_forward;
use weaver_kernels::parallel::fill_rows;

/// Numbers of a keypoint's state, and layers.
const WIDTH: usize = 96;
const LAYERS: usize = 6;
/// Keypoints that are less likely than this to have a match take no part in further layers.
const MATCHABLE: f32 = 0.05;
/// Added to variances in normalizations.
const EPSILON: f32 = 1e-5;

/// y = x W^T + b.
#[derive(Clone, Debug)]
struct Linear {
    outputs: usize,
    inputs: usize,
    weight: Vec<f32>,
    bias: Vec<f32>,
}

impl Linear {
    fn read(reader: &Reader<'_>, name: &str, [outputs, inputs]: [usize; 2]) -> Result<Self, WeightsFault> {
        let weight = reader.get(&format!("{name}.weight"), &[outputs, inputs])?;
        let bias = reader.get(&format!("{name}.bias"), &[outputs])?;
        Ok(Self { outputs, inputs, weight, bias })
    }

    /// Every third output, beginning with `first`.
    fn third(&self, first: usize) -> Self {
        let rows = self.weight.chunks_exact(self.inputs).skip(first).step_by(3);
        let bias = self.bias.iter().skip(first).step_by(3).copied().collect();
        Self { outputs: self.outputs / 3, inputs: self.inputs, weight: rows.flatten().copied().collect(), bias }
    }

    fn forward(&self, x: &[f32]) -> Vec<f32> {
        let n = x.len() / self.inputs;
        let mut y = vec![0.0; n * self.outputs];
        fill_rows(&self.bias, &mut y);
        let weight = Mat::new(&self.weight, self.outputs, self.inputs).transposed();
        gemm(1.0, Mat::new(x, n, self.inputs), weight, 1.0, MatMut::new(&mut y, n, self.outputs));
        y
    }
}

/// Adds to states what two layers make of each together with its message.
#[derive(Clone, Debug)]
struct Update {
    first: Linear,
    norm: [Vec<f32>; 2],
    last: Linear,
}

impl Update {
    fn read(reader: &Reader<'_>, name: &str) -> Result<Self, WeightsFault> {
        let norm = |kind: &str| reader.get(&format!("{name}.1.{kind}"), &[2 * WIDTH]);
        Ok(Self {
            first: Linear::read(reader, &format!("{name}.0"), [2 * WIDTH, 2 * WIDTH])?,
            norm: [norm("weight")?, norm("bias")?],
            last: Linear::read(reader, &format!("{name}.3"), [WIDTH, 2 * WIDTH])?,
        })
    }

    fn apply(&self, states: &mut [f32], messages: &[f32]) {
        let both = states.chunks_exact(WIDTH).zip(messages.chunks_exact(WIDTH));
        let both: Vec<f32> = both.flat_map(|(state, message)| state.iter().chain(message).copied()).collect();
        let hidden = self.first.forward(&both);
        let mut normed = both;
        let [weight, bias] = &self.norm;
        let mut stats = vec![0.0; 2 * (hidden.len() / weight.len())];
        layer_norm_forward(weight.len(), EPSILON, &hidden, Some((weight, bias)), &mut normed, &mut stats);
        let mut bent = hidden;
        gelu_forward(&normed, &mut bent);
        states.iter_mut().zip(self.last.forward(&bent)).for_each(|(state, more)| *state += more);
    }
}

/// softmax(q k^T / sqrt(96)) v.
fn attended(q: &[f32], k: &[f32], v: &[f32]) -> Vec<f32> {
    let (queries, keys) = (q.len() / WIDTH, k.len() / WIDTH);
    let shape = AttentionShape { batch: 1, heads: 1, queries, keys, dim: WIDTH };
    let at = |tokens: usize| Strides::tokens_first(tokens, 1, WIDTH);
    let scale = 1.0 / (WIDTH as f32).sqrt();
    let inputs = AttentionInputs { shape, scale, q: (q, at(queries)), k: (k, at(keys)), v: (v, at(keys)) };
    let (mut out, mut logs) = (vec![0.0; q.len()], vec![0.0; queries]);
    attention_forward(&inputs, (&mut out, at(queries)), &mut logs);
    out
}

/// A layer: the keypoints of each photo look at one another, then at the other photo's.
#[derive(Clone, Debug)]
struct Layer {
    /// Queries, keys and values within a photo.
    own: [Linear; 3],
    own_out: Linear,
    own_update: Update,
    /// Queries that are keys as well, and values, between photos.
    cross: [Linear; 2],
    cross_out: Linear,
    cross_update: Update,
}

impl Layer {
    fn read(reader: &Reader<'_>, name: &str) -> Result<Self, WeightsFault> {
        let square = |part: &str| Linear::read(reader, &format!("{name}.{part}"), [WIDTH, WIDTH]);
        let together = Linear::read(reader, &format!("{name}.self_attn.Wqkv"), [3 * WIDTH, WIDTH])?;
        Ok(Self {
            own: [0, 1, 2].map(|first| together.third(first)),
            own_out: square("self_attn.out_proj")?,
            own_update: Update::read(reader, &format!("{name}.self_attn.ffn"))?,
            cross: [square("cross_attn.to_qk")?, square("cross_attn.to_v")?],
            cross_out: square("cross_attn.to_out")?,
            cross_update: Update::read(reader, &format!("{name}.cross_attn.ffn"))?,
        })
    }

    fn forward(&self, photos: &mut [States; 2]) {
        for photo in photos.iter_mut() {
            let [mut q, mut k, v] = [0, 1, 2].map(|i| self.own[i].forward(&photo.values));
            photo.turn(&mut q);
            photo.turn(&mut k);
            let message = self.own_out.forward(&attended(&q, &k, &v));
            self.own_update.apply(&mut photo.values, &message);
        }
        let [a, b] = [0, 1].map(|i| [0, 1].map(|k| self.cross[k].forward(&photos[i].values)));
        let messages = [attended(&a[0], &b[0], &b[1]), attended(&b[0], &a[0], &a[1])];
        for (photo, message) in photos.iter_mut().zip(messages) {
            self.cross_update.apply(&mut photo.values, &self.cross_out.forward(&message));
        }
    }
}

/// The states of the keypoints of a photo.
#[derive(Clone, Debug)]
struct States {
    /// `[n, 96]`.
    values: Vec<f32>,
    /// Cosines and sines of each keypoint's place `[n, 48]`, by which pairs of numbers are turned.
    turns: [Vec<f32>; 2],
    /// Numbers of the keypoints.
    numbers: Vec<u32>,
}

impl States {
    /// Turns pairs of neighboring numbers by the places of the keypoints.
    fn turn(&self, values: &mut [f32]) {
        let turns = self.turns[0].iter().zip(&self.turns[1]);
        for (pair, (cos, sin)) in values.chunks_exact_mut(2).zip(turns) {
            (pair[0], pair[1]) = (pair[0] * cos - pair[1] * sin, pair[1] * cos + pair[0] * sin);
        }
    }

    /// Keeps some keypoints.
    fn keep(&mut self, kept: &[bool]) {
        let filter = |values: &mut Vec<f32>, width: usize| {
            let rows = values.chunks_exact(width).zip(kept).filter(|(_, kept)| **kept);
            *values = rows.flat_map(|(row, _)| row.iter().copied()).collect();
        };
        filter(&mut self.values, WIDTH);
        self.turns.iter_mut().for_each(|turns| filter(turns, WIDTH / 2));
        let mut kept = kept.iter();
        self.numbers.retain(|_| *kept.next().expect("one flag for each"));
    }
}

/// The network.
#[derive(Clone, Debug)]
pub(super) struct Matcher {
    input: Linear,
    /// `[48, 2]`.
    places: Vec<f32>,
    layers: Vec<Layer>,
    /// Probability that a keypoint has a match, after each layer.
    matchable: Vec<Linear>,
    last: Linear,
}

impl Matcher {
    pub fn read(reader: &Reader<'_>) -> Result<Self, WeightsFault> {
        let assignment = |i: usize, part: &str| format!("matcher.log_assignment.{i}.{part}");
        Ok(Self {
            input: Linear::read(reader, "matcher.input_proj", [WIDTH, LEARNED_DESCRIPTOR])?,
            places: reader.get("matcher.posenc.Wr.weight", &[WIDTH / 2, 2])?,
            layers: (0..LAYERS)
                .map(|i| Layer::read(reader, &format!("matcher.transformers.{i}")))
                .collect::<Result<_, _>>()?,
            matchable: (0..LAYERS)
                .map(|i| Linear::read(reader, &assignment(i, "matchability"), [1, WIDTH]))
                .collect::<Result<_, _>>()?,
            last: Linear::read(reader, &assignment(LAYERS - 1, "final_proj"), [WIDTH, WIDTH])?,
        })
    }

    /// See [`LearnedMatcher::matches`](super::LearnedMatcher::matches).
    pub fn matches(&self, first: &LearnedFeatures, second: &LearnedFeatures, least: f32) -> Vec<LearnedMatch> {
        let mut photos = [self.states(first), self.states(second)];
        for (i, layer) in self.layers.iter().enumerate() {
            if photos.iter().any(|photo| photo.numbers.is_empty()) {
                return Vec::new();
            }
            layer.forward(&mut photos);
            if i + 1 < LAYERS {
                for photo in &mut photos {
                    let logits = self.matchable[i].forward(&photo.values);
                    let kept: Vec<bool> = logits.iter().map(|x| 1.0 / (1.0 + (-x).exp()) > MATCHABLE).collect();
                    photo.keep(&kept);
                }
            }
        }
        let [a, b] = photos.map(|photo| Side {
            logits: self.matchable[LAYERS - 1].forward(&photo.values),
            states: self.last.forward(&photo.values),
            numbers: photo.numbers,
        });
        assigned(&a, &b, least)
    }

    fn states(&self, features: &LearnedFeatures) -> States {
        let [height, width] = features.size.map(|side| side as f32);
        let half = height.max(width) / 2.0;
        let place = |[x, y]: &[f32; 2]| [(x - width / 2.0) / half, (y - height / 2.0) / half];
        let angles: Vec<f32> = (features.points.iter().map(place))
            .flat_map(|[x, y]| self.places.chunks_exact(2).map(move |w| x * w[0] + y * w[1]))
            .collect();
        States {
            values: self.input.forward(&features.descriptors),
            turns: [angles.iter().map(|x| x.cos()).collect(), angles.iter().map(|x| x.sin()).collect()],
            numbers: (0..features.points.len() as u32).collect(),
        }
    }
}
