//! Mixed adaptive models: numbers as decisions, each predicted in several contexts at once.

use crate::estimates::{Estimates, Mixer, Outcomes};
use crate::range::Coder;

/// Largest number of bits of a magnitude.
const BITS: usize = 24;

/// Decisions that are predicted together.
const LANES: usize = 8;

/// Groups of decisions that have estimates in all contexts: is a magnitude longer than 0, 1, ... 7 bits? Then, for a
/// length of 1, 2, ... 6, the sign and the three bits behind the highest.
const GROUPS: usize = 7;

/// Further ones, which are rare, have estimates in one context only: is it longer than 8, 9, ... 23 bits? Then, for a
/// length of 7, 8, ... 24, as above.
const LENGTHS: usize = BITS / LANES;
const FURTHER: usize = LENGTHS - 1 + BITS - (GROUPS - 1);

/// A model of whole numbers below 2^24 in magnitude, by `K` contexts that are mixed.
///
/// A number is a path of decisions: its length in bits, one at a time, its sign, and the bits behind the highest one,
/// equally probable from the fourth on. Every decision has an estimate in each context, and the mixture of these is its
/// probability.
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
    /// Of each context, estimates of one value after the other.
    contexts: [Vec<[Estimates<LANES>; GROUPS]>; K],
    mixers: [Mixer<K, LANES>; GROUPS],
    further: [Single; FURTHER],
}

impl<const K: usize> MixedModel<K> {
    /// A model before the first number; `contexts` are the values that each context may have.
    pub fn new(contexts: [usize; K]) -> Self {
        Self {
            contexts: contexts.map(|values| vec![[Estimates::UNKNOWN; GROUPS]; values]),
            mixers: [Mixer::new(); GROUPS],
            further: [(Estimates::UNKNOWN, Mixer::new()); FURTHER],
        }
    }

    /// Codes a number in its contexts. A context beyond the last value counts as that one.
    ///
    /// # Panics
    /// For numbers of 2^24 and above in magnitude, which no decoder returns.
    #[inline(always)]
    pub fn code(&mut self, coder: &mut impl Coder, contexts: [usize; K], value: i32) -> i32 {
        assert!(value.unsigned_abs() < 1 << BITS, "expected a magnitude below 2^24, found {value}");
        let mut rows = self.contexts.iter_mut().zip(contexts).map(|(rows, context)| {
            let last = rows.len() - 1;
            &mut rows[context.min(last)]
        });
        let mut rows: [_; K] = std::array::from_fn(|_| rows.next().expect("a row in each context"));
        let magnitude = value.unsigned_abs();
        let length = (u32::BITS - magnitude.leading_zeros()) as usize;
        let mut bits = 0;
        let estimates = rows.each_mut().map(|row| &mut row[0]);
        self.mixers[0].code(estimates, |parts| longer(coder, parts, &mut bits, length));
        if bits == 0 {
            return 0;
        }
        if bits == LANES {
            bits = long(coder, &mut self.further, length);
        }
        let mut found = 0;
        if bits < GROUPS {
            let estimates = rows.each_mut().map(|row| &mut row[bits]);
            self.mixers[bits].code(estimates, |parts| details(coder, parts, &mut found, bits, value));
        } else {
            let (estimates, mixer) = &mut self.further[LENGTHS - 1 + bits - GROUPS];
            mixer.code([estimates], |parts| details(coder, parts, &mut found, bits, value));
        }
        let plain = bits.saturating_sub(1 + DETAILS) as u32;
        if plain > 0 {
            let low = coder.raw(plain, magnitude & ((1 << plain) - 1)) as i32;
            let magnitude = found.abs() << plain | low;
            found = if found < 0 { -magnitude } else { magnitude };
        }
        found
    }
}

/// An estimate in one context.
type Single = (Estimates<LANES>, Mixer<1, LANES>);

/// The length of a magnitude of at least eight bits.
fn long(coder: &mut impl Coder, groups: &mut [Single], length: usize) -> usize {
    let mut bits = LANES;
    for (group, (estimates, mixer)) in groups[..LENGTHS - 1].iter_mut().enumerate() {
        mixer.code([estimates], |parts| longer(coder, parts, &mut bits, length));
        if bits < (group + 2) * LANES {
            break;
        }
    }
    bits
}

/// Codes that a magnitude is longer than `bits`, and so on up to its length or the last lane.
#[inline(always)]
fn longer(coder: &mut impl Coder, parts: &[u32; LANES], bits: &mut usize, length: usize) -> Outcomes {
    let mut lane = 0;
    while lane < LANES && coder.bit(parts[lane], *bits < length) {
        (lane, *bits) = (lane + 1, *bits + 1);
    }
    let ones = (1 << lane) - 1;
    Outcomes { made: ones << 1 | 1, ones }
}

/// Bits behind the highest one that are predicted.
const DETAILS: usize = 3;

/// Codes the sign of a number, and the first bits of its magnitude, which has `bits`.
#[inline(always)]
fn details(coder: &mut impl Coder, parts: &[u32; LANES], found: &mut i32, bits: usize, value: i32) -> Outcomes {
    let negative = coder.bit(parts[0], value < 0);
    let (mut made, mut ones, mut top) = (1, u32::from(negative), 1);
    // A bit has the lane of those before it, from the highest one on.
    for place in (0..bits - 1).rev().take(DETAILS) {
        let lane = top as usize % LANES;
        let bit = u32::from(coder.bit(parts[lane], value.unsigned_abs() >> place & 1 == 1));
        (made, ones) = (made | 1 << lane, ones | bit << lane);
        top = top << 1 | bit as i32;
    }
    *found = if negative { -top } else { top };
    Outcomes { made, ones }
}

/// A model of four bits at once, by `K` contexts that are mixed.
#[derive(Clone, Debug)]
pub(crate) struct MixedNibble<const K: usize> {
    contexts: [Vec<Estimates<16>>; K],
    mixer: Mixer<K, 16>,
}

impl<const K: usize> MixedNibble<K> {
    pub(crate) fn new(contexts: [usize; K]) -> Self {
        Self { contexts: contexts.map(|values| vec![Estimates::UNKNOWN; values]), mixer: Mixer::new() }
    }

    /// Codes four bits, the lowest first. The last one is not coded where it `must` be 1 if the others are 0.
    #[inline(always)]
    pub(crate) fn code(&mut self, coder: &mut impl Coder, contexts: [usize; K], must: bool, value: u8) -> u8 {
        let mut estimates = self.contexts.iter_mut().zip(contexts).map(|(estimates, context)| {
            let last = estimates.len() - 1;
            &mut estimates[context.min(last)]
        });
        let estimates = std::array::from_fn(|_| estimates.next().expect("estimates in each context"));
        let mut found = 1_usize;
        self.mixer.code(estimates, |parts| {
            let (mut made, mut ones) = (0, 0);
            for place in 0..4 {
                let lane = found % 16;
                if must && found == 8 {
                    found = 17;
                    break;
                }
                let bit = coder.bit(parts[lane], value >> place & 1 == 1);
                (made, ones) = (made | 1 << lane, ones | u32::from(bit) << lane);
                found = found << 1 | usize::from(bit);
            }
            Outcomes { made, ones }
        });
        // The first bit has come to the top.
        ((found as u8) << 4).reverse_bits()
    }
}

/// A model of a single decision, by `K` contexts that are mixed.
#[derive(Clone, Debug)]
pub(crate) struct MixedBit<const K: usize> {
    contexts: [Vec<Estimates<1>>; K],
    mixer: Mixer<K, 1>,
}

impl<const K: usize> MixedBit<K> {
    pub(crate) fn new(contexts: [usize; K]) -> Self {
        Self { contexts: contexts.map(|values| vec![Estimates::UNKNOWN; values]), mixer: Mixer::new() }
    }

    /// Codes a decision in its contexts.
    #[inline(always)]
    pub(crate) fn code(&mut self, coder: &mut impl Coder, contexts: [usize; K], value: bool) -> bool {
        let mut estimates = self.contexts.iter_mut().zip(contexts).map(|(estimates, context)| &mut estimates[context]);
        let estimates = std::array::from_fn(|_| estimates.next().expect("an estimate in each context"));
        let mut found = false;
        self.mixer.code(estimates, |parts| {
            found = coder.bit(parts[0], value);
            Outcomes { made: 1, ones: found.into() }
        });
        found
    }
}
