//! Bits a Gaussian, and quality of pictures, of a scene at the four settings: `playbot FILE.ply`.
//!
//! Pictures are six views of an orbit, 256 pixels square, over white, against those of the scene as it was read. `without contexts` is the
//! code length of the same symbols by adaptive models of order 0, `equal steps` is the setting without adaptation.

use std::error::Error;
use std::f64::consts::FRAC_PI_3;
use std::time::Instant;
use weaver_codec::Container;
use weaver_codec::lite::{Quality, decode, encode, order_zero_bits};
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Intrinsics, trajectory};
use weaver_scene::Gaussians;
use weaver_splat::{RasterSettings, Workspace, render};

const SIDE: usize = 256;
const VIEWS: usize = 6;

fn quantile(q: f64, mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[(q * values.len() as f64) as usize]
}

/// Cameras on a circle about the middle of a scene, -y up, with a field of view of 60 degrees.
fn orbit(gaussians: &Gaussians) -> Vec<Camera> {
    let means: Vec<DVec3> = gaussians.means.iter().map(|m| DVec3::from(m.map(f64::from))).collect();
    let axis = |of: fn(&DVec3) -> f64| {
        let at = |q| quantile(q, means.iter().map(of).collect());
        (at(0.1) + at(0.9)) / 2.0
    };
    let middle = DVec3::new(axis(|m| m.x), axis(|m| m.y), axis(|m| m.z));
    let spread = quantile(0.8, means.iter().map(|m| m.distance(middle)).collect());
    let scale = quantile(0.5, gaussians.log_scales.as_flattened().iter().map(|s| f64::from(*s).exp()).collect());
    let half = SIDE as f64 / 2.0;
    let focal = half / (FRAC_PI_3 / 2.0).tan();
    let intrinsics = Intrinsics { fx: focal, fy: focal, cx: half, cy: half };
    let eye = middle - DVec3::Z * (2.0 * spread + 4.0 * scale);
    let poses = trajectory::orbit(eye, middle, -DVec3::Y, VIEWS);
    poses.into_iter().map(|pose| Camera { pose, intrinsics, width: SIDE, height: SIDE }).collect()
}

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
    let cameras = orbit(&gaussians);
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
