//! Attention against the softmax written out.

use crate::{assert_close, noise, threads, widen};
use std::f32::consts::LOG2_E;
use weaver_kernels::Real;
use weaver_kernels::attention::*;

/// Output, lse, dq, dk, dv for `[batch, heads, tokens, dim]` tensors.
fn naive(s: &AttentionShape, scale: f64, q: &[f64], k: &[f64], v: &[f64], dout: &[f64]) -> [Vec<f64>; 5] {
    let d = s.dim;
    let [mut out, mut dq] = [(); 2].map(|()| vec![0.0; q.len()]);
    let [mut dk, mut dv] = [(); 2].map(|()| vec![0.0; k.len()]);
    let mut lse = vec![];
    for i in 0..s.batch * s.heads * s.queries {
        let plane = i / s.queries * s.keys;
        let dot = |a: &[f64], i: usize, b: &[f64], j: usize| (0..d).map(|c| a[i * d + c] * b[j * d + c]).sum::<f64>();
        let e: Vec<f64> = (0..s.keys).map(|j| (scale * dot(q, i, k, plane + j)).exp()).collect();
        let sum: f64 = e.iter().sum();
        lse.push(sum.log2());
        for j in 0..s.keys {
            (0..d).for_each(|c| out[i * d + c] += e[j] / sum * v[(plane + j) * d + c]);
        }
        let along = dot(&out, i, dout, i);
        for j in 0..s.keys {
            let p = e[j] / sum;
            let ds = p * (dot(dout, i, v, plane + j) - along) * scale;
            for c in 0..d {
                dv[(plane + j) * d + c] += p * dout[i * d + c];
                dq[i * d + c] += ds * k[(plane + j) * d + c];
                dk[(plane + j) * d + c] += ds * q[i * d + c];
            }
        }
    }
    [out, lse, dq, dk, dv]
}

/// `[batch, heads, tokens, dim]` of a tensor with any strides.
fn gather<T: Real>(s: &AttentionShape, tokens: usize, x: &[T], at: Strides) -> Vec<T> {
    let mut y = vec![];
    for b in 0..s.batch {
        for h in 0..s.heads {
            for t in 0..tokens {
                y.extend_from_slice(&x[b * at.batch + h * at.head + t * at.token..][..s.dim]);
            }
        }
    }
    y
}

fn agrees<T: Real>(s: &AttentionShape, tolerance: f64) {
    let scale = 1.3 / (s.dim as f64).sqrt();
    let planes = s.batch * s.heads * s.dim;
    let (first_q, first_k) =
        (Strides::tokens_first(s.queries, s.heads, s.dim), Strides::tokens_first(s.keys, s.heads, s.dim));
    let heads_k = Strides::heads_first(s.keys, s.heads, s.dim);
    let (q, k, v) = (noise::<T>(planes * s.queries, 1), noise::<T>(planes * s.keys, 2), noise::<T>(planes * s.keys, 3));
    let dout = noise::<T>(q.len(), 4);
    let nan = |n: usize| vec![T::from_f64(f64::NAN); n];
    let (mut out, mut lse) = (nan(q.len()), nan(s.batch * s.heads * s.queries));
    let scale_t = T::from_f64(scale);
    let inputs = AttentionInputs { shape: *s, scale: scale_t, q: (&q, first_q), k: (&k, heads_k), v: (&v, first_k) };
    attention_forward(&inputs, (&mut out, first_q), &mut lse);
    let wide = |x: &[T], n: usize, at: Strides| widen(&gather(s, n, x, at));
    let expected = naive(
        s,
        scale_t.to_f64(),
        &wide(&q, s.queries, first_q),
        &wide(&k, s.keys, heads_k),
        &wide(&v, s.keys, first_k),
        &wide(&dout, s.queries, first_q),
    );
    let name = format!("{s:?}");
    assert_close(&gather(s, s.queries, &out, first_q), &expected[0], tolerance, &name);
    assert_close(&lse, &expected[1], tolerance, &name);
    let (mut dq, mut dk, mut dv) = (nan(q.len()), vec![T::ONE; k.len()], nan(v.len()));
    let output = AttentionOutput { out: (&out, first_q), lse: &lse };
    let gradients =
        [((&mut dq[..], T::ZERO), first_q), ((&mut dk[..], T::ONE), heads_k), ((&mut dv[..], T::ZERO), first_k)];
    attention_backward(&inputs, &output, &dout, gradients.map(Some));
    assert_close(&gather(s, s.queries, &dq, first_q), &expected[2], tolerance, &name);
    dk.iter_mut().for_each(|x| *x -= T::ONE);
    assert_close(&gather(s, s.keys, &dk, heads_k), &expected[3], tolerance, &name);
    assert_close(&gather(s, s.keys, &dv, first_k), &expected[4], tolerance, &name);
    // One gradient alone is the same to the bit.
    let mut alone = nan(v.len());
    attention_backward(&inputs, &output, &dout, [None, None, Some(((&mut alone, T::ZERO), first_k))]);
    assert_eq!(alone, dv);
}

const CASES: [[usize; 5]; 10] = [
    [1, 1, 1, 1, 1],
    [2, 3, 5, 7, 4],
    [1, 2, 51, 51, 32],
    [1, 2, 4, 4, 16],
    [1, 1, 70, 130, 8],
    [2, 1, 65, 257, 3],
    [1, 3, 130, 20, 5],
    [1, 1, 400, 300, 6], // several tiles of queries and of keys
    [1, 1, 0, 5, 4],
    [0, 2, 3, 3, 4],
];

fn size([batch, heads, queries, keys, dim]: [usize; 5]) -> AttentionShape {
    AttentionShape { batch, heads, queries, keys, dim }
}

#[test]
fn matches_the_formula_f64() {
    CASES.map(size).iter().for_each(|s| agrees::<f64>(s, 1e-12));
}

#[test]
fn matches_the_formula_f32() {
    CASES.map(size).iter().for_each(|s| agrees::<f32>(s, 2e-5));
}

#[test]
fn later_larger_scores_do_not_overflow() {
    let shape = size([1, 1, 1, 300, 1]);
    let (k, v): (Vec<f32>, Vec<f32>) = (0..300).map(|i| (i as f32, i as f32)).unzip();
    let (mut out, mut lse, at) = ([0.0], [0.0], Strides::heads_first(300, 1, 1));
    let inputs = AttentionInputs { shape, scale: 10.0, q: (&[1.0], at), k: (&k, at), v: (&v, at) };
    attention_forward(&inputs, (&mut out, at), &mut lse);
    assert!((out[0] - 299.0).abs() < 1e-3 && (lse[0] - 2990.0 * LOG2_E).abs() < 1e-3);
}

/// Scores of minus infinity count nothing wherever they are.
#[test]
fn scores_of_minus_infinity_count_nothing() {
    let shape = size([1, 1, 1, 200, 1]);
    let (v, at) = (vec![2.0_f32; 200], Strides::heads_first(200, 1, 1));
    for finite in [0, 63, 199] {
        let mut k = vec![f32::NEG_INFINITY; 200];
        k[finite] = 0.5;
        let (mut out, mut lse) = ([0.0], [0.0]);
        let inputs = AttentionInputs { shape, scale: 1.0, q: (&[1.0], at), k: (&k, at), v: (&v, at) };
        attention_forward(&inputs, (&mut out, at), &mut lse);
        assert_eq!((out[0], lse[0]), (2.0, 0.5 * LOG2_E), "the finite one at {finite}");
    }
}

#[test]
#[should_panic(expected = "has only")]
fn strides_that_wrap_around_panic() {
    let (shape, at) = (size([1, 1, 2, 2, 2]), Strides::heads_first(2, 1, 2));
    let (x, mut out, mut lse) = ([1.0_f32; 8], [0.0; 4], [0.0; 2]);
    let far = Strides { token: usize::MAX, ..at };
    let inputs = AttentionInputs { shape, scale: 1.0, q: (&x[4..], far), k: (&x, at), v: (&x, at) };
    attention_forward(&inputs, (&mut out, at), &mut lse);
}

#[test]
#[should_panic(expected = "overlap")]
fn overlapping_output_panics() {
    let shape = size([1, 2, 3, 3, 4]);
    let at = Strides::heads_first(3, 2, 4);
    let wrong = Strides { batch: 24, head: 4, token: 4 };
    let x = [0.0_f32; 24];
    let inputs = AttentionInputs { shape, scale: 1.0, q: (&x, at), k: (&x, at), v: (&x, at) };
    attention_forward(&inputs, (&mut [0.0; 24], wrong), &mut [0.0; 6]);
}

#[test]
fn same_bits_at_any_thread_count() {
    let shape = size([2, 3, 100, 150, 16]);
    let (q_at, k_at) = (Strides::tokens_first(100, 3, 16), Strides::tokens_first(150, 3, 16));
    let (q, k, v) = (noise::<f32>(9600, 1), noise::<f32>(14400, 2), noise::<f32>(14400, 3));
    threads(|| {
        let (mut out, mut lse) = (vec![0.0; q.len()], vec![0.0; 600]);
        let inputs = AttentionInputs { shape, scale: 0.25, q: (&q, q_at), k: (&k, k_at), v: (&v, k_at) };
        attention_forward(&inputs, (&mut out, q_at), &mut lse);
        let (mut dq, mut dk, mut dv) = (vec![0.0; q.len()], vec![0.0; k.len()], vec![0.0; v.len()]);
        let gradients = [((&mut dq[..], 0.0), q_at), ((&mut dk[..], 0.0), k_at), ((&mut dv[..], 0.0), k_at)];
        let output = AttentionOutput { out: (&out, q_at), lse: &lse };
        attention_backward(&inputs, &output, &out, gradients.map(Some));
        [out, lse, dq, dk, dv].concat()
    });
}
