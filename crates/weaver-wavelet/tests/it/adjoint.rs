//! Linear maps and their adjoints, for all sizes.

use proptest::prelude::*;
use weaver_autograd::Params;
use weaver_autograd::Tape;
use weaver_autograd::gradcheck::{Input, adjoint_check, gradcheck};
use weaver_nn::{Builder, Context};
use weaver_wavelet::{Guidance, Wavelet, analysis, detail_energy, energy, luma, synthesis};

fn wavelet() -> impl Strategy<Value = Wavelet> {
    prop_oneof![Just(Wavelet::Haar), Just(Wavelet::Db2)]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn adjoints(wavelet in wavelet(), n in 0..3usize, height in 1..9usize, width in 1..9usize, seed in any::<u64>()) {
        adjoint_check([n, height, width], seed, |x| analysis(x, wavelet));
        let bands = [n, 4, wavelet.output_len(height), wavelet.output_len(width)];
        adjoint_check(bands, seed, |x| synthesis(x, wavelet, [height, width]));
        adjoint_check([n, 3, height, width], seed, luma);
    }

    #[test]
    fn gradients(wavelet in wavelet(), height in 1..6usize, width in 1..6usize, seed in any::<u64>()) {
        gradcheck(&[Input::normal(seed, [2, height, width])], |x| vec![analysis(x[0], wavelet)]);
        let bands = [2, 4, wavelet.output_len(height), wavelet.output_len(width)];
        gradcheck(&[Input::normal(seed, bands)], |x| vec![synthesis(x[0], wavelet, [height, width])]);
        gradcheck(&[Input::normal(seed, [2, 3, height, width])], |x| vec![luma(x[0])]);
        gradcheck(&[Input::normal(seed, [2, 4, height, width])], |x| vec![detail_energy(x[0])]);
    }

    #[test]
    fn gradients_by_the_images(wavelet in wavelet(), height in 2..6usize, width in 2..6usize, seed in any::<u64>()) {
        let images = [Input::uniform(seed, 0.0, 1.0, [2, 3, height, width])];
        gradcheck(&images, |x| vec![energy(x[0], wavelet)]);
        let mut params = Params::<f64>::new();
        let guidance = Guidance::new(&mut Builder::new(&mut params, seed), wavelet, 2, 3);
        gradcheck(&images, |x| vec![guidance.forward(Context::new(x[0].tape(), &params), x[0])]);
    }

    #[test]
    fn perfect_reconstruction(wavelet in wavelet(), height in 1..12usize, width in 1..12usize, seed in any::<u64>()) {
        let image = Input::normal(seed, [2, 3, height, width]);
        let tape = Tape::<f64>::new();
        let x = tape.constant(&image.data, image.shape);
        let again = synthesis(analysis(x, wavelet), wavelet, [height, width]).to_vec();
        for (a, b) in again.iter().zip(&image.data) {
            prop_assert!((a - b).abs() < 1e-12, "{a} against {b}");
        }
    }
}

#[test]
fn every_parameter_of_the_guidance_gets_a_gradient() {
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
fn shapes_that_do_not_fit_are_refused() {
    let tape = Tape::<f64>::new();
    let bands = tape.constant(&[0.0; 16], [4, 2, 2]);
    let panic = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| synthesis(bands, Wavelet::Db2, [4, 4])));
    let message = *panic.unwrap_err().downcast::<String>().unwrap();
    assert_eq!(message, "wavelet_synthesis: expected sub-bands [.., 4, 3, 3] for images of 4 x 4, found [4, 2, 2]");
}
