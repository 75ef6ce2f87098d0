//! Convolutions against the sum they are defined by; gradients as adjoints of it.

use crate::{assert_close, noise, stressed, threads};
use weaver_kernels::Real;
use weaver_kernels::conv::*;

fn naive(s: &Conv2dShape, x: &[f64], w: &[f64], b: Option<&[f64]>) -> Vec<f64> {
    let (oh, ow) = (s.out_h(), s.out_w());
    let mut y = vec![0.0; s.n * s.o * oh * ow];
    for (at, y) in y.iter_mut().enumerate() {
        let (n, o, i, j) = (at / (s.o * oh * ow), at / (oh * ow) % s.o, at / ow % oh, at % ow);
        *y = b.map_or(0.0, |b| b[o]);
        for c in 0..s.c {
            for p in 0..s.kh {
                for q in 0..s.kw {
                    let (r, t) = ((i * s.stride + p).wrapping_sub(s.pad), (j * s.stride + q).wrapping_sub(s.pad));
                    if r < s.h && t < s.w {
                        *y += w[((o * s.c + c) * s.kh + p) * s.kw + q] * x[((n * s.c + c) * s.h + r) * s.w + t];
                    }
                }
            }
        }
    }
    y
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn size(n: usize, c: usize, hw: [usize; 2], o: usize, k: [usize; 2], stride: usize, pad: usize) -> Conv2dShape {
    Conv2dShape { n, c, h: hw[0], w: hw[1], o, kh: k[0], kw: k[1], stride, pad }
}

fn cases() -> Vec<Conv2dShape> {
    let mut cases = vec![
        size(2, 3, [6, 8], 4, [3, 3], 1, 1),
        size(1, 2, [5, 70], 3, [3, 3], 1, 1),
        size(2, 5, [12, 16], 7, [1, 1], 1, 0),
        size(1, 3, [9, 11], 8, [7, 7], 1, 3),
        size(2, 8, [6, 5], 33, [5, 5], 1, 2),
        size(3, 30, [4, 4], 2, [3, 3], 2, 1),
        size(1, 3, [8, 12], 5, [4, 4], 4, 0),
        size(1, 1, [1, 1], 1, [3, 3], 1, 1),
        size(1, 2, [7, 6], 3, [2, 3], 3, 2),
        size(2, 40, [3, 3], 13, [3, 3], 1, 0),
        size(1, 2, [4, 5], 2, [2, 2], 1, 3),
        size(1, 3, [40, 33], 2, [3, 1], 1, 1),
        size(0, 3, [4, 4], 2, [3, 3], 1, 1),
        // More channels, pixels and outputs than a tile, a chain or a band holds.
        size(2, 20, [9, 40], 14, [3, 3], 1, 1),
        size(1, 70, [3, 50], 35, [3, 3], 1, 1),
        size(1, 2, [2, 1100], 3, [1, 5], 1, 2),
        size(1, 3, [3, 30], 2, [2, 2], 1, 3),
        size(2, 2, [40, 25], 17, [5, 2], 1, 0),
        size(0, 3, [4, 40], 2, [3, 3], 1, 1),
        // Nothing to sum, and nothing to write.
        size(1, 0, [4, 4], 2, [3, 3], 1, 1),
        size(1, 3, [2, 5], 2, [3, 1], 1, 0),
        size(1, 3, [5, 2], 2, [1, 3], 1, 0),
        size(1, 3, [5, 4], 0, [3, 3], 1, 1),
    ];
    let mut at = 0;
    let mut draw = |n: usize| {
        at += 1;
        weaver_kernels::random::Stream::new(5, 0, "conv.sizes").below(at, n) + 1
    };
    for _ in 0..if stressed() { 200 } else { 16 } {
        let k = [draw(4), draw(4)];
        let pad = draw(3) - 1;
        let hw = [k[0] + draw(9), k[1] + draw(9)];
        cases.push(size(draw(2), draw(5), hw, draw(14), k, draw(3), pad));
    }
    cases
}

fn agrees<T: Real>(s: &Conv2dShape, tolerance: f64) {
    let wide = |x: &[T]| x.iter().map(|x| x.to_f64()).collect::<Vec<f64>>();
    let x = noise::<T>(s.n * s.c * s.h * s.w, 1);
    let w = noise::<T>(s.o * s.c * s.kh * s.kw, 2);
    let b = noise::<T>(s.o, 3);
    let pixels = s.out_h() * s.out_w();
    let dy = noise::<T>(s.n * s.o * pixels, 4);

    let mut y = vec![T::from_f64(f64::NAN); dy.len()];
    conv2d_forward(s, &x, &w, Some(&b), &mut y);
    assert_close(&y, &naive(s, &wide(&x), &wide(&w), Some(&wide(&b))), tolerance, &format!("y {s:?}"));
    conv2d_forward(s, &x, &w, None, &mut y);
    assert_close(&y, &naive(s, &wide(&x), &wide(&w), None), tolerance, &format!("y {s:?}"));

    // The gradients by brute force: y is linear in x and in w, so probe with unit vectors.
    let unit = |n: usize, i: usize| (0..n).map(|j| f64::from(u8::from(i == j))).collect::<Vec<_>>();
    let mut scratch = vec![T::from_f64(f64::NAN); conv2d_dx_scratch_len(s)];
    let mut dx = vec![T::from_f64(f64::NAN); x.len()];
    conv2d_dx(s, &w, &dy, (&mut dx, T::ZERO), &mut scratch);
    let probe = |i| dot(&naive(s, &unit(x.len(), i), &wide(&w), None), &wide(&dy));
    let probes = if stressed() { 60 } else { 12 };
    let step = x.len() / probes + 1;
    for i in (0..x.len()).step_by(step) {
        assert_close(&dx[i..=i], &[probe(i)], tolerance, &format!("dx[{i}] {s:?}"));
    }
    let mut dw = vec![T::from_f64(f64::NAN); w.len()];
    conv2d_dw(s, &x, &dy, (&mut dw, T::ZERO), &mut vec![T::from_f64(f64::NAN); conv2d_dw_scratch_len::<T>(s)]);
    let probe = |i| dot(&naive(s, &wide(&x), &unit(w.len(), i), None), &wide(&dy));
    let step = w.len() / probes + 1;
    for i in (0..w.len()).step_by(step) {
        assert_close(&dw[i..=i], &[probe(i)], tolerance, &format!("dw[{i}] {s:?}"));
    }
    let mut db = vec![T::ONE; s.o];
    conv2d_db(s.o, pixels, &dy, (&mut db, T::ONE));
    for (o, db) in db.iter().enumerate() {
        let planes = (0..s.n).flat_map(|n| &dy[(n * s.o + o) * pixels..][..pixels]);
        assert_close(&[*db], &[1.0 + planes.map(|x| x.to_f64()).sum::<f64>()], tolerance, "db");
    }
    // Accumulation.
    let (mut dx2, mut dw2) = (dx.clone(), dw.clone());
    conv2d_dx(s, &w, &dy, (&mut dx2, T::ONE), &mut scratch);
    conv2d_dw(s, &x, &dy, (&mut dw2, T::ONE), &mut vec![T::from_f64(f64::NAN); conv2d_dw_scratch_len::<T>(s)]);
    for (once, twice) in dx.iter().zip(&dx2).chain(dw.iter().zip(&dw2)) {
        assert_close(&[*twice], &[2.0 * once.to_f64()], tolerance, "accumulated");
    }
}

#[test]
fn matches_the_definition_f64() {
    cases().iter().for_each(|s| agrees::<f64>(s, 1e-12));
}

#[test]
fn matches_the_definition_f32() {
    cases().iter().for_each(|s| agrees::<f32>(s, 1e-4));
}

#[test]
fn transposed_is_the_adjoint() {
    for s in [
        size(2, 3, [8, 12], 4, [2, 2], 2, 0),
        size(1, 5, [8, 8], 2, [4, 4], 4, 0),
        size(2, 3, [7, 9], 4, [3, 3], 2, 0),
        size(1, 2, [6, 6], 3, [3, 3], 1, 0),
    ] {
        let pixels = s.out_h() * s.out_w();
        let (x, w) = (noise::<f64>(s.n * s.o * pixels, 1), noise::<f64>(s.o * s.c * s.kh * s.kw, 2));
        let (b, dy) = (noise::<f64>(s.c, 3), noise::<f64>(s.n * s.c * s.h * s.w, 4));
        let mut scratch = vec![f64::NAN; conv_transpose2d_scratch_len(&s)];
        let mut y = vec![f64::NAN; dy.len()];
        conv_transpose2d_forward(&s, &x, &w, Some(&b), &mut y, &mut scratch);
        // The definition: every input pixel stamps the kernel.
        let mut expected = vec![0.0; y.len()];
        for (at, e) in expected.iter_mut().enumerate() {
            *e = b[at / (s.h * s.w) % s.c];
        }
        for (at, x) in x.iter().enumerate() {
            let (n, o, i, j) = (at / (s.o * pixels), at / pixels % s.o, at / s.out_w() % s.out_h(), at % s.out_w());
            for k in 0..s.c * s.kh * s.kw {
                let (c, p, q) = (k / (s.kh * s.kw), k / s.kw % s.kh, k % s.kw);
                expected[((n * s.c + c) * s.h + i * s.stride + p) * s.w + j * s.stride + q] +=
                    x * w[o * s.c * s.kh * s.kw + k];
            }
        }
        assert_close(&y, &expected, 1e-12, "transposed");
        // <y - b, dy> is bilinear in x and w.
        let mut plain = vec![0.0; y.len()];
        conv_transpose2d_forward(&s, &x, &w, None, &mut plain, &mut scratch);
        let (mut dx, mut dw) = (vec![f64::NAN; x.len()], vec![f64::NAN; w.len()]);
        conv_transpose2d_dx(&s, &w, &dy, (&mut dx, 0.0));
        conv_transpose2d_dw(&s, &x, &dy, (&mut dw, 0.0), &mut vec![f64::NAN; conv2d_dw_scratch_len::<f64>(&s)]);
        let value = dot(&plain, &dy);
        assert_close(&[dot(&dx, &x), dot(&dw, &w)], &[value, value], 1e-12, "adjoint");
    }
}

#[test]
fn same_bits_at_any_thread_count() {
    for s in [([24, 32], 1), ([24, 32], 2), ([24, 16], 1)].map(|(hw, stride)| size(3, 8, hw, 16, [3, 3], stride, 1)) {
        let (x, w) = (noise::<f32>(s.n * s.c * s.h * s.w, 1), noise::<f32>(s.o * s.c * s.kh * s.kw, 2));
        threads(|| {
            let mut y = vec![0.0; s.n * s.o * s.out_h() * s.out_w()];
            conv2d_forward(&s, &x, &w, None, &mut y);
            let (mut dx, mut dw, mut db) = (vec![0.0; x.len()], vec![0.0; w.len()], vec![0.0; s.o]);
            conv2d_dx(&s, &w, &y, (&mut dx, 0.0), &mut vec![0.0; conv2d_dx_scratch_len(&s)]);
            conv2d_dw(&s, &x, &y, (&mut dw, 0.0), &mut vec![f32::NAN; conv2d_dw_scratch_len::<f32>(&s)]);
            conv2d_db(s.o, s.out_h() * s.out_w(), &y, (&mut db, 0.0));
            [y, dx, dw, db].concat()
        });
    }
}

#[test]
#[should_panic(expected = "output length")]
fn an_output_that_wraps_around_panics() {
    let size = Conv2dShape { n: 1 << 60, c: 1, h: 0, w: 0, o: 1, kh: 2, kw: 1, stride: 1, pad: 8 };
    conv2d_forward(&size, &[], &[0.0_f32; 2], None, &mut []);
}

#[test]
#[should_panic(expected = "must not be 0")]
fn an_empty_kernel_panics() {
    let size = Conv2dShape { n: 1, c: 1, h: 2, w: 2, o: 1, kh: 0, kw: 1, stride: 1, pad: 0 };
    conv2d_forward(&size, &[0.0_f32; 4], &[], None, &mut [0.0; 6]);
}
