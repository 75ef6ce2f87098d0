//! Lanes of every instruction set against scalars.

use proptest::prelude::*;
use weaver_kernels::lanes::{LANES, LaneKernel, LaneMask, Lanes, Vector, run_at};
use weaver_kernels::random::Stream;
use weaver_kernels::simd::Level;
use weaver_kernels::{Real, simd};

/// The instruction sets that can be tried here.
fn levels() -> Vec<Level> {
    simd::levels().collect()
}

/// The results of all operations on x, y, z, in a row.
struct Operations<'a, T>([&'a [T; LANES]; 3], u16);

impl<T: Real> LaneKernel<T> for Operations<'_, T> {
    type Output = Vec<[T; LANES]>;
    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) -> Self::Output {
        let [x, y, z] = self.0.map(V::load);
        let mask = V::Mask::from_bits(self.1);
        let bits = |mask: V::Mask| V::splat(T::from_usize(usize::from(mask.bits())));
        [
            x + y,
            x - y,
            x * y,
            x / y,
            -x,
            x.mul_add(y, z),
            x.neg_mul_add(y, z),
            x.min(y),
            x.max(y),
            x.abs(),
            x.abs().sqrt(),
            x.only(mask),
            x.or(mask, y),
            x.negative(mask),
            bits(x.ge(y)),
            bits(x.gt(y)),
            bits(x.ge_among(y, mask)),
            bits(x.gt_among(y, mask)),
            bits(mask.and(x.gt(z))),
            bits(mask.and_not(x.gt(z))),
            bits(mask.or(x.gt(z))),
        ]
        .map(V::to_array)
        .to_vec()
    }
}

fn expected([x, y, z]: [f64; 3], lane: usize, mask: u16, compare: &dyn Fn(bool, bool) -> f64) -> Vec<f64> {
    let (set, beyond) = (mask >> lane & 1 == 1, x > z);
    let flag = |b: bool| compare(b, true);
    vec![
        x + y,
        x - y,
        x * y,
        x / y,
        -x,
        x * y + z,
        z - x * y,
        if x < y { x } else { y },
        if x > y { x } else { y },
        x.abs(),
        x.abs().sqrt(),
        if set { x } else { 0.0 },
        if set { x } else { y },
        if set { -x.abs() } else { x },
        flag(x >= y),
        flag(x > y),
        flag(x >= y && set),
        flag(x > y && set),
        flag(set && beyond),
        flag(set && !beyond),
        flag(set || beyond),
    ]
}

fn check<T: Real>(seed: u64, mask: u16, level: Level) {
    let stream = Stream::new(seed, 0, "lanes");
    let mut inputs = [[T::ZERO; LANES]; 3];
    for (row, values) in inputs.iter_mut().enumerate() {
        for (lane, x) in values.iter_mut().enumerate() {
            // Small integers now and then, so that comparisons meet equal numbers.
            let at = (row * LANES + lane) as u64;
            let normal: f64 = stream.normal(at);
            *x = T::from_f64(if at.is_multiple_of(3) { normal.round() + 0.0 } else { normal });
        }
    }
    let rows = run_at(level, Operations([&inputs[0], &inputs[1], &inputs[2]], mask));
    for lane in 0..LANES {
        let scalars = [0, 1, 2].map(|row| inputs[row][lane].to_f64());
        let bit = |b: bool, _| f64::from(u8::from(b));
        for (row, want) in expected(scalars, lane, mask, &bit).into_iter().enumerate() {
            let got = rows[row][lane].to_f64();
            let got = if row >= 14 { f64::from(got as u16 >> lane & 1) } else { got };
            let scale = scalars.iter().map(|x| x.abs()).fold(1.0, f64::max);
            let close = (got - want).abs() <= 4.0 * T::EPSILON.to_f64() * (want.abs() + scale * scale);
            assert!(close || got == want || (got.is_nan() && want.is_nan()), "row {row}: {got} {want}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 4, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn operations_are_those_of_scalars(seed: u64, mask: u16) {
        for level in levels() {
            check::<f32>(seed, mask, level);
            check::<f64>(seed, mask, level);
        }
    }
}

struct Unary<'a, T>(&'a [T; LANES]);

impl<T: Real> LaneKernel<T> for Unary<'_, T> {
    type Output = [[T; LANES]; 4];
    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) -> Self::Output {
        let x = V::load(self.0);
        [x.exp2(), x.log2(), x.recip(), x.exp()].map(V::to_array)
    }
}

/// Largest error of exp2, log2, recip and exp in units in the last place, over `x`, where `f` is of interest.
fn worst(level: Level, which: usize, x: impl Iterator<Item = f32>, f: impl Fn(f64) -> f64) -> f64 {
    let x: Vec<f32> = x.collect();
    let mut worst = 0.0_f64;
    for chunk in x.as_chunks::<LANES>().0 {
        let got = run_at(level, Unary(chunk))[which];
        for (x, got) in chunk.iter().zip(got) {
            let want = f(f64::from(*x));
            let unit = f64::from(f32::EPSILON) * 2_f64.powi(want.abs().log2().floor() as i32);
            // Below the normal numbers, and where a logarithm is nearly 0, the distance that can be seen.
            let unit = unit.max(if which == 1 { 2_f64.powi(-25) } else { 2_f64.powi(-149) });
            let got = f64::from(got);
            let error =
                if want > f64::from(f32::MAX) && got == f64::INFINITY { 0.0 } else { (got - want).abs() / unit };
            assert!(!error.is_nan(), "{level:?}, function {which}: {got} at {x}");
            worst = worst.max(error);
        }
    }
    worst
}

#[test]
fn functions_are_accurate() {
    let steps = 1 << 17;
    for level in levels() {
        let exponents = (0..steps).map(|i| -152.0 + 284.0 * i as f32 / steps as f32);
        let error = worst(level, 0, exponents, f64::exp2);
        assert!(error < 2.5, "exp2 {level:?}: {error}");
        // All normal numbers, by their bits.
        let normal = || (0..steps).map(|i| f32::from_bits(0x0080_0000 + i * ((0x7f00_0000 - 0x0080_0000) / steps)));
        let error = worst(level, 1, normal(), f64::log2);
        assert!(error < 4.0, "log2 {level:?}: {error}");
        let error = worst(level, 2, normal().filter(|x| *x < 1e37), |x| 1.0 / x);
        assert!(error < 2.0, "recip {level:?}: {error}");
        let exponents = (0..steps).map(|i| -106.0 + 197.0 * i as f32 / steps as f32);
        let error = worst(level, 3, exponents, f64::exp);
        assert!(error < 2.0, "exp {level:?}: {error}");
    }
}

#[test]
fn exponentials_go_from_nothing_to_infinity() {
    for level in levels() {
        let x = std::array::from_fn(|i| {
            [0.0, -200.0, f32::NEG_INFINITY, 200.0, f32::INFINITY, f32::MAX, f32::MIN, f32::NAN][i % 8]
        });
        let [exp2, _, _, exp] = run_at(level, Unary(&x));
        for y in [exp2, exp] {
            let most = f32::INFINITY;
            assert_eq!(y[..7], [1.0, 0.0, 0.0, most, most, most, 0.0], "{level:?}");
            assert!(y[7].is_nan(), "{level:?}");
        }
    }
}

struct Normal<'a, T>(&'a [T; LANES]);

impl<T: Real> LaneKernel<T> for Normal<'_, T> {
    type Output = [[T; LANES]; 2];
    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) -> Self::Output {
        let (below, density) = V::load(self.0).normal();
        [below.to_array(), density.to_array()]
    }
}

/// Normal distribution is accurate in its lower tail too.
#[test]
fn the_lower_tail_is_accurate_too() {
    for level in levels() {
        for start in 0..800 {
            let x: [f32; LANES] = std::array::from_fn(|i| -4.0 + (start * LANES + i) as f32 * 1e-3);
            let [below, density] = run_at(level, Normal(&x));
            for (i, x) in x.map(f64::from).into_iter().enumerate() {
                let expected = 0.5 * (1.0 + weaver_kernels::erf::erf_f64(x * std::f64::consts::FRAC_1_SQRT_2));
                // The array's way goes through erf, which loses the tail.
                let slack = if level == Level::Portable { 6e-8 } else { 0.0 };
                let bound = 4e-7 + 1e-7 * x * x;
                assert!((f64::from(below[i]) - expected).abs() < bound * expected + slack, "{level:?} {x}");
                let expected = (-0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt();
                assert!((f64::from(density[i]) - expected).abs() < bound * expected, "{level:?} {x}");
            }
        }
        let [below, density] = run_at(level, Normal(&[f32::NAN; LANES]));
        assert!(below[0].is_nan() && density[0].is_nan());
        for (x, expected) in
            [(f32::INFINITY, [1.0, 0.0]), (3e38, [1.0, 0.0]), (-3e38, [0.0; 2]), (f32::NEG_INFINITY, [0.0; 2])]
        {
            assert_eq!(run_at(level, Normal(&[x; LANES])).map(|y| y[0]), expected, "{level:?} at {x}");
        }
    }
}

/// Powers of two times a scale.
struct Scaled<'a>(&'a [f32; LANES], f32);

impl LaneKernel<f32> for Scaled<'_> {
    type Output = [f32; LANES];
    #[inline(always)]
    fn run<V: Lanes<Scalar = f32>>(self) -> Self::Output {
        V::load(self.0).exp2_times(V::splat(self.1)).to_array()
    }
}

#[test]
fn scaled_powers_are_accurate_and_end_in_nothing() {
    let steps = 1 << 17;
    let exponents: Vec<f32> = (0..steps).map(|i| -126.0 + 253.0 * i as f32 / steps as f32).collect();
    for level in levels() {
        for chunk in exponents.as_chunks::<LANES>().0 {
            for scale in [0.7_f32, 1.7] {
                for (x, got) in chunk.iter().zip(run_at(level, Scaled(chunk, scale))) {
                    let want = f64::from(scale) * f64::from(*x).exp2();
                    let error = (f64::from(got) - want).abs() / want;
                    let normal = want >= f64::from(f32::MIN_POSITIVE);
                    assert!(!normal || error < 3.0 * f64::from(f32::EPSILON), "{level:?}: {error} at {scale} 2^{x}");
                }
            }
        }
        let beyond = std::array::from_fn(|i| [-126.1, -127.5, -1e3, -1e9, f32::MIN, f32::NEG_INFINITY][i % 6]);
        for got in run_at(level, Scaled(&beyond, 1.7)) {
            assert!((0.0..=1.7 * f32::MIN_POSITIVE).contains(&got), "{level:?}: {got}");
        }
    }
}

/// The results of all functions of x, y, z, computed part by part, and at once.
struct ByParts<'a, T>([&'a [T; LANES]; 3], u16);

impl<T: Real> LaneKernel<T> for ByParts<'_, T> {
    type Output = [Vec<[T; LANES]>; 2];
    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) -> Self::Output {
        let Self(rows, mask) = self;
        let (mut parts, mut whole) = (vec![[T::ZERO; LANES]; 27], vec![[T::ZERO; LANES]; 27]);
        for part in 0..V::PARTS {
            functions::<V::Part>(rows, mask, part, &mut parts);
        }
        functions::<V>(rows, mask, 0, &mut whole);
        [parts, whole]
    }
}

#[inline(always)]
fn functions<V: Vector>(rows: [&[V::Scalar; LANES]; 3], mask: u16, part: usize, out: &mut [[V::Scalar; LANES]]) {
    let [x, y, z] = rows.map(|row| V::load_part(row, part));
    let mask = V::Mask::from_bits(mask >> (part * V::WIDTH) & u16::MAX >> (LANES - V::WIDTH));
    let one = V::constant(1.0);
    let (below, density) = x.normal();
    let results = [
        x + y,
        x - y,
        x * y,
        x / y,
        -x,
        x.mul_add(y, z),
        x.neg_mul_add(y, z),
        x.min(y),
        x.max(y),
        x.abs(),
        x.abs().sqrt(),
        x.recip(),
        x.exp2_times(y),
        x.exp2(),
        x.exp(),
        x.abs().log2(),
        below,
        density,
        x.only(mask),
        x.or(mask, y),
        x.negative(mask),
        one.only(x.ge(y)),
        one.only(x.gt(y)),
        one.only(x.ge_among(y, mask)),
        one.only(mask.and(x.gt(z))),
        one.only(mask.and_not(x.gt(z))),
        one.only(mask.or(x.gt(z))),
    ];
    for (result, row) in results.into_iter().zip(out) {
        result.store_part(row, part);
    }
    assert_eq!(mask.bits() >> (V::WIDTH - 1) >> 1, 0, "bits beyond the lanes");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 4, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn parts_have_the_bits_of_the_whole(seed: u64, mask: u16) {
        let stream = Stream::new(seed, 0, "lanes");
        let row = |k: usize| std::array::from_fn(|i| 3.0 * stream.normal::<f32>((k * LANES + i) as u64));
        let rows: [[f32; LANES]; 3] = std::array::from_fn(row);
        for level in levels() {
            let [parts, whole] = run_at(level, ByParts(rows.each_ref(), mask));
            for (i, (part, whole)) in parts.iter().zip(&whole).enumerate() {
                assert_eq!(part.map(f32::to_bits), whole.map(f32::to_bits), "{level:?}, function {i}");
            }
        }
    }
}

/// The sums of rows added to a row of ones, by vectors that hold all parts of the rows in turn.
struct AddSums<'a, T>(&'a [[T; LANES]; LANES]);

impl<T: Real> LaneKernel<T> for AddSums<'_, T> {
    type Output = [T; LANES];
    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) -> Self::Output {
        let mut row = [T::ONE; LANES];
        for part in 0..V::PARTS {
            let of: [V::Part; LANES] = std::array::from_fn(|i| V::Part::load_part(&self.0[i], part));
            V::Part::add_sums(&of, &mut row);
        }
        row
    }
}

#[test]
fn sums_of_parts_are_added_to_a_row() {
    let stream = Stream::new(2, 0, "lanes");
    let rows: [[f32; LANES]; LANES] =
        std::array::from_fn(|i| std::array::from_fn(|j| stream.normal((i * LANES + j) as u64)));
    for level in levels() {
        for (got, row) in run_at(level, AddSums(&rows)).into_iter().zip(&rows) {
            let sum: f64 = row.iter().map(|x| f64::from(*x)).sum();
            assert!((f64::from(got) - 1.0 - sum).abs() < 1e-5, "{level:?}");
        }
    }
}

struct Rearrange<'a, T>(&'a [[T; LANES]; LANES]);

impl<T: Real> LaneKernel<T> for Rearrange<'_, T> {
    type Output = ([T; LANES], [[T; LANES]; LANES]);
    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) -> Self::Output {
        let mut rows: [V; LANES] = std::array::from_fn(|i| V::load(&self.0[i]));
        let sums = V::sums(&rows).to_array();
        V::transpose(&mut rows);
        (sums, rows.map(V::to_array))
    }
}

#[test]
fn sums_and_transposes_agree_to_the_bit() {
    let stream = Stream::new(1, 0, "lanes");
    let rows: [[f32; LANES]; LANES] =
        std::array::from_fn(|i| std::array::from_fn(|j| stream.normal((i * LANES + j) as u64)));
    let (first, _) = run_at(Level::Portable, Rearrange(&rows));
    for level in levels() {
        let (sums, columns) = run_at(level, Rearrange(&rows));
        assert_eq!(sums, first, "{level:?}");
        for i in 0..LANES {
            let sum: f64 = rows[i].iter().map(|x| f64::from(*x)).sum();
            assert!((f64::from(sums[i]) - sum).abs() < 1e-5);
            for j in 0..LANES {
                assert_eq!(columns[j][i], rows[i][j]);
            }
        }
    }
}
