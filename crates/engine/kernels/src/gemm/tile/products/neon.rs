//! Tiles of NEON.

use super::{LeftOperand, OutputRows};

/// The vector functions of NEON, whose vectors are two registers, and the tile made of them: as wide and as high as
/// that of AVX2, with twice as many registers half as wide.
macro_rules! neon_tile {
    (
        $name:ident, $t:ty, $v:ty, $half:literal,
        $splat:ident, $load:ident, $store:ident, $mul:ident, $mul_add:ident
    ) => {
        #[allow(unsafe_code)]
        pub mod $name {
            use super::{LeftOperand, OutputRows};
            use std::arch::aarch64::*;

            pub const LANES: usize = 2 * $half;
            type Vector = [$v; 2];

            #[inline(always)]
            fn zero() -> Vector {
                splat(0.0)
            }
            #[inline(always)]
            fn splat(x: $t) -> Vector {
                // SAFETY: NEON belongs to the baseline, here and below.
                unsafe { [$splat(x); 2] }
            }
            #[inline(always)]
            fn mul(a: Vector, b: Vector) -> Vector {
                unsafe { [$mul(a[0], b[0]), $mul(a[1], b[1])] }
            }
            #[inline(always)]
            fn mul_add(a: Vector, b: Vector, c: Vector) -> Vector {
                unsafe { [$mul_add(c[0], a[0], b[0]), $mul_add(c[1], a[1], b[1])] }
            }
            #[inline(always)]
            unsafe fn load(p: *const $t) -> Vector {
                // SAFETY: the caller guarantees LANES elements.
                unsafe { [$load(p), $load(p.add($half))] }
            }
            #[inline(always)]
            unsafe fn store(p: *mut $t, x: Vector) {
                // SAFETY: the caller guarantees LANES elements.
                unsafe {
                    $store(p, x[0]);
                    $store(p.add($half), x[1]);
                }
            }
            #[inline(always)]
            unsafe fn load_part(p: *const $t, count: usize) -> Vector {
                let mut part = [0.0; LANES];
                // SAFETY: the caller guarantees `count` elements, at most LANES.
                unsafe {
                    p.copy_to_nonoverlapping(part.as_mut_ptr(), count);
                    load(part.as_ptr())
                }
            }
            #[inline(always)]
            unsafe fn store_part(p: *mut $t, count: usize, x: Vector) {
                let mut part = [0.0; LANES];
                // SAFETY: the caller guarantees `count` elements, at most LANES.
                unsafe {
                    store(part.as_mut_ptr(), x);
                    p.copy_from_nonoverlapping(part.as_ptr(), count);
                }
            }

            products!($t, 4, 6: 1 2 3 4 5 6,);
            windows!($t, 1 2 3 4 5 6,);
            stores!($t,);
        }
    };
}

neon_tile!(neon_f32, f32, float32x4_t, 4, vdupq_n_f32, vld1q_f32, vst1q_f32, vmulq_f32, vfmaq_f32);
neon_tile!(neon_f64, f64, float64x2_t, 2, vdupq_n_f64, vld1q_f64, vst1q_f64, vmulq_f64, vfmaq_f64);
