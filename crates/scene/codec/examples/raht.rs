//! Contexts of neighbors or the transform RAHT for colors, at equal decibels: `raht FILE ...`.
//!
//! Of each scene the harmonics are coded in three ways, in equal steps for all Gaussians: as symbols by frequencies alone, as `lite` does by
//! contexts, and as coefficients of RAHT on the same voxels, of orthonormal mixtures of the channels, by a mixed model whose contexts are the
//! channel, the number of the coefficient and those before it. Steps of the transform are scaled until pictures are as good as by contexts.
//! Everything else of a Gaussian is coded as `lite` does. Bits are of one Gaussian.

use std::error::Error;
use weaver_codec::lite::{Quality, encode, order_zero_bits, rounded_in_place};
use weaver_codec::{CodeLength, Container, MixedModel, Quantizer, Raht, morton3};
use weaver_scene::{Gaussians, orbit};
use weaver_splat::{RasterSettings, Renderer};

/// Equal steps for all Gaussians.
const QUALITY: Quality = Quality { adaptation: 0.0, dead_zone: 0.0, ..Quality::SETTINGS[1] };

/// Orthonormal mixtures of red, green and blue.
const MIXTURES: [[f64; 3]; 3] = [
    [0.577_350_269, 0.577_350_269, 0.577_350_269],
    [std::f64::consts::FRAC_1_SQRT_2, 0.0, -std::f64::consts::FRAC_1_SQRT_2],
    [0.408_248_290, -0.816_496_581, 0.408_248_290],
];

fn main() -> Result<(), Box<dyn Error>> {
    for path in std::env::args().skip(1) {
        scene(&path)?;
    }
    Ok(())
}

fn scene(path: &str) -> Result<(), Box<dyn Error>> {
    let gaussians = weaver_io::read_gaussians(path)?;
    let per_gaussian = (gaussians.len() as f64).recip();
    let bytes = encode(&gaussians, &QUALITY)?;
    let container = Container::read(&bytes)?;
    let contexts = |name: &[u8; 4]| {
        let own = container.streams.iter().filter(|stream| stream.name == *name);
        own.map(|stream| 8.0 * stream.bytes.len() as f64).sum::<f64>() * per_gaussian
    };
    let alone = order_zero_bits(&gaussians, &QUALITY)?.map(|(name, bits)| (name, bits * per_gaussian));
    let frequencies = |name: &[u8; 4]| alone.iter().find(|(other, _)| other == name).map_or(0.0, |(_, bits)| *bits);
    // Both in Morton order of the positions that a decoder has.
    let placed = rounded_in_place(&gaussians, &QUALITY)?;
    let (codes, numbers) = morton_order(&placed);
    let (before, coded) = (gaussians.select(&numbers), placed.select(&numbers));
    let raht = Raht::new(&codes, &vec![1.0; codes.len()])?;
    // The factor of the transform's steps at which pictures are as good as those of the contexts.
    let plain = psnr(&before, &coded)?;
    let (mut finer, mut coarser) = (0.5_f64, 4.0_f64);
    let mut equal = ([0.0; 2], 0.0);
    for _ in 0..7 {
        let factor = (finer * coarser).sqrt();
        let (bits, turned) = transformed((&before, &coded), factor, &raht);
        let decibels = psnr(&before, &turned)?;
        equal = (bits.map(|bits| bits * per_gaussian), decibels);
        *(if decibels > plain { &mut finer } else { &mut coarser }) = factor;
    }
    let (bits, decibels) = equal;
    let whole = 8.0 * bytes.len() as f64 * per_gaussian;
    let others = whole - contexts(b"colo") - contexts(b"harm");
    let zero: f64 = alone.iter().map(|(_, bits)| bits).sum();
    println!("{path}: {} Gaussians", gaussians.len());
    println!("                   frequencies  contexts      RAHT");
    println!("degree 0           {:>11.2} {:>9.2} {:>9.2}", frequencies(b"colo"), contexts(b"colo"), bits[0]);
    println!("further harmonics  {:>11.2} {:>9.2} {:>9.2}", frequencies(b"harm"), contexts(b"harm"), bits[1]);
    println!("all of a Gaussian  {zero:>11.2} {whole:>9.2} {:>9.2}", others + bits[0] + bits[1]);
    println!("dB of pictures     {plain:>11.2} {plain:>9.2} {decibels:>9.2}");
    Ok(())
}

/// Gaussians whose harmonics have been transformed, rounded in steps times a factor, and transformed back; bits of degree 0 and of the others.
fn transformed((before, coded): (&Gaussians, &Gaussians), factor: f64, raht: &Raht) -> ([f64; 2], Gaussians) {
    let (mut bits, mut gaussians) = ([0.0; 2], Gaussians { sh: before.sh.clone(), ..coded.clone() });
    for k in 0..before.coefficients() {
        let step = factor * if k == 0 { QUALITY.dc_step } else { QUALITY.sh_step };
        bits[usize::from(k > 0)] += harmonic(&mut gaussians, k, step, raht);
    }
    (bits, gaussians)
}

/// Morton codes on a grid of 2^16 voxels a side, ascending, and whose they are.
fn morton_order(gaussians: &Gaussians) -> (Vec<u64>, Vec<usize>) {
    let bound =
        |axis: usize, start: f32, of: fn(f32, f32) -> f32| gaussians.means.iter().map(|m| m[axis]).fold(start, of);
    let low = [0, 1, 2].map(|axis| bound(axis, f32::INFINITY, f32::min));
    let extents = [0, 1, 2].map(|axis| bound(axis, f32::NEG_INFINITY, f32::max) - low[axis]);
    let cell = extents.into_iter().fold(f32::MIN_POSITIVE, f32::max) / 65_535.0;
    let voxel = |m: &[f32; 3]| morton3([0, 1, 2].map(|axis| ((m[axis] - low[axis]) / cell).round() as u32));
    let mut order: Vec<(u64, usize)> = gaussians.means.iter().map(voxel).zip(0..).collect();
    order.sort_unstable();
    order.into_iter().unzip()
}

/// Transforms, rounds and transforms back a harmonic of all Gaussians; returns the bits of its coefficients.
fn harmonic(gaussians: &mut Gaussians, k: usize, step: f64, raht: &Raht) -> f64 {
    let (row, quantizer) = (3 * gaussians.coefficients(), Quantizer { step, dead_zone: 0.0 });
    let rgb = |row: &[f32]| [0, 1, 2].map(|c| f64::from(row[3 * k + c]));
    let mixed = |rgb: [f64; 3]| MIXTURES.map(|mixture| (0..3).map(|c| mixture[c] * rgb[c]).sum::<f64>());
    let mut values: Vec<f64> = gaussians.sh.chunks_exact(row).flat_map(|row| mixed(rgb(row))).collect();
    raht.forward(&mut values, 3);
    let symbols: Vec<i32> = values.iter().map(|x| quantizer.symbol(*x)).collect();
    let mut restored: Vec<f64> = symbols.iter().map(|symbol| quantizer.value(*symbol)).collect();
    raht.inverse(&mut restored, 3);
    for (row, mixed) in gaussians.sh.chunks_exact_mut(row).zip(restored.chunks_exact(3)) {
        (0..3).for_each(|c| row[3 * k + c] = (0..3).map(|m| MIXTURES[m][c] * mixed[m]).sum::<f64>() as f32);
    }
    let size = |symbol: i32, most: u32| (u32::BITS - symbol.unsigned_abs().leading_zeros()).min(most) as usize;
    let (mut model, mut length) = (MixedModel::new([3 * 24, 3 * 64, 12 * 12]), CodeLength::default());
    let (mut before, order) = ([0; 3], raht.order());
    for (at, &i) in order.iter().enumerate() {
        // Coefficients come from coarse to fine: their number says how large their cells are.
        let level = size(at as i32, 23);
        for (channel, symbol) in symbols[3 * i..][..3].iter().enumerate() {
            let luma = if channel > 0 { size(symbols[3 * i], 11) } else { 0 };
            let last = size(before[channel], 7) * 8 + size(before[(channel + 1) % 3], 7);
            model.code(&mut length, [3 * level + channel, 3 * last + channel, 12 * luma + level / 2], *symbol);
        }
        before = [0, 1, 2].map(|channel| symbols[3 * i + channel]);
    }
    length.bits
}

/// Decibels of six pictures of an orbit over white, 256 pixels square.
fn psnr(before: &Gaussians, after: &Gaussians) -> Result<f64, Box<dyn Error>> {
    let cameras = orbit(before, 6, [256; 2]).ok_or("expected Gaussians, found none")?;
    let mut renderer = Renderer::default();
    let mut draw = |gaussians: &Gaussians| {
        renderer.render(&gaussians.to_activated(), &cameras, [1.0; 3], &RasterSettings::default())
    };
    let (expected, found) = (draw(before)?, draw(after)?);
    let decibels = expected.iter().zip(&found).map(|(a, b)| {
        let squares = a.iter().zip(b).map(|(a, b)| f64::from(a.clamp(0.0, 1.0) - b.clamp(0.0, 1.0)).powi(2));
        -10.0 * (squares.sum::<f64>() / a.len() as f64).log10()
    });
    Ok(decibels.sum::<f64>() / cameras.len() as f64)
}
