//! Equality with PyWavelets and pytorch_wavelets, values and exact gradients.

use crate::fixture::Fixture;
use weaver_autograd::Tape;
use weaver_wavelet::{Wavelet, analysis};

const SIZES: [&str; 4] = ["16x20", "17x20", "16x23", "15x21"];

#[test]
fn sub_bands_and_their_gradient() {
    let fixture = Fixture::open("wavelet.safetensors");
    for wavelet in [Wavelet::Haar, Wavelet::Db2] {
        for size in SIZES {
            let name = format!("{wavelet}.{size}");
            let (image, shape) = fixture.tensor(&format!("in.{size}"));
            let tape = Tape::<f32>::new();
            let x = tape.leaf(&image, &shape[2..]);
            let bands = analysis(x, wavelet);
            let band = bands.shape()[1] * bands.shape()[2];
            fixture.assert_close(&format!("out.{name}.low"), &bands.value()[..band]);
            fixture.assert_close(&format!("out.{name}.high"), &bands.value()[band..]);
            let mut cotangent = fixture.tensor(&format!("cot.{name}.low")).0;
            cotangent.extend(fixture.tensor(&format!("cot.{name}.high")).0);
            bands.backward_with(&cotangent);
            fixture.assert_close(&format!("grad.bands.{name}"), &x.grad().unwrap());
        }
    }
}
