//! Gradients of a step that has several batches of tuples, computed by one process or shared by several.

use super::{PendingStep, Position, Session};
use crate::{Config, Error, Ranks, Recipe, StageConfig};
use std::sync::Arc;
use weaver_kernels::random::fnv1a;
use weaver_ranks::sum;

/// Outcome of a batch beside gradients.
#[derive(Debug)]
pub(super) struct Batch {
    pub loss: f32,
    pub terms: Vec<(String, f32)>,
    pub gaussians_per_pixel: f32,
}

impl<R: Recipe> Session<R> {
    /// Shares the batches of each step with other processes, which hold the same session.
    ///
    /// # Errors
    /// When there are more processes than batches; when the processes do not hold the same configuration, captures or
    /// weights.
    pub fn share(&mut self, ranks: Arc<dyn Ranks>) -> Result<(), Error> {
        let batches = self.config.optimizer.accumulate;
        if ranks.size() > batches {
            return Err(Error::Input(format!(
                "optimizer.accumulate: expected at least one batch for each of {} processes, found {batches}",
                ranks.size()
            )));
        }
        let of = |text: &str| fnv1a(text.bytes());
        let configuration = of(&Config { threads: None, ..self.config.clone() }.to_toml());
        let inputs = self.sources.entries().map(|(key, sum)| (key.to_string(), of(sum))).collect::<Vec<_>>();
        let same = [("configuration".to_string(), configuration), ("step".into(), self.step as u64)]
            .into_iter()
            .chain(inputs)
            .chain([("weights".into(), of(&self.checksum()))]);
        for (name, word) in same {
            if let Some(other) = ranks.other(word) {
                let found = "others than process 0 has";
                return Err(Error::Input(format!(
                    "process {other}: {name}: expected those of process 0, found {found}"
                )));
            }
        }
        self.ranks = ranks;
        Ok(())
    }

    /// The work of every process but the first: takes part in every step until process 0 has no more.
    ///
    /// # Errors
    /// As [`Session::advance`].
    pub fn follow(&mut self) -> Result<(), Error> {
        loop {
            let mut more = [0.0];
            self.ranks.broadcast(&mut more);
            if more == [0.0] {
                return Ok(());
            }
            self.advance()?;
        }
    }

    /// Announces one more step to the other processes, or the end.
    pub(super) fn announce(&self, more: bool) {
        self.ranks.broadcast(&mut [f32::from(more)]);
    }

    /// The gradients of all batches, averaged onto the tape.
    pub(super) fn averaged_batches(
        &mut self,
        stage: &StageConfig<R>,
        position: Position,
    ) -> Result<PendingStep, Error> {
        let batches = self.config.optimizer.accumulate;
        let ranks = self.ranks.clone();
        let mut names = Vec::new();
        let sum = sum(&*ranks, batches, |number| {
            let batch = self.batch(stage, position, number)?;
            let row = self.row(&batch);
            names = batch.terms.into_iter().map(|(name, _)| name).collect();
            Ok::<_, Error>(row)
        })?;
        let mean = 1.0 / batches as f32;
        let (numbers, mut rest) = sum.split_at(2 + names.len());
        let terms = names.into_iter().zip(&numbers[2..]).map(|(name, sum)| (name, sum * mean)).collect();
        for id in self.params.ids() {
            let (present, gradient);
            (present, rest) = (rest[0], &rest[1..]);
            (gradient, rest) = rest.split_at(self.params.get(id).value().len());
            match self.tape.param_grad_mut(id) {
                Some(own) if present == batches as f32 => {
                    own.iter_mut().zip(gradient).for_each(|(own, sum)| *own = sum * mean);
                }
                None if present == 0.0 => {}
                _ => {
                    let name = self.params.get(id).name();
                    let message =
                        format!("{name}: expected a gradient in all {batches} batches, found it in {present}");
                    return Err(Error::Input(message));
                }
            }
        }
        Ok(PendingStep { position, loss: numbers[0] * mean, terms, gaussians_per_pixel: numbers[1] * mean })
    }

    /// The row of a batch that is averaged: its numbers, and for each parameter 1 and the gradient, or zeros without a
    /// gradient.
    fn row(&self, batch: &Batch) -> Vec<f32> {
        let mut row = vec![batch.loss, batch.gaussians_per_pixel];
        row.extend(batch.terms.iter().map(|(_, value)| value));
        for (id, param) in self.params.iter() {
            match self.tape.param_grad(id) {
                Some(gradient) => {
                    row.push(1.0);
                    row.extend_from_slice(&gradient);
                }
                None => row.resize(row.len() + 1 + param.value().len(), 0.0),
            }
        }
        row
    }
}
