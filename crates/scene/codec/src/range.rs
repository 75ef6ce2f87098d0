//! A range coder, and its divisions: slices of 2^16.

/// Logarithm of the whole that probabilities are parts of.
pub const PRECISION: u32 = 16;

/// The whole that probabilities are parts of, 2^16.
pub const WHOLE: u32 = 1 << PRECISION;

/// Below this the range gets a further byte.
const SMALLEST: u32 = 1 << 24;

/// Bytes of the range: the look-ahead of the decoder, and trailing zeros that the encoder may leave out.
const AHEAD: usize = 4;

/// A division of 2^16 among symbols, with at least one part for each.
pub trait Slices {
    /// First part and number of parts of a symbol.
    fn slice(&self, symbol: usize) -> (u32, u32);

    /// The symbol that a part below 2^16 belongs to.
    fn at(&self, part: u32) -> usize;
}

/// A division into 2^bits equal slices, up to 16 bits.
#[derive(Clone, Copy, Debug)]
pub struct Uniform {
    /// Logarithm of the number of symbols.
    pub bits: u32,
}

impl Slices for Uniform {
    fn slice(&self, symbol: usize) -> (u32, u32) {
        let size = PRECISION - self.bits;
        ((symbol as u32) << size, 1 << size)
    }

    fn at(&self, part: u32) -> usize {
        (part >> (PRECISION - self.bits)) as usize
    }
}

/// A direction of coding: one description of a stream serves for writing, reading and measuring it.
///
/// An encoder takes the symbol that it is handed and returns it. A decoder ignores it and returns the stream's symbol.
pub trait Coder {
    /// Codes one of two outcomes; `probability` belongs to `true`, in parts of 2^16, neither none nor all of them.
    fn bit(&mut self, probability: u32, bit: bool) -> bool;

    /// Codes a symbol by the slice that it has.
    fn symbol(&mut self, slices: &impl Slices, symbol: usize) -> usize;

    /// Codes the lowest bits of a number, all values equally probable; at most 32.
    #[inline(always)]
    fn raw(&mut self, bits: u32, value: u32) -> u32 {
        let low = bits.min(PRECISION);
        let high =
            if bits > low { self.symbol(&Uniform { bits: bits - low }, (value >> low) as usize) as u32 } else { 0 };
        let mask = (1 << low) - 1;
        (high << low) | self.symbol(&Uniform { bits: low }, (value & mask) as usize) as u32
    }

    /// True if symbols come from a stream that has ended before them.
    fn exhausted(&self) -> bool {
        false
    }
}

/// A writer of symbols, 32-bit range with carry.
///
/// Bytes stand for a number in `[low, low + range)`. A byte that a carry may still change is held back.
///
/// ```
/// use weaver_codec::{Coder, RangeDecoder, RangeEncoder};
///
/// let mut encoder = RangeEncoder::default();
/// for bit in [true, true, false] {
///     encoder.bit(60_000, bit);
/// }
/// let bytes = encoder.finish();
/// let mut decoder = RangeDecoder::new(&bytes);
/// let back = [(); 3].map(|()| decoder.bit(60_000, false));
/// assert_eq!(back, [true, true, false]);
/// ```
#[derive(Clone, Debug)]
pub struct RangeEncoder {
    low: u64,
    range: u32,
    /// Last byte that is not 255, and the number of those behind it.
    held: Option<u8>,
    full: usize,
    bytes: Vec<u8>,
}

impl Default for RangeEncoder {
    fn default() -> Self {
        Self { low: 0, range: u32::MAX, held: None, full: 0, bytes: Vec::new() }
    }
}

impl RangeEncoder {
    /// The bytes of all symbols: up to four zeros at the end are left out.
    pub fn finish(mut self) -> Vec<u8> {
        let end = self.low + u64::from(self.range);
        let roundest = (0..32).rev().map(|zeros| self.low.next_multiple_of(1 << zeros)).find(|&low| low < end);
        self.low = roundest.unwrap_or(self.low);
        for _ in 0..=AHEAD {
            self.shift();
        }
        let zeros = self.bytes.iter().rev().take(AHEAD).take_while(|&&byte| byte == 0).count();
        self.bytes.truncate(self.bytes.len() - zeros);
        self.bytes
    }

    fn narrow(&mut self, first: u32, size: u32) {
        let part = self.range >> PRECISION;
        self.low += u64::from(part) * u64::from(first);
        // The remainder of the division belongs to the last symbol.
        self.range = if first + size == WHOLE { self.range - part * first } else { part * size };
        while self.range < SMALLEST {
            self.range <<= 8;
            self.shift();
        }
    }

    fn shift(&mut self) {
        let carry = (self.low >> 32) as u8;
        if carry == 0 && self.low >= 0xff00_0000 {
            self.full += 1;
        } else {
            self.bytes.extend(self.held.map(|byte| byte.wrapping_add(carry)));
            self.bytes.extend(std::iter::repeat_n(255_u8.wrapping_add(carry), self.full));
            self.full = 0;
            self.held = Some((self.low >> 24) as u8);
        }
        self.low = (self.low & 0x00ff_ffff) << 8;
    }
}

impl Coder for RangeEncoder {
    fn bit(&mut self, probability: u32, bit: bool) -> bool {
        let size = probability;
        if bit {
            self.narrow(0, size)
        } else {
            self.narrow(size, WHOLE - size)
        }
        bit
    }

    fn symbol(&mut self, slices: &impl Slices, symbol: usize) -> usize {
        let (first, size) = slices.slice(symbol);
        self.narrow(first, size);
        symbol
    }
}

/// A reader of [`RangeEncoder`]'s output.
///
/// Behind the end it reads zeros, so that nothing panics; [`RangeDecoder::is_whole`] says whether the stream fits.
#[derive(Clone, Debug)]
pub struct RangeDecoder<'a> {
    bytes: &'a [u8],
    next: usize,
    /// Distance of the stream's number from the range's lower end.
    code: u32,
    range: u32,
}

impl<'a> RangeDecoder<'a> {
    /// A reader of a whole stream.
    pub fn new(bytes: &'a [u8]) -> Self {
        let mut decoder = Self { bytes, next: 0, code: 0, range: u32::MAX };
        for _ in 0..AHEAD {
            decoder.pull();
        }
        decoder
    }

    /// True if the symbols read so far are all of the stream: no byte is left, and none was missing.
    pub fn is_whole(&self) -> bool {
        self.next >= self.bytes.len() && !self.exhausted()
    }

    fn pull(&mut self) {
        let byte = self.bytes.get(self.next).copied().unwrap_or(0);
        self.next += 1;
        self.code = (self.code << 8) | u32::from(byte);
    }

    #[inline(always)]
    fn narrow(&mut self, part: u32, first: u32, size: u32) {
        self.code = self.code.wrapping_sub(part * first);
        self.range = if first + size == WHOLE { self.range - part * first } else { part * size };
        self.refill();
    }

    #[inline(always)]
    fn refill(&mut self) {
        while self.range < SMALLEST {
            self.range <<= 8;
            self.pull();
        }
    }
}

impl Coder for RangeDecoder<'_> {
    #[inline(always)]
    fn bit(&mut self, probability: u32, _: bool) -> bool {
        // Selections in place of a branch, which would be predicted wrongly as often as the bit is uncertain.
        let bound = (self.range >> PRECISION) * probability;
        let bit = self.code < bound;
        self.code = self.code.wrapping_sub(if bit { 0 } else { bound });
        self.range = if bit { bound } else { self.range - bound };
        self.refill();
        bit
    }

    #[inline(always)]
    fn symbol(&mut self, slices: &impl Slices, _: usize) -> usize {
        let part = self.range >> PRECISION;
        let symbol = slices.at((self.code / part).min(WHOLE - 1));
        let (first, size) = slices.slice(symbol);
        self.narrow(part, first, size);
        symbol
    }

    fn exhausted(&self) -> bool {
        self.next > self.bytes.len() + AHEAD
    }
}

/// The length of a stream that is not written: the sum of `-log2(probability)`.
#[derive(Clone, Copy, Debug, Default)]
pub struct CodeLength {
    /// Bits so far.
    pub bits: f64,
}

impl CodeLength {
    fn add(&mut self, size: u32) {
        self.bits -= (f64::from(size) / f64::from(WHOLE)).log2();
    }
}

impl Coder for CodeLength {
    fn bit(&mut self, probability: u32, bit: bool) -> bool {
        let size = probability;
        self.add(if bit { size } else { WHOLE - size });
        bit
    }

    fn symbol(&mut self, slices: &impl Slices, symbol: usize) -> usize {
        self.add(slices.slice(symbol).1);
        symbol
    }
}
