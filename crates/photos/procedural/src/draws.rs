//! Random decisions taken one after the other.

use weaver_kernels::random::Stream;

/// A stream read in order: composing a world is sequential, so the count of draws is the index.
pub(crate) struct Draws {
    stream: Stream,
    next: u64,
}

impl Draws {
    pub fn new(stream: Stream) -> Self {
        Self { stream, next: 0 }
    }

    fn step(&mut self) -> u64 {
        self.next += 1;
        self.next - 1
    }

    /// Uniform between `low` and `high`.
    pub fn within(&mut self, low: f64, high: f64) -> f64 {
        let index = self.step();
        low + (high - low) * self.stream.uniform::<f64>(index)
    }

    /// Uniform in `0..n`.
    pub fn below(&mut self, n: usize) -> usize {
        let index = self.step();
        self.stream.below(index, n)
    }

    /// True with probability `p`.
    pub fn chance(&mut self, p: f64) -> bool {
        self.within(0.0, 1.0) < p
    }

    /// An independent stream.
    pub fn stream(&mut self) -> Stream {
        let index = self.step();
        self.stream.fork(index)
    }
}
