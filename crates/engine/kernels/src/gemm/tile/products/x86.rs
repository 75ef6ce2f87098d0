//! Tiles of AVX-512 and AVX2.

use super::{LeftOperand, OutputRows};

/// The vector functions of one instruction set, and the tile made of them.
macro_rules! vector_tile {
    (
        $name:ident, $features:literal, $t:ty, $v:ty, $lanes:literal, $turn:literal, $rows:literal: $($row:literal)*,
        $zero:ident, $splat:ident, $load:ident, $store:ident, $mul:ident, $mul_add:ident,
        $mask:expr, $load_part:ident($($load_arg:ident)*), $store_part:ident
    ) => {
        #[allow(unsafe_code)]
        pub mod $name {
            use super::{LeftOperand, OutputRows};
            use std::arch::x86_64::*;

            pub const LANES: usize = $lanes;
            pub(super) type Vector = $v;

            #[inline]
            #[target_feature(enable = $features)]
            pub(super) fn zero() -> $v {
                $zero()
            }
            #[inline]
            #[target_feature(enable = $features)]
            pub(super) fn splat(x: $t) -> $v {
                $splat(x)
            }
            #[inline]
            #[target_feature(enable = $features)]
            fn mul(a: $v, b: $v) -> $v {
                $mul(a, b)
            }
            #[inline]
            #[target_feature(enable = $features)]
            fn mul_add(a: $v, b: $v, c: $v) -> $v {
                $mul_add(a, b, c)
            }
            #[inline]
            #[target_feature(enable = $features)]
            pub(super) unsafe fn load(p: *const $t) -> $v {
                // SAFETY: the caller guarantees LANES elements.
                unsafe { $load(p) }
            }
            #[inline]
            #[target_feature(enable = $features)]
            pub(super) unsafe fn store(p: *mut $t, x: $v) {
                // SAFETY: the caller guarantees LANES elements.
                unsafe { $store(p, x) }
            }
            #[inline]
            #[target_feature(enable = $features)]
            unsafe fn load_part(p: *const $t, count: usize) -> $v {
                // SAFETY: masked lanes are not accessed; the caller guarantees `count` elements.
                unsafe {
                    let mask = $mask(count);
                    vector_tile!(@load $load_part, mask, p, $($load_arg)*)
                }
            }
            #[inline]
            #[target_feature(enable = $features)]
            unsafe fn store_part(p: *mut $t, count: usize, x: $v) {
                // SAFETY: masked lanes are not accessed; the caller guarantees `count` elements.
                unsafe { $store_part(p, $mask(count), x) }
            }

            products!($t, $turn, $rows: $($row)*, #[target_feature(enable = $features)]);
            windows!($t, $($row)*, #[target_feature(enable = $features)]);
            stores!($t, #[target_feature(enable = $features)]);
        }
    };
    (@load $load:ident, $mask:ident, $p:ident, mask_first) => { $load($mask, $p) };
    (@load $load:ident, $mask:ident, $p:ident, mask_last) => { $load($p, $mask) };
}

/// Eight set lanes followed by eight clear ones: a window of it is a mask of the first `count` lanes.
static WINDOW: [i32; 16] = [-1, -1, -1, -1, -1, -1, -1, -1, 0, 0, 0, 0, 0, 0, 0, 0];

vector_tile!(
    avx512_f32, "avx512f", f32, __m512, 16, 1, 12: 1 2 3 4 5 6 7 8 9 10 11 12,
    _mm512_setzero_ps, _mm512_set1_ps, _mm512_loadu_ps, _mm512_storeu_ps, _mm512_mul_ps, _mm512_fmadd_ps,
    (|count: usize| ((1_u32 << count) - 1) as __mmask16), _mm512_maskz_loadu_ps(mask_first), _mm512_mask_storeu_ps
);
vector_tile!(
    avx512_f64, "avx512f", f64, __m512d, 8, 1, 12: 1 2 3 4 5 6 7 8 9 10 11 12,
    _mm512_setzero_pd, _mm512_set1_pd, _mm512_loadu_pd, _mm512_storeu_pd, _mm512_mul_pd, _mm512_fmadd_pd,
    (|count: usize| ((1_u32 << count) - 1) as __mmask8), _mm512_maskz_loadu_pd(mask_first), _mm512_mask_storeu_pd
);
vector_tile!(
    avx2_f32, "avx2,fma", f32, __m256, 8, 4, 6: 1 2 3 4 5 6,
    _mm256_setzero_ps, _mm256_set1_ps, _mm256_loadu_ps, _mm256_storeu_ps, _mm256_mul_ps, _mm256_fmadd_ps,
    (|count: usize| _mm256_loadu_si256(super::WINDOW[8 - count..].as_ptr().cast())), _mm256_maskload_ps(mask_last), _mm256_maskstore_ps
);
vector_tile!(
    avx2_f64, "avx2,fma", f64, __m256d, 4, 4, 6: 1 2 3 4 5 6,
    _mm256_setzero_pd, _mm256_set1_pd, _mm256_loadu_pd, _mm256_storeu_pd, _mm256_mul_pd, _mm256_fmadd_pd,
    (|count: usize| _mm256_loadu_si256(super::WINDOW[8 - 2 * count..].as_ptr().cast())), _mm256_maskload_pd(mask_last), _mm256_maskstore_pd
);

/// Tiles whose numbers are pairs of bf16: a product is the sum of two products.
#[allow(unsafe_code)]
pub mod avx512_pairs {
    use super::avx512_f32::{LANES, Vector, fetch, finish, load, splat, store, zero};
    use super::{LeftOperand, OutputRows};
    use std::arch::x86_64::*;

    #[inline]
    #[target_feature(enable = "avx512f,avx512bf16")]
    fn mul_add(a: Vector, b: Vector, sum: Vector) -> Vector {
        // SAFETY: any bits are a vector of either type.
        let [a, b] = unsafe { std::mem::transmute::<[__m512; 2], [__m512bh; 2]>([a, b]) };
        _mm512_dpbf16_ps(sum, a, b)
    }

    products!(f32, 1, 12: 1 2 3 4 5 6 7 8 9 10 11 12, #[target_feature(enable = "avx512f,avx512bf16")]);
}
