//! Time to encode and to decode a million Gaussians: `speed FILE [THREADS]`.
//!
//! The scene is put side by side with copies of itself, whose numbers differ by a thousandth, until there are a
//! million. Beside seconds on the clock there are seconds of processors (Linux), which other work on the machine
//! changes little.

use std::error::Error;
use std::time::Instant;
use weaver_codec::lite::{Quality, decode, encode};
use weaver_kernels::random::Stream;
use weaver_scene::Gaussians;

const MILLION: usize = 1_000_000;
const ROUNDS: usize = 4;

/// A copy of a scene, beside the others.
fn copy(tile: &Gaussians, number: usize, width: f32) -> Gaussians {
    let stream = Stream::new(number as u64, 0, "codec.speed");
    let mut copy = tile.clone();
    copy.means.iter_mut().for_each(|mean| mean[0] += width * number as f32);
    let shapes = copy.log_scales.as_flattened_mut().iter_mut();
    let numbers = shapes.chain(&mut copy.sh).chain(copy.quats.as_flattened_mut());
    numbers.zip(0..).for_each(|(x, i)| *x *= 1.0 + 1e-3 * stream.normal::<f32>(i));
    copy
}

/// Seconds of processors so far; NaN where the system does not say.
fn processors() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let behind_name = stat.rsplit(')').next().unwrap_or_default();
    let ticks = |field: usize| behind_name.split_whitespace().nth(field).and_then(|ticks| ticks.parse::<f64>().ok());
    ticks(11).zip(ticks(12)).map_or(f64::NAN, |(user, system)| (user + system) / 100.0)
}

/// Runs something, and says how long it took.
fn timed<T>(what: &str, run: impl FnOnce() -> T) -> T {
    let (started, before) = (Instant::now(), processors());
    let result = run();
    println!("{what}: {:.2} s, {:.2} s of processors", started.elapsed().as_secs_f64(), processors() - before);
    result
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
    let gaussians = Gaussians::joined(&copies).select(&(0..MILLION).collect::<Vec<_>>());
    println!("degree {}, {} parameters of a Gaussian", tile.degree, 11 + 3 * tile.coefficients());
    let bytes = timed("encode", || encode(&gaussians, &Quality::default()))?;
    println!("{:.2} bits of a Gaussian", 8.0 * bytes.len() as f64 / MILLION as f64);
    for _ in 0..ROUNDS {
        timed("decode", || decode(&bytes))?;
    }
    Ok(())
}
