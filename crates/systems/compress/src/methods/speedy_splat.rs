//! Speedy-Splat (Hanson et al., 2024): pruning by squared gradients of pixels, in rounds of training.

use super::format::{from_ply, ply};
use super::pruning::kept;
use crate::method::Point;
use crate::recovery::{Change, recover};
use crate::views::squared_gradients;
use crate::{CompressError, Method, Schedule, Task};
use weaver_scene::Gaussians;

/// Share of the Gaussians that soft pruning takes away, at the beginning.
const SOFT: f64 = 0.8;
/// Share that each round of hard pruning takes away.
const HARD: f64 = 0.3;
/// Steps between two rounds, of 5000.
const INTERVAL: f64 = 3000.0 / 5000.0;

/// Rounds of pruning with training between them, stored as PLY: the method saves Gaussians, not bits of a Gaussian.
///
/// The score of a Gaussian is the sum over all pixels of the squared derivative of the pixel with respect to the Gaussian's value there. In the
/// paper soft pruning falls into the time when Gaussians still split; a scene that is complete loses more by it.
#[derive(Clone, Copy, Debug)]
pub struct SpeedySplat {
    /// True with soft pruning at the beginning.
    pub soft: bool,
    /// Rounds of hard pruning.
    pub rounds: usize,
}

impl SpeedySplat {
    pub(crate) fn points() -> Vec<Point> {
        let all = [(false, 1), (false, 3), (true, 1)];
        let point = |(soft, rounds): (bool, usize)| {
            let setting = if soft { format!("soft, {rounds} hard") } else { format!("{rounds} hard") };
            Point { setting, method: Box::new(Self { soft, rounds }) }
        };
        all.map(point).into()
    }
}

impl Method for SpeedySplat {
    fn encode(&self, task: &Task<'_>) -> Result<Vec<u8>, CompressError> {
        let interval = (INTERVAL * task.steps as f64) as usize;
        let prune = |share: f64| -> Change<'_> {
            Box::new(move |recovery| {
                let scores = squared_gradients(&recovery.gaussians, &task.pictures)?;
                recovery.gaussians = kept(&recovery.gaussians, &scores, 1.0 - share);
                Ok(())
            })
        };
        let mut tasks = Vec::new();
        if self.soft {
            tasks.push((0, 0, prune(SOFT)));
        }
        let first = usize::from(self.soft);
        tasks.extend((first..first + self.rounds).map(|round| (round * interval, 0, prune(HARD))));
        let steps = (first + self.rounds) * interval;
        ply(&recover(task, task.gaussians.clone(), Schedule::new(tasks, 0), steps)?)
    }

    fn decode(&self, bytes: &[u8]) -> Result<Gaussians, CompressError> {
        from_ply(bytes)
    }
}
