//! Linear maps and their adjoints, for all sizes.

use proptest::prelude::*;
use weaver_autograd::Tape;
use weaver_autograd::gradcheck::{Input, adjoint_check, gradcheck};
use weaver_wavelet::{Wavelet, analysis, detail_energy, energy, luma, synthesis};

fn wavelet() -> impl Strategy<Value = Wavelet> {
    prop_oneof![Just(Wavelet::Haar), Just(Wavelet::Db2)]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 10))]

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
    }

    #[test]
    fn perfect_reconstruction(wavelet in wavelet(), height in 1..12usize, width in 1..12usize, seed in any::<u64>()) {
        let image = Input::normal(seed, [2, 3, height, width]);
        let tape = Tape::<f64>::new();
        let x = tape.constant(&image.data, image.shape);
        let again = synthesis(analysis(x, wavelet), wavelet, [height, width]);
        prop_assert_eq!(again.shape(), image.shape);
        for (a, b) in again.to_vec().iter().zip(&image.data) {
            prop_assert!((a - b).abs() < 1e-12, "{a} against {b}");
        }
    }
}

#[test]
fn shapes_that_do_not_fit_are_refused() {
    let tape = Tape::<f64>::new();
    let bands = tape.constant(&[0.0; 16], [4, 2, 2]);
    let panic = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| synthesis(bands, Wavelet::Db2, [4, 4])));
    let message = *panic.unwrap_err().downcast::<String>().unwrap();
    assert_eq!(message, "wavelet_synthesis: expected sub-bands [.., 4, 3, 3] for images of 4 x 4, found [4, 2, 2]");
}
