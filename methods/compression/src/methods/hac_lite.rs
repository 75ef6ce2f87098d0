//! HAC (Chen et al., 2024), small: anchors of Scaffold-GS (Lu et al., 2023) whose numbers are coded by the predictions
//! of a hash grid.
//!
//! | | papers | here |
//! |---|---|---|
//! | anchors | voxels of the points of COLMAP, grown and pruned | groups of neighbors of the given scene, kept |
//! | features, offsets of an anchor | 50, 10 | 32, 5 |
//! | hash grid: levels of space, of planes, numbers | 12 of 18 to 514, 4 of 130 to 1026, 4 | 6 of 18 to 257, 2 of 130 and 514, 4 |
//! | rows of a table | 2^13, 2^15 | a quarter of the anchors, up to 2^13 |
//! | opacity | a tanh, nothing below 0 | a sigmoid |
//! | colors | of a view, which the network is given | harmonics, which the network puts out |
//! | networks | hidden layers of 50 and 100, 32-bit floats | of 32, steps of a 32nd of the deviation of a layer's weights |
//! | steps `Q` of features, scalings, offsets | 1, 0.001, 0.2 times `1 + tanh` | 1, 0.05 of logarithms, 0.2 times `1 + tanh` |
//! | training | 30,000 steps from points, bits of 5 % of the anchors | 6 times `--steps`: the numbers of the scene, then pictures; bits of all anchors |
//!
//! Colors are harmonics so that it decodes to plain Gaussians, as every other method does: the same pictures judge it,
//! and any viewer draws it. The context is evaluated by arithmetic that has the same bits on every machine, as encoder
//! and decoder must agree about it.

mod coding;
mod model;
mod start;
mod training;

use crate::method::Point;
use crate::recovery::trainable;
use crate::{CompressionError, Method, Task, Training};
use training::HacTraining;
use weaver_scene::Gaussians;

/// Anchors with features, scalings and offsets, from which networks make the Gaussians; all rounded with steps, and
/// coded by normal distributions that a network predicts from a binary hash grid; trained with noise for rounding, and
/// with its bits in the loss.
#[derive(Clone, Copy, Debug)]
pub struct HacLite {
    /// Weight of the bits of a number in the loss, 0.001 in the paper.
    pub rate: f64,
}

impl HacLite {
    pub(crate) fn points() -> Vec<Point> {
        let point = |rate: f64| Point { setting: format!("rate {rate}"), method: Box::new(Self { rate }) };
        [0.001, 0.004].map(point).into()
    }
}

impl Method for HacLite {
    fn steps(&self, of: usize) -> usize {
        6 * of
    }

    fn begin<'a>(&'a self, task: &'a Task<'a>) -> Result<Box<dyn Training + 'a>, CompressionError> {
        let gaussians = trainable(task.gaussians)?;
        Ok(Box::new(HacTraining::new(task, gaussians, self.rate, self.steps(task.steps))?))
    }

    fn decode(&self, bytes: &[u8]) -> Result<Gaussians, CompressionError> {
        coding::read(bytes)
    }
}
