//! What the transform RAHT is worth for colors, at equal error: `raht FILE.ply`.
//!
//! Harmonics of degree 0 of Gaussians on a grid of 2^10 voxels a side, rounded with steps of 0.05, as they are, as differences along the Morton order, and as
//! coefficients of the transform. It is orthonormal, so that errors are equal. Bits are those of adaptive models of order 0.

use std::error::Error;
use weaver_codec::{AdaptiveModel, CodeLength, Quantizer, Raht, morton3};
use weaver_scene::Gaussians;

const QUANTIZER: Quantizer = Quantizer { step: 0.05, dead_zone: 0.0 };

/// Bits a number of symbols by their frequencies.
fn bits(symbols: &[i32]) -> f64 {
    let low = symbols.iter().copied().fold(0, i32::min);
    let high = symbols.iter().copied().fold(0, i32::max);
    let (mut length, mut model) = (CodeLength::default(), AdaptiveModel::new((high - low + 1) as usize));
    symbols.iter().for_each(|symbol| _ = model.code(&mut length, (symbol - low) as usize));
    length.bits / symbols.len() as f64
}

/// Morton codes with indices, sorted.
fn order(gaussians: &Gaussians) -> Vec<(u64, usize)> {
    let low = |axis: usize| gaussians.means.iter().map(|m| m[axis]).fold(f32::INFINITY, f32::min);
    let high = |axis: usize| gaussians.means.iter().map(|m| m[axis]).fold(f32::NEG_INFINITY, f32::max);
    let extent = (0..3).map(|axis| high(axis) - low(axis)).fold(f32::MIN_POSITIVE, f32::max);
    let corner = [0, 1, 2].map(low);
    let voxel = |m: &[f32; 3]| morton3([0, 1, 2].map(|axis| ((m[axis] - corner[axis]) / extent * 1023.0) as u32));
    let mut order: Vec<(u64, usize)> = gaussians.means.iter().map(voxel).zip(0..).collect();
    order.sort_unstable();
    order
}

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("expected a file of Gaussians, found no argument")?;
    let gaussians = weaver_io::read_gaussians(&path)?;
    let order = order(&gaussians);
    let codes: Vec<u64> = order.iter().map(|(code, _)| *code).collect();
    let raht = Raht::new(&codes, &vec![1.0; codes.len()])?;
    println!("channel           as is  differences  transformed");
    for (name, [r, g, b]) in
        [("green", [0.0, 1.0, 0.0]), ("red less green", [1.0, -1.0, 0.0]), ("blue less green", [0.0, -1.0, 1.0])]
    {
        let row = |i: usize| gaussians.sh[3 * gaussians.coefficients() * i..][..3].iter().map(|x| f64::from(*x));
        let value = |&(_, i): &(u64, usize)| row(i).zip([r, g, b]).map(|(x, factor)| x * factor).sum::<f64>();
        let mut values: Vec<f64> = order.iter().map(value).collect();
        let quantize = |values: &[f64]| values.iter().map(|x| QUANTIZER.symbol(*x)).collect::<Vec<_>>();
        let plain = quantize(&values);
        let differences: Vec<i32> = plain.windows(2).map(|pair| pair[1] - pair[0]).collect();
        raht.forward(&mut values, 1);
        println!("{name:<16} {:>6.3} {:>12.3} {:>12.3}", bits(&plain), bits(&differences), bits(&quantize(&values)));
    }
    Ok(())
}
