//! Speedy-Splat (Hanson et al., 2024): pruning by squared gradients of pixels, in rounds of training.

use super::format::{from_ply, ply};
use super::pruning::kept;
use crate::method::Point;
use crate::recovery::{Change, Recovery};
use crate::views::squared_gradients;
use crate::{CompressionError, Method, Schedule, Task, Training};
use weaver_scene::Gaussians;

/// Share of the Gaussians removed by soft pruning, at the beginning.
const SOFT: f64 = 0.8;
/// Share removed by each round of hard pruning.
const HARD: f64 = 0.3;
/// Steps between two rounds, of 5000.
const INTERVAL: f64 = 3000.0 / 5000.0;

/// Rounds of pruning with training between them, stored as PLY: the method saves Gaussians, not bits of a Gaussian.
///
/// The score of a Gaussian is the sum over all pixels of the squared derivative of the pixel with respect to the
/// Gaussian's value there. In the paper soft pruning falls into the phase of splitting Gaussians; a complete scene
/// loses more by it.
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
    fn steps(&self, of: usize) -> usize {
        (usize::from(self.soft) + self.rounds) * interval(of)
    }

    fn begin<'a>(&'a self, task: &'a Task<'a>) -> Result<Box<dyn Training + 'a>, CompressionError> {
        let prune = |share: f64| -> Change<'_> {
            Box::new(move |it| Ok(kept(it, &squared_gradients(it, &task.pictures)?, 1.0 - share)))
        };
        let shares = std::iter::repeat_n(SOFT, self.soft.into()).chain(std::iter::repeat_n(HARD, self.rounds));
        let tasks = shares.enumerate().map(|(round, share)| (round * interval(task.steps), 0, prune(share))).collect();
        let steps = self.steps(task.steps);
        Ok(Box::new(Recovery::new(task, task.gaussians.clone(), Schedule::new(tasks), steps, ply)))
    }

    fn decode(&self, bytes: &[u8]) -> Result<Gaussians, CompressionError> {
        from_ply(bytes)
    }
}

/// Steps between two rounds, for `of` in place of a paper's 5000.
fn interval(of: usize) -> usize {
    (INTERVAL * of as f64) as usize
}
