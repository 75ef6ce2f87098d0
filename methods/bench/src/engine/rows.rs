//! The timed work. Sizes and operation counts follow other engines, for easy comparison: a multiplication and an
//! addition are two operations, the backward pass of a layer twice its forward pass, of attention two and a half times,
//! because it computes the weights again.

use super::meter::{Meter, Work, normal};
use super::vit;
use weaver_autograd::ops::{self, Activation};
use weaver_autograd::{Params, Tape};
use weaver_nn::{Block, BlockConfig, Builder, Context, WeightInit};

/// Milliseconds of a row, and its work.
type Row = fn(&Meter) -> (f64, Work);

/// All rows with their names.
pub const ROWS: [(&str, Row); 15] = [
    ("matmul/512", |meter| square(meter, 512)),
    ("matmul/1024", |meter| square(meter, 1024)),
    ("matmul/2048", |meter| square(meter, 2048)),
    ("matmul/1374x1024x4096", |meter| linear(meter, 1374, 1024, 4096)),
    ("matmul/2048x384x1536", |meter| linear(meter, 2048, 384, 1536)),
    ("bmm/24x512x64x512", batched),
    ("attention/forward", attention_forward),
    ("attention/forward_backward", attention_forward_backward),
    ("block/forward_backward", block_forward_backward),
    ("vit/step", vit::step),
    ("conv3x3/forward_backward", conv3x3),
    ("bilinear/forward_backward", bilinear),
    ("layer_norm/forward_backward", layer_norm),
    ("gelu/forward_backward", gelu),
    ("softmax/forward_backward", softmax),
];

/// `[n, n]` times `[n, n]`.
fn square(meter: &Meter, n: usize) -> (f64, Work) {
    let ms = meter.forward([&[n, n], &[n, n]], |[a, b]| a.matmul(b));
    (ms, Work::Operations(2.0 * (n * n * n) as f64))
}

/// A layer without a bias, `[m, k]` times the transpose of `[n, k]`.
fn linear(meter: &Meter, m: usize, k: usize, n: usize) -> (f64, Work) {
    let ms = meter.forward([&[m, k], &[n, k]], |[x, w]| ops::linear(x, w, None, Activation::None));
    (ms, Work::Operations(2.0 * (m * k * n) as f64))
}

fn batched(meter: &Meter) -> (f64, Work) {
    let ms = meter.forward([&[24, 512, 64], &[24, 64, 512]], |[a, b]| a.matmul(b));
    (ms, Work::Operations(2.0 * (24_u64 * 512 * 64 * 512) as f64))
}

/// Batch, tokens, heads, numbers per head.
const ATTENTION: [usize; 4] = [4, 512, 6, 64];
const ATTENTION_FORWARD: f64 = (4_u64 * 4 * 6 * 512 * 512 * 64) as f64;

fn attention_forward(meter: &Meter) -> (f64, Work) {
    let ms = meter.forward([&ATTENTION; 3], |[q, k, v]| ops::attention(q, k, v, 0.125));
    (ms, Work::Operations(ATTENTION_FORWARD))
}

fn attention_forward_backward(meter: &Meter) -> (f64, Work) {
    let ms = meter.forward_backward([&ATTENTION; 3], |[q, k, v]| ops::attention(q, k, v, 0.125));
    (ms, Work::Operations(3.5 * ATTENTION_FORWARD))
}

/// A block of a vision transformer: no scales of the branches, hidden width four times the width.
pub fn block_config(width: usize, heads: usize) -> BlockConfig {
    BlockConfig {
        width,
        heads,
        hidden: 4 * width,
        eps: 1e-6,
        layer_scale: None,
        qk_norm: false,
        init: WeightInit::FanIn,
    }
}

/// Operations of a block's forward pass: the products with weights, and attention.
pub fn block_operations(batch: usize, tokens: usize, width: usize) -> f64 {
    2.0 * (batch * (12 * tokens * width * width + 2 * tokens * tokens * width)) as f64
}

fn block_forward_backward(meter: &Meter) -> (f64, Work) {
    let (batch, tokens, width) = (2, 1024, 384);
    let shape = [batch, tokens, width];
    let mut params = Params::<f32>::new();
    let block = Block::new(Builder::new(&mut params, 0).scope("block"), &block_config(width, 6));
    let x = params.add("x", shape, normal("x", shape.iter().product()));
    let cotangent = normal("cotangent", shape.iter().product());
    let mut tape = Tape::new();
    let ms = meter.ms(|| {
        let cx = Context::new(&tape, &params);
        block.forward(cx, cx.param(x), None).backward_with(&cotangent);
        tape.reset();
    });
    (ms, Work::Operations(3.0 * block_operations(batch, tokens, width)))
}

fn conv3x3(meter: &Meter) -> (f64, Work) {
    let shapes: [&[usize]; 3] = [&[4, 64, 128, 128], &[64, 64, 3, 3], &[64]];
    let ms = meter.forward_backward(shapes, |[x, w, b]| ops::conv2d(x, w, Some(b), 1, 1));
    (ms, Work::Operations(3.0 * 2.0 * (4_u64 * 64 * 64 * 9 * 128 * 128) as f64))
}

/// Bytes of this many numbers.
fn bytes(numbers: usize) -> Work {
    Work::Bytes((numbers * size_of::<f32>()) as f64)
}

/// Moves x and y forward, dy and dx backward.
fn bilinear(meter: &Meter) -> (f64, Work) {
    let ms = meter.forward_backward([&[1, 64, 128, 128]], |[x]| x.bilinear(256, 256, false));
    (ms, bytes(2 * 64 * (128 * 128 + 256 * 256)))
}

const ROWS_OF_TOKENS: [usize; 2] = [4096, 384];
/// x and y forward; x or y, dy and dx backward.
const FIVE_PASSES: usize = 5 * 4096 * 384;

fn layer_norm(meter: &Meter) -> (f64, Work) {
    let shapes: [&[usize]; 3] = [&ROWS_OF_TOKENS, &[384], &[384]];
    (meter.forward_backward(shapes, |[x, w, b]| x.layer_norm(Some((w, b)), 1e-6)), bytes(FIVE_PASSES))
}

fn gelu(meter: &Meter) -> (f64, Work) {
    (meter.forward_backward([&ROWS_OF_TOKENS], |[x]| x.gelu()), bytes(FIVE_PASSES))
}

fn softmax(meter: &Meter) -> (f64, Work) {
    (meter.forward_backward([&ROWS_OF_TOKENS], |[x]| x.softmax(1)), bytes(FIVE_PASSES))
}
