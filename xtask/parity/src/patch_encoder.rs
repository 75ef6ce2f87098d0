//! The patch encoder.

use super::reference::Reference;
use weaver_autograd::{Params, Real, Tape};
use weaver_nn::{Builder, Context};
use weaver_vggt::{BackboneInit, VisionTransformer, VisionTransformerConfig};

pub fn run<T: Real>(file: Reference) -> Reference {
    let config = VisionTransformerConfig {
        patch: file.size("patch"),
        dim: file.size("dim"),
        depth: file.size("depth"),
        heads: file.size("heads"),
        mlp_ratio: file.size("mlp_ratio"),
        registers: file.size("register_tokens"),
        table: file.grid("pos_table"),
    };
    let mut params = Params::<T>::new();
    let mut root = Builder::new(&mut params, 0);
    let encoder = VisionTransformer::new(root.scope("aggregator.patch_embed"), config, BackboneInit::PUBLISHED);
    file.load(&mut params);
    let tape = Tape::<T>::new();
    let cx = Context::new(&tape, &params);
    let images = file.leaf(&tape, "in.image");

    let (class, grid) = encoder.positions(cx, file.size("grid_h"), file.size("grid_w"));
    file.check("out.pos_resized", &[class.to_vec(), grid.to_vec()].concat());
    file.check("out.patch_embed", &encoder.patch_embed().forward(cx, images).value());
    let mut x = encoder.embed(cx, images);
    for (i, block) in encoder.blocks().iter().enumerate() {
        x = block.forward(cx, x, None);
        file.check(&format!("out.block{i}"), &x.value());
    }
    // The published way of running it.
    let tokens = encoder.forward(cx, images);
    file.check("out.patch_tokens", &tokens.value());
    file.backward(file.weighted(tokens, "cot.patch_tokens"));
    file.check_grad("grad.in.image", images);
    file.check_params(&params, &tape);
    file
}
