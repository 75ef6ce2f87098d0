//! The memory of a forward pass without recording: everything but the results of a part is given back.

use weaver_autograd::{Params, Tape};
use weaver_kernels::random::Stream;
use weaver_model::{ModelConfig, SplatWeaver};
use weaver_nn::Context;
use weaver_router::AllocationKind;

/// The most bytes in use while tokens, maps and Gaussians are made of six photos.
fn peaks() -> [usize; 3] {
    let mut params = Params::<f32>::new();
    let model = SplatWeaver::new(ModelConfig::preset("tiny").unwrap(), &mut params, 0);
    let (height, width, views) = (model.config().height, model.config().width, 6);
    let tape = Tape::new();
    let (cx, pool) = (Context::new(&tape, &params), tape.pool());
    let photos = tape.constant_with([1, views, 3, height, width], |all| {
        all.iter_mut().zip(0..).for_each(|(x, i)| *x = Stream::new(0, 0, "photo").uniform(i));
    });
    let peak = || {
        let peak = pool.peak_bytes();
        pool.reset_peak();
        peak
    };
    tape.without_gradient(|| {
        peak();
        let encoded = model.encode(cx, photos);
        let of_tokens = peak();
        let photos = photos.reshape([views, 3, height, width]);
        let dense = model.dense(cx, &encoded, 0, photos);
        let of_maps = peak();
        let cameras = encoded.scene_cameras(0);
        let two = AllocationKind::Fixed(2).allocation(1.0, model.config().gaussians.experts()).unwrap();
        let predicted = model.gaussians(cx, &dense, photos, &cameras, &*two, Stream::new(0, 0, ""));
        assert_eq!(predicted.assignment.count(), 2 * views * height * width);
        [of_tokens, of_maps, peak()]
    })
}

/// A step or a part that kept more than its results would show here: the bounds are a twentieth above the need.
#[test]
fn a_forward_pass_holds_what_its_parts_return() {
    let found = peaks();
    let most = [2_720_000, 8_040_000, 52_200_000];
    assert!(found.iter().zip(most).all(|(found, most)| *found <= most), "{found:?} bytes, at most {most:?}");
}
