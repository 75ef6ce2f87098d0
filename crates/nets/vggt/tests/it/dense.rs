use weaver_autograd::gradcheck::{Input, gradcheck};
use weaver_autograd::{Params, Tape};
use weaver_fixtures::Fixture;
use weaver_nn::{Builder, Context, WeightInit};
use weaver_pose::{cameras, unproject};
use weaver_vggt::{DenseTokens, DepthHead, DepthHeadConfig, DptConfig, DptHead, FeatureHead, FeatureHeadConfig};

#[test]
fn parity() {
    let file = Fixture::open("dpt_depth_micro.safetensors");
    let dpt = DptConfig { dim: 48, out_channels: [12, 16, 20, 24], features: 16, width: 8 };
    let config = DepthHeadConfig { dpt, hidden: 32, log_depth_bounds: None, last: WeightInit::FanIn };
    let mut params = Params::<f32>::new();
    let head = DepthHead::new(Builder::new(&mut params, 0).scope("depth_head"), config);
    file.load(&mut params);
    let tape = Tape::new();
    let layers = [0, 1, 2, 3].map(|i| file.leaf(&tape, &format!("in.tokens{i}")));
    let tokens = DenseTokens { layers: &layers, special: 5, grid: [2, 3], image: [28, 42] };
    let maps = head.forward(Context::new(&tape, &params), tokens);
    let depth = maps.depth.reshape([1, 2, 28, 42]);
    let pose = file.leaf(&tape, "in.pose");
    let c = cameras(pose, 28, 42);
    let points = unproject(depth, c.viewmats, c.intrinsics, 0.0);
    file.assert_close("out.extrinsics", &c.viewmats.value());
    file.assert_close("out.depth", &depth.value());
    file.assert_close("out.conf", &maps.confidence.value());
    file.assert_close("out.points", &points.value());
    let mut loss = tape.scalar(0.0);
    for (x, key) in [(depth, "cot.depth"), (maps.confidence, "cot.conf"), (points, "cot.points")] {
        loss = loss + (x * tape.constant(&file.f32(key), x.shape())).sum();
    }
    loss.backward();
    file.assert_close("grad.in.pose", &pose.grad().unwrap());
    for (i, layer) in layers.iter().enumerate() {
        file.assert_close(&format!("grad.in.tokens{i}"), &layer.grad().unwrap());
    }
    file.assert_gradients(&params, &tape);
}

#[test]
fn feature_parity() {
    let file = Fixture::open("splatweaver_head_micro.safetensors");
    let dpt = DptConfig { dim: 32, out_channels: [8, 12, 16, 16], features: 16, width: 8 };
    let mut params = Params::<f32>::new();
    let config = FeatureHeadConfig { dpt, merger: Some(8) };
    let head = FeatureHead::new(Builder::new(&mut params, 0).scope("gaussian_param_head"), config);
    file.load(&mut params);
    let tape = Tape::new();
    let layers = [0, 1, 2, 3].map(|i| file.constant(&tape, &format!("in.tokens{i}")));
    let tokens = DenseTokens { layers: &layers, special: 5, grid: [2, 1], image: [28, 14] };
    let maps = head.forward(Context::new(&tape, &params), tokens, file.constant(&tape, "in.images"));
    file.assert_close("out.E", &maps.embedding.value());
    file.assert_close("out.F", &maps.features.value());
}

const MICRO: DptConfig = DptConfig { dim: 4, out_channels: [4, 4, 8, 4], features: 4, width: 8 };

/// Four layers of tokens of two views with one special token each.
fn layers(grid: [usize; 2]) -> Vec<Input> {
    (0..4).map(|i| Input::normal(10 + i, [2, 1 + grid[0] * grid[1], 4])).collect()
}

#[test]
fn gradients_of_tokens_images_and_every_weight() {
    let (grid, image) = ([1, 2], [3, 6]);
    let mut params = Params::<f64>::new();
    let mut b = Builder::new(&mut params, 5);
    let bounds = Some((-4.0, 4.0));
    let depth = DepthHeadConfig { dpt: MICRO, hidden: 4, log_depth_bounds: bounds, last: WeightInit::FanIn };
    let depth = DepthHead::new(b.scope("depth_head"), depth);
    let features = FeatureHead::new(b.scope("gaussian_param_head"), FeatureHeadConfig { dpt: MICRO, merger: Some(4) });
    let params = &params;
    let mut inputs = layers(grid);
    inputs.push(Input::uniform(20, 0.0, 1.0, [2, 3, image[0], image[1]]));
    gradcheck(&inputs, |x| {
        let cx = Context::new(x[0].tape(), params);
        let tokens = DenseTokens { layers: &x[..4], special: 1, grid, image };
        let maps = depth.forward(cx, tokens);
        let f = features.forward(cx, tokens, x[4]);
        vec![maps.depth, maps.confidence, f.embedding, f.features]
    });
    let ids: Vec<_> = params.iter().map(|(id, _)| id).collect();
    crate::check_weights(params, &ids, |cx| {
        let x: Vec<_> = inputs.iter().map(|i| cx.tape.constant(&i.data, i.shape)).collect();
        let tokens = DenseTokens { layers: &x[..4], special: 1, grid, image };
        let maps = depth.forward(cx, tokens);
        let f = features.forward(cx, tokens, x[4]);
        weaver_autograd::ops::concat(
            &[
                maps.depth.reshape([36]),
                maps.confidence.reshape([36]),
                f.embedding.reshape([288]),
                f.features.reshape([288]),
            ],
            0,
        )
    });
}

/// The last resize brings 8 cells a patch to any patch size: 14 and 4 as well as 8, where nothing is left to do.
#[test]
fn patches_of_any_size() {
    let mut params = Params::<f64>::new();
    let head = DptHead::new(&mut Builder::new(&mut params, 5), MICRO);
    let grid = [2, 3];
    let run = |image: [usize; 2]| {
        let tape = Tape::new();
        let x: Vec<_> = layers(grid).iter().map(|i| tape.constant(&i.data, i.shape)).collect();
        let maps = head.forward(Context::new(&tape, &params), DenseTokens { layers: &x, special: 1, grid, image });
        assert_eq!(maps.shape().dims(), [2, 8, image[0], image[1]]);
        maps.to_vec()
    };
    // Same aspect ratio, so the same positions: the trunk's 16 x 24 maps, resized with aligned corners.
    let (fine, coarse, small) = (run([16, 24]), run([28, 42]), run([8, 12]));
    for (resized, [h, w]) in [(coarse, [28, 42]), (small, [8, 12])] {
        for plane in 0..16 {
            for (row, column) in [(0, 0), (h - 1, 0), (h / 2, w / 3), (h - 1, w - 1)] {
                let at = |i: usize, n: usize, full: usize| i as f64 * (full - 1) as f64 / (n - 1) as f64;
                let (y, x) = (at(row, h, 16), at(column, w, 24));
                let value = |i: usize, j: usize| fine[(plane * 16 + i.min(15)) * 24 + j.min(23)];
                let (i, j) = (y.floor() as usize, x.floor() as usize);
                let (a, b) = (y - i as f64, x - j as f64);
                let expected = (1.0 - a) * ((1.0 - b) * value(i, j) + b * value(i, j + 1))
                    + a * ((1.0 - b) * value(i + 1, j) + b * value(i + 1, j + 1));
                let found = resized[(plane * h + row) * w + column];
                assert!((found - expected).abs() < 1e-9, "{h} x {w}, plane {plane} at {row}, {column}");
            }
        }
    }
}
