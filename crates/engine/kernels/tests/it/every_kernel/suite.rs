//! Every kernel, at sizes drawn at random.

use crate::{matrix, noise};
use half::{bf16, f16};
use weaver_kernels::Real;
use weaver_kernels::attention::*;
use weaver_kernels::conv::*;
use weaver_kernels::gelu::{gelu_backward, gelu_forward};
use weaver_kernels::gemm::{Half, Mat, MatMut, gemm, gemm_batched, gemm_half, gemm_half_scratch_len};
use weaver_kernels::layer_norm::*;
use weaver_kernels::optim::{AdamW, lerp};
use weaver_kernels::permute::permute;
use weaver_kernels::random::Stream;
use weaver_kernels::reduce::*;
use weaver_kernels::resample::Resample;
use weaver_kernels::rms_norm::*;
use weaver_kernels::rope::Rope2d;
use weaver_kernels::rows::*;
use weaver_kernels::softmax::*;

/// A kernel of some size: its inputs and its function.
pub struct Kernel<T> {
    pub name: String,
    pub inputs: Vec<Vec<T>>,
    /// True if it is linear in every input.
    pub linear: bool,
    pub run: Run<T>,
}

pub type Run<T> = Box<dyn Fn(&[Vec<T>]) -> Vec<T> + Send + Sync>;

struct Suite<T> {
    kernels: Vec<Kernel<T>>,
    shapes: Stream,
    drawn: u64,
    large: bool,
}

impl<T: Real> Suite<T> {
    /// Linear kernels with inputs of these lengths.
    fn linear<const N: usize>(
        &mut self,
        name: String,
        lengths: [usize; N],
        run: impl Fn(&[Vec<T>]) -> Vec<T> + Send + Sync + 'static,
    ) {
        self.add(name, lengths, true, run);
    }

    /// Others.
    fn curved<const N: usize>(
        &mut self,
        name: String,
        lengths: [usize; N],
        run: impl Fn(&[Vec<T>]) -> Vec<T> + Send + Sync + 'static,
    ) {
        self.add(name, lengths, false, run);
    }

    fn add<const N: usize>(
        &mut self,
        name: String,
        lengths: [usize; N],
        linear: bool,
        run: impl Fn(&[Vec<T>]) -> Vec<T> + Send + Sync + 'static,
    ) {
        let inputs = lengths.iter().zip(1..).map(|(n, seed)| noise(*n, seed)).collect();
        self.kernels.push(Kernel { name, inputs, linear, run: Box::new(run) });
    }

    /// A size: often at the edge of a vector, else anything up to `most`. Larger where threads are to share the work.
    fn size(&mut self, most: usize) -> usize {
        self.drawn += 1;
        let edges = [1, 2, 3, 4, 7, 8, 9, 15, 16, 17, 31, 32, 33];
        let edge = edges[self.shapes.below(2 * self.drawn, edges.len())];
        let any = 1 + self.shapes.below(2 * self.drawn + 1, most);
        let size = if edge <= most && self.drawn.is_multiple_of(2) { edge } else { any };
        if self.large { 2 * size + 5 } else { size }
    }

    fn products(&mut self) {
        for variant in 0..4 {
            let (ta, tb, beta) = (variant & 1 == 1, variant & 2 == 2, T::from_usize(variant & 1));
            let [m, n, k] = [self.size(40), self.size(40), self.size(70)];
            self.linear(format!("gemm {m}x{n}x{k} {ta} {tb}"), [m * k, k * n, m * n], move |x| {
                let mut c = x[2].clone();
                let (a, b) = (matrix(&x[0], m, k, ta), matrix(&x[1], k, n, tb));
                gemm(T::ONE, a, b, beta, MatMut::new(&mut c, m, n));
                c
            });
            let [batch, m, n, k] = [self.size(4), self.size(18), self.size(18), self.size(20)];
            let shared = if variant < 2 { 0 } else { k * n };
            let b_len = if shared == 0 { k * n } else { batch * k * n };
            self.linear(format!("gemm_batched {batch}x{m}x{n}x{k} {ta} {tb}"), [batch * m * k, b_len], move |x| {
                let mut c = vec![T::ZERO; batch * m * n];
                let (a, b) = (matrix(&x[0], m, k, ta).batch(m * k), matrix(&x[1], k, n, tb).batch(shared));
                gemm_batched(batch, T::ONE, a, b, T::ZERO, MatMut::new(&mut c, m, n).batch(m * n));
                c
            });
        }
    }

    fn convolutions(&mut self) {
        for (kernel, stride, pad) in [(3, 1, 1), (3, 2, 1), (1, 1, 0), (4, 4, 0), (5, 1, 2)] {
            let [n, c, o] = [1 + self.size(2) % 3, self.size(9), self.size(9)];
            let [h, w] = [kernel + self.size(12), kernel + self.size(20)];
            let s = Conv2dShape { n, c, h, w, o, kh: kernel, kw: kernel, stride, pad };
            let (x_len, w_len, y_len) = (n * c * h * w, o * c * kernel * kernel, n * o * s.out_h() * s.out_w());
            self.linear(format!("conv2d {s:?}"), [x_len, w_len, o], move |x| {
                let mut y = vec![T::ZERO; y_len];
                conv2d_forward(&s, &x[0], &x[1], Some(&x[2]), &mut y);
                y
            });
            self.linear(format!("conv2d_dx {s:?}"), [w_len, y_len], move |x| {
                let mut dx = vec![T::ZERO; x_len];
                let mut scratch = vec![T::from_f64(f64::NAN); conv2d_dx_scratch_len(&s)];
                conv2d_dx(&s, &x[0], &x[1], (&mut dx, T::ZERO), &mut scratch);
                dx
            });
            self.linear(format!("conv2d_dw {s:?}"), [x_len, y_len, w_len], move |x| {
                let (mut dw, mut db) = (x[2].clone(), vec![T::ZERO; o]);
                conv2d_dw(
                    &s,
                    &x[0],
                    &x[1],
                    (&mut dw, T::ONE),
                    &mut vec![T::from_f64(f64::NAN); conv2d_dw_scratch_len::<T>(&s)],
                );
                conv2d_db(o, s.out_h() * s.out_w(), &x[1], (&mut db, T::ZERO));
                [dw, db].concat()
            });
        }
        for kernel in [2, 4] {
            let [n, c, o] = [1 + self.size(2) % 3, self.size(9), self.size(9)];
            let [h, w] = [kernel * self.size(6), kernel * self.size(9)];
            let s = Conv2dShape { n, c, h, w, o, kh: kernel, kw: kernel, stride: kernel, pad: 0 };
            let (image, w_len, maps) = (n * c * h * w, o * c * kernel * kernel, n * o * s.out_h() * s.out_w());
            self.linear(format!("conv_transpose2d {s:?}"), [maps, w_len, c], move |x| {
                let mut y = vec![T::ZERO; image];
                let mut scratch = vec![T::from_f64(f64::NAN); conv_transpose2d_scratch_len(&s)];
                conv_transpose2d_forward(&s, &x[0], &x[1], Some(&x[2]), &mut y, &mut scratch);
                y
            });
            self.linear(format!("conv_transpose2d gradients {s:?}"), [maps, w_len, image], move |x| {
                let (mut dx, mut dw) = (vec![T::ZERO; maps], vec![T::ZERO; w_len]);
                conv_transpose2d_dx(&s, &x[1], &x[2], (&mut dx, T::ZERO));
                conv_transpose2d_dw(
                    &s,
                    &x[0],
                    &x[2],
                    (&mut dw, T::ZERO),
                    &mut vec![T::from_f64(f64::NAN); conv2d_dw_scratch_len::<T>(&s)],
                );
                [dx, dw].concat()
            });
        }
    }

    fn attentions(&mut self) {
        for _ in 0..3 {
            let [batch, heads, queries, keys] = [1 + self.size(2) % 3, self.size(3), self.size(70), self.size(70)];
            let dim = self.size(20);
            let shape = AttentionShape { batch, heads, queries, keys, dim };
            let (q_at, k_at) = (Strides::tokens_first(queries, heads, dim), Strides::heads_first(keys, heads, dim));
            let (q_len, k_len) = (batch * heads * queries * dim, batch * heads * keys * dim);
            self.curved(format!("attention {shape:?}"), [q_len, k_len, k_len, q_len], move |x| {
                let (mut out, mut lse) = (vec![T::ZERO; q_len], vec![T::ZERO; batch * heads * queries]);
                let (q, k, v) = ((&x[0][..], q_at), (&x[1][..], k_at), (&x[2][..], k_at));
                let inputs = AttentionInputs { shape, scale: T::from_f64(0.3), q, k, v };
                attention_forward(&inputs, (&mut out, q_at), &mut lse);
                let [mut dq, mut dk, mut dv] = [q_len, k_len, k_len].map(|n| vec![T::ZERO; n]);
                let gradients = [(&mut dq, q_at), (&mut dk, k_at), (&mut dv, k_at)];
                let gradients = gradients.map(|(d, at)| Some(((&mut d[..], T::ZERO), at)));
                attention_backward(&inputs, &AttentionOutput { out: (&out, q_at), lse: &lse }, &x[3], gradients);
                [out, lse, dq, dk, dv].concat()
            });
        }
    }

    fn activations(&mut self) {
        for n in [self.size(70), 9000 + self.size(70)] {
            self.curved(format!("gelu {n}"), [n, n], move |x| {
                let (mut y, mut dx) = (vec![T::ZERO; n], vec![T::ZERO; n]);
                gelu_forward(&x[0], &mut y);
                gelu_backward(&x[0], &x[1], (&mut dx, T::ZERO));
                [y, dx].concat()
            });
        }
    }

    fn half_precision(&mut self) {
        for (variant, name) in ["bf16", "f16", "pairs of bf16"].into_iter().enumerate() {
            let [m, n, k] = [self.size(40), self.size(40), self.size(70)];
            let w = noise::<f32>(n * k, 9);
            self.linear(format!("gemm_half {name} {m}x{n}x{k}"), [m * k, m * n], move |x| {
                let (as_bf16, as_f16): (Vec<_>, Vec<_>) =
                    w.iter().map(|w| (bf16::from_f32(*w), f16::from_f32(*w))).unzip();
                let w = [Half::Bf16(&as_bf16), Half::F16(&as_f16), Half::Bf16Pairs(&as_bf16)][variant];
                let (mut c, mut scratch) = (x[1].clone(), vec![T::ZERO; gemm_half_scratch_len(m, k, w)]);
                gemm_half(Mat::new(&x[0], m, k), w, T::ONE, MatMut::new(&mut c, m, n), &mut scratch);
                c
            });
        }
    }

    fn rows(&mut self) {
        for round in 0..3 {
            // A row of one number has no variance, and its gradient is rounding.
            let [rows, cols] = [self.size(60), 2 + self.size(70)];
            let n = rows * cols;
            self.curved(format!("layer_norm {rows}x{cols}"), [n, cols, cols, n], move |x| {
                let (eps, w, b) = (T::from_f64(1e-5), &x[1][..], &x[2][..]);
                let (mut y, mut stats) = (vec![T::ZERO; n], vec![T::ZERO; 2 * rows]);
                layer_norm_forward(cols, eps, &x[0], Some((w, b)), &mut y, &mut stats);
                let (mut dx, mut dw, mut db) = (vec![T::ZERO; n], vec![T::ZERO; cols], vec![T::ZERO; cols]);
                let targets = [&mut dx, &mut dw, &mut db].map(|target| Some((&mut target[..], T::ZERO)));
                let mut scratch = vec![T::ZERO; layer_norm_scratch_len(rows, cols)];
                layer_norm_backward(cols, &x[0], Some(w), &stats, &x[3], targets, &mut scratch);
                [y, dx, dw, db].concat()
            });
            self.curved(format!("rms_norm {rows}x{cols}"), [n, cols, n], move |x| {
                let (eps, w) = (T::from_f64(1e-5), &x[1][..]);
                let (mut y, mut dx, mut dw) = (vec![T::ZERO; n], vec![T::ZERO; n], vec![T::ZERO; cols]);
                rms_norm_forward(eps, &x[0], w, &mut y);
                let targets = [&mut dx, &mut dw].map(|target| Some((&mut target[..], T::ZERO)));
                rms_norm_backward(eps, &x[0], w, &x[2], targets, &mut vec![T::ZERO; rms_norm_scratch_len(rows, cols)]);
                [y, dx, dw].concat()
            });
            let inner = if round == 1 { 1 } else { self.size(20) };
            let (len, all) = (cols, n * inner);
            self.curved(format!("softmax {rows}x{len}x{inner}"), [all, all], move |x| {
                let (mut y, mut dx) = (vec![T::ZERO; all], vec![T::ZERO; all]);
                softmax_forward(len, inner, &x[0], &mut y);
                softmax_backward(len, inner, &y, &x[1], (&mut dx, T::ZERO));
                [y, dx].concat()
            });
            self.linear(format!("sums {rows}x{cols}"), [n], move |x| {
                let (mut by_row, mut by_col) = (vec![T::ZERO; rows], vec![T::ZERO; cols]);
                row_sums(rows, cols, &x[0], (&mut by_row, T::ZERO));
                column_sums(rows, cols, &x[0], (&mut by_col, T::ZERO));
                [by_row, by_col, vec![sum(&x[0]), sum_serial(&x[0]), mean(&x[0])]].concat()
            });
            self.linear(format!("dot {n}"), [n, n], move |x| vec![dot(&x[0], &x[1]), dot_serial(&x[0], &x[1])]);
            self.curved(format!("squared_norm {n}"), [n], move |x| vec![squared_norm(&x[0])]);
            let index: Vec<u32> = (0..2 * rows as u32).map(|i| i * 7919 % rows as u32).collect();
            self.linear(format!("gather, scatter, copy, permute {rows}x{cols}"), [2 * n], move |x| {
                let (mut picked, mut added, mut moved) = (vec![T::ZERO; 2 * n], vec![T::ZERO; n], vec![T::ZERO; 2 * n]);
                gather_rows(cols, &x[0][..n], &index, (&mut picked, T::ZERO));
                scatter_add_rows(cols, &x[0], &index, (&mut added, T::ZERO));
                permute([2, rows, cols, 1], [2, 0, 3, 1], &x[0], (&mut moved, T::ZERO));
                let mut apart = vec![T::ZERO; rows * (cols + 3)];
                copy_blocks(rows, cols, &x[0], cols, (&mut apart, T::ZERO), cols + 3);
                [picked, added, moved, apart].concat()
            });
            self.curved(format!("AdamW, lerp {n}"), [n, n], move |x| {
                let [beta1, beta2, rate, eps, weight_decay] = [0.9, 0.99, 0.01, 1e-8, 0.1].map(T::from_f64);
                let step = AdamW { rate, beta1, beta2, eps, weight_decay, gradient_scale: T::ONE };
                let (mut p, mut m, mut v) = (x[0].clone(), vec![T::ONE; n], vec![T::ONE; n]);
                step.step(3, &mut p, &x[1], &mut m, &mut v);
                let mut average = x[1].clone();
                lerp(&mut average, &x[0], beta1);
                [p, m, v, average].concat()
            });
        }
    }

    fn images(&mut self) {
        let [from, to] = [[self.size(20), self.size(30)], [self.size(20), self.size(30)]];
        let plans = [
            ("bilinear", Resample::<T>::bilinear(from, to, false)),
            ("corners", Resample::bilinear(from, to, true)),
            ("bicubic", Resample::bicubic(from, to)),
            ("antialiased", Resample::bicubic_antialiased(from, to)),
            ("box", Resample::box_filter(from, 3)),
        ];
        for (name, plan) in plans {
            let (planes, [h, w], [to_h, to_w]) = (3, plan.input_size(), plan.output_size());
            let (n, m) = (planes * h * w, planes * to_h * to_w);
            let run = move |x: &[Vec<T>]| {
                let (mut y, mut dx) = (vec![T::ZERO; m], vec![T::ZERO; n]);
                plan.forward(&x[0], &mut y);
                plan.backward(&x[1], (&mut dx, T::ZERO));
                [y, dx].concat()
            };
            // A pixel of the border may have weights of both signs, and infinity less infinity is NaN.
            let name = format!("{name} {from:?} to {to:?}");
            if name.starts_with("bicubic") || name.starts_with("antialiased") {
                self.curved(name, [n, m], run);
            } else {
                self.linear(name, [n, m], run);
            }
        }
        let [heads, dim, batch] = [self.size(4), 4 * self.size(9), self.size(9)];
        let positions: Vec<_> = (0..21).map(|i| [i / 5, i % 5]).collect();
        let rope = Rope2d::<T>::new(&positions, dim, 100.0);
        let n = batch * 21 * heads * dim;
        self.linear(format!("rope2d {batch}x21x{heads}x{dim}"), [n, n], move |x| {
            let (mut y, mut dx) = (vec![T::ZERO; n], vec![T::ZERO; n]);
            rope.forward(heads, &x[0], &mut y);
            rope.backward(heads, &x[1], (&mut dx, T::ZERO));
            [y, dx].concat()
        });
    }
}

/// Every kernel at sizes that are a function of the seed.
pub fn every<T: Real>(seed: u64, large: bool) -> Vec<Kernel<T>> {
    let shapes = Stream::new(seed, 0, "every_kernel.shapes");
    let mut suite = Suite { kernels: Vec::new(), shapes, drawn: 0, large };
    suite.products();
    suite.convolutions();
    suite.attentions();
    suite.activations();
    suite.half_precision();
    suite.rows();
    suite.images();
    suite.kernels
}
