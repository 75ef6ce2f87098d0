//! Promises of every kernel: the same bits at any number of threads, the same numbers by every instruction set, and NaN
//! and infinities that reach the values depending on them and nothing else.

mod suite;

use std::process::Command;
use suite::{Kernel, every};
use weaver_kernels::attention::*;
use weaver_kernels::layer_norm::*;
use weaver_kernels::random::Stream;
use weaver_kernels::softmax::*;
use weaver_kernels::{Real, simd};

fn bits<T: Real>(x: &[T]) -> Vec<u64> {
    x.iter().map(|x| x.to_f64().to_bits()).collect()
}

fn same_at_any_number_of_threads<T: Real>(seed: u64) {
    let kernels = every::<T>(seed, true);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
        pool.install(|| kernels.iter().map(|k| bits(&(k.run)(&k.inputs))).collect::<Vec<_>>())
    };
    let first = run(1);
    for threads in [2, 4] {
        for ((kernel, first), other) in kernels.iter().zip(&first).zip(run(threads)) {
            assert!(first.iter().any(|x| *x != 0), "{}: a result of zeros proves nothing", kernel.name);
            assert_eq!(*first, other, "{} at {threads} threads", kernel.name);
        }
    }
}

#[test]
fn same_bits_at_one_two_and_four_threads() {
    (0..2).for_each(same_at_any_number_of_threads::<f32>);
    same_at_any_number_of_threads::<f64>(2);
}

/// The sign of a change, and whether there is one.
fn change<T: Real>(from: T, to: T) -> i32 {
    i32::from(to > from) - i32::from(to < from)
}

/// NaN, or an infinity, in one place of one input: values that depend on that place become NaN (or, in linear kernels,
/// an infinity of the right sign), everything else stays as it was, to the bit.
fn special_values_go_where_they_belong<T: Real>(kernel: &Kernel<T>, seed: u64) {
    let plain = (kernel.run)(&kernel.inputs);
    for which in 0..kernel.inputs.len() {
        for draw in 0..3 {
            let at = Stream::new(seed, draw, "every_kernel.place").below(which as u64, kernel.inputs[which].len());
            let with = |value: T| {
                let mut inputs = kernel.inputs.clone();
                inputs[which][at] = value;
                (kernel.run)(&inputs)
            };
            let moved = with(kernel.inputs[which][at] + T::ONE);
            let (nan, infinite) = (with(T::from_f64(f64::NAN)), with(T::INFINITY));
            let what = format!("{} input {which} element {at}", kernel.name);
            for i in 0..plain.len() {
                if moved[i] == plain[i] {
                    // A weight of zero makes NaN, too.
                    assert!(nan[i].to_f64().is_nan() || nan[i] == plain[i], "{what}: {} became {}", plain[i], nan[i]);
                    continue;
                }
                assert!(nan[i].to_f64().is_nan(), "{what}: NaN became {} at {i}", nan[i]);
                if kernel.linear {
                    let expected = f64::INFINITY * f64::from(change(plain[i], moved[i]));
                    assert_eq!(infinite[i].to_f64(), expected, "{what}: infinity at {i}");
                }
            }
        }
    }
}

#[test]
fn nan_and_infinity_go_where_they_belong() {
    for seed in 0..3 {
        every::<f32>(seed, false).iter().for_each(|k| special_values_go_where_they_belong(k, seed));
        every::<f64>(seed, false).iter().for_each(|k| special_values_go_where_they_belong(k, seed));
    }
}

/// The curved ones: an infinity less an infinity is NaN, e to minus infinity is 0.
#[test]
fn infinities_in_curved_kernels() {
    let infinity = f32::INFINITY;
    let softmax = |x: [f32; 3]| {
        let mut y = [0.0; 3];
        softmax_forward(3, 1, &x, &mut y);
        y
    };
    assert_eq!(softmax([0.0, -infinity, 0.0]), [0.5, 0.0, 0.5]);
    let (mut long, mut y) = ([-infinity; 40], [0.0; 40]); // long enough for vectors
    long[7] = 1.0;
    softmax_forward(40, 1, &long, &mut y);
    assert!(y.iter().enumerate().all(|(i, y)| *y == f32::from(u8::from(i == 7))));
    assert!(softmax([0.0, infinity, 0.0])[1].is_nan() && softmax([-infinity; 3]).iter().all(|y| y.is_nan()));

    let (mut y, mut stats) = ([0.0; 4], [0.0; 4]);
    layer_norm_forward(2, 1e-5, &[infinity, 0.0, 1.0, -1.0], None, &mut y, &mut stats);
    assert!(y[..2].iter().all(|y| y.is_nan()) && y[2..].iter().all(|y| y.abs() < 1.0));

    let (shape, at) =
        (AttentionShape { batch: 1, heads: 1, queries: 1, keys: 2, dim: 1 }, Strides::heads_first(2, 1, 1));
    let attend = |k: [f32; 2], v: [f32; 2]| {
        let (mut out, mut lse) = ([0.0], [0.0]);
        let inputs = AttentionInputs { shape, scale: 1.0, q: (&[1.0], at), k: (&k, at), v: (&v, at) };
        attention_forward(&inputs, (&mut out, at), &mut lse);
        (out[0], lse[0])
    };
    assert_eq!(attend([0.5, -infinity], [3.0, 7.0]), (3.0, 0.5 * std::f32::consts::LOG2_E));
    assert!(attend([0.5, infinity], [3.0, 7.0]).0.is_nan());
    assert!(attend([-infinity; 2], [3.0, 7.0]).0.is_nan());
    assert_eq!(attend([0.0, 0.0], [3.0, infinity]).0, infinity);
    assert!(attend([0.0, -infinity], [3.0, infinity]).0.is_nan(), "0 times infinity");
}

/// Set in the processes that [`instruction_sets_agree`] starts.
const RESULTS: &str = "WEAVER_KERNEL_RESULTS";
const SEEDS: std::ops::Range<u64> = 10..16;

/// All results, in `f64`.
fn results() -> Vec<f64> {
    let single = SEEDS.flat_map(|seed| every::<f32>(seed, false)).flat_map(|k| (k.run)(&k.inputs)).map(f64::from);
    let double = SEEDS.flat_map(|seed| every::<f64>(seed, false)).flat_map(|k| (k.run)(&k.inputs));
    single.chain(double).collect()
}

/// The name by which `WEAVER_SIMD` knows an instruction set.
fn name(level: simd::Level) -> String {
    format!("{level:?}").to_lowercase()
}

/// The instruction set is chosen once in a process, so that each has a process of its own.
#[test]
fn instruction_sets_agree() {
    if let Some(path) = std::env::var_os(RESULTS) {
        let bytes: Vec<u8> = results().iter().flat_map(|x| x.to_le_bytes()).collect();
        return std::fs::write(path, bytes).expect("the parent's folder can be written to");
    }
    let run = |level: &str| -> Vec<f64> {
        let path = std::env::temp_dir().join(format!("weaver-kernels-{}-{level}", std::process::id()));
        let mut command = Command::new(std::env::current_exe().expect("a test has an executable"));
        command.args(["--exact", "every_kernel::instruction_sets_agree"]).env("WEAVER_SIMD", level).env(RESULTS, &path);
        let output = command.output().expect("a test can be started again");
        assert!(output.status.success(), "{level}: {}", String::from_utf8_lossy(&output.stdout));
        let bytes = std::fs::read(&path).expect("the results");
        std::fs::remove_file(&path).expect("the results can be removed");
        bytes.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().expect("eight bytes"))).collect()
    };
    let portable = run("portable");
    assert!(portable.len() > 100_000);
    for level in simd::levels().skip(1) {
        let level = &name(level);
        let mut results = run(level).into_iter().zip(&portable);
        for seed in SEEDS {
            compare(level, every::<f32>(seed, false), &mut results, 3e-5);
        }
        for seed in SEEDS {
            compare(level, every::<f64>(seed, false), &mut results, 3e-13);
        }
        assert!(results.next().is_none());
    }
    assert!(simd::level() <= simd::Level::Avx512);
}

/// The tests against slow twins, by the instruction sets that this processor would not choose.
#[test]
fn lesser_instruction_sets_pass_the_same_tests() {
    for level in simd::levels().filter(|level| *level < simd::level()).map(name) {
        let mut command = Command::new(std::env::current_exe().expect("a test has an executable"));
        command.args([
            "gemm::small",
            "gemm::larger",
            "gemm::batched",
            "gemm::every_cut",
            "conv::matches",
            "attention::matches",
        ]);
        command.args(["layer_norm::matches", "softmax::matches", "reduce::rows", "gemm::every_size", "gelu", "half"]);
        command.args(["every_kernel::nan", "every_kernel::infinities", "byte_products"]).env("WEAVER_SIMD", &level);
        let output = command.output().expect("a test can be started again");
        let text = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success() && !text.contains("running 0 tests"), "{level}: {text}");
    }
}

/// The next results belong to these kernels; equal up to the rounding of sums of products in another order.
fn compare<'a, T: Real>(
    level: &str,
    kernels: Vec<Kernel<T>>,
    results: &mut impl Iterator<Item = (f64, &'a f64)>,
    tolerance: f64,
) {
    for kernel in kernels {
        // Only some processors multiply pairs as they are, and round A for it to three digits; others widen them.
        let tolerance = if kernel.name.contains("pairs") { 0.1 } else { tolerance };
        for i in 0..(kernel.run)(&kernel.inputs).len() {
            let (got, portable) = results.next().expect("as many results");
            let close = (got - portable).abs() <= tolerance * (1.0 + portable.abs());
            assert!(close, "{} at {i}: {got} by {level}, {portable} by portable code", kernel.name);
        }
    }
}
