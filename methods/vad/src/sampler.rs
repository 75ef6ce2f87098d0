//! The order of videos in training.

use weaver_kernels::random::Stream;

/// Goes through samples, a video and a crop each, in an order drawn anew each epoch.
#[derive(Clone, Debug)]
pub(crate) struct Sampler {
    samples: Vec<(usize, usize)>,
    order: Vec<usize>,
    taken: usize,
    seed: u64,
    purpose: String,
}

impl Sampler {
    /// A sampler of at least one sample.
    pub fn new(samples: Vec<(usize, usize)>, seed: u64, purpose: &str) -> Self {
        Self { samples, order: Vec::new(), taken: 0, seed, purpose: purpose.to_string() }
    }

    /// The next `count` samples.
    pub fn next(&mut self, count: usize) -> Vec<(usize, usize)> {
        (0..count).map(|_| self.one()).collect()
    }

    fn one(&mut self) -> (usize, usize) {
        let count = self.samples.len();
        let at = self.taken % count;
        if at == 0 {
            self.order = Stream::new(self.seed, (self.taken / count) as u64, &self.purpose).permutation(count);
        }
        self.taken += 1;
        self.samples[self.order[at]]
    }
}
