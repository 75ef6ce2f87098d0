//! Bits a Gaussian, and quality of pictures, of a scene at the four settings: `playbot FILE.ply`.

use std::error::Error;
use std::f64::consts::FRAC_PI_3;
use std::time::Instant;
use weaver_codec::Container;
use weaver_codec::lite::{Quality, decode, encode};
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
    println!("setting  bytes  bits a Gaussian  PSNR  encode, decode ms  bits of each stream");
    for (row, quality) in Quality::SETTINGS.iter().enumerate() {
        let started = Instant::now();
        let bytes = encode(&gaussians, quality)?;
        let (encoded, started) = (started.elapsed(), Instant::now());
        let decoded = decode(&bytes)?;
        let took = started.elapsed();
        let bits = |bytes: usize| 8.0 * bytes as f64 / gaussians.len() as f64;
        let quality = psnr(&expected, &draw(&decoded, &cameras)?);
        print!(
            "{row}  {}  {:.2}  {quality:.2}  {:.0} {:.0} ",
            bytes.len(),
            bits(bytes.len()),
            encoded.as_secs_f64() * 1e3,
            took.as_secs_f64() * 1e3
        );
        for stream in Container::read(&bytes)?.streams {
            print!("  {} {:.2}", stream.name.escape_ascii(), bits(stream.bytes.len()));
        }
        println!();
    }
    Ok(())
}
