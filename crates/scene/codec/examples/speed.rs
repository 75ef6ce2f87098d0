//! Time to decode and to encode a scene of a million Gaussians: `speed FILE [THREADS]`.
//!
//! A smaller scene is put side by side with copies of itself, whose numbers differ by a thousandth, until there are a million.

use std::error::Error;
use std::time::Instant;
use weaver_codec::lite::{Quality, decode, encode};
use weaver_kernels::random::Stream;
use weaver_scene::Gaussians;

const MILLION: usize = 1_000_000;

/// The copy of a number.
fn copy(tile: &Gaussians, number: usize, width: f32) -> Gaussians {
    let stream = Stream::new(number as u64, 0, "codec.speed");
    let shift = width * number as f32;
    let mut copy = tile.clone();
    copy.means.iter_mut().for_each(|mean| mean[0] += shift);
    let numbers =
        copy.log_scales.as_flattened_mut().iter_mut().chain(&mut copy.sh).chain(copy.quats.as_flattened_mut());
    numbers.zip(0..).for_each(|(x, i)| *x *= 1.0 + 1e-3 * stream.normal::<f32>(i));
    copy
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("expected a file of Gaussians, found no argument")?;
    if let Some(threads) = arguments.next() {
        rayon::ThreadPoolBuilder::new().num_threads(threads.parse()?).build_global()?;
    }
    let tile = weaver_io::read_gaussians(&path)?;
    let x = || tile.means.iter().map(|mean| mean[0]);
    let width = x().fold(f32::MIN, f32::max) - x().fold(f32::MAX, f32::min);
    let copies: Vec<Gaussians> = (0..MILLION.div_ceil(tile.len())).map(|i| copy(&tile, i, width)).collect();
    let all = Gaussians::joined(&copies);
    let gaussians = all.select(&(0..MILLION).collect::<Vec<_>>());
    let started = Instant::now();
    let bytes = encode(&gaussians, &Quality::default())?;
    let encoded = started.elapsed().as_secs_f64();
    let parameters = MILLION as f64 * (11 + 3 * tile.coefficients()) as f64;
    let bits = 8.0 * bytes.len() as f64 / MILLION as f64;
    println!("degree {}: encoded in {encoded:.2} s, {bits:.1} bits a Gaussian", tile.degree);
    let seconds = (0..5).map(|_| {
        let started = Instant::now();
        std::hint::black_box(decode(&bytes).map(|gaussians| gaussians.len())).ok();
        started.elapsed().as_secs_f64()
    });
    let best = seconds.fold(f64::INFINITY, f64::min);
    println!("decoded in {best:.3} s, {:.1} million parameters a second", parameters / best / 1e6);
    Ok(())
}
