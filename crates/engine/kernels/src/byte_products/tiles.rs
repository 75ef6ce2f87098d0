//! A few rows times a panel, for each instruction set.

use super::{Largest, PANEL, STEP};
use crate::simd::Level;

/// The kernel that is used.
#[derive(Clone, Copy, Debug)]
pub enum Tile {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// AVX-512 with sums of four products of bytes.
    #[cfg(target_arch = "x86_64")]
    Vnni,
}

impl Tile {
    /// The best for a level, which the processor must support.
    pub fn new(level: Level) -> Self {
        #[cfg(target_arch = "x86_64")]
        match level {
            Level::Avx512 if is_x86_feature_detected!("avx512vnni") => return Self::Vnni,
            Level::Avx512 | Level::Avx2 => return Self::Avx2,
            _ => {}
        }
        let _ = level;
        Self::Portable
    }

    /// Rows of a tile; they divide the rows of a block.
    pub fn rows(self) -> usize {
        match self {
            Self::Portable => 4,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => x86::AVX2_ROWS,
            #[cfg(target_arch = "x86_64")]
            Self::Vnni => x86::VNNI_ROWS,
        }
    }

    /// Takes the products of rows `a` with the columns of a panel into account; the columns count down from `number`.
    #[allow(unsafe_code)]
    #[inline]
    pub fn run(self, a: &[u8], panel: &[u8], number: u32, largest: &mut [Largest], maxima: &mut [u32; PANEL]) {
        match self {
            Self::Portable => portable(a, panel, number, largest, maxima),
            // SAFETY: the tile was made for a level that the processor supports.
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => unsafe { x86::avx2(a, panel, number, largest, maxima) },
            // SAFETY: `new` makes this variant only where the processor has the instruction.
            #[cfg(target_arch = "x86_64")]
            Self::Vnni => unsafe { x86::vnni(a, panel, number, largest, maxima) },
        }
    }
}

fn portable(a: &[u8], panel: &[u8], number: u32, largest: &mut [Largest], maxima: &mut [u32; PANEL]) {
    let depth = panel.len() / PANEL;
    for (a, [first, second]) in a.chunks_exact(depth).zip(largest) {
        let mut parts = [0_u16; 4 * PANEL];
        for (a, b) in a.as_chunks::<4>().0.iter().zip(panel.as_chunks::<{ 4 * PANEL }>().0) {
            let eight: [u16; 8] = std::array::from_fn(|i| u16::from(a[i % 4]));
            for (parts, b) in parts.as_chunks_mut::<8>().0.iter_mut().zip(b.as_chunks::<8>().0) {
                for i in 0..8 {
                    // Nothing wraps: a check would only keep the loop from becoming vectors.
                    parts[i] = parts[i].wrapping_add(eight[i].wrapping_mul(u16::from(b[i])));
                }
            }
        }
        let mut sums = [0_u32; PANEL];
        for (sum, parts) in sums.iter_mut().zip(parts.as_chunks::<4>().0) {
            *sum = parts.iter().map(|part| u32::from(*part)).sum();
        }
        for i in 0..PANEL {
            let key = sums[i] << 16 | (number - i as u32);
            maxima[i] = maxima[i].max(key);
            second[i] = second[i].max(first[i].min(key));
            first[i] = first[i].max(key);
        }
    }
}

/// The products of a vector with chosen ones, which exist. `level` must be supported.
#[allow(unsafe_code)]
pub fn chosen(level: Level, query: &[u8], b: &[u8], chosen: &[u32], out: &mut [u32]) {
    let depth = query.len();
    let (fours, ones) = chosen.as_chunks::<4>();
    let (totals, sums) = out.as_chunks_mut::<4>();
    for (four, total) in fours.iter().zip(totals) {
        let vectors = four.map(|i| &b[i as usize * depth..][..depth]);
        *total = match level {
            // SAFETY: the level is supported.
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 | Level::Avx512 => unsafe { x86::four(query, vectors) },
            _ => vectors.map(|vector| product(query, vector)),
        };
    }
    for (i, sum) in ones.iter().zip(sums) {
        *sum = product(query, &b[*i as usize * depth..][..depth]);
    }
}

/// The product of two vectors.
fn product(a: &[u8], b: &[u8]) -> u32 {
    let mut lanes = [0_u32; STEP];
    for (a, b) in a.as_chunks::<STEP>().0.iter().zip(b.as_chunks::<STEP>().0) {
        for (lane, (a, b)) in lanes.iter_mut().zip(a.iter().zip(b)) {
            *lane += u32::from(*a) * u32::from(*b);
        }
    }
    lanes.iter().sum()
}

#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
mod x86 {
    use super::{Largest, PANEL, STEP};
    use std::arch::x86_64::*;

    /// With two vectors of sums each, of the vectors of a panel, and two more, they take all sixteen registers.
    pub const AVX2_ROWS: usize = 6;
    pub const VNNI_ROWS: usize = 8;

    /// Eight products, given as two parts in 16-bit lanes side by side, in the upper halves of 32-bit lanes; 0 below.
    #[target_feature(enable = "avx2")]
    fn joined(halves: __m256i) -> __m256i {
        let upper = _mm256_and_si256(halves, _mm256_set1_epi32(-65536));
        _mm256_add_epi32(_mm256_slli_epi32::<16>(halves), upper)
    }

    /// Numbers counting down from the first lane's.
    #[target_feature(enable = "avx2")]
    fn numbers(first: u32) -> __m256i {
        _mm256_sub_epi32(_mm256_set1_epi32(first as i32), _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7))
    }

    #[target_feature(enable = "avx2")]
    pub fn avx2(a: &[u8], panel: &[u8], number: u32, largest: &mut [Largest], maxima: &mut [u32; PANEL]) {
        let depth = panel.len() / PANEL;
        assert!(a.len() == AVX2_ROWS * depth && largest.len() == AVX2_ROWS && depth.is_multiple_of(4));
        let mut sums = [[_mm256_setzero_si256(); 2]; AVX2_ROWS];
        for k in 0..depth / 4 {
            // SAFETY: the panel has 64 bytes for every four of the depth, and each row of A has four.
            unsafe {
                let b = panel.as_ptr().add(64 * k).cast::<__m256i>();
                let b = [_mm256_loadu_si256(b), _mm256_loadu_si256(b.add(1))];
                for (r, sums) in sums.iter_mut().enumerate() {
                    let four = a.as_ptr().add(r * depth + 4 * k).cast::<i32>().read_unaligned();
                    let four = _mm256_set1_epi32(four);
                    for (sum, b) in sums.iter_mut().zip(b) {
                        *sum = _mm256_add_epi16(*sum, _mm256_maddubs_epi16(b, four));
                    }
                }
            }
        }
        for h in 0..2 {
            let numbers = numbers(number - 8 * h as u32);
            // SAFETY: half h of sixteen numbers begins at 8 h.
            unsafe {
                let most = maxima.as_mut_ptr().add(8 * h).cast::<__m256i>();
                let mut column = _mm256_loadu_si256(most);
                for (sums, [first, second]) in sums.iter().zip(&mut *largest) {
                    let key = _mm256_or_si256(joined(sums[h]), numbers);
                    let first = first.as_mut_ptr().add(8 * h).cast::<__m256i>();
                    let second = second.as_mut_ptr().add(8 * h).cast::<__m256i>();
                    let before = _mm256_loadu_si256(first);
                    let lesser = _mm256_min_epu32(before, key);
                    _mm256_storeu_si256(second, _mm256_max_epu32(_mm256_loadu_si256(second), lesser));
                    _mm256_storeu_si256(first, _mm256_max_epu32(before, key));
                    column = _mm256_max_epu32(column, key);
                }
                _mm256_storeu_si256(most, column);
            }
        }
    }

    #[target_feature(enable = "avx512f,avx512bw,avx512vnni")]
    pub fn vnni(a: &[u8], panel: &[u8], number: u32, largest: &mut [Largest], maxima: &mut [u32; PANEL]) {
        let depth = panel.len() / PANEL;
        assert!(a.len() == VNNI_ROWS * depth && largest.len() == VNNI_ROWS && depth.is_multiple_of(4));
        let mut sums = [_mm512_setzero_si512(); VNNI_ROWS];
        for k in 0..depth / 4 {
            // SAFETY: the panel has 64 bytes for every four of the depth, and each row of A has four.
            unsafe {
                let b = _mm512_loadu_si512(panel.as_ptr().add(64 * k).cast());
                for (r, sum) in sums.iter_mut().enumerate() {
                    let four = a.as_ptr().add(r * depth + 4 * k).cast::<i32>().read_unaligned();
                    *sum = _mm512_dpbusd_epi32(*sum, b, _mm512_set1_epi32(four));
                }
            }
        }
        let lanes = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
        let numbers = _mm512_sub_epi32(_mm512_set1_epi32(number as i32), lanes);
        // SAFETY: all arrays have sixteen numbers.
        unsafe {
            let mut column = _mm512_loadu_si512(maxima.as_ptr().cast());
            for (sum, [first, second]) in sums.iter().zip(&mut *largest) {
                let key = _mm512_or_si512(_mm512_slli_epi32::<16>(*sum), numbers);
                let before = _mm512_loadu_si512(first.as_ptr().cast());
                let lesser = _mm512_min_epu32(before, key);
                let lesser = _mm512_max_epu32(_mm512_loadu_si512(second.as_ptr().cast()), lesser);
                _mm512_storeu_si512(second.as_mut_ptr().cast(), lesser);
                _mm512_storeu_si512(first.as_mut_ptr().cast(), _mm512_max_epu32(before, key));
                column = _mm512_max_epu32(column, key);
            }
            _mm512_storeu_si512(maxima.as_mut_ptr().cast(), column);
        }
    }

    /// The products of a vector with four others.
    #[target_feature(enable = "avx2")]
    pub fn four(query: &[u8], vectors: [&[u8]; 4]) -> [u32; 4] {
        assert!(vectors.iter().all(|v| v.len() == query.len()));
        let mut sums = [_mm256_setzero_si256(); 4];
        for k in 0..query.len() / STEP {
            // SAFETY: all vectors have 32 bytes at 32 k.
            unsafe {
                let q = _mm256_loadu_si256(query.as_ptr().add(STEP * k).cast());
                for (sum, vector) in sums.iter_mut().zip(vectors) {
                    let v = _mm256_loadu_si256(vector.as_ptr().add(STEP * k).cast());
                    *sum = _mm256_add_epi16(*sum, _mm256_maddubs_epi16(q, v));
                }
            }
        }
        let [a, b, c, d] = sums.map(|s| {
            let low = _mm256_and_si256(s, _mm256_set1_epi32(0xffff));
            _mm256_add_epi32(low, _mm256_srli_epi32::<16>(s))
        });
        let sums = _mm256_hadd_epi32(_mm256_hadd_epi32(a, b), _mm256_hadd_epi32(c, d));
        let sums = _mm_add_epi32(_mm256_castsi256_si128(sums), _mm256_extracti128_si256::<1>(sums));
        let mut out = [0_u32; 4];
        // SAFETY: four numbers.
        unsafe { _mm_storeu_si128(out.as_mut_ptr().cast(), sums) };
        out
    }
}
