//! Tiles for any processor.

use super::{LeftOperand, OutputRows};

/// The vector functions and the tile for any target: arrays, which the compiler vectorizes with the baseline
/// instructions.
macro_rules! portable_tile {
    ($name:ident, $t:ty, $lanes:literal) => {
        #[allow(unsafe_code)]
        pub mod $name {
            use super::{LeftOperand, OutputRows};

            pub const LANES: usize = $lanes;
            type Vector = [$t; LANES];

            #[inline(always)]
            fn zero() -> Vector {
                [0.0; LANES]
            }
            #[inline(always)]
            fn splat(x: $t) -> Vector {
                [x; LANES]
            }
            #[inline(always)]
            fn mul(a: Vector, b: Vector) -> Vector {
                std::array::from_fn(|i| a[i] * b[i])
            }
            // A fused operation would be a library call here.
            #[inline(always)]
            fn mul_add(a: Vector, b: Vector, c: Vector) -> Vector {
                std::array::from_fn(|i| a[i] * b[i] + c[i])
            }
            #[inline(always)]
            unsafe fn load(p: *const $t) -> Vector {
                // SAFETY: the caller guarantees LANES elements; Vector needs no more alignment than they have.
                unsafe { p.cast::<Vector>().read() }
            }
            #[inline(always)]
            unsafe fn store(p: *mut $t, x: Vector) {
                // SAFETY: as for `load`.
                unsafe { p.cast::<Vector>().write(x) }
            }
            #[inline(always)]
            unsafe fn load_part(p: *const $t, count: usize) -> Vector {
                // SAFETY: the caller guarantees `count` elements.
                std::array::from_fn(|i| if i < count { unsafe { *p.add(i) } } else { 0.0 })
            }
            #[inline(always)]
            unsafe fn store_part(p: *mut $t, count: usize, x: Vector) {
                for i in 0..count {
                    // SAFETY: the caller guarantees `count` elements.
                    unsafe { *p.add(i) = x[i] }
                }
            }

            products!($t, 1, 4: 1 2 3 4,);
            windows!($t, 1 2 3 4,);
            stores!($t,);
        }
    };
}

portable_tile!(portable_f32, f32, 4);
portable_tile!(portable_f64, f64, 2);
