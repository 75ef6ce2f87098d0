//! The aggregator.

use super::reference::Reference;
use weaver_autograd::{Params, Real, Tape};
use weaver_nn::{Builder, Context};
use weaver_vggt::{Aggregator, AggregatorConfig, BackboneInit, VisionTransformerConfig, normalize_image};

pub fn run<T: Real>(file: Reference) -> Reference {
    let rounds = file.size("rounds");
    let (heads, mlp_ratio) = (file.size("heads"), file.size("mlp_ratio"));
    let encoder = VisionTransformerConfig {
        patch: file.size("patch"),
        dim: file.size("dim"),
        depth: file.size("dino_depth"),
        heads,
        mlp_ratio,
        registers: file.size("dino_register_tokens"),
        table: file.grid("pos_table"),
    };
    let registers = file.size("register_tokens");
    let config = AggregatorConfig { encoder, rounds, heads, mlp_ratio, registers, layers: (0..rounds).collect() };
    let mut params = Params::<T>::new();
    let mut root = Builder::new(&mut params, 0);
    let aggregator = Aggregator::new(root.scope("aggregator"), config, BackboneInit::PUBLISHED);
    file.load(&mut params);
    let tape = Tape::<T>::new();
    let cx = Context::new(&tape, &params);
    let images = file.leaf(&tape, "in.images");
    let [b, v, c, h, w] = [0, 1, 2, 3, 4].map(|axis| images.shape()[axis]);
    let patches = tape
        .without_gradient(|| aggregator.patch_embed().forward(cx, normalize_image(images.reshape([b * v, c, h, w]))));
    file.check("out.patch_tokens", &patches.value());

    let out = aggregator.forward(cx, images);
    let mut loss = tape.scalar(T::ZERO);
    for (round, tokens) in out.layers.iter().enumerate() {
        file.check(&format!("out.round{round}"), &tokens.value());
        loss = loss + file.weighted(*tokens, &format!("cot.round{round}"));
    }
    file.backward(loss);
    file.check_grad("grad.in.images", images);
    file.check_params(&params, &tape);
    file
}
