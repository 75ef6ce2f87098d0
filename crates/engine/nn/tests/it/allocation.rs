//! A training step of fixed shape allocates nothing once it has run.

use weaver_autograd::{Params, Tape, ops};
use weaver_nn::{
    AdamW, Block, BlockConfig, Builder, Context, Conv2d, ConvTranspose2d, Ema, Group, LayerNorm, WeightInit,
    clip_global_norm,
};

#[test]
fn a_repeated_step_allocates_nothing() {
    // A thread of the pool: work that the kernels hand to the pool then runs on it, too, and is counted.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread pool");
    let counts = pool.install(|| {
        let mut params = Params::<f32>::new();
        let mut builder = Builder::new(&mut params, 0);
        let init = WeightInit::FanIn;
        let config =
            BlockConfig { width: 8, heads: 2, hidden: 16, eps: 1e-5, layer_scale: Some(0.1), qk_norm: true, init };
        let patch = Conv2d::new(builder.scope("patch"), 3, 8, 4, init).with_stride(4).with_padding(0);
        let block = Block::new(builder.scope("block"), &config);
        let norm = LayerNorm::new(builder.scope("norm"), 8, 1e-5);
        let up = ConvTranspose2d::new(builder.scope("up"), 8, 4, 2, init);
        let table = std::sync::Arc::new(ops::RopeTable::new(&[[1, 1], [1, 2], [2, 1], [2, 2]], 4, 100.0));
        let group = Group { params: params.ids().collect(), lr_scale: 1.0, weight_decay: 0.01 };
        let mut optimizer = AdamW::new(vec![group], 0.9, 0.99, 1e-8);
        let mut ema = Ema::new(&params, 0.99);
        let (mut tape, image) = (Tape::<f32>::new(), [0.3_f32; 2 * 3 * 64]);
        let mut step = || {
            let cx = Context::new(&tape, &params);
            let maps = patch.forward(cx, tape.constant(&image, [2, 3, 8, 8]));
            let tokens = maps.reshape([2, 8, 4]).permute(&[0, 2, 1]);
            let tokens = norm.forward(cx, block.forward(cx, tokens, Some(&table)));
            let picked = tokens.reshape([8, 8]).gather_rows(&[0, 3, 3, 7]).scatter_add_rows(&[1, 0, 1, 2], 3);
            let maps = up.forward(cx, tokens.permute(&[0, 2, 1]).reshape([2, 8, 2, 2])).bilinear(6, 6, true);
            let both = ops::concat(&[maps.avg_pool_same(3).reshape([288]), picked.softmax(1).reshape([24])], 0);
            (both.square().sum() + ops::cross_entropy(picked, &[0, 1, 2], 0.1)).backward();
            let norm = clip_global_norm(&params, &mut tape, 1.0);
            assert!(norm.is_finite() && norm > 0.0);
            optimizer.step(&mut params, &mut tape, 1e-3);
            tape.reset();
            ema.update(&params);
        };
        let mut count = || allocation_counter::measure(&mut step).count_total;
        [count(), count(), count(), count(), count()]
    });
    assert!(counts[0] > 0, "the counter counts");
    assert_eq!(counts[3..], [0, 0], "allocations per step: {counts:?}");
}
