//! Mixed adaptive models: numbers as decisions, each predicted in several contexts at once.

use crate::logistic::Logistic;
use crate::range::Coder;

/// Largest number of bits of a magnitude.
const BITS: usize = 24;

/// Nodes of the tree of decisions: is the number negative; is its magnitude longer than b bits, beside the two bits behind the highest one of
/// those that are not. Those of small numbers lie next to each other, in one line of the cache.
const SIGN: usize = 0;
const NODES: usize = 1 + 4 * BITS;

/// Observations after which an estimate forgets.
const MEMORY: u32 = 60;

/// Bits of an estimate's probability, above those of its count.
const FINE: u32 = 22;
const COUNT: u32 = 32 - FINE;

/// Step of the mixer's descent: large at first, then this.
const RATE: f32 = 0.01;
const FIRST_RATE: f32 = 0.03;

/// `2^16 / (n + 2)`: what the n-th observation moves an estimate by.
const SHARES: [i64; 1 << COUNT] = {
    let (mut shares, mut n) = ([0; 1 << COUNT], 0);
    while n < shares.len() {
        shares[n] = (1 << 16) / (n as i64 + 2);
        n += 1;
    }
    shares
};

/// An estimate of a decision's probability: frequencies with ½ added, which forgets after 60 observations.
#[derive(Clone, Copy, Debug)]
struct Estimate(u32);

impl Estimate {
    const UNKNOWN: Self = Self(1 << 31);

    /// The probability in parts of 2^16.
    #[inline(always)]
    fn probability(self) -> u16 {
        (self.0 >> 16) as u16
    }

    #[inline(always)]
    fn learn(&mut self, bit: bool) {
        let (probability, count) = (i64::from(self.0 >> COUNT), self.0 & ((1 << COUNT) - 1));
        let target = if bit { (1 << FINE) - 1 } else { 0 };
        let moved = probability + (((target - probability) * SHARES[count as usize]) >> 16);
        self.0 = (moved as u32) << COUNT | (count + 1).min(MEMORY);
    }
}

/// Weights of the estimates at one node, and how often it came.
#[derive(Clone, Copy, Debug)]
struct Weights<const K: usize> {
    weights: [f32; K],
    rate: f32,
}

/// A model of whole numbers below 2^24 in magnitude, by `K` contexts that are mixed.
///
/// A number is a path of decisions: its length in bits, one at a time, its sign, the bits behind the highest one, of which the third and
/// further ones are equally probable. Every decision has an estimate in each context. Their logits are added with weights that descend
/// on the code length (Mahoney's logistic mixing), so that a context that predicts well is soon the one that counts.
///
/// ```
/// use weaver_codec::{CodeLength, MixedModel};
///
/// // The second context says what the number will be.
/// let (mut model, mut length) = (MixedModel::new([1, 2]), CodeLength::default());
/// for i in 0..1000 {
///     model.code(&mut length, [0, i % 2], 5 * (i % 2) as i32);
/// }
/// assert!(length.bits < 100.0);
/// ```
#[derive(Clone, Debug)]
pub struct MixedModel<const K: usize> {
    /// Of each context, estimates at all nodes for one value after the other.
    estimates: [Vec<Estimate>; K],
    nodes: usize,
    weights: Vec<Weights<K>>,
    logistic: Logistic,
}

impl<const K: usize> MixedModel<K> {
    /// A model before the first number; `contexts` are the values that each context may have.
    pub fn new(contexts: [usize; K]) -> Self {
        Self::with_nodes(contexts, NODES)
    }

    /// A model for [`MixedModel::code_bit`] alone, which takes less memory.
    pub fn of_bits(contexts: [usize; K]) -> Self {
        Self::with_nodes(contexts, 1)
    }

    fn with_nodes(contexts: [usize; K], nodes: usize) -> Self {
        let first = Weights { weights: [0.7 / (K as f32).sqrt(); K], rate: FIRST_RATE };
        Self {
            estimates: contexts.map(|n| vec![Estimate::UNKNOWN; n * nodes]),
            nodes,
            weights: vec![first; nodes],
            logistic: Logistic::default(),
        }
    }

    /// Codes a number in its contexts. A context beyond the last value counts as that one.
    ///
    /// # Panics
    /// In a model [of bits](MixedModel::of_bits); for numbers of 2^24 and above in magnitude, which no decoder returns.
    pub fn code(&mut self, coder: &mut impl Coder, contexts: [usize; K], value: i32) -> i32 {
        assert!(value.unsigned_abs() < 1 << BITS, "expected a magnitude below 2^24, found {value}");
        let at = self.places(contexts);
        let Self { estimates, weights, logistic, .. } = self;
        let mut row = estimates.iter_mut().zip(at).map(|(estimates, at)| estimates[at..].first_chunk_mut::<NODES>());
        let rows: [_; K] = std::array::from_fn(|_| row.next().flatten().expect("estimates of all nodes"));
        let weights = weights.first_chunk_mut::<NODES>().expect("weights of all nodes");
        let mut path = Path { rows, weights, logistic: *logistic };
        let magnitude = value.unsigned_abs();
        let length = (u32::BITS - magnitude.leading_zeros()) as usize;
        let mut bits = 0;
        while bits < BITS && path.decide(coder, 1 + 4 * bits, bits < length) {
            bits += 1;
        }
        if bits == 0 {
            return 0;
        }
        let negative = path.decide(coder, SIGN, value < 0);
        let mut found = 1_u32;
        for place in (0..bits - 1).rev() {
            let bit = magnitude >> place & 1;
            // Behind the highest bit two are modeled, by those before them.
            let bit = if found < 4 {
                u32::from(path.decide(coder, 1 + 4 * (bits - 1) + found as usize, bit == 1))
            } else {
                coder.raw(1, bit)
            };
            found = found << 1 | bit;
        }
        if negative { -(found as i32) } else { found as i32 }
    }

    /// Codes a single decision in its contexts.
    pub fn code_bit(&mut self, coder: &mut impl Coder, contexts: [usize; K], bit: bool) -> bool {
        let at = self.places(contexts);
        let Self { estimates, weights, logistic, .. } = self;
        let mut estimates = estimates.iter_mut().zip(at).map(|(estimates, at)| &mut estimates[at]);
        let estimates = std::array::from_fn(|_| estimates.next().expect("estimates of all contexts"));
        decide(coder, estimates, &mut weights[0], *logistic, bit)
    }

    /// Where the estimates of each context begin.
    fn places(&self, contexts: [usize; K]) -> [usize; K] {
        std::array::from_fn(|k| (contexts[k] * self.nodes).min(self.estimates[k].len() - self.nodes))
    }
}

/// Estimates of one number's contexts, and weights, at all nodes.
struct Path<'a, const K: usize> {
    rows: [&'a mut [Estimate; NODES]; K],
    weights: &'a mut [Weights<K>; NODES],
    logistic: Logistic,
}

impl<const K: usize> Path<'_, K> {
    #[inline(always)]
    fn decide(&mut self, coder: &mut impl Coder, node: usize, bit: bool) -> bool {
        decide(coder, self.rows.each_mut().map(|row| &mut row[node]), &mut self.weights[node], self.logistic, bit)
    }
}

/// Codes a decision by mixed estimates, which learn from it.
#[inline(always)]
fn decide<const K: usize>(
    coder: &mut impl Coder,
    estimates: [&mut Estimate; K],
    mixer: &mut Weights<K>,
    logistic: Logistic,
    bit: bool,
) -> bool {
    let logits = estimates.each_ref().map(|estimate| logistic.stretch(estimate.probability()));
    let sum = mixer.weights.iter().zip(&logits).fold(0.0, |sum, (weight, logit)| sum + weight * logit);
    let p = logistic.squash(sum);
    let bit = coder.bit(((p * 65_536.0) as i32).clamp(1, 65_535) as u16, bit);
    let step = (if bit { 1.0 - p } else { -p }) * mixer.rate;
    mixer.weights.iter_mut().zip(&logits).for_each(|(weight, logit)| *weight += step * logit);
    estimates.into_iter().for_each(|estimate| estimate.learn(bit));
    mixer.rate += (RATE - mixer.rate) * (1.0 / 128.0);
    bit
}
