use weaver_autograd::gradcheck::{Input, gradcheck};
use weaver_autograd::{Params, Tape};
use weaver_fixtures::Fixture;
use weaver_nn::{Builder, Context};
use weaver_vggt::{BackboneInit, VisionTransformer, VisionTransformerConfig};

#[test]
fn parity() {
    let file = Fixture::open("dinov2_micro.safetensors");
    let config =
        VisionTransformerConfig { patch: 14, dim: 24, depth: 2, heads: 2, mlp_ratio: 2, registers: 4, table: [5, 5] };
    let mut params = Params::<f32>::new();
    let mut b = Builder::new(&mut params, 0);
    let vit = VisionTransformer::new(b.scope("aggregator.patch_embed"), config, BackboneInit::PUBLISHED);
    file.load(&mut params);
    let tape = Tape::new();
    let image = file.leaf(&tape, "in.image");
    let tokens = vit.forward(Context::new(&tape, &params), image);
    file.assert_close("out.patch_tokens", &tokens.value());
    tokens.backward_with(&file.f32("cot.patch_tokens"));
    file.assert_close("grad.in.image", &image.grad().unwrap());
    file.assert_gradients(&params, &tape);
}

fn micro(table: [usize; 2], registers: usize) -> (VisionTransformer, Params<f64>) {
    let config = VisionTransformerConfig { patch: 2, dim: 4, depth: 1, heads: 2, mlp_ratio: 2, registers, table };
    let mut params = Params::new();
    let vit = VisionTransformer::new(Builder::new(&mut params, 3), config, BackboneInit::FROM_SCRATCH);
    (vit, params)
}

#[test]
fn gradients_of_image_and_every_weight() {
    for (table, registers) in [([2, 3], 2), ([3, 3], 0)] {
        let (vit, params) = micro(table, registers);
        let params = &params;
        gradcheck(&[Input::normal(1, [2, 3, 4, 6])], |x| vec![vit.forward(Context::new(x[0].tape(), params), x[0])]);
        let ids: Vec<_> = params.iter().map(|(id, _)| id).collect();
        let image = Input::normal(1, [1, 3, 4, 6]);
        crate::check_weights(params, &ids, |cx| {
            let image = cx.tape.constant(&image.data, image.shape);
            vit.forward(cx, image)
        });
    }
}

/// A table of the grid's own size, square or not, is used as it is; another one is resized.
#[test]
fn position_table() {
    let (vit, mut params) = micro([2, 3], 1);
    let table = params.find("pos_embed").unwrap();
    let run = |params: &Params<f64>, h: usize, w: usize| {
        let tape = Tape::new();
        let image = tape.constant(&vec![0.5; 3 * h * w], [1, 3, h, w]);
        vit.forward(Context::new(&tape, params), image).to_vec()
    };
    let (before, before_resized) = (run(&params, 4, 6), run(&params, 6, 6));
    assert_eq!((before.len(), before_resized.len()), (6 * 4, 9 * 4));
    // Equal positions everywhere: the resize of a constant is that constant, so every patch of a flat image is alike.
    params.value_mut(table).fill(0.25);
    for (h, w) in [(4, 6), (6, 6), (2, 10)] {
        let tokens = run(&params, h, w);
        let alike = tokens.chunks(4).all(|t| t.iter().zip(&tokens).all(|(a, b)| (a - b).abs() < 1e-12));
        assert!(alike, "{h} x {w}");
    }
    assert!(before.chunks(4).any(|t| t.iter().zip(&before).any(|(a, b)| (a - b).abs() > 1e-3)));
}
