//! A whole training: its parts and their durations.

use crate::Result;
use crate::checkpoint::Checkpoint;
use crate::detector::Detector;
use crate::encoder::EncoderKind;
use crate::training::{Course, Labels, Part, Stage, StepReport, Trainer, expert_parts};
use crate::training_set::TrainingSet;
use std::collections::VecDeque;
use weaver_nn::{AdamW, Optimizer};

/// Categories of its experts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Experts {
    /// No experts: the encoder alone.
    None,
    /// One for each class.
    Classes,
    /// One for each of this number of clusters, independent of classes.
    Clusters(usize),
}

/// A training from nothing to the gate.
#[derive(Clone, Debug, PartialEq)]
pub struct Schedule {
    /// Segments of every video after resampling.
    pub segments: usize,
    /// Videos of each half of a batch.
    pub batch: usize,
    /// The encoder by itself.
    pub encoder: Stage,
    /// The encoder with labels of snippets.
    pub splatting: Stage,
    /// Each expert.
    pub expert: Stage,
    /// The gate.
    pub gate: Stage,
    /// Labels of snippets.
    pub labels: Labels,
    /// Categories of its experts.
    pub experts: Experts,
    /// Seed of everything random.
    pub seed: u64,
}

impl Schedule {
    /// UR-DMU's published training, and experts and gate by its rate (ours; their length is unpublished).
    pub fn published(labels: Labels, experts: Experts, seed: u64) -> Self {
        let encoder = Stage { steps: 3000, rate: 1e-4, l2: 5e-5, decay: 0.0, dropout: 0.5 };
        let later = Stage { steps: 1000, rate: 1e-4, l2: 0.0, decay: 0.01, dropout: 0.0 };
        let splatting = Stage { steps: 1000, ..encoder };
        Self { segments: 200, batch: 64, encoder, splatting, expert: later, gate: later, labels, experts, seed }
    }

    /// The training for the planted videos.
    pub fn planted(labels: Labels, experts: Experts, seed: u64) -> Self {
        let encoder = Stage { steps: 300, rate: 3e-3, l2: 5e-5, decay: 0.0, dropout: 0.1 };
        let expert = Stage { steps: 150, rate: 2e-3, l2: 0.0, decay: 0.01, dropout: 0.0 };
        let gate = Stage { steps: 100, rate: 5e-4, ..expert };
        let splatting = Stage { steps: 200, ..encoder };
        Self { segments: 64, batch: 12, encoder, splatting, expert, gate, labels, experts, seed }
    }

    /// The schedule with all stages longer or shorter.
    #[must_use]
    pub fn scaled(mut self, factor: f64) -> Self {
        for stage in [&mut self.encoder, &mut self.splatting, &mut self.expert, &mut self.gate] {
            stage.steps = ((stage.steps as f64 * factor).round() as usize).max(1);
        }
        self
    }

    /// Steps of the encoder, with and without labels.
    fn encoder_steps(&self) -> usize {
        self.encoder.steps + if self.labels == Labels::None { 0 } else { self.splatting.steps }
    }

    /// Steps of all stages together; an upper bound with clusters, which may be fewer.
    pub fn steps(&self, set: &TrainingSet) -> usize {
        let experts = match self.experts {
            Experts::None => return self.encoder_steps(),
            Experts::Classes => set.classes.len(),
            Experts::Clusters(k) => k,
        };
        self.encoder_steps() + experts * self.expert.steps + self.gate.steps
    }

    fn trainer<'a>(&self, set: &'a TrainingSet) -> Trainer<'a> {
        Trainer { set, segments: self.segments, batch: self.batch, seed: self.seed }
    }

    /// A training of a detector from its beginning.
    pub fn training<'a>(&'a self, set: &'a TrainingSet, kind: EncoderKind) -> Training<'a> {
        Training::new(self, set, Detector::new(kind, self.seed))
    }

    /// Trains a detector.
    ///
    /// # Errors
    /// When features cannot be read, or the loss is no longer finite.
    pub fn train(
        &self,
        set: &TrainingSet,
        kind: EncoderKind,
        observe: &mut dyn FnMut(&StepReport),
    ) -> Result<Detector> {
        let mut training = self.training(set, kind);
        while !training.is_done() {
            observe(&training.step()?);
        }
        Ok(training.into_detector())
    }
}

/// A training by a schedule, step by step.
#[derive(Debug)]
pub struct Training<'a> {
    schedule: &'a Schedule,
    set: &'a TrainingSet,
    detector: Detector,
    /// The part that is trained.
    course: Course,
    /// The parts that follow; experts and gate once their groups are known.
    left: VecDeque<(Part, Stage, Labels)>,
    /// Categories of the experts, once they are known.
    groups: Option<Vec<String>>,
    done: usize,
    total: usize,
}

impl<'a> Training<'a> {
    fn new(schedule: &'a Schedule, set: &'a TrainingSet, mut detector: Detector) -> Self {
        let Schedule { encoder, splatting, labels, .. } = *schedule;
        let labeled = (labels != Labels::None).then_some((Part::Encoder, splatting, labels));
        let groups = (schedule.experts == Experts::None).then(Vec::new);
        let course = Course::new(Part::Encoder, encoder, Labels::None, schedule.trainer(set), &mut detector.params);
        let total = schedule.steps(set);
        Self { schedule, set, detector, course, left: labeled.into_iter().collect(), groups, done: 0, total }
    }

    /// Goes on from a checkpoint of a training on the same videos by the same schedule: the result has the bits of an
    /// uninterrupted training.
    ///
    /// # Errors
    /// When features cannot be read, or the checkpoint is of another training.
    pub fn resume(
        schedule: &'a Schedule,
        set: &'a TrainingSet,
        detector: Detector,
        checkpoint: Checkpoint,
    ) -> Result<Self> {
        let mut training = Self::new(schedule, set, detector);
        while training.course.name() != checkpoint.stage {
            training.done += training.course.steps();
            training.find_groups()?;
            let Some(next) = training.left.pop_front() else { return Err(checkpoint.wrong_stage()) };
            // A checkpoint's detector has its experts, and its gate.
            let detector = &training.detector;
            if training.groups.as_ref().is_some_and(|names| *names != detector.names)
                || next.0 == Part::Gate && detector.gate.is_none()
            {
                return Err(checkpoint.wrong_stage());
            }
            training.begin(next);
        }
        training.done += checkpoint.step;
        let Self { course, detector, .. } = &mut training;
        course.restore(checkpoint.step, checkpoint.state, &detector.params, schedule.batch)?;
        training.find_groups()?;
        Ok(training)
    }

    /// Does the next step of a training that is not [done](Self::is_done).
    ///
    /// # Errors
    /// When features cannot be read, or the loss is no longer finite.
    pub fn step(&mut self) -> Result<StepReport> {
        if self.course.is_done()
            && let Some(next) = self.left.pop_front()
        {
            match (&next.0, &self.groups) {
                (Part::Expert { .. }, Some(names)) if self.detector.experts.is_empty() => {
                    self.detector.add_experts(names.clone(), self.schedule.seed);
                }
                (Part::Gate, _) => self.detector.add_gate(self.schedule.seed),
                _ => {}
            }
            self.begin(next);
        }
        let report = self.course.step(self.schedule.trainer(self.set), &mut self.detector)?;
        self.done += 1;
        self.find_groups()?;
        Ok(report)
    }

    fn begin(&mut self, (part, stage, labels): (Part, Stage, Labels)) {
        let trainer = self.schedule.trainer(self.set);
        self.course = Course::new(part, stage, labels, trainer, &mut self.detector.params);
    }

    /// Finds the groups of experts once the encoder is trained.
    fn find_groups(&mut self) -> Result<()> {
        if self.groups.is_some() || !self.left.is_empty() || self.done < self.schedule.encoder_steps() {
            return Ok(());
        }
        let trainer = self.schedule.trainer(self.set);
        let groups = match self.schedule.experts {
            Experts::None => Vec::new(),
            Experts::Classes => trainer.by_class(),
            Experts::Clusters(k) => trainer.by_cluster(&self.detector, k)?,
        };
        let Schedule { expert, gate, labels, .. } = *self.schedule;
        self.left.extend(expert_parts(&groups).map(|part| (part, expert, labels)));
        self.left.extend((!groups.is_empty()).then_some((Part::Gate, gate, labels)));
        self.total = self.done + self.left.iter().map(|(_, stage, _)| stage.steps).sum::<usize>();
        self.groups = Some(groups.into_iter().map(|(name, _)| name).collect());
        Ok(())
    }

    /// Steps done, and steps in all; with clusters, which may be fewer, an upper bound until they are known.
    pub fn steps(&self) -> [usize; 2] {
        [self.done, self.total]
    }

    /// True after the last step.
    pub fn is_done(&self) -> bool {
        self.course.is_done() && self.left.is_empty() && self.groups.is_some()
    }

    /// The detector as it is now.
    pub fn detector(&self) -> &Detector {
        &self.detector
    }

    /// The stage, its finished steps, and its optimizer.
    pub fn position(&self) -> (&str, usize, &AdamW) {
        (self.course.name(), self.course.steps_done(), self.course.optimizer())
    }

    /// A checkpoint, for the [detector](Self::detector) as it is now.
    pub fn checkpoint(&self) -> Checkpoint {
        let (stage, step, optimizer) = self.position();
        let state = optimizer.state(self.detector.params());
        let state = state.map(|(name, steps, moments)| (name.to_string(), (steps, moments.clone()))).collect();
        Checkpoint { stage: stage.into(), step, state }
    }

    /// The detector, every parameter free.
    pub fn into_detector(mut self) -> Detector {
        self.detector.thaw();
        self.detector
    }
}
