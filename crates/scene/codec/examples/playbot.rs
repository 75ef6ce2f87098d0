//! Bits a Gaussian, and quality of pictures, of a scene at the four settings: `playbot FILE.ply`.
//!
//! Pictures are six views of an orbit, 256 pixels square, over white, compared with the scene as read. `without
//! contexts` is the code length of the same symbols by adaptive models of order 0, `equal steps` is the setting without
//! adaptation.

use std::error::Error;
use std::time::Instant;
use weaver_codec::Container;
use weaver_codec::lite::{Quality, decode, encode, order_zero_bits};
use weaver_geometry::Camera;
use weaver_scene::{Gaussians, orbit};
use weaver_splat::{RasterSettings, Workspace, render};

const SIDE: usize = 256;
const VIEWS: usize = 6;

fn draw(gaussians: &Gaussians, cameras: &[Camera]) -> Result<Vec<Vec<f32>>, Box<dyn Error>> {
    let mut views =
        render(&gaussians.to_activated(), cameras, [1.0; 3], &RasterSettings::default(), &mut Workspace::new())?;
    views.iter_mut().flatten().for_each(|x| *x = x.clamp(0.0, 1.0));
    Ok(views)
}

/// Mean over views of `20 log10(1 / √MSE)`.
fn psnr(a: &[Vec<f32>], b: &[Vec<f32>]) -> f64 {
    let of = |(a, b): (&Vec<f32>, &Vec<f32>)| {
        let squares: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
        -10.0 * (squares / a.len() as f64).log10()
    };
    a.iter().zip(b).map(of).sum::<f64>() / a.len() as f64
}

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("expected a file of Gaussians, found no argument")?;
    let gaussians = weaver_io::read_gaussians(&path)?;
    let cameras = orbit(&gaussians, VIEWS, [SIDE; 2]).ok_or("expected Gaussians, found none")?;
    let expected = draw(&gaussians, &cameras)?;
    let bits = |bytes: usize| 8.0 * bytes as f64 / gaussians.len() as f64;
    println!("{} Gaussians of degree {}", gaussians.len(), gaussians.degree);
    println!("setting     bytes  bits a Gaussian  PSNR dB  without contexts  encode ms  decode ms");
    let equal = Quality::SETTINGS.map(|q| Quality { adaptation: 0.0, rotation_adaptation: 0.0, ..q });
    let rows = Quality::SETTINGS.iter().zip(["0", "1", "2", "3"]);
    for (quality, name) in rows.chain(equal.iter().zip(["0, equal", "1, equal", "2, equal", "3, equal"])) {
        let started = Instant::now();
        let bytes = encode(&gaussians, quality)?;
        let (encoding, started) = (started.elapsed().as_secs_f64() * 1e3, Instant::now());
        let decoded = decode(&bytes)?;
        let decoding = started.elapsed().as_secs_f64() * 1e3;
        let psnr = psnr(&expected, &draw(&decoded, &cameras)?);
        let control = order_zero_bits(&gaussians, quality)?;
        let order_zero: f64 = control.iter().map(|(_, bits)| bits).sum::<f64>() / gaussians.len() as f64;
        let (count, own) = (bytes.len(), bits(bytes.len()));
        println!("{name:<8} {count:>8} {own:>16.2} {psnr:>8.2} {order_zero:>17.2} {encoding:>10.0} {decoding:>10.0}");
        let mut lengths = [0; 6];
        for stream in Container::read(&bytes)?.streams {
            let at = control.iter().position(|(name, _)| *name == stream.name);
            lengths[at.unwrap_or(0)] += stream.bytes.len();
        }
        for ((name, order_zero), bytes) in control.iter().zip(lengths) {
            let order_zero = order_zero / gaussians.len() as f64;
            println!("  {} {:>22.2} {:>26.2}", name.escape_ascii(), bits(bytes), order_zero);
        }
    }
    Ok(())
}
