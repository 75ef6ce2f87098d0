//! Measurements of the machine's peak arithmetic rate and memory bandwidth, to compare timings with.
//!
//! The functions start threads of their own, outside any pool, and measure from the first thread's start to the last
//! thread's end. They take the best of several short runs, since other load can only slow a run down. Measure the peak
//! in the same run as the code compared with it: figures from another day or machine say little.

use std::hint::black_box;
use std::sync::Barrier;
use std::thread;
use std::time::{Duration, Instant};

/// Runs of each measurement.
const RUNS: usize = 10;
/// Time that one run of arithmetic should take.
const RUN: Duration = Duration::from_millis(20);
/// Values in each of the two arrays that are copied: 128 MiB, far beyond the caches.
const COPIED: usize = 32 << 20;

/// The peak rate of `f32` arithmetic on `threads` threads together, in billions of operations per second.
///
/// Counts fused multiply-adds as two operations each. They run in independent chains, enough to hide the latency, in
/// the registers of the instruction set in use ([`simd::level`](crate::simd::level)), AVX-512 or AVX2, or with the
/// compilation target's own instructions (NEON on ARM), where a multiplication and an addition stand in for a missing
/// FMA. No memory is accessed. Takes about 0.2 s.
pub fn fma_gflops_f32(threads: usize) -> f64 {
    let threads = threads.max(1);
    let (lanes, chains) = chains();
    // This also warms up the processor.
    let trial = 1_u32 << 18;
    let rate = f64::from(trial) / together(1, |_| chains(u64::from(trial))).as_secs_f64();
    let steps = (rate * RUN.as_secs_f64()).ceil() as u64;
    let best = (0..RUNS).map(|_| together(threads, |_| chains(steps))).min().unwrap_or(RUN);
    2.0 * (threads as u64 * steps) as f64 * lanes as f64 / best.as_secs_f64() / 1e9
}

/// The memory bandwidth of a copy on `threads` threads together, in billions of bytes per second, read and written.
///
/// Each thread copies its part of one large array to another with ordinary stores. As is usual, the lines that stores
/// fetch from memory are not counted. Takes 256 MiB of memory and about 0.2 s.
pub fn copy_gbs(threads: usize) -> f64 {
    let threads = threads.max(1);
    let from = vec![1.0_f32; COPIED];
    let mut to = vec![0.0_f32; COPIED];
    // A factor of one hidden from the compiler: a plain copy would become a library call with other kinds of stores.
    let factor = black_box(1.0_f32);
    let share = COPIED.div_ceil(threads);
    let mut copy = || {
        let mut parts = from.chunks(share).zip(to.chunks_mut(share)).collect::<Vec<_>>().into_iter();
        let mut part = || parts.next().unwrap_or((&[], &mut []));
        together_each((0..threads).map(|_| part()).collect(), |(from, to)| {
            crate::simd::dispatch(
                #[inline(always)]
                || {
                    for (to, from) in to.iter_mut().zip(from) {
                        *to = factor * *from;
                    }
                },
            );
        })
    };
    // The first touch of the pages does not count.
    copy();
    let best = (0..RUNS).map(|_| copy()).min().unwrap_or(RUN);
    (2 * COPIED * size_of::<f32>()) as f64 / best.as_secs_f64() / 1e9
}

/// The time from the first start to the last end of `job` on this many threads.
fn together(threads: usize, job: impl Fn(usize) + Sync) -> Duration {
    together_each((0..threads).collect(), job)
}

/// The time from the first start to the last end of `job`, which runs on one thread per input.
fn together_each<I: Send>(inputs: Vec<I>, job: impl Fn(I) + Sync) -> Duration {
    let barrier = Barrier::new(inputs.len());
    let timed = |input| {
        barrier.wait();
        let start = Instant::now();
        job(input);
        (start, Instant::now())
    };
    let spans: Vec<(Instant, Instant)> = thread::scope(|scope| {
        let threads: Vec<_> = inputs.into_iter().map(|input| scope.spawn(|| timed(input))).collect();
        threads.into_iter().map(|t| t.join().expect("a measurement does not panic")).collect()
    });
    let start = spans.iter().map(|s| s.0).min();
    let end = spans.iter().map(|s| s.1).max();
    start.zip(end).map_or(Duration::ZERO, |(start, end)| end - start)
}

/// The number of FMA lanes in one step of the chains, and a function that runs the chains for a number of steps.
fn chains() -> (usize, fn(u64)) {
    #[cfg(target_arch = "x86_64")]
    #[allow(unsafe_code)]
    {
        use crate::simd::{Level, level};
        match level() {
            // SAFETY: the processor has AVX-512 F.
            Level::Avx512 => return (16 * 16, |steps| unsafe { x86::avx512(steps) }),
            // SAFETY: the processor has AVX2 and FMA.
            Level::Avx2 => return (12 * 8, |steps| unsafe { x86::avx2(steps) }),
            _ => {}
        }
    }
    (CHAINS * 4, portable)
}

/// Chains of four lanes: with the two constants they fill the registers, 16 of x86 without AVX2, 32 elsewhere.
const CHAINS: usize = if cfg!(target_arch = "x86_64") { 12 } else { 24 };

/// Factor and summand of every FMA: x -> x * FACTOR + SUMMAND tends to 1, far from overflow and denormals.
const FACTOR: f32 = 0.999_999;
const SUMMAND: f32 = 1e-6;

fn portable(steps: u64) {
    let fma = |x: f32| {
        // Without the instruction, `mul_add` would be a library call.
        if cfg!(any(target_feature = "fma", target_arch = "aarch64")) {
            x.mul_add(FACTOR, SUMMAND)
        } else {
            x * FACTOR + SUMMAND
        }
    };
    let mut chains: [[f32; 4]; CHAINS] = std::array::from_fn(|i| [0.5 + i as f32; 4]);
    for _ in 0..steps {
        chains = chains.map(|chain| chain.map(fma));
    }
    black_box(chains);
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{FACTOR, SUMMAND};
    use std::arch::x86_64::{_mm256_fmadd_ps, _mm256_set1_ps, _mm512_fmadd_ps, _mm512_set1_ps};
    use std::hint::black_box;

    /// 16 chains of 16 lanes, of 32 registers.
    #[target_feature(enable = "avx512f")]
    pub fn avx512(steps: u64) {
        let (factor, summand) = (_mm512_set1_ps(FACTOR), _mm512_set1_ps(SUMMAND));
        let mut chains: [_; 16] = std::array::from_fn(|i| _mm512_set1_ps(0.5 + i as f32));
        for _ in 0..steps {
            for chain in &mut chains {
                *chain = _mm512_fmadd_ps(*chain, factor, summand);
            }
        }
        black_box(chains);
    }

    /// 12 chains of 8 lanes: with the two constants 14 of 16 registers.
    #[target_feature(enable = "avx2,fma")]
    pub fn avx2(steps: u64) {
        let (factor, summand) = (_mm256_set1_ps(FACTOR), _mm256_set1_ps(SUMMAND));
        let mut chains: [_; 12] = std::array::from_fn(|i| _mm256_set1_ps(0.5 + i as f32));
        for _ in 0..steps {
            for chain in &mut chains {
                *chain = _mm256_fmadd_ps(*chain, factor, summand);
            }
        }
        black_box(chains);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_chains_take_as_long_as_they_are() {
        // If the compiler removed them, ten times the steps would take no longer.
        let (_, widest) = chains();
        for chains in [widest, portable] {
            let time = |steps| (0..5).map(|_| together(1, |_| chains(steps))).min().unwrap().as_secs_f64();
            let ratio = time(2_000_000) / time(200_000);
            assert!(ratio > 3.0, "{ratio}");
        }
    }

    #[test]
    fn figures_are_those_of_a_machine() {
        assert!((0.1..1e6).contains(&fma_gflops_f32(1)));
        assert!((0.1..1e5).contains(&copy_gbs(2)));
    }

    #[test]
    fn a_span_covers_all_threads() {
        let pause = Duration::from_millis(5);
        let span = together_each(vec![1_u32, 3], |n| thread::sleep(n * pause));
        assert!(span >= 3 * pause, "{span:?}");
    }
}
