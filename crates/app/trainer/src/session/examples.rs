//! The tuples of a step.

use super::Session;
use crate::{Error, Example, Recipe, StageConfig};
use weaver_kernels::random::Stream;

/// The most tuples drawn in search of one with a scale.
const MOST_DRAWN: usize = 1000;

impl<R: Recipe> Session<R> {
    /// The examples of the run's batch number `draw`.
    pub(super) fn examples(&mut self, stage: &StageConfig<R>, draw: usize) -> Result<Vec<Example>, Error> {
        let d = &self.config.data;
        let count = R::tuples(stage);
        let (sampler, context) = (d.sampler(), d.context_of(self.config.seed, draw));
        let (scenes, layouts) = match self.fresh.scenes(self.step) {
            Some(fresh) => fresh,
            None => (&self.scenes[..], &self.layouts[..]),
        };
        let stream = Stream::new(self.config.seed, draw as u64, "tuples");
        let variation = Stream::new(self.config.seed, draw as u64, "augmentation");
        let looks = Stream::new(self.config.seed, draw as u64, "looks");
        // A tuple without a scale is left out, and the next one in the sequence of draws takes its place.
        let drawn = (0..count * MOST_DRAWN).map(|i| {
            let varied = variation.fork(i as u64);
            let tuple = sampler.tuple(layouts, stream, i as u64, context, d.target_views);
            let tuple = d.augmentation.ordered(tuple, varied);
            let mut example = Example::new(&scenes[tuple.scene], &layouts[tuple.scene], tuple)?;
            if let Some(given) = &d.looks {
                let scene = &scenes[example.tuple.scene];
                given.vary(&mut example, scene, looks.fork(i as u64));
            }
            d.augmentation.apply(&mut example, varied);
            Ok(example)
        });
        let mut without_scale = None;
        let told = drawn.filter_map(|example| match example {
            Err(Error::Data(error @ weaver_data::Error::Scale { .. })) => {
                without_scale = Some(error);
                None
            }
            example => Some(example),
        });
        let examples = told.take(count).collect::<Result<Vec<_>, Error>>()?;
        match without_scale {
            Some(error) if examples.len() < count => Err(error.into()),
            _ => Ok(examples),
        }
    }
}
