//! The guidance mask against the official code and finite differences.

use proptest::prelude::*;
use weaver_autograd::gradcheck::{Input, gradcheck};
use weaver_autograd::{Params, Tape};
use weaver_fixtures::Fixture;
use weaver_model::Guidance;
use weaver_nn::{Builder, Context};
use weaver_wavelet::Wavelet;

fn wavelet() -> impl Strategy<Value = Wavelet> {
    prop_oneof![Just(Wavelet::Haar), Just(Wavelet::Db2)]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 20))]

    #[test]
    fn gradients_with_respect_to_the_images(
        wavelet in wavelet(), height in 2..6usize, width in 2..6usize, seed in any::<u64>()
    ) {
        let images = [Input::uniform(seed, 0.0, 1.0, [2, 3, height, width])];
        let mut params = Params::<f64>::new();
        let guidance = Guidance::new(&mut Builder::new(&mut params, seed), wavelet, 2, 3);
        gradcheck(&images, |x| vec![guidance.forward(Context::new(x[0].tape(), &params), x[0])]);
    }
}

#[test]
fn every_parameter_gets_a_gradient() {
    let mut params = Params::<f64>::new();
    let guidance = Guidance::new(&mut Builder::new(&mut params, 1), Wavelet::Db2, 4, 6);
    let tape = Tape::new();
    let images = Input::uniform(1, 0.0, 1.0, [2, 3, 8, 10]);
    let mask = guidance.forward(Context::new(&tape, &params), tape.constant(&images.data, images.shape));
    assert_eq!(mask.shape().dims(), [2, 6, 8, 10]);
    assert!(mask.value().iter().all(|a| (0.0..1.0).contains(a)));
    mask.sum().backward();
    let names: Vec<_> = params.iter().map(|(id, p)| (p.name(), tape.param_grad(id).is_some())).collect();
    let expected = ["wave_merger1.0", "wave_merger1.1", "wave_merger2.0"];
    let expected = expected.map(|name| [(format!("{name}.weight"), true), (format!("{name}.bias"), true)]);
    assert_eq!(names, expected.as_flattened().iter().map(|(n, g)| (n.as_str(), *g)).collect::<Vec<_>>());
}

#[test]
fn parity() {
    let fixture = Fixture::open("splatweaver_head_micro.safetensors");
    let (images, shape) = fixture.tensor("in.images");
    let mut params = Params::<f32>::new();
    let guidance = Guidance::new(&mut Builder::new(&mut params, 0), Wavelet::Db2, 8, 8);
    for (id, name) in params.iter().map(|(id, p)| (id, p.name().to_owned())).collect::<Vec<_>>() {
        let (values, shape) = fixture.tensor(&format!("w.gaussian_param_head.{name}"));
        assert_eq!(params.get(id).shape().dims(), shape);
        params.value_mut(id).copy_from_slice(&values);
    }
    let tape = Tape::new();
    let images = tape.constant(&images, &shape[1..]);
    fixture.assert_close("out.mask_A", &guidance.forward(Context::new(&tape, &params), images).value());
}
