//! Memory against time: `cargo run --release -p weaver-nn --example recompute`.
//!
//! A step of 24 transformer blocks, once remembering everything for the way back, then with `ops::checkpoint` around
//! groups of blocks, which are run again when their gradient arrives. Prints the memory held, the peak and the time of
//! each, and whether the gradients are the same to the bit.

use std::time::{Duration, Instant};
use weaver_autograd::{Params, Tape, Var, ops};
use weaver_nn::{Block, BlockConfig, Builder, Context, WeightInit};

const BLOCKS: usize = 24;
const WIDTH: usize = 192;
const TOKENS: [usize; 2] = [2, 512];

/// All blocks; with a group size, every group as one op that is recomputed.
fn forward<'t>(blocks: &[Block], cx: Context<'t, '_>, mut x: Var<'t>, group: Option<usize>) -> Var<'t> {
    for part in blocks.chunks(group.unwrap_or(blocks.len())) {
        x = match group {
            Some(_) => {
                let part = part.to_vec();
                ops::checkpoint(cx.params, &[x], move |tape, params, x| {
                    part.iter().fold(x[0], |x, block| block.forward(Context::new(tape, params), x, None))
                })
            }
            None => part.iter().fold(x, |x, block| block.forward(cx, x, None)),
        };
    }
    x
}

fn main() {
    let mut params = Params::<f32>::new();
    let mut root = Builder::new(&mut params, 0);
    let config = BlockConfig {
        width: WIDTH,
        heads: 6,
        hidden: 4 * WIDTH,
        eps: 1e-5,
        layer_scale: Some(0.1),
        qk_norm: false,
        init: WeightInit::TruncatedNormal(0.02),
    };
    let blocks: Vec<Block> = (0..BLOCKS).map(|i| Block::new(root.scope(format_args!("blocks.{i}")), &config)).collect();
    let [batch, tokens] = TOKENS;
    println!(
        "{BLOCKS} blocks of width {WIDTH}, {batch} x {tokens} tokens, {:.1} M parameters",
        params.count() as f64 / 1e6
    );
    println!("{:<26}{:>12}{:>12}{:>12}", "", "held, MB", "peak, MB", "ms a step");

    let mut first: Option<Vec<f32>> = None;
    for group in [None, Some(1), Some(2), Some(4), Some(6)] {
        let mut tape = Tape::<f32>::new();
        let (mut best, mut held, mut gradient) = (Duration::MAX, 0, Vec::new());
        for _ in 0..3 {
            tape.reset();
            tape.pool().reset_peak();
            let started = Instant::now();
            let x = tape.constant_with([batch, tokens, WIDTH], |x| {
                x.iter_mut().enumerate().for_each(|(i, x)| *x = (0.37 * i as f32).sin());
            });
            let loss = forward(&blocks, Context::new(&tape, &params), x, group).square().mean();
            held = tape.pool().used_bytes();
            loss.backward();
            best = best.min(started.elapsed());
            gradient = params.ids().flat_map(|id| tape.param_grad(id).expect("a gradient").to_vec()).collect();
        }
        let name = group.map_or("everything remembered".into(), |n| format!("recomputed {n} by {n}"));
        let [held, peak] = [held, tape.pool().peak_bytes()].map(|bytes| bytes as f64 / 1e6);
        println!("{name:<26}{held:>12.1}{peak:>12.1}{:>12.0}", 1e3 * best.as_secs_f64());
        assert!(*first.get_or_insert(gradient.clone()) == gradient, "recomputation must not change a bit");
    }
    println!("the gradients of all are the same to the bit");
}
