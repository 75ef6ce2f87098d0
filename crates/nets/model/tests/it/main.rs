//! The network put together: the published sizes, and the two ways to run it.

mod guidance;
mod memory;

use weaver_autograd::{Params, Tape};
use weaver_kernels::random::Stream;
use weaver_model::{ModelConfig, SplatWeaver};
use weaver_nn::Context;
use weaver_router::Sampled;

/// As many parameters in each part as the published checkpoint has; the patch encoder's `mask_token` is left out here.
#[test]
fn published_sizes() {
    let mut params = Params::<f32>::new();
    SplatWeaver::declare(ModelConfig::splatweaver_1b(), &mut params);
    let count = |prefix: &str| -> usize {
        params.iter().filter(|(_, p)| p.name().starts_with(prefix)).map(|(_, p)| p.shape().len()).sum()
    };
    let mask_token = 1024;
    assert_eq!(count("aggregator.patch_embed."), 304_372_736 - mask_token);
    assert_eq!(count("aggregator.frame_blocks."), 302_364_672);
    assert_eq!(count("aggregator.global_blocks."), 302_364_672);
    assert_eq!(count("aggregator."), 909_112_320 - mask_token);
    assert_eq!(count("camera_head."), 216_174_610);
    assert_eq!(count("depth_head."), 32_654_562);
    assert_eq!(count("gaussian_param_head."), 33_011_211);
    assert_eq!(count("gaussian_param_head.gs_moe.gs_predictor."), 9_891);
    assert_eq!(params.count(), 1_190_952_703 - mask_token);
}

/// View by view without recording, all at once with: the same bits, in less memory.
#[test]
fn inference_equals_the_recorded_pass() {
    let config = ModelConfig::preset("micro").unwrap();
    let (height, width, views) = (config.height, config.width, 3);
    let mut params = Params::<f32>::new();
    let model = SplatWeaver::new(config, &mut params, 7);
    let stream = Stream::new(1, 0, "photos");
    let photos: Vec<f32> = (0..(views * 3 * height * width) as u64).map(|i| stream.uniform(i)).collect();
    let run = |tape: &Tape<f32>| {
        let cx = Context::new(tape, &params);
        let photos = tape.constant(&photos, [views, 3, height, width]);
        let encoded = model.encode(cx, photos.reshape([1, views, 3, height, width]));
        let dense = model.dense(cx, &encoded, 0, photos);
        let cameras = encoded.scene_cameras(0);
        let predicted = model.gaussians(cx, &dense, photos, &cameras, &Sampled, Stream::new(3, 0, "routing"));
        let g = &predicted.gaussians;
        let values =
            [g.means, g.scales, g.quats, g.opacities, g.colors, dense.depth, dense.confidence, cameras.viewmats];
        values.map(|v| v.to_vec())
    };
    let (recorded, sparing) = (Tape::new(), Tape::new());
    let expected = run(&recorded);
    let found = sparing.without_gradient(|| run(&sparing));
    assert_eq!(found, expected);
    let (less, more) = (sparing.pool().allocated_bytes(), recorded.pool().allocated_bytes());
    assert!(2 * less < more, "{less} bytes without recording, {more} with");
}
