//! The kernels at the sizes of a small model on 64 x 48 images.

use criterion::{Criterion, Throughput};
use half::{bf16, f16};
use std::hint::black_box;
use std::time::Duration;
use weaver_kernels::attention::*;
use weaver_kernels::byte_products::{TopTwo, chosen_products, top_products};
use weaver_kernels::conv::{
    Conv2dShape, conv_transpose2d_dw, conv_transpose2d_dx, conv_transpose2d_forward, conv_transpose2d_scratch_len,
    conv2d_dw, conv2d_dw_scratch_len, conv2d_dx, conv2d_dx_scratch_len, conv2d_forward,
};
use weaver_kernels::gelu::{gelu_backward, gelu_forward};
use weaver_kernels::gemm::{Half, Mat, MatMut, gemm, gemm_batched, gemm_half, gemm_half_scratch_len};
use weaver_kernels::layer_norm::{layer_norm_backward, layer_norm_forward, layer_norm_scratch_len};
use weaver_kernels::nearest_neighbors::nearest_neighbors;
use weaver_kernels::optim::{AdamW, lerp};
use weaver_kernels::permute::permute;
use weaver_kernels::random::Stream;
use weaver_kernels::reduce::{column_sums, dot, row_sums, sum};
use weaver_kernels::resample::Resample;
use weaver_kernels::rope::Rope2d;
use weaver_kernels::rows::{copy_blocks, gather_rows, scatter_add_rows};
use weaver_kernels::softmax::{softmax_backward, softmax_forward};
use weaver_kernels::{Real, simd};

fn numbers(n: usize) -> Vec<f32> {
    (0..n).map(|i| (i % 17) as f32 * 0.1 - 0.8).collect()
}

/// Elementwise loops; throughput in elements.
fn pointwise(c: &mut Criterion) {
    let mut group = c.benchmark_group("pointwise");
    let (x, mut y) = (numbers(1 << 14), numbers(1 << 14));
    group.throughput(Throughput::Elements(x.len() as u64));
    group.bench_function("exp called", |b| {
        b.iter(|| y.iter_mut().zip(black_box(&x)).for_each(|(y, x)| *y = Real::exp(*x)));
    });
    macro_rules! dispatched {
        ($name:literal, $f:expr) => {
            group.bench_function($name, |b| {
                b.iter(|| {
                    let x = black_box(&x);
                    simd::dispatch(
                        #[inline(always)]
                        || {
                            for (y, x) in y.iter_mut().zip(x) {
                                *y = $f(*x);
                            }
                        },
                    );
                });
            });
        };
    }
    dispatched!("exp", Real::exp);
    dispatched!("tanh", Real::tanh);
    dispatched!("erf", Real::erf);
    let mut dx = x.clone();
    group.bench_function("gelu forward", |b| b.iter(|| gelu_forward(black_box(&x), &mut y)));
    group.bench_function("gelu backward", |b| b.iter(|| gelu_backward(black_box(&x), &y, (&mut dx, 0.0))));
    let stream = Stream::new(0, 0, "bench");
    group.bench_function("normal numbers", |b| {
        b.iter(|| y.iter_mut().enumerate().for_each(|(i, y)| *y = stream.normal(i as u64)));
    });
    group.finish();
}

/// The largest products of vectors of bytes; throughput in products of bytes.
fn byte_products(c: &mut Criterion) {
    let mut group = c.benchmark_group("byte products");
    let (n, depth) = (3000, 128);
    let bytes = |by: usize| -> Vec<u8> { (0..n * depth).map(|i| (i * by % 31) as u8).collect() };
    let (a, b) = (bytes(7), bytes(11));
    let (mut rows, mut columns) = (vec![TopTwo::default(); n], vec![0; n]);
    group.throughput(Throughput::Elements((n * n * depth) as u64));
    group.bench_function("3000x3000x128", |bench| {
        bench.iter(|| top_products(depth, black_box(&a), &b, &mut rows, &mut columns));
    });
    let chosen: Vec<u32> = (0..200).map(|i| i * 13).collect();
    let mut out = vec![0; chosen.len()];
    group.throughput(Throughput::Elements((chosen.len() * depth) as u64));
    group.bench_function("200 chosen of 3000", |bench| {
        bench.iter(|| chosen_products(black_box(&a[..depth]), &b, &chosen, &mut out));
    });
    group.finish();
}

/// Products; throughput in floating-point operations.
fn products(c: &mut Criterion) {
    let mut group = c.benchmark_group("gemm");
    let sizes =
        [(512, 512, 512, false), (220, 384, 96, true), (51, 288, 96, true), (12288, 23, 32, true), (51, 51, 32, true)];
    for (m, n, k, trans_b) in sizes {
        let (a, b, mut y) = (numbers(m * k), numbers(k * n), numbers(m * n));
        group.throughput(Throughput::Elements((2 * m * n * k) as u64));
        let b = if trans_b { Mat::new(&b, n, k).transposed() } else { Mat::new(&b, k, n) };
        group.bench_function(format!("{m}x{n}x{k}{}", if trans_b { "t" } else { "" }), |bench| {
            bench.iter(|| gemm(1.0, Mat::new(black_box(&a), m, k), b, 0.0, MatMut::new(&mut y, m, n)));
        });
    }
    let (batch, n, k) = (12, 53, 32);
    let (a, mut y) = (numbers(batch * n * k), numbers(batch * n * n));
    group.throughput(Throughput::Elements((2 * y.len() * k) as u64));
    group.bench_function(format!("{batch} of {n}x{n}x{k}t"), |bench| {
        bench.iter(|| {
            let (a, y) = (Mat::new(black_box(&a), n, k).batch(n * k), MatMut::new(&mut y, n, n).batch(n * n));
            gemm_batched(batch, 1.0, a, a.transposed(), 0.0, y);
        });
    });
    let (m, n, k) = (686, 1024, 1024);
    let (a, mut y, numbers) = (numbers(m * k), vec![0.0; m * n], numbers(n * k));
    let brief: Vec<bf16> = numbers.iter().map(|x| bf16::from_f32(*x)).collect();
    let half: Vec<f16> = numbers.iter().map(|x| f16::from_f32(*x)).collect();
    group.throughput(Throughput::Elements((2 * m * n * k) as u64));
    for (name, w) in [("bf16", Half::Bf16(&brief)), ("bf16 pairs", Half::Bf16Pairs(&brief)), ("f16", Half::F16(&half))]
    {
        let mut scratch = vec![0.0; gemm_half_scratch_len(m, k, w)];
        group.bench_function(format!("{m}x{n}x{k}t {name}"), |bench| {
            bench.iter(|| gemm_half(Mat::new(black_box(&a), m, k), w, 0.0, MatMut::new(&mut y, m, n), &mut scratch));
        });
    }
    group.finish();
}

/// Convolutions; throughput in floating-point operations.
fn convolutions(c: &mut Criterion) {
    let mut group = c.benchmark_group("conv2d");
    let (h, w, stride) = (48, 64, 1);
    for size in [
        Conv2dShape { n: 4, c: 32, h, w, o: 32, kh: 3, kw: 3, stride, pad: 1 },
        Conv2dShape { n: 4, c: 8, h, w, o: 32, kh: 5, kw: 5, stride, pad: 2 },
        Conv2dShape { n: 4, c: 96, h: 6, w: 8, o: 32, kh: 3, kw: 3, stride, pad: 1 },
    ] {
        let pixels = size.out_h() * size.out_w();
        let mut x = numbers(size.n * size.c * size.h * size.w);
        let mut weights = numbers(size.o * size.c * size.kh * size.kw);
        let mut y = numbers(size.n * size.o * pixels);
        let mut scratch = vec![0.0; conv2d_dx_scratch_len(&size)];
        let mut turned = vec![0.0; conv2d_dw_scratch_len::<f32>(&size)];
        group.throughput(Throughput::Elements((2 * y.len() * weights.len() / size.o) as u64));
        let name = format!("{}x{} {}x{} at {}x{}", size.c, size.o, size.kh, size.kw, size.h, size.w);
        group.bench_function(format!("{name} forward"), |b| {
            b.iter(|| conv2d_forward(&size, black_box(&x), &weights, None, &mut y));
        });
        group.bench_function(format!("{name} dw"), |b| {
            b.iter(|| conv2d_dw(&size, black_box(&x), &y, (&mut weights, 0.0), &mut turned));
        });
        weights.fill(0.1);
        group.bench_function(format!("{name} dx"), |b| {
            b.iter(|| conv2d_dx(&size, black_box(&weights), &y, (&mut x, 0.0), &mut scratch));
        });
    }
    group.finish();
}

/// Transposed convolution, 32 to 16 channels, twice as large; throughput in floating-point operations.
fn transposed(c: &mut Criterion) {
    let mut group = c.benchmark_group("conv_transpose2d");
    let size = Conv2dShape { n: 4, c: 16, h: 48, w: 64, o: 32, kh: 2, kw: 2, stride: 2, pad: 0 };
    let mut x = numbers(size.n * size.o * size.out_h() * size.out_w());
    let mut weights = numbers(size.o * size.c * size.kh * size.kw);
    let mut y = numbers(size.n * size.c * size.h * size.w);
    let mut scratch = vec![0.0; conv_transpose2d_scratch_len(&size)];
    let mut turned = vec![0.0; conv2d_dw_scratch_len::<f32>(&size)];
    group.throughput(Throughput::Elements((2 * x.len() * weights.len() / size.o) as u64));
    group.bench_function("forward", |b| {
        b.iter(|| conv_transpose2d_forward(&size, black_box(&x), &weights, None, &mut y, &mut scratch));
    });
    group.bench_function("dw", |b| {
        b.iter(|| conv_transpose2d_dw(&size, black_box(&x), &y, (&mut weights, 0.0), &mut turned));
    });
    weights.fill(0.1);
    group.bench_function("dx", |b| b.iter(|| conv_transpose2d_dx(&size, black_box(&weights), &y, (&mut x, 0.0))));
    group.finish();
}

fn tokens(c: &mut Criterion) {
    let mut group = c.benchmark_group("tokens");
    for (batch, n) in [(4, 53), (1, 212)] {
        let shape = AttentionShape { batch, heads: 3, queries: n, keys: n, dim: 32 };
        let (at, len) = (Strides::tokens_first(n, 3, 32), batch * n * 96);
        let (qkv, mut out, mut lse) = (numbers(3 * len), numbers(len), vec![0.0; batch * 3 * n]);
        let [q, k, v] = [0, len, 2 * len].map(|offset| (&qkv[offset..], at));
        group.bench_function(format!("attention {batch}x{n} forward"), |b| {
            let inputs = AttentionInputs { shape, scale: 0.2, q, k, v };
            b.iter(|| attention_forward(black_box(&inputs), (&mut out, at), &mut lse));
        });
        let (dout, mut dq, mut dk, mut dv) = (numbers(len), numbers(len), numbers(len), numbers(len));
        group.bench_function(format!("attention {batch}x{n} backward"), |b| {
            let inputs = AttentionInputs { shape, scale: 0.2, q, k, v };
            let output = AttentionOutput { out: (&out, at), lse: &lse };
            b.iter(|| {
                let gradients = [&mut dq, &mut dk, &mut dv].map(|d| Some(((&mut d[..], 0.0), at)));
                attention_backward(black_box(&inputs), &output, &dout, gradients);
            });
        });
    }
    let (x, w) = (numbers(220 * 96), numbers(96));
    let (mut y, mut stats, mut dx) = (x.clone(), vec![0.0; 440], x.clone());
    group.bench_function("layer_norm 220x96 forward", |b| {
        b.iter(|| layer_norm_forward(96, 1e-5, black_box(&x), Some((&w, &w)), &mut y, &mut stats));
    });
    let (mut dw, mut db, mut scratch) = (w.clone(), w.clone(), vec![0.0; layer_norm_scratch_len(220, 96)]);
    group.bench_function("layer_norm 220x96 backward", |b| {
        b.iter(|| {
            let targets = [&mut dx, &mut dw, &mut db].map(|target| Some((&mut target[..], 0.0)));
            layer_norm_backward(96, black_box(&x), Some(&w), &stats, &y, targets, &mut scratch);
        });
    });
    group.bench_function("softmax 220x96", |b| b.iter(|| softmax_forward(96, 1, black_box(&x), &mut y)));
    group.bench_function("softmax 220x96 backward", |b| {
        b.iter(|| softmax_backward(96, 1, black_box(&y), &x, (&mut dx, 0.0)));
    });
    let positions: Vec<_> = (0..220).map(|i| [i / 20, i % 20]).collect();
    let rope = Rope2d::new(&positions, 32, 100.0);
    group.bench_function("rope 220 tokens, 3 heads of 32, forward", |b| {
        b.iter(|| rope.forward(3, black_box(&x), &mut y));
    });
    group.bench_function("rope 220 tokens, 3 heads of 32, backward", |b| {
        b.iter(|| rope.backward(3, black_box(&y), (&mut dx, 0.0)));
    });
    group.finish();
}

/// Resizing and filters of 32 maps; throughput in pixels of the larger size.
fn resampling(c: &mut Criterion) {
    let mut group = c.benchmark_group("resample");
    let (small, large) = ([24, 32], [48, 64]);
    for (name, plan) in [
        ("bilinear 24x32 to 48x64", Resample::bilinear(small, large, true)),
        ("bicubic 24x32 to 48x64", Resample::bicubic(small, large)),
        ("bicubic_antialiased 48x64 to 24x32", Resample::bicubic_antialiased(large, small)),
        ("box_filter 7 of 48x64", Resample::box_filter(large, 7)),
    ] {
        let [mut x, mut y] = [plan.input_size(), plan.output_size()].map(|[h, w]| numbers(32 * h * w));
        group.throughput(Throughput::Elements(x.len().max(y.len()) as u64));
        group.bench_function(format!("{name} forward"), |b| b.iter(|| plan.forward(black_box(&x), &mut y)));
        group.bench_function(format!("{name} backward"), |b| b.iter(|| plan.backward(black_box(&y), (&mut x, 0.0))));
    }
    group.finish();
}

/// Elements moved and added up, a matrix of 4096 x 96; throughput in bytes of the matrix.
fn memory(c: &mut Criterion) {
    let mut group = c.benchmark_group("memory");
    let (rows, cols) = (4096, 96);
    let (x, mut y) = (numbers(rows * cols), numbers(rows * cols));
    group.throughput(Throughput::Bytes(size_of_val(&x[..]) as u64));
    for (name, axes) in [("permute 0213", [0, 2, 1, 3]), ("permute 0132", [0, 1, 3, 2])] {
        group.bench_function(name, |b| b.iter(|| permute([4, 1024, 3, 32], axes, black_box(&x), (&mut y, 0.0))));
    }
    // 5 has no divisor in common with the number of rows, so every row comes once.
    let index: Vec<u32> = (0..rows as u32).map(|i| 5 * i % rows as u32).collect();
    group.bench_function("gather_rows", |b| b.iter(|| gather_rows(cols, black_box(&x), &index, (&mut y, 0.0))));
    group.bench_function("scatter_add_rows", |b| {
        b.iter(|| scatter_add_rows(cols, black_box(&x), &index, (&mut y, 0.0)));
    });
    group.bench_function("copy_blocks", |b| {
        b.iter(|| copy_blocks(rows, cols / 2, black_box(&x), cols, (&mut y, 0.0), cols));
    });
    group.bench_function("sum", |b| b.iter(|| sum(black_box(&x))));
    group.bench_function("dot", |b| b.iter(|| dot(black_box(&x), &y)));
    group.bench_function("row_sums", |b| b.iter(|| row_sums(rows, cols, black_box(&x), (&mut y[..rows], 0.0))));
    group.bench_function("column_sums", |b| b.iter(|| column_sums(rows, cols, black_box(&x), (&mut y[..cols], 0.0))));
    group.finish();
}

/// The 8 nearest neighbors of points on a bumpy surface; throughput in points.
fn neighbors(c: &mut Criterion) {
    let mut group = c.benchmark_group("nearest_neighbors");
    let stream = Stream::new(1, 0, "surface");
    for n in [5_000, 13_000] {
        let mut points: Vec<f32> = (0..3 * n as u64).map(|i| stream.uniform(i)).collect();
        points
            .chunks_exact_mut(3)
            .for_each(|p| p[2] = 1.0 + 0.2 * (7.0 * p[0]).sin() * (5.0 * p[1]).cos() + 0.01 * p[2]);
        let mut found = vec![0; 9 * n];
        group.throughput(Throughput::Elements(n as u64));
        group.bench_function(n.to_string(), |b| b.iter(|| nearest_neighbors(black_box(&points), 8, &mut found)));
    }
    group.finish();
}

/// An optimizer's update after every step; throughput in parameters.
fn optimizers(c: &mut Criterion) {
    let mut group = c.benchmark_group("optim");
    let (mut p, g) = (numbers(1 << 18), numbers(1 << 18));
    let (mut m, mut v) = (vec![0.0; p.len()], vec![0.0; p.len()]);
    group.throughput(Throughput::Elements(p.len() as u64));
    let adamw = AdamW { rate: 1e-4, beta1: 0.9, beta2: 0.999, eps: 1e-8, weight_decay: 0.05, gradient_scale: 1.0 };
    group.bench_function("adamw", |b| b.iter(|| adamw.step(10, &mut p, black_box(&g), &mut m, &mut v)));
    group.bench_function("lerp", |b| b.iter(|| lerp(&mut p, black_box(&g), 0.999)));
    group.finish();
}

fn main() {
    let mut criterion = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(50))
        .measurement_time(Duration::from_millis(200))
        .configure_from_args();
    pointwise(&mut criterion);
    byte_products(&mut criterion);
    products(&mut criterion);
    convolutions(&mut criterion);
    transposed(&mut criterion);
    tokens(&mut criterion);
    resampling(&mut criterion);
    memory(&mut criterion);
    neighbors(&mut criterion);
    optimizers(&mut criterion);
    criterion.final_summary();
}
