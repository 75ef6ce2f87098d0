//! Counter-based random numbers: every value is a pure function of (seed, step, purpose, index).
//!
//! A value therefore does not depend on how many numbers were drawn before, on the number of threads, or on whether a
//! run was resumed.

use crate::Real;

/// A stream of random numbers for one purpose.
///
/// There is no state: every method takes the index of the number to draw and returns the same number each time.
///
/// ```
/// use weaver_kernels::random::Stream;
/// let noise = Stream::new(7, 100, "router.gumbel");
/// assert_eq!(noise.uniform::<f32>(3), Stream::new(7, 100, "router.gumbel").uniform::<f32>(3));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stream {
    key: u64,
}

/// SplitMix64's finalizer: a bijection of 64-bit words with good avalanche (Steele et al., OOPSLA 2014).
#[inline(always)]
fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// The hash FNV-1a of bytes, 64 bits.
pub fn fnv1a(bytes: impl IntoIterator<Item = u8>) -> u64 {
    bytes.into_iter().fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0000_0100_0000_01b3))
}

impl Stream {
    /// The stream for `purpose` at a step of a run with this seed. Different purposes give independent streams.
    pub fn new(seed: u64, step: u64, purpose: &str) -> Self {
        let name = fnv1a(purpose.bytes());
        let key = mix(mix(seed.wrapping_add(0x9e37_79b9_7f4a_7c15)) ^ mix(step.wrapping_add(0x7f4a_7c15)) ^ name);
        Self { key }
    }

    /// An independent stream derived from this one by a number, for example one per view.
    pub fn fork(self, index: u64) -> Self {
        Self { key: mix(self.key ^ mix(index.wrapping_add(0x632b_e59b_d9b4_e019))) }
    }

    /// Draws 64 random bits.
    #[inline(always)]
    pub fn bits(self, index: u64) -> u64 {
        mix(self.key.wrapping_add(index.wrapping_mul(0x9e37_79b9_7f4a_7c15)))
    }

    /// Draws a uniform number from the open interval (0, 1): never exactly 0 or 1, so its logarithm is finite.
    #[inline(always)]
    pub fn uniform<T: Real>(self, index: u64) -> T {
        // 23 bits and a half: exact in f32 and symmetric about 1/2.
        T::from_f64(((self.bits(index) >> 41) as f64 + 0.5) / (1u64 << 23) as f64)
    }

    /// Draws a uniform integer from `0..n`, for n > 0.
    pub fn below(self, index: u64, n: usize) -> usize {
        ((u128::from(self.bits(index)) * n as u128) >> 64) as usize
    }

    /// Draws a standard normal number, by the Box-Muller transform.
    pub fn normal<T: Real>(self, index: u64) -> T {
        let u: f64 = self.uniform(2 * index);
        let v: f64 = self.uniform(2 * index + 1);
        T::from_f64((-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos())
    }

    /// Draws a standard Gumbel number, -ln(-ln u) with uniform u.
    #[inline(always)]
    pub fn gumbel<T: Real>(self, index: u64) -> T {
        let u: f64 = self.uniform(index);
        T::from_f64(-(-u.ln()).ln())
    }

    /// A random permutation of `0..n` (Fisher-Yates).
    pub fn permutation(self, n: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..n).collect();
        self.shuffle(&mut order);
        order
    }

    /// Brings items into the order of [`permutation`](Self::permutation). Allocates nothing.
    pub fn shuffle<U>(self, items: &mut [U]) {
        for i in (1..items.len()).rev() {
            items.swap(i, self.below(i as u64, i + 1));
        }
    }
}
