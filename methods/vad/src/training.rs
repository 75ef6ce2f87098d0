//! Training in stages: encoder, encoder on labels of its own curves, experts, gate.

use crate::checkpoint::{Checkpoint, Snapshot};
use crate::detector::{Detector, EXPERT, GATE};
use crate::kmeans::{cluster_centers, nearest_center};
use crate::losses::{abnormal, bag_loss, class_loss, curve_loss};
use crate::sampler::Sampler;
use crate::splatting::Splatting;
use crate::top_k::top_k;
use crate::training_set::TrainingSet;
use crate::{Error, Result};
use std::ops::ControlFlow;
use weaver_autograd::{ParamId, Tape, Var, ops};
use weaver_kernels::random::Stream;
use weaver_nn::{AdamW, Context, Group, add_l2_gradient};

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

/// An observer of a detector's training, which may end it.
pub trait Observe {
    /// Receives the report of a step and the state of the training after it. `Break` ends training with
    /// [`Error::Stopped`].
    ///
    /// # Errors
    /// Errors that end training as well, such as a file that cannot be written.
    fn step(&mut self, report: &StepReport, snapshot: &Snapshot<'_>) -> Result<ControlFlow<()>>;
}

impl<F: FnMut(&StepReport)> Observe for F {
    fn step(&mut self, report: &StepReport, _snapshot: &Snapshot<'_>) -> Result<ControlFlow<()>> {
        self(report);
        Ok(ControlFlow::Continue(()))
    }
}

/// Trains detectors on a set of videos. The same seed gives the same bits at any number of threads, interrupted or not.
pub struct Trainer<'a> {
    /// The videos.
    pub set: &'a TrainingSet,
    /// Segments of every video after resampling.
    pub segments: usize,
    /// Videos of each half of a batch.
    pub batch: usize,
    /// Seed of the order of videos, noise and initial weights.
    pub seed: u64,
    /// Observer of every step.
    pub observe: &'a mut dyn Observe,
    /// Checkpoint to go on from: the stages before its own are passed over, since the detector has been through them.
    pub resume: Option<Checkpoint>,
}

impl std::fmt::Debug for Trainer<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { segments, batch, seed, .. } = self;
        f.debug_struct("Trainer").field("segments", segments).field("batch", batch).field("seed", seed).finish()
    }
}

/// A batch on the tape: videos `[2 b, T, features]`, the normal half first.
struct Batch<'t> {
    x: Var<'t, f32>,
    /// `[2 b, classes]`.
    classes: Var<'t, f32>,
}

impl Trainer<'_> {
    /// Trains the encoder by its own loss, its heads by the classes and, with labels, its curve by the labels.
    ///
    /// # Errors
    /// When features cannot be read or the loss is no longer finite.
    pub fn encoder(&mut self, detector: &mut Detector, stage: &Stage, labels: Labels) -> Result<()> {
        let encoder = detector.encoder.clone();
        let name = if labels == Labels::None { "encoder" } else { "encoder on labels" };
        let stream = |seed, step| Stream::new(seed, step as u64, name);
        let (seed, dropout) = (self.seed, stage.dropout);
        let everyone = self.set.abnormal();
        let trained = |name: &str| !name.starts_with(EXPERT) && !name.starts_with(GATE);
        self.run(detector, (name, stage), everyone, trained, |cx, batch, step| {
            let (encoded, mut loss) = encoder.train(cx, batch.x, stream(seed, step), dropout);
            if let Some(scores) = encoded.class_scores {
                loss = loss + class_loss(scores, batch.classes);
            }
            if labels != Labels::None {
                loss = loss + curve_loss(encoded.scores, labels.of(abnormal(encoded.scores)).as_deref());
            }
            loss
        })
    }

    /// Adds an expert for each group of abnormal videos and trains it on these and all normal ones; the encoder stays.
    /// In the first epoch over a group's videos there are no labels of snippets.
    ///
    /// # Errors
    /// As [`encoder`](Self::encoder).
    pub fn experts(
        &mut self,
        detector: &mut Detector,
        groups: &[(String, Vec<usize>)],
        stage: &Stage,
        labels: Labels,
    ) -> Result<()> {
        let names: Vec<String> = groups.iter().map(|(name, _)| name.clone()).collect();
        match &self.resume {
            // A checkpoint's detector has its experts.
            Some(checkpoint) if detector.names != names => return Err(checkpoint.wrong_stage()),
            Some(_) => {}
            None => detector.add_experts(names, self.seed),
        }
        for (e, (name, videos)) in groups.iter().enumerate() {
            let (encoder, expert) = (detector.encoder.clone(), detector.experts[e].clone());
            let first_round = videos.len().div_ceil(self.batch);
            let scope = format!("{EXPERT}{e}.");
            let stage = (format!("expert {name}"), stage);
            self.run(
                detector,
                (&stage.0, stage.1),
                videos.clone(),
                |name| name.starts_with(&scope),
                |cx, batch, step| {
                    let features = cx.tape.without_gradient(|| encoder.encode(cx, batch.x).features);
                    curve_stage_loss(expert.forward(cx, features), labels, step >= first_round)
                },
            )?;
        }
        Ok(())
    }

    /// Adds a gate and trains it; encoder and experts stay.
    ///
    /// # Errors
    /// As [`encoder`](Self::encoder).
    pub fn gate(&mut self, detector: &mut Detector, stage: &Stage, labels: Labels) -> Result<()> {
        if self.resume.is_none() {
            detector.add_gate(self.seed);
        }
        if detector.gate.is_none() {
            return self.resume.as_ref().map_or(Ok(()), |checkpoint| Err(checkpoint.wrong_stage()));
        }
        let all = detector.clone();
        let everyone = self.set.abnormal();
        let first_round = everyone.len().div_ceil(self.batch);
        self.run(
            detector,
            ("gate", stage),
            everyone,
            |name| name.starts_with(GATE),
            |cx, batch, step| {
                let (features, experts) = cx.tape.without_gradient(|| {
                    let features = all.encoder.encode(cx, batch.x).features;
                    (features, all.expert_scores(cx, features, None))
                });
                let (Some(gate), Some(experts)) = (&all.gate, experts) else { return cx.tape.scalar(0.0) };
                curve_stage_loss(gate.forward(cx, features, experts), labels, step >= first_round)
            },
        )
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

    /// Steps of Adam on the parameters selected by `trained`, each on a batch of all normal and the given abnormal
    /// videos.
    fn run(
        &mut self,
        detector: &mut Detector,
        (name, stage): (&str, &Stage),
        videos: Vec<usize>,
        trained: impl Fn(&str) -> bool,
        loss: impl for<'t> Fn(Context<'t, '_>, &Batch<'t>, usize) -> Var<'t, f32>,
    ) -> Result<()> {
        if self.resume.as_ref().is_some_and(|checkpoint| checkpoint.stage != name) {
            return Ok(());
        }
        let params = &mut detector.params;
        let ids: Vec<ParamId> = params.iter().filter(|(_, param)| trained(param.name())).map(|(id, _)| id).collect();
        params.ids().for_each(|id| params.set_frozen(id, !ids.contains(&id)));
        let group = Group { params: ids.clone(), lr_scale: 1.0, weight_decay: stage.decay };
        let mut optimizer = AdamW::new(vec![group], 0.9, 0.999, 1e-8);
        let mut normal = Sampler::new(self.set.samples(&self.set.normal()), self.seed, &format!("{name}.normal"));
        let mut abnormal = Sampler::new(self.set.samples(&videos), self.seed, &format!("{name}.abnormal"));
        let mut done = 0;
        if let Some(checkpoint) = self.resume.take() {
            done = checkpoint.step;
            checkpoint.restore(params, &mut optimizer)?;
            (0..done).for_each(|_| {
                normal.next(self.batch);
                abnormal.next(self.batch);
            });
        }
        let mut tape = Tape::<f32>::new();
        for step in done..stage.steps {
            let halves = normal.next(self.batch).into_iter().chain(abnormal.next(self.batch));
            let chosen: Vec<(usize, usize)> = halves.collect();
            let mut x = Vec::with_capacity(chosen.len() * self.segments * self.set.width());
            for (video, crop) in &chosen {
                x.extend(self.set.bag(*video, *crop, self.segments)?);
            }
            let classes = self.set.class_labels(chosen.iter().map(|(video, _)| *video));
            let batch = Batch {
                x: tape.constant(&x, [chosen.len(), self.segments, self.set.width()]),
                classes: tape.constant(&classes, [chosen.len(), self.set.classes.len()]),
            };
            let value = loss(Context::new(&tape, &detector.params), &batch, step);
            let reached = f64::from(value.item());
            if !reached.is_finite() {
                return Err(Error::Diverged { stage: name.to_string(), step: step + 1 });
            }
            value.backward();
            if stage.l2 > 0.0 {
                add_l2_gradient(&detector.params, &mut tape, stage.l2);
            }
            optimizer.step(&mut detector.params, &mut tape, stage.rate);
            tape.reset();
            let report = StepReport { stage: name.to_string(), step: step + 1, steps: stage.steps, loss: reached };
            let snapshot = Snapshot { detector, optimizer: &optimizer, stage: name, step: step + 1 };
            if self.observe.step(&report, &snapshot)?.is_break() {
                return Err(Error::Stopped { stage: report.stage, step: report.step });
            }
        }
        let params = &mut detector.params;
        params.ids().for_each(|id| params.set_frozen(id, false));
        Ok(())
    }
}

/// The splatting loss of experts and gate.
fn curve_stage_loss<'t>(scores: Var<'t, f32>, labels: Labels, labeled: bool) -> Var<'t, f32> {
    let labels = if labeled { labels.of(abnormal(scores)) } else { None };
    bag_loss(scores) + curve_loss(scores, labels.as_deref())
}
