//! Mixed adaptive models: numbers as decisions, each predicted in several contexts at once.

use crate::logistic::Logistic;
use crate::range::Coder;

/// Largest number of bits of a magnitude.
const BITS: usize = 24;

/// Nodes of the tree of decisions: is the magnitude longer than k bits, is the number negative, and for each length the three bits
/// behind the highest one.
const SIGN: usize = BITS;
const NODES: usize = BITS + 1 + 8 * BITS;

/// Observations after which an estimate forgets.
const MEMORY: u8 = 250;

/// Step of the mixer's descent: large at first, then this.
const RATE: f32 = 0.004;
const FIRST_RATE: f32 = 0.03;

/// An estimate of a decision's probability: frequencies with ½ added, which forgets after 250 observations.
#[derive(Clone, Copy, Debug)]
struct Estimate {
    probability: u16,
    seen: u8,
}

impl Estimate {
    const UNKNOWN: Self = Self { probability: 1 << 15, seen: 0 };

    #[inline(always)]
    fn learn(&mut self, bit: bool) {
        let divisor = i32::from(self.seen) + 2;
        let target = if bit { 65_535 } else { 0 };
        self.probability = (i32::from(self.probability) + (target - i32::from(self.probability)) / divisor) as u16;
        self.seen = (self.seen + 1).min(MEMORY);
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
/// A number is a path of decisions: its length in bits, one at a time, its sign, the bits behind the highest one, of which the fourth and
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
    estimates: [Vec<[Estimate; NODES]>; K],
    weights: Vec<Weights<K>>,
    logistic: Logistic,
}

impl<const K: usize> MixedModel<K> {
    /// A model before the first number; `contexts` are the values that each context may have.
    pub fn new(contexts: [usize; K]) -> Self {
        let first = Weights { weights: [1.0 / (K as f32).sqrt(); K], rate: FIRST_RATE };
        Self {
            estimates: contexts.map(|n| vec![[Estimate::UNKNOWN; NODES]; n]),
            weights: vec![first; NODES],
            logistic: Logistic::default(),
        }
    }

    /// Codes a number in its contexts. A context beyond the last value counts as that one.
    ///
    /// # Panics
    /// For numbers of 2^24 and above in magnitude, which no decoder returns.
    pub fn code(&mut self, coder: &mut impl Coder, contexts: [usize; K], value: i32) -> i32 {
        assert!(value.unsigned_abs() < 1 << BITS, "expected a magnitude below 2^24, found {value}");
        let mut at = contexts;
        for (at, estimates) in at.iter_mut().zip(&self.estimates) {
            *at = (*at).min(estimates.len() - 1);
        }
        let magnitude = value.unsigned_abs();
        let length = (u32::BITS - magnitude.leading_zeros()) as usize;
        let mut bits = 0;
        while bits < BITS && self.decide(coder, &at, bits, bits < length) {
            bits += 1;
        }
        if bits == 0 {
            return 0;
        }
        let negative = self.decide(coder, &at, SIGN, value < 0);
        let mut found = 1_u32;
        for place in (0..bits - 1).rev() {
            let bit = magnitude >> place & 1;
            // Behind the highest bit three are modeled, by those before them.
            let bit = if found < 8 {
                u32::from(self.decide(coder, &at, SIGN + 8 * (bits - 1) + found as usize, bit == 1))
            } else {
                coder.raw(1, bit)
            };
            found = found << 1 | bit;
        }
        if negative { -(found as i32) } else { found as i32 }
    }

    /// Codes a single decision in its contexts, each within its values.
    pub fn code_bit(&mut self, coder: &mut impl Coder, contexts: [usize; K], bit: bool) -> bool {
        self.decide(coder, &contexts, 0, bit)
    }

    #[inline(always)]
    fn decide(&mut self, coder: &mut impl Coder, at: &[usize; K], node: usize, bit: bool) -> bool {
        let mut logits = [0.0; K];
        for k in 0..K {
            logits[k] = self.logistic.stretch(self.estimates[k][at[k]][node].probability);
        }
        let mixer = &mut self.weights[node];
        let mut sum = 0.0;
        for k in 0..K {
            sum += mixer.weights[k] * logits[k];
        }
        let p = self.logistic.squash(sum);
        let bit = coder.bit(((p * 65_536.0) as i32).clamp(1, 65_535) as u16, bit);
        let step = (if bit { 1.0 - p } else { -p }) * mixer.rate;
        for k in 0..K {
            mixer.weights[k] += step * logits[k];
            self.estimates[k][at[k]][node].learn(bit);
        }
        mixer.rate += (RATE - mixer.rate) * (1.0 / 128.0);
        bit
    }
}
