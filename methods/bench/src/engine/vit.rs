//! A small vision transformer, to time a whole training step with.

use super::meter::{Meter, Work, normal};
use super::rows::{block_config, block_operations};
use weaver_autograd::{ParamId, Params, Tape, Var, ops};
use weaver_nn::{AdamW, Block, Builder, Context, Conv2d, Group, Init, LayerNorm, Linear, WeightInit};

const BATCH: usize = 16;
const SIDE: usize = 64;
const PATCH: usize = 8;
const WIDTH: usize = 192;
const DEPTH: usize = 6;
const HEADS: usize = 3;
const CLASSES: usize = 10;
const PATCHES: usize = (SIDE / PATCH) * (SIDE / PATCH);
const TOKENS: usize = PATCHES + 1;

/// Patches and a class token through blocks to classes.
struct VisionTransformer {
    patches: Conv2d,
    class: ParamId,
    position: ParamId,
    blocks: Vec<Block>,
    norm: LayerNorm,
    head: Linear,
}

impl VisionTransformer {
    fn new(mut builder: Builder<'_, f32>) -> Self {
        let init = WeightInit::FanIn;
        let patches = Conv2d::new(builder.scope("patches"), 3, WIDTH, PATCH, init).with_stride(PATCH).with_padding(0);
        let block = block_config(WIDTH, HEADS);
        Self {
            patches,
            class: builder.add("class", [1, 1, WIDTH], Init::Constant(0.0)),
            position: builder.add("position", [1, TOKENS, WIDTH], Init::Normal(0.02)),
            blocks: (0..DEPTH).map(|i| Block::new(builder.scope(format_args!("blocks.{i}")), &block)).collect(),
            norm: LayerNorm::new(builder.scope("norm"), WIDTH, 1e-6),
            head: Linear::new(builder.scope("head"), WIDTH, CLASSES, init),
        }
    }

    /// Images `[B, 3, H, W]` to logits `[B, classes]`.
    fn forward<'t>(&self, cx: Context<'t, '_>, images: Var<'t>) -> Var<'t> {
        let batch = images.shape()[0];
        let patches = self.patches.forward(cx, images).reshape([batch, WIDTH, PATCHES]).permute(&[0, 2, 1]);
        let class = cx.param(self.class).expand([batch, 1, WIDTH]);
        let mut x = ops::concat(&[class, patches], 1) + cx.param(self.position).expand([batch, TOKENS, WIDTH]);
        for block in &self.blocks {
            x = block.forward(cx, x, None);
        }
        self.head.forward(cx, self.norm.forward(cx, x).slice(1, 0, 1).reshape([batch, WIDTH]))
    }
}

/// Forward, backward and AdamW on one batch.
pub fn step(meter: &Meter) -> (f64, Work) {
    let mut params = Params::new();
    let model = VisionTransformer::new(Builder::new(&mut params, 0));
    let group = Group { params: params.ids().collect(), lr_scale: 1.0, weight_decay: 0.01 };
    let mut optimizer = AdamW::new(vec![group], 0.9, 0.999, 1e-8);
    let images = normal("images", BATCH * 3 * SIDE * SIDE);
    let labels: Vec<u32> = (0..BATCH).map(|i| (i % CLASSES) as u32).collect();
    let mut tape = Tape::new();
    let ms = meter.ms(|| {
        let images = tape.constant(&images, [BATCH, 3, SIDE, SIDE]);
        let logits = model.forward(Context::new(&tape, &params), images);
        ops::cross_entropy(logits, &labels, 0.0).backward();
        optimizer.step(&mut params, &mut tape, 1e-4);
        tape.reset();
    });
    let embedding = 2.0 * (BATCH * PATCHES * WIDTH * 3 * PATCH * PATCH) as f64;
    let forward = embedding + DEPTH as f64 * block_operations(BATCH, TOKENS, WIDTH);
    (ms, Work::Operations(3.0 * forward))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_has_as_many_parameters_as_its_peers() {
        let mut params = Params::new();
        VisionTransformer::new(Builder::new(&mut params, 0));
        assert_eq!(params.count(), 2_721_226);
    }

    #[test]
    fn every_parameter_is_reached() {
        let mut params = Params::new();
        let model = VisionTransformer::new(Builder::new(&mut params, 0));
        let tape = Tape::new();
        let images = tape.constant(&normal("images", 2 * 3 * SIDE * SIDE), [2, 3, SIDE, SIDE]);
        let logits = model.forward(Context::new(&tape, &params), images);
        assert_eq!(logits.shape().dims(), [2, CLASSES]);
        ops::cross_entropy(logits, &[3, 7], 0.0).backward();
        assert_eq!(weaver_nn::missing_gradients(&params, &tape), [] as [String; 0]);
    }
}
