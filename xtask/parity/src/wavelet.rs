//! Wavelet analysis and energy.

use super::reference::Reference;
use weaver_autograd::{Real, Tape};
use weaver_wavelet::{Wavelet, analysis, detail_energy};

pub fn run<T: Real>(file: Reference) -> Reference {
    let names = |key: &str| -> Vec<String> {
        let list = file.config[key].as_array().unwrap_or_else(|| panic!("config {key}: expected a list"));
        list.iter().map(|v| v.as_str().unwrap_or_default().to_string()).collect()
    };
    for name in names("wavelets") {
        let wavelet: Wavelet = name.parse().unwrap_or_else(|e| panic!("{e}"));
        // Listed the other way round than the taps meet the signal.
        let low: Vec<T> = wavelet.low().iter().rev().map(|x| T::from_f64(*x)).collect();
        let high: Vec<T> = (0..wavelet.taps()).rev().map(|j| T::from_f64(wavelet.high(j))).collect();
        file.check(&format!("filter.{name}.dec_lo"), &low);
        file.check(&format!("filter.{name}.dec_hi"), &high);
        for size in names("sizes") {
            image::<T>(&file, wavelet, &size);
        }
    }
    file
}

fn image<T: Real>(file: &Reference, wavelet: Wavelet, size: &str) {
    let at = format!("{wavelet}.{size}");
    let shape = file.shape(&format!("in.{size}"));
    let (height, width) = (shape[2], shape[3]);
    let tape = Tape::<T>::new();
    let x = tape.leaf(&file.data(&format!("in.{size}")), [height, width]);
    let bands = analysis(x, wavelet);
    let [h, w] = [bands.shape()[1], bands.shape()[2]];
    file.check(&format!("out.{at}.low"), &bands.value()[..h * w]);
    file.check(&format!("out.{at}.high"), &bands.value()[h * w..]);
    let cotangent = [file.data(&format!("cot.{at}.low")), file.data(&format!("cot.{at}.high"))].concat();
    file.backward_with(bands, &cotangent);
    file.check_grad(&format!("grad.bands.{at}"), x);

    let tape = Tape::<T>::new();
    let x = tape.leaf(&file.data(&format!("in.{size}")), [1, height, width]);
    let energy = detail_energy(analysis(x, wavelet));
    file.check(&format!("out.{at}.energy"), &energy.value());
    let map = energy.reshape([1, 1, h, w]).bilinear(height, width, false);
    file.check(&format!("out.{at}.energy_up"), &map.value());
    file.backward_with(map, &file.data(&format!("cot.{at}.energy_up")));
    file.check_grad(&format!("grad.energy_up.{at}"), x);
}
