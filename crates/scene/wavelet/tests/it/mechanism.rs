//! The effect of the transform on images whose coefficients are known.

use weaver_autograd::Tape;
use weaver_wavelet::{Wavelet, analysis};

/// The bands [4, h, w] of an image given by a function of (x, y), and the size of each.
fn bands(wavelet: Wavelet, size: [usize; 2], f: impl Fn(usize, usize) -> f64) -> (Vec<Vec<f64>>, [usize; 2]) {
    let tape = Tape::<f64>::new();
    let pixels: Vec<f64> = (0..size[0] * size[1]).map(|i| f(i % size[1], i / size[1])).collect();
    let out = analysis(tape.constant(&pixels, size), wavelet);
    let (h, w) = (out.shape()[1], out.shape()[2]);
    let values = out.to_vec();
    (values.chunks(h * w).map(<[f64]>::to_vec).collect(), [h, w])
}

fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |m, v| v.abs().max(m))
}

/// The coefficients whose taps stay inside the image.
fn interior(band: &[f64], [h, w]: [usize; 2]) -> Vec<f64> {
    (1..h - 1).flat_map(|y| (1..w - 1).map(move |x| band[y * w + x])).collect()
}

/// Db2 is blind to ramps inside and gives half the size plus one.
#[test]
fn db2_is_blind_to_ramps() {
    let (bands, size) = bands(Wavelet::Db2, [16, 20], |x, y| 3.0 * x as f64 - 2.0 * y as f64 + 1.0);
    assert_eq!(size, [16 / 2 + 1, 20 / 2 + 1]);
    for band in &bands[1..] {
        assert!(largest(&interior(band, size)) < 1e-12);
    }
    // The mirror makes a kink of the ramp, which only the band across that border sees.
    assert!(largest(&bands[1]) > 0.1 && largest(&bands[2]) > 0.1);
    assert!(largest(&bands[3]) < 1e-12);
}

#[test]
fn bands_come_in_order() {
    let sign = |k: usize| if k.is_multiple_of(2) { 1.0 } else { -1.0 };
    for wavelet in [Wavelet::Haar, Wavelet::Db2] {
        let loudest = |f: &dyn Fn(usize, usize) -> f64| {
            let (bands, size) = bands(wavelet, [16, 16], f);
            let energy: Vec<f64> = bands.iter().map(|b| largest(&interior(b, size))).collect();
            (0..4).filter(|&b| energy[b] > 1e-9).collect::<Vec<_>>()
        };
        assert_eq!(loudest(&|_, _| 1.0), [0]);
        // A pixel-wide alternation is half the sampling rate: all of it is in a high band.
        assert_eq!(loudest(&|_, y| sign(y)), [1], "stripes along x alternate in y");
        assert_eq!(loudest(&|x, _| sign(x)), [2], "stripes along y alternate in x");
        assert_eq!(loudest(&|x, y| sign(x + y)), [3], "a checkerboard alternates in both");
    }
}

#[test]
fn a_checkerboard_in_haar_has_amplitude_two() {
    let (bands, size) = bands(Wavelet::Haar, [4, 6], |x, y| if (x + y) % 2 == 0 { 1.0 } else { -1.0 });
    assert_eq!(size, [2, 3]);
    assert!(bands[3].iter().all(|v| (v - 2.0).abs() < 1e-12), "{:?}", bands[3]);
}

/// The definition, one sum over all taps of the extended image, taken literally.
#[test]
fn the_slow_twin_agrees() {
    for wavelet in [Wavelet::Haar, Wavelet::Db2] {
        let size = [7, 10];
        let image = |x: usize, y: usize| ((x * 13 + y * 7) % 11) as f64 - 0.3 * x as f64;
        let (bands, [h, w]) = bands(wavelet, size, image);
        let taps = wavelet.taps();
        let tap = |high: bool, j: usize| if high { wavelet.high(j) } else { wavelet.low()[j] };
        let mirror = |i: isize, n: usize| {
            if i < 0 {
                -1 - i
            } else if i >= n as isize {
                2 * n as isize - 1 - i
            } else {
                i
            }
        };
        for (b, (x_high, y_high)) in
            [(false, false), (false, true), (true, false), (true, true)].into_iter().enumerate()
        {
            for (ky, kx) in (0..h).flat_map(|y| (0..w).map(move |x| (y, x))) {
                let mut sum = 0.0;
                for (jy, jx) in (0..taps).flat_map(|y| (0..taps).map(move |x| (y, x))) {
                    let at = |k: usize, j: usize, n| mirror((2 * k + j) as isize - (taps as isize - 2), n) as usize;
                    sum += tap(y_high, jy) * tap(x_high, jx) * image(at(kx, jx, size[1]), at(ky, jy, size[0]));
                }
                assert!((bands[b][ky * w + kx] - sum).abs() < 1e-12);
            }
        }
    }
}
