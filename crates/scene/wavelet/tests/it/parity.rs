//! Equality with PyWavelets and pytorch_wavelets, values and exact gradients.

use weaver_autograd::{Pool, Tape};
use weaver_fixtures::Fixture;
use weaver_wavelet::{EnergyMap, Wavelet, analysis, detail_energy, energy, luma};

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

#[test]
fn energy_of_coefficients_and_of_pixels() {
    let fixture = Fixture::open("wavelet.safetensors");
    for wavelet in [Wavelet::Haar, Wavelet::Db2] {
        for size in SIZES {
            let (image, shape) = fixture.tensor(&format!("in.{size}"));
            let tape = Tape::<f32>::new();
            let bands = analysis(tape.constant(&image, &shape[1..]), wavelet);
            fixture.assert_close(&format!("out.{wavelet}.{size}.energy"), &detail_energy(bands).value());
            // A gray image has that gray as its luma.
            let gray = image.repeat(3);
            let mut map = vec![0.0; image.len()];
            EnergyMap::new(wavelet, [shape[2], shape[3]]).compute(&gray, &Pool::new(), &mut map);
            fixture.assert_close(&format!("out.{wavelet}.{size}.energy_up"), &map);
            let x = tape.leaf(&gray, [1, 3, shape[2], shape[3]]);
            let on_tape = energy(x, wavelet);
            fixture.assert_close(&format!("out.{wavelet}.{size}.energy_up"), &on_tape.value());
            on_tape.backward_with(&fixture.tensor(&format!("cot.{wavelet}.{size}.energy_up")).0);
            // The luma's weights sum to 1, so the gradient of the gray is the sum over its channels.
            let gradient = x.grad().unwrap();
            let gray = (0..image.len()).map(|i| gradient.iter().skip(i).step_by(image.len()).sum());
            fixture.assert_close(&format!("grad.energy_up.{wavelet}.{size}"), &gray.collect::<Vec<f32>>());
        }
    }
}

#[test]
fn energy_of_photos() {
    let fixture = Fixture::open("losses_tiny.safetensors");
    let (images, shape) = fixture.tensor("in.images");
    let mut energy = vec![0.0; images.len() / 3];
    EnergyMap::new(Wavelet::Db2, [shape[3], shape[4]]).compute(&images, &Pool::new(), &mut energy);
    fixture.assert_close("out.energy", &energy);
}

#[test]
fn sub_bands_of_photos() {
    let fixture = Fixture::open("splatweaver_head_micro.safetensors");
    let (images, shape) = fixture.tensor("in.images");
    let tape = Tape::new();
    let images = tape.constant(&images, &shape[1..]);
    fixture.assert_close("out.bands", &analysis(luma(images), Wavelet::Db2).slice(1, 1, 3).value());
}
