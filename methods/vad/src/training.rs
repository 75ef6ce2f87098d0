//! Training in stages: encoder, encoder on labels of its own curves, experts, gate.

use crate::detector::{Detector, EXPERT, GATE};
use crate::kmeans::{cluster_centers, nearest_center};
use crate::losses::{abnormal, bag_loss, class_loss, curve_loss};
use crate::sampler::Sampler;
use crate::splatting::Splatting;
use crate::top_k::top_k;
use crate::training_set::TrainingSet;
use crate::{Error, Result};
use std::collections::BTreeMap;
use weaver_autograd::{ParamId, Params, Tape, Var, ops};
use weaver_kernels::random::Stream;
use weaver_nn::{AdamW, Context, Group, Moments, Optimizer, add_l2_gradient};

/// Labels of the snippets of abnormal videos, from the trained curve itself; constant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Labels {
    /// No labels of snippets, only of bags.
    None,
    /// Gaussians at the curve's peaks.
    Splat(Splatting),
    /// The curve itself.
    Scores,
    /// 1 at snippets with a score above this, else 0.
    Above(f64),
}

impl Labels {
    /// Labels of `scores` `[b, T]`.
    fn of(self, scores: Var<'_, f32>) -> Option<Vec<f32>> {
        let values = scores.value();
        let each = |f: &dyn Fn(f32) -> f32| Some(values.iter().map(|s| f(*s)).collect());
        match self {
            Self::None => None,
            Self::Scores => each(&|s| s),
            Self::Above(least) => each(&|s| f32::from(u8::from(f64::from(s) > least))),
            Self::Splat(splatting) => {
                let rows = values.chunks_exact(scores.shape()[1]).flat_map(|row| {
                    let row: Vec<f64> = row.iter().map(|s| f64::from(*s)).collect();
                    splatting.labels(&row)
                });
                Some(rows.map(|y| y as f32).collect())
            }
        }
    }
}

/// Training of one part of a detector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stage {
    /// Steps.
    pub steps: usize,
    /// Learning rate of Adam.
    pub rate: f64,
    /// L2 penalty within the gradient.
    pub l2: f64,
    /// Decoupled weight decay.
    pub decay: f64,
    /// Share of numbers that dropout removes, for networks with dropout.
    pub dropout: f64,
}

/// Report of one step.
#[derive(Clone, Debug, PartialEq)]
pub struct StepReport {
    /// The stage.
    pub stage: String,
    /// Finished steps of the stage.
    pub step: usize,
    /// Steps of the stage in all.
    pub steps: usize,
    /// The loss of the step.
    pub loss: f64,
}

/// Trains parts of detectors on a set of videos. The same seed gives the same bits at any number of threads.
#[derive(Clone, Copy, Debug)]
pub struct Trainer<'a> {
    /// The videos.
    pub set: &'a TrainingSet,
    /// Segments of every video after resampling.
    pub segments: usize,
    /// Videos of each half of a batch.
    pub batch: usize,
    /// Seed of the order of videos, noise and initial weights.
    pub seed: u64,
}

/// A batch on the tape: videos `[2 b, T, features]`, the normal half first.
struct Batch<'t> {
    x: Var<'t, f32>,
    /// `[2 b, classes]`.
    classes: Var<'t, f32>,
}

/// A part of a detector that is trained by itself.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Part {
    /// The encoder, with its heads.
    Encoder,
    /// An expert, on normal videos and its own abnormal ones.
    Expert {
        /// Number among the experts.
        number: usize,
        /// Name of its group.
        name: String,
        /// Its abnormal videos.
        videos: Vec<usize>,
    },
    /// The gate.
    Gate,
}

impl Part {
    /// Name of its stage.
    pub fn stage(&self, labels: Labels) -> String {
        match self {
            Self::Encoder if labels == Labels::None => "encoder".into(),
            Self::Encoder => "encoder on labels".into(),
            Self::Expert { name, .. } => format!("expert {name}"),
            Self::Gate => GATE_STAGE.into(),
        }
    }

    /// True for the parameters that are trained.
    fn trains(&self, name: &str) -> bool {
        match self {
            Self::Encoder => !name.starts_with(EXPERT) && !name.starts_with(GATE),
            Self::Expert { number, .. } => name.starts_with(&format!("{EXPERT}{number}.")),
            Self::Gate => name.starts_with(GATE),
        }
    }
}

/// Name of the stage of the gate.
const GATE_STAGE: &str = "gate";

/// Parts of experts for groups of abnormal videos.
pub(crate) fn expert_parts(groups: &[(String, Vec<usize>)]) -> impl Iterator<Item = Part> {
    let groups = groups.iter().cloned().enumerate();
    groups.map(|(number, (name, videos))| Part::Expert { number, name, videos })
}

/// The training of one part of a detector under way: steps of Adam, each on a batch of all normal videos and the part's
/// abnormal ones. Other parameters stay.
#[derive(Debug)]
pub(crate) struct Course {
    part: Part,
    stage: Stage,
    labels: Labels,
    name: String,
    /// Steps of the first epoch over the abnormal videos.
    first_round: usize,
    optimizer: AdamW,
    normal: Sampler,
    abnormal: Sampler,
    tape: Tape<f32>,
    step: usize,
}

impl Course {
    pub fn new(part: Part, stage: Stage, labels: Labels, trainer: Trainer<'_>, params: &mut Params<f32>) -> Self {
        let Trainer { set, batch, seed, .. } = trainer;
        let name = part.stage(labels);
        let ids: Vec<ParamId> =
            params.iter().filter(|(_, param)| part.trains(param.name())).map(|(id, _)| id).collect();
        params.ids().for_each(|id| params.set_frozen(id, !ids.contains(&id)));
        let group = Group { params: ids, lr_scale: 1.0, weight_decay: stage.decay };
        let optimizer = AdamW::new(vec![group], 0.9, 0.999, 1e-8);
        let videos = match &part {
            Part::Expert { videos, .. } => videos.clone(),
            _ => set.abnormal(),
        };
        let normal = Sampler::new(set.samples(&set.normal()), seed, &format!("{name}.normal"));
        let abnormal = Sampler::new(set.samples(&videos), seed, &format!("{name}.abnormal"));
        let (first_round, tape) = (videos.len().div_ceil(batch), Tape::new());
        Self { part, stage, labels, name, first_round, optimizer, normal, abnormal, tape, step: 0 }
    }

    /// Goes to a step of an earlier course, with its optimizer's state.
    pub fn restore(
        &mut self,
        step: usize,
        state: BTreeMap<String, (u64, Moments<f32>)>,
        params: &Params<f32>,
        batch: usize,
    ) -> Result<()> {
        self.optimizer.set_state(params, state)?;
        for _ in 0..step {
            self.normal.next(batch);
            self.abnormal.next(batch);
        }
        self.step = step;
        Ok(())
    }

    pub fn name(&self) -> &str {
        &self.name
    }

    pub fn steps(&self) -> usize {
        self.stage.steps
    }

    pub fn steps_done(&self) -> usize {
        self.step
    }

    pub fn optimizer(&self) -> &AdamW {
        &self.optimizer
    }

    pub fn is_done(&self) -> bool {
        self.step == self.stage.steps
    }

    /// Does the next step.
    pub fn step(&mut self, trainer: Trainer<'_>, detector: &mut Detector) -> Result<StepReport> {
        let Trainer { set, segments, batch, seed } = trainer;
        let halves = self.normal.next(batch).into_iter().chain(self.abnormal.next(batch));
        let chosen: Vec<(usize, usize)> = halves.collect();
        let mut x = Vec::with_capacity(chosen.len() * segments * set.width());
        for (video, crop) in &chosen {
            x.extend(set.bag(*video, *crop, segments)?);
        }
        let classes = set.class_labels(chosen.iter().map(|(video, _)| *video));
        let batch = Batch {
            x: self.tape.constant(&x, [chosen.len(), segments, set.width()]),
            classes: self.tape.constant(&classes, [chosen.len(), set.classes.len()]),
        };
        let value = self.loss(Context::new(&self.tape, &detector.params), detector, &batch, seed);
        let loss = f64::from(value.item());
        if !loss.is_finite() {
            return Err(Error::Diverged { stage: self.name.clone(), step: self.step + 1 });
        }
        value.backward();
        if self.stage.l2 > 0.0 {
            add_l2_gradient(&detector.params, &mut self.tape, self.stage.l2);
        }
        self.optimizer.step(&mut detector.params, &mut self.tape, self.stage.rate);
        self.tape.reset();
        self.step += 1;
        Ok(StepReport { stage: self.name.clone(), step: self.step, steps: self.stage.steps, loss })
    }

    fn loss<'t>(&self, cx: Context<'t, '_>, detector: &Detector, batch: &Batch<'t>, seed: u64) -> Var<'t, f32> {
        let Self { labels, step, stage, .. } = self;
        // In the first epoch over a group's videos there are no labels of snippets.
        let labeled = *step >= self.first_round;
        match &self.part {
            Part::Encoder => {
                let stream = Stream::new(seed, *step as u64, &self.name);
                let (encoded, mut loss) = detector.encoder.train(cx, batch.x, stream, stage.dropout);
                if let Some(scores) = encoded.class_scores {
                    loss = loss + class_loss(scores, batch.classes);
                }
                if *labels != Labels::None {
                    loss = loss + curve_loss(encoded.scores, labels.of(abnormal(encoded.scores)).as_deref());
                }
                loss
            }
            Part::Expert { number, .. } => {
                let features = cx.tape.without_gradient(|| detector.encoder.encode(cx, batch.x).features);
                curve_stage_loss(detector.experts[*number].forward(cx, features), *labels, labeled)
            }
            Part::Gate => {
                let (features, experts) = cx.tape.without_gradient(|| {
                    let features = detector.encoder.encode(cx, batch.x).features;
                    (features, detector.expert_scores(cx, features, None))
                });
                let (Some(gate), Some(experts)) = (&detector.gate, experts) else { return cx.tape.scalar(0.0) };
                curve_stage_loss(gate.forward(cx, features, experts), *labels, labeled)
            }
        }
    }
}

/// Observer of every step.
type Observe<'a> = &'a mut dyn FnMut(&StepReport);

impl Trainer<'_> {
    /// Trains the encoder by its own loss, its heads by the classes and, with labels, its curve by the labels;
    /// `observe` is called after every step.
    ///
    /// # Errors
    /// When features cannot be read or the loss is no longer finite.
    pub fn encoder(self, detector: &mut Detector, stage: &Stage, labels: Labels, observe: Observe<'_>) -> Result<()> {
        self.run(detector, (Part::Encoder, stage), labels, observe)
    }

    /// Adds an expert for each group of abnormal videos and trains it on these and all normal ones; the encoder stays.
    /// In the first epoch over a group's videos there are no labels of snippets.
    ///
    /// # Errors
    /// As [`encoder`](Self::encoder).
    pub fn experts(
        self,
        detector: &mut Detector,
        groups: &[(String, Vec<usize>)],
        stage: &Stage,
        labels: Labels,
        observe: Observe<'_>,
    ) -> Result<()> {
        detector.add_experts(groups.iter().map(|(name, _)| name.clone()).collect(), self.seed);
        expert_parts(groups).try_for_each(|part| self.run(detector, (part, stage), labels, observe))
    }

    /// Adds a gate and trains it; encoder and experts stay.
    ///
    /// # Errors
    /// As [`encoder`](Self::encoder).
    pub fn gate(self, detector: &mut Detector, stage: &Stage, labels: Labels, observe: Observe<'_>) -> Result<()> {
        detector.add_gate(self.seed);
        self.run(detector, (Part::Gate, stage), labels, observe)
    }

    fn run(
        self,
        detector: &mut Detector,
        (part, stage): (Part, &Stage),
        labels: Labels,
        observe: Observe<'_>,
    ) -> Result<()> {
        let mut course = Course::new(part, *stage, labels, self, &mut detector.params);
        while !course.is_done() {
            observe(&course.step(self, detector)?);
        }
        detector.thaw();
        Ok(())
    }

    /// Groups of abnormal videos by their classes; a video with several is in each.
    pub fn by_class(&self) -> Vec<(String, Vec<usize>)> {
        let of = |c: usize| {
            let videos = self.set.videos.iter().enumerate();
            videos.filter(|(_, video)| video.classes.contains(&c)).map(|(i, _)| i).collect()
        };
        self.set.classes.iter().enumerate().map(|(c, name)| (name.clone(), of(c))).collect()
    }

    /// At most `k` groups of abnormal videos by K-means of the mean features, of unit length, at their highest scores,
    /// independent of classes.
    ///
    /// # Errors
    /// When features cannot be read.
    pub fn by_cluster(&self, detector: &Detector, k: usize) -> Result<Vec<(String, Vec<usize>)>> {
        let videos = self.set.abnormal();
        let mut points = Vec::new();
        let mut tape = Tape::<f32>::new();
        for &video in &videos {
            let x = self.set.bag(video, 0, self.segments)?;
            points.extend(tape.without_gradient(|| {
                let x = tape.constant(&x, [1, self.segments, self.set.width()]);
                let encoded = detector.encoder.encode(Context::new(&tape, &detector.params), x);
                ops::mean_at_top_k(encoded.features, encoded.scores, top_k(self.segments)).normalize_rows(0.0).to_vec()
            }));
            tape.reset();
        }
        let width = points.len() / videos.len().max(1);
        let centers = cluster_centers(&points, width, k, self.seed);
        let mut groups = vec![Vec::new(); centers.len() / width.max(1)];
        for (point, video) in points.chunks_exact(width.max(1)).zip(videos) {
            groups[nearest_center(&centers, point)].push(video);
        }
        groups.retain(|group| !group.is_empty());
        Ok(groups.into_iter().enumerate().map(|(i, group)| (format!("cluster {i}"), group)).collect())
    }
}

/// The splatting loss of experts and gate.
fn curve_stage_loss<'t>(scores: Var<'t, f32>, labels: Labels, labeled: bool) -> Var<'t, f32> {
    let labels = if labeled { labels.of(abnormal(scores)) } else { None };
    bag_loss(scores) + curve_loss(scores, labels.as_deref())
}
