//! Warm kernels allocate nothing.

use crate::noise;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use weaver_kernels::attention::*;
use weaver_kernels::conv::{
    Conv2dShape, conv2d_db, conv2d_dw, conv2d_dw_scratch_len, conv2d_dx, conv2d_dx_scratch_len, conv2d_forward,
};
use weaver_kernels::gemm::{Mat, MatMut, gemm};
use weaver_kernels::layer_norm::{layer_norm_backward, layer_norm_forward};
use weaver_kernels::optim::{AdamW, lerp};
use weaver_kernels::permute::permute;
use weaver_kernels::reduce::{column_sums, sum};
use weaver_kernels::resample::Resample;
use weaver_kernels::rows::scatter_add_rows;
use weaver_kernels::softmax::softmax_forward;

/// Counts the allocations of each thread.
struct Counting;

thread_local!(static COUNT: Cell<usize> = const { Cell::new(0) });

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[allow(unsafe_code)]
// SAFETY: the system allocator does the work.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|c| c.set(c.get() + 1));
        // SAFETY: passed on.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, start: *mut u8, layout: Layout) {
        // SAFETY: passed on.
        unsafe { System.dealloc(start, layout) }
    }
}

#[test]
fn warm_kernels_allocate_nothing() {
    let size = Conv2dShape { n: 2, c: 8, h: 24, w: 32, o: 16, kh: 3, kw: 3, stride: 1, pad: 1 };
    let shape = AttentionShape { batch: 2, heads: 3, queries: 80, keys: 80, dim: 16 };
    let x = noise::<f32>(2 * 8 * 24 * 32, 1);
    let w = noise::<f32>(16 * 72, 2);
    let qkv = noise::<f32>(2 * 80 * 3 * 48, 3);
    let plan = Resample::bilinear([24, 32], [30, 40], true);
    let index: Vec<u32> = (0..384).map(|i| i % 100).collect();
    let (mut y, mut dx, mut dw, mut db) = (vec![0.0; 2 * 16 * 24 * 32], x.clone(), w.clone(), vec![0.0; 16]);
    let mut scratch = vec![0.0; conv2d_dx_scratch_len(&size)];
    let mut turned = vec![0.0; conv2d_dw_scratch_len::<f32>(&size)];
    let (mut out, mut lse, mut dqkv) = (vec![0.0; 2 * 80 * 48], vec![0.0; 480], qkv.clone());
    let (mut stats, mut large, mut small) = (vec![0.0; 2 * 384], vec![0.0; 2 * 8 * 30 * 40], vec![0.0; 3200]);
    let mut step = move || {
        gemm(1.0, Mat::new(&x, 96, 72), Mat::new(&x, 128, 72).transposed(), 0.0, MatMut::new(&mut y, 96, 128));
        conv2d_forward(&size, &x, &w, None, &mut y);
        conv2d_dx(&size, &w, &y, (&mut dx, 0.0), &mut scratch);
        conv2d_dw(&size, &x, &y, (&mut dw, 0.0), &mut turned);
        conv2d_db(16, 24 * 32, &y, (&mut db, 0.0));
        let at = Strides::tokens_first(80, 3, 16);
        let [q, k, v] = [0, 7680, 15360].map(|offset| (&qkv[offset..], at));
        let inputs = AttentionInputs { shape, scale: 0.25, q, k, v };
        attention_forward(&inputs, (&mut out, at), &mut lse);
        let (dq, rest) = dqkv.split_at_mut(7680);
        let (dk, dv) = rest.split_at_mut(7680);
        let gradients = [dq, dk, dv].map(|d| Some(((d, 0.0), at)));
        attention_backward(&inputs, &AttentionOutput { out: (&out, at), lse: &lse }, &out, gradients);
        layer_norm_forward(32, 1e-5, &x, None, &mut dx, &mut stats);
        let targets = [Some((&mut dx[..], 0.0)), Some((&mut small[..32], 0.0)), None];
        layer_norm_backward(32, &x, None, &stats, &x, targets, &mut scratch);
        softmax_forward(32, 1, &x, &mut dx);
        plan.forward(&x, &mut large);
        plan.backward(&large, (&mut dx, 0.0));
        scatter_add_rows(32, &x, &index, (&mut small, 0.0));
        permute([2, 8, 24, 32], [0, 2, 3, 1], &x, (&mut dx, 0.0));
        column_sums(384, 32, &x, (&mut small[..32], 0.0));
        db[0] = sum(&x);
        let settings = AdamW { rate: 1e-3, beta1: 0.9, beta2: 0.99, eps: 1e-8, weight_decay: 0.0, gradient_scale: 1.0 };
        let (m, v) = large.split_at_mut(w.len());
        settings.step(1, &mut dw, &w, m, &mut v[..w.len()]);
        lerp(&mut dw, &w, 0.9);
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread pool");
    let count = pool.install(|| {
        step();
        step();
        let before = COUNT.get();
        step();
        COUNT.get() - before
    });
    assert_eq!(count, 0);
}
