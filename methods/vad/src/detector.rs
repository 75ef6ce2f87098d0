//! A detector of anomalies: an encoder and, after the later stages of training, experts and their gate.

use crate::encoded::Encoded;
use crate::encoder::{Encoder, EncoderKind};
use crate::expert::{Expert, ExpertSizes};
use crate::gate::{Gate, GateSizes};
use crate::{Error, Features, Result};
use std::path::Path;
use weaver_autograd::{Params, Real, Tape, Var, ops};
use weaver_nn::{Builder, Context};

/// Scope of the parameters of experts and gate; all others are the encoder's.
pub(crate) const EXPERT: &str = "expert";
pub(crate) const GATE: &str = "gate";

/// An encoder, experts and a gate, with their parameters.
#[derive(Clone, Debug)]
pub struct Detector {
    pub(crate) params: Params<f32>,
    pub(crate) kind: EncoderKind,
    pub(crate) encoder: Encoder,
    pub(crate) experts: Vec<Expert>,
    /// Category of each expert.
    pub(crate) names: Vec<String>,
    pub(crate) gate: Option<Gate>,
    /// True if experts and gate are as published.
    pub(crate) published: bool,
}

/// The curves of a video, each with a score for every snippet.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curves {
    /// The encoder's curve.
    pub encoder: Vec<f32>,
    /// Curves of the encoder's heads for classes.
    pub classes: Vec<Vec<f32>>,
    /// Curves of the experts.
    pub experts: Vec<Vec<f32>>,
    /// The gate's curve.
    pub gate: Option<Vec<f32>>,
}

impl Curves {
    /// The final curve: the gate's if there is one, else the encoder's.
    pub fn scores(&self) -> &[f32] {
        self.gate.as_deref().unwrap_or(&self.encoder)
    }
}

/// Scores of experts and gate on a batch.
#[derive(Clone, Debug)]
pub(crate) struct Judged<'t, T: Real> {
    pub encoded: Encoded<'t, T>,
    /// `[B, T, experts]`.
    pub experts: Option<Var<'t, T>>,
    /// `[B, T]`.
    pub gate: Option<Var<'t, T>>,
}

impl Detector {
    /// An encoder with initial weights, without experts.
    pub fn new(kind: EncoderKind, seed: u64) -> Self {
        let mut params = Params::new();
        let encoder = Encoder::new(Builder::new(&mut params, seed), &kind);
        Self { params, kind, encoder, experts: Vec::new(), names: Vec::new(), gate: None, published: false }
    }

    /// The detector with experts and gate as published: with attention in their blocks, and a gate without residual
    /// paths. Either lets a curve depend on the whole video at every snippet; on planted anomalies it then separates
    /// videos, not snippets.
    ///
    /// # Panics
    /// When there are experts already.
    #[must_use]
    pub fn with_published_experts(mut self) -> Self {
        assert!(self.experts.is_empty(), "there are experts already");
        self.published = true;
        self
    }

    /// Adds an expert for each name, with initial weights, and no gate yet.
    ///
    /// # Panics
    /// When there are experts already.
    pub fn add_experts(&mut self, names: Vec<String>, seed: u64) {
        assert!(self.experts.is_empty(), "experts are added once");
        let sizes = if self.published { ExpertSizes::published } else { ExpertSizes::local }(self.width());
        for e in 0..names.len() {
            let mut builder = Builder::new(&mut self.params, seed);
            self.experts.push(Expert::new(builder.scope(format!("{EXPERT}{e}")), &sizes));
        }
        self.names = names;
    }

    /// Adds a gate with initial weights.
    ///
    /// # Panics
    /// When there is one already.
    pub fn add_gate(&mut self, seed: u64) {
        assert!(self.gate.is_none(), "a gate is added once");
        let sizes = if self.published { GateSizes::published } else { GateSizes::local };
        let sizes = sizes(self.width(), self.experts.len());
        self.gate = Some(Gate::new(Builder::new(&mut self.params, seed).scope(GATE), &sizes));
    }

    /// Lets every parameter be trained.
    pub(crate) fn thaw(&mut self) {
        let params = &mut self.params;
        params.ids().for_each(|id| params.set_frozen(id, false));
    }

    /// The encoder's kind and sizes.
    pub fn kind(&self) -> &EncoderKind {
        &self.kind
    }

    /// Categories of its experts.
    pub fn experts(&self) -> &[String] {
        &self.names
    }

    /// Its parameters.
    pub fn params(&self) -> &Params<f32> {
        &self.params
    }

    /// Numbers of the task-aware features.
    fn width(&self) -> usize {
        match self.kind {
            EncoderKind::UrDmu(sizes) => sizes.task_aware(),
            EncoderKind::Convolutions(sizes) => sizes.width,
            EncoderKind::DeepMil(sizes) => sizes.hidden[1],
            EncoderKind::Rtfm(sizes) => sizes.features,
        }
    }

    /// The curves of a video at its full length, means over its crops.
    ///
    /// # Errors
    /// When a number of the features is not finite, or so large that scores are not.
    ///
    /// # Panics
    /// When the features and the encoder differ in width.
    pub fn curves(&self, features: &Features) -> Result<Curves> {
        self.curves_without(features, None)
    }

    /// The curves with the input of one expert to the gate set to 0.
    ///
    /// # Errors
    /// As [`curves`](Self::curves).
    ///
    /// # Panics
    /// As [`curves`](Self::curves).
    pub fn curves_without(&self, features: &Features, masked: Option<usize>) -> Result<Curves> {
        let snippets = features.snippets();
        let mut sum = Curves::default();
        let mut tape = Tape::<f32>::new();
        for c in 0..features.crops() {
            let crop = features.crop(c)?;
            let one = tape.without_gradient(|| {
                let x = tape.constant(&crop, [1, snippets, features.width()]);
                let judged = self.judge(Context::new(&tape, &self.params), x, masked);
                Curves {
                    encoder: judged.encoded.scores.to_vec(),
                    classes: judged.encoded.class_scores.map_or(Vec::new(), columns),
                    experts: judged.experts.map_or(Vec::new(), columns),
                    gate: judged.gate.map(|gate| gate.to_vec()),
                }
            });
            tape.reset();
            add(&mut sum, one);
        }
        let share = 1.0 / features.crops() as f32;
        let Curves { encoder, classes, experts, gate } = &mut sum;
        let all = [encoder].into_iter().chain(classes).chain(experts).chain(gate.iter_mut());
        all.flatten().for_each(|score| *score *= share);
        if sum.scores().iter().any(|score| !score.is_finite()) {
            let path = features.path().unwrap_or(Path::new("features"));
            return Err(Error::invalid(
                path,
                "scores",
                "finite numbers",
                "none, as numbers of the features are too large",
            ));
        }
        Ok(sum)
    }

    /// Scores of x `[B, T, features]`.
    pub(crate) fn judge<'t>(&self, cx: Context<'t, '_>, x: Var<'t, f32>, masked: Option<usize>) -> Judged<'t, f32> {
        let encoded = cx.tape.steps(|| self.encoder.encode(cx, x)).end();
        let experts = self.expert_scores(cx, encoded.features, masked);
        let gate = self.gate.as_ref().zip(experts).map(|(gate, experts)| gate.forward(cx, encoded.features, experts));
        Judged { encoded, experts, gate }
    }

    /// Scores of all experts, `[B, T, experts]`, from features `[B, T, width]`; `None` without experts.
    pub(crate) fn expert_scores<'t>(
        &self,
        cx: Context<'t, '_>,
        features: Var<'t, f32>,
        masked: Option<usize>,
    ) -> Option<Var<'t, f32>> {
        let shape = features.shape();
        let scores = self.experts.iter().enumerate().map(|(e, expert)| {
            let scores = cx.tape.steps(|| expert.forward(cx, features)).end();
            let scores = if masked == Some(e) { scores * 0.0 } else { scores };
            scores.reshape([shape[0], shape[1], 1])
        });
        let scores: Vec<_> = scores.collect();
        (!scores.is_empty()).then(|| ops::concat(&scores, 2))
    }
}

/// The columns of `[1, T, C]`.
fn columns(x: Var<'_, f32>) -> Vec<Vec<f32>> {
    let (values, count) = (x.value(), x.shape().last());
    (0..count).map(|c| values.iter().skip(c).step_by(count).copied().collect()).collect()
}

/// Adds curves to the sum of earlier ones, which is empty at first.
fn add(sum: &mut Curves, one: Curves) {
    if sum.encoder.is_empty() {
        *sum = one;
        return;
    }
    let plus = |sum: &mut Vec<f32>, one: &[f32]| sum.iter_mut().zip(one).for_each(|(sum, x)| *sum += x);
    plus(&mut sum.encoder, &one.encoder);
    sum.classes.iter_mut().zip(&one.classes).for_each(|(sum, one)| plus(sum, one));
    sum.experts.iter_mut().zip(&one.experts).for_each(|(sum, one)| plus(sum, one));
    if let (Some(sum), Some(one)) = (&mut sum.gate, &one.gate) {
        plus(sum, one);
    }
}
