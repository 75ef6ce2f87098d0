//! Similarity of two pictures.

use rayon::prelude::*;

pub use weaver_losses::metrics::psnr;

/// Exponents of the scales, from the finest (Wang, Simoncelli and Bovik, 2003).
const EXPONENTS: [f64; 5] = [0.0448, 0.2856, 0.3001, 0.2363, 0.1333];
const WINDOW: usize = 11;
const SIGMA: f64 = 1.5;
/// Rows of windows whose moments are in memory at once.
const BAND: usize = 64;
const C1: f64 = 1e-4;
const C2: f64 = 9e-4;

/// The multi-scale structural similarity of two pictures `[H, W, 3]` in [0, 1], the mean of the channels.
///
/// Scales are halved by means of 2 x 2 pixels. The contrast and structure terms of the four finer scales and the whole
/// similarity of the coarsest are raised to the scales' exponents; negative terms count as 0. Windows are Gaussians of
/// 11 x 11 pixels inside the picture. `None` for a side below 176 pixels, which leaves no window at the coarsest scale.
/// Source: Wang et al., 2003.
///
/// # Panics
/// Unless both have `size`, (H, W).
pub fn ms_ssim(a: &[f32], b: &[f32], size: [usize; 2]) -> Option<f64> {
    let [height, width] = size;
    assert!(
        a.len() == 3 * height * width && b.len() == a.len(),
        "ms_ssim: expected pictures of {size:?}, found {} and {} numbers",
        a.len(),
        b.len()
    );
    if height.min(width) < WINDOW << (EXPONENTS.len() - 1) {
        return None;
    }
    let channel = |c: usize| {
        let plane = |of: &[f32]| of.iter().skip(c).step_by(3).map(|x| f64::from(x.clamp(0.0, 1.0))).collect::<Vec<_>>();
        let (mut a, mut b, mut size) = (plane(a), plane(b), size);
        let mut product = 1.0;
        for (scale, exponent) in EXPONENTS.into_iter().enumerate() {
            let [whole, contrast] = similarity(&a, &b, size);
            let term = if scale + 1 == EXPONENTS.len() { whole } else { contrast };
            product *= term.max(0.0).powf(exponent);
            (a, b) = (halved(&a, size), halved(&b, size));
            size = size.map(|side| side / 2);
        }
        product
    };
    // One after the other: a plane takes a large part of the picture's memory.
    Some((0..3).map(channel).sum::<f64>() / 3.0)
}

fn halved(plane: &[f64], [height, width]: [usize; 2]) -> Vec<f64> {
    let mean = |y: usize, x: usize| {
        let at = 2 * y * width + 2 * x;
        0.25 * (plane[at] + plane[at + 1] + plane[at + width] + plane[at + width + 1])
    };
    (0..height / 2).flat_map(|y| (0..width / 2).map(move |x| mean(y, x))).collect()
}

/// Means over windows of the similarity, and of its term of contrast and structure.
fn similarity(a: &[f64], b: &[f64], [height, width]: [usize; 2]) -> [f64; 2] {
    let rows = height + 1 - WINDOW;
    let bands = (0..rows.div_ceil(BAND)).into_par_iter().map(|band| {
        let (first, end) = (band * BAND, ((band + 1) * BAND).min(rows) + WINDOW - 1);
        let rows = first * width..end * width;
        similarity_sums(&a[rows.clone()], &b[rows], [end - first, width])
    });
    let bands: Vec<[f64; 2]> = bands.collect();
    let count = (rows * (width + 1 - WINDOW)) as f64;
    [0, 1].map(|k| bands.iter().map(|sums| sums[k]).sum::<f64>() / count)
}

/// Sums over the windows inside a band of both planes.
fn similarity_sums(a: &[f64], b: &[f64], size: [usize; 2]) -> [f64; 2] {
    let products = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).collect::<Vec<_>>();
    let blur = |plane: &[f64]| blurred(plane, size);
    let means = [blur(a), blur(b)];
    let [aa, bb, ab] = [blur(&products(a, a)), blur(&products(b, b)), blur(&products(a, b))];
    let mut sums = [0.0; 2];
    for i in 0..aa.len() {
        let (ma, mb) = (means[0][i], means[1][i]);
        let contrast = (2.0 * (ab[i] - ma * mb) + C2) / (aa[i] - ma * ma + bb[i] - mb * mb + C2);
        sums[0] += contrast * (2.0 * ma * mb + C1) / (ma * ma + mb * mb + C1);
        sums[1] += contrast;
    }
    sums
}

/// Weighted means over the windows inside a plane.
fn blurred(plane: &[f64], [height, width]: [usize; 2]) -> Vec<f64> {
    let weight = |i: usize| (-(i as f64 - (WINDOW / 2) as f64).powi(2) / (2.0 * SIGMA * SIGMA)).exp();
    let sum: f64 = (0..WINDOW).map(weight).sum();
    let taps: [f64; WINDOW] = std::array::from_fn(|i| weight(i) / sum);
    let (rows, columns) = (height + 1 - WINDOW, width + 1 - WINDOW);
    let mut along = vec![0.0; height * columns];
    for (out, line) in along.chunks_exact_mut(columns).zip(plane.chunks_exact(width)) {
        for (k, tap) in taps.iter().enumerate() {
            out.iter_mut().zip(&line[k..]).for_each(|(out, x)| *out += tap * x);
        }
    }
    let mut out = vec![0.0; rows * columns];
    for (y, row) in out.chunks_exact_mut(columns).enumerate() {
        for (k, tap) in taps.iter().enumerate() {
            row.iter_mut().zip(&along[(y + k) * columns..]).for_each(|(out, x)| *out += tap * x);
        }
    }
    out
}
