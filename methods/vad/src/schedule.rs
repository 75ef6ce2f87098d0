//! A whole training: its parts and their durations.

use crate::Result;
use crate::checkpoint::Checkpoint;
use crate::detector::Detector;
use crate::encoder::EncoderKind;
use crate::training::{Labels, Observe, Stage, Trainer};
use crate::training_set::TrainingSet;

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

    /// Steps of all stages together; an upper bound with clusters, which may be fewer.
    pub fn steps(&self, set: &TrainingSet) -> usize {
        let labeled = if self.labels == Labels::None { 0 } else { self.splatting.steps };
        let experts = match self.experts {
            Experts::None => return self.encoder.steps + labeled,
            Experts::Classes => set.classes.len(),
            Experts::Clusters(k) => k,
        };
        self.encoder.steps + labeled + experts * self.expert.steps + self.gate.steps
    }

    /// Trains a detector.
    ///
    /// # Errors
    /// When features cannot be read, the loss is no longer finite, or the observer ends it.
    pub fn train(&self, set: &TrainingSet, kind: EncoderKind, observe: &mut dyn Observe) -> Result<Detector> {
        self.go_on(set, Detector::new(kind, self.seed), None, observe)
    }

    /// Goes on from a checkpoint of a training on the same videos by the same schedule; the result has the bits of an
    /// uninterrupted training.
    ///
    /// # Errors
    /// As [`train`](Self::train), and when the checkpoint is of another training.
    pub fn resume(
        &self,
        set: &TrainingSet,
        (detector, checkpoint): (Detector, Checkpoint),
        observe: &mut dyn Observe,
    ) -> Result<Detector> {
        self.go_on(set, detector, Some(checkpoint), observe)
    }

    fn go_on(
        &self,
        set: &TrainingSet,
        mut detector: Detector,
        resume: Option<Checkpoint>,
        observe: &mut dyn Observe,
    ) -> Result<Detector> {
        let Self { segments, batch, seed, labels, .. } = *self;
        let mut trainer = Trainer { set, segments, batch, seed, observe, resume };
        trainer.encoder(&mut detector, &self.encoder, Labels::None)?;
        if labels != Labels::None {
            trainer.encoder(&mut detector, &self.splatting, labels)?;
        }
        let groups = match self.experts {
            Experts::None => Vec::new(),
            Experts::Classes => trainer.by_class(),
            Experts::Clusters(k) => trainer.by_cluster(&detector, k)?,
        };
        if !groups.is_empty() {
            trainer.experts(&mut detector, &groups, &self.expert, labels)?;
            trainer.gate(&mut detector, &self.gate, labels)?;
        }
        trainer.resume.map_or(Ok(detector), |checkpoint| Err(checkpoint.wrong_stage()))
    }
}
