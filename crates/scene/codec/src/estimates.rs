//! Decisions that are predicted together: estimates in several contexts, mixed for all lanes of a vector at once.
//!
//! Everything is sums, products, quotients and bits of `f32` in the order that is written, so that a decoder finds the
//! probabilities of the encoder on any machine. There is no table and no branch: inside of
//! [`simd::dispatch`](weaver_kernels::simd::dispatch) a line is an instruction for eight decisions.

use crate::range::WHOLE;

/// Share of an observation in an estimate: ½, ⅓, ¼, ..., at last this, so that it forgets.
const LAST_SHARE: f32 = 1.0 / 62.0;

/// Odds are held within this and its reciprocal.
const LARGEST_ODDS: f32 = 262_144.0;

/// Binary logarithm of odds beyond which a mixture is not surer.
const SUREST: f32 = 15.8;

/// Step of the mixer's descent: large at first, then this; in units of binary logarithms.
const RATE: f32 = 0.007;
const FIRST_RATE: f32 = 0.021;

/// Estimates of `L` decisions in one context: the odds of `true`, and the share of the next observation.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(crate) struct Estimates<const L: usize> {
    odds: [f32; L],
    shares: [f32; L],
}

impl<const L: usize> Estimates<L> {
    pub(crate) const UNKNOWN: Self = Self { odds: [1.0; L], shares: [0.5; L] };

    /// Moves the probability of each decision that was made by a share of the way to its outcome. In odds `o`, with the
    /// share `r`, these are `(o + r) / (1 - r)` and `o (1 - r) / (1 + o r)`.
    #[inline(always)]
    fn learn(&mut self, made: &[u32; L], ones: &[u32; L]) {
        for i in 0..L {
            let (o, r) = (self.odds[i], self.shares[i]);
            let product = o * r;
            let odds = either(ones[i], o + r, o - product) / either(ones[i], 1.0 - r, 1.0 + product);
            self.odds[i] = either(made[i], within(odds, 1.0 / LARGEST_ODDS, LARGEST_ODDS), o);
            // r / (1 + r) without a quotient.
            let share = r - r * r * (1.0 - r * (2.0 / 3.0));
            self.shares[i] = either(made[i], within(share, LAST_SHARE, 1.0), r);
        }
    }
}

/// One of two numbers: the first where the mask has all bits, the second where it has none.
#[inline(always)]
fn either(mask: u32, a: f32, b: f32) -> f32 {
    f32::from_bits(a.to_bits() & mask | b.to_bits() & !mask)
}

/// A number held within limits. Of comparisons, unlike `clamp`, vectors have an instruction each.
#[inline(always)]
fn within(x: f32, least: f32, most: f32) -> f32 {
    let x = if x < least { least } else { x };
    if x > most { most } else { x }
}

/// The decisions made among `L`, and the ones that came out `true`: a bit for each.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Outcomes {
    pub(crate) made: u32,
    pub(crate) ones: u32,
}

/// Weights of `K` contexts in each of `L` decisions.
///
/// The logits of a decision are added with weights that descend on the code length (Mahoney's logistic mixing), so that
/// a context that predicts well is soon the one that counts.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(crate) struct Mixer<const K: usize, const L: usize> {
    weights: [[f32; L]; K],
    rates: [f32; L],
}

impl<const K: usize, const L: usize> Mixer<K, L> {
    pub(crate) fn new() -> Self {
        Self { weights: [[0.7 / (K as f32).sqrt(); L]; K], rates: [FIRST_RATE; L] }
    }

    /// Predicts all decisions, has some of them coded, given the probabilities of `true` in parts of 2^16, and learns
    /// from these.
    #[inline(always)]
    pub(crate) fn code(&mut self, contexts: [&mut Estimates<L>; K], walk: impl FnOnce(&[u32; L]) -> Outcomes) {
        let (mut logits, mut sums) = ([[0.0; L]; K], [0.0; L]);
        for k in 0..K {
            for i in 0..L {
                logits[k][i] = log2(contexts[k].odds[i]);
                sums[i] += self.weights[k][i] * logits[k][i];
            }
        }
        let (mut probabilities, mut parts) = ([0.0; L], [0; L]);
        for i in 0..L {
            probabilities[i] = probability(sums[i]);
            // Adding 2^23 rounds to an integer, which is left in the lowest bits.
            parts[i] = (probabilities[i] * WHOLE as f32 + 8_388_608.0).to_bits() & (WHOLE - 1);
        }
        let outcomes = walk(&parts);
        let (mut made, mut ones, mut steps) = ([0; L], [0; L], [0.0; L]);
        for i in 0..L {
            made[i] = 0_u32.wrapping_sub(outcomes.made >> i & 1);
            ones[i] = 0_u32.wrapping_sub(outcomes.ones >> i & 1);
            let error = either(ones[i], 1.0, 0.0) - probabilities[i];
            steps[i] = either(made[i], error * self.rates[i], 0.0);
            self.rates[i] += either(made[i], (RATE - self.rates[i]) * (1.0 / 128.0), 0.0);
        }
        for k in 0..K {
            for i in 0..L {
                self.weights[k][i] += steps[i] * logits[k][i];
            }
            contexts[k].learn(&made, &ones);
        }
    }
}

/// The binary logarithm of a positive normal number, within 0.001: its exponent, and a polynomial of its fraction that
/// is exact at 1 and 2.
#[inline(always)]
fn log2(x: f32) -> f32 {
    let bits = x.to_bits();
    let fraction = f32::from_bits(bits & 0x007f_ffff | 0x3f80_0000);
    // The number as an integer is the logarithm with the fraction less 1 for its own.
    let straight = bits as i32 as f32 * (1.0 / 8_388_608.0) - 127.0;
    straight + (fraction - 1.0) * (2.0 - fraction) * (0.579 - 0.157 * fraction)
}

/// `1 / (1 + 2^-x)`, within 1e-4 relatively, for `x` held within ±15.8.
#[inline(always)]
fn probability(x: f32) -> f32 {
    /// Adding and subtracting it rounds to an integer, which is left in the lowest bits.
    const ROUND: f32 = 12_582_912.0;
    let x = -within(x, -SUREST, SUREST);
    let shifted = x + ROUND;
    let f = x - (shifted - ROUND);
    let power = (1.0 + 0.6934 * f) + f * f * (0.2422 + 0.0544 * f);
    let exponent = shifted.to_bits().wrapping_sub(ROUND.to_bits()) << 23;
    1.0 / (1.0 + f32::from_bits(power.to_bits().wrapping_add(exponent)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logarithms_and_probabilities_are_near() {
        for i in -1600..=1600 {
            let x = i as f32 / 100.0;
            assert!((log2(x.exp2()) - x).abs() < 1e-3, "{x}");
            let exact = 1.0 / (1.0 + (-x.clamp(-SUREST, SUREST)).exp2());
            assert!((probability(x) / exact - 1.0).abs() < 3e-4, "{x}");
            let part = (probability(x) * WHOLE as f32).round();
            assert!((1.0..WHOLE as f32).contains(&part), "{x}");
        }
    }

    #[test]
    fn odds_are_those_of_frequencies() {
        // With ½ added to both frequencies, as long as nothing is forgotten.
        let mut estimates = Estimates::<2>::UNKNOWN;
        let (mut ones, mut count) = (0.5, 1.0);
        for i in 0..40 {
            let one = i % 3 == 0;
            estimates.learn(&[u32::MAX, 0], &[if one { u32::MAX } else { 0 }; 2]);
            (ones, count) = (ones + f32::from(u8::from(one)), count + 1.0);
            let found = estimates.odds[0] / (1.0 + estimates.odds[0]);
            assert!((found - ones / count).abs() < 0.02, "{found} for {}", ones / count);
        }
        assert_eq!((estimates.odds[1], estimates.shares[1]), (1.0, 0.5));
    }
}
