//! Plants junk into fitted scenes, cleans them, and prints the share of the junk that was found and of the rest that
//! went: `junk STEPS GAUSSIANS LONG_SIDE PLACE...`, where a place is the folder of a capture, or a number, the seed
//! of a drawn scene.
//!
//! The scene is cleaned first, for what it has of its own is junk, too.

use std::error::Error;
use weaver_data::capture::HoldOut;
use weaver_data::posed::{self, PosedOptions};
use weaver_fit::{CleaningRules, Fit, FitSettings, Judge, Photo, contributions, init, mean_color};
use weaver_geometry::glam::DVec3;
use weaver_kernels::random::Stream;
use weaver_procedural::{ProceduralOptions, scene};
use weaver_scene::{Gaussians, PointCloud};

/// Pieces of each kind.
const PIECES: usize = 100;
/// Views of a drawn scene, every fourth held out.
const DRAWN: usize = 40;
const KINDS: [&str; 3] = ["before cameras", "dust", "halos"];

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let mut number = || arguments.next().and_then(|number| number.parse::<usize>().ok());
    let numbers = (number(), number(), number());
    let (Some(steps), Some(gaussians), Some(side)) = numbers else {
        return Err("expected STEPS GAUSSIANS LONG_SIDE PLACE...".into());
    };
    let rules = CleaningRules { rise: 0.0, ..CleaningRules::ANY_SCENE };
    println!(
        "held out, dB: fitted, cleaned, planted, cleaned again; found of {}; went of the rest, at first",
        KINDS.join(", ")
    );
    for place in arguments {
        let Place { name, fitted, held_out, points } = Place::load(&place, side)?;
        let settings = FitSettings { steps, gaussians, background: mean_color(&fitted), ..FitSettings::default() };
        let mut fit = Fit::new(fitted.clone(), &init::from_points(&points, &settings)?, settings.clone())?;
        while fit.steps_done() < steps {
            fit.step()?;
        }
        let own = fit.gaussians();
        let first = judge(&mut fit, &held_out)?;
        fit.clean(&rules)?;
        let cleaned = judge(&mut fit, &held_out)?;
        let rest = fit.gaussians();
        let planted = planted(&rest, &fitted, &settings)?;
        let settings = FitSettings { gaussians: planted.len(), ..settings };
        let mut again = Fit::new(fitted, &planted, settings)?;
        again.set_raster_settings(fit.raster_settings());
        let dirty = judge(&mut again, &held_out)?;
        again.clean(&rules)?;
        let last = judge(&mut again, &held_out)?;
        let left = again.gaussians();
        let is_left = |mean: &[f32; 3]| left.means.contains(mean);
        let (before, junk) = planted.means.split_at(rest.len());
        let found = junk.chunks(PIECES).map(|kind| kind.iter().filter(|mean| !is_left(mean)).count());
        let found: Vec<String> = found.map(|found| format!("{:3}", 100 * found / PIECES)).collect();
        let kept = before.iter().filter(|mean| is_left(mean)).count();
        println!(
            "{name:<14} {first:7.3} {cleaned:8.3} {dirty:7.3} {last:7.3} | {} % | {:.2} % | {:.1} %",
            found.join(" "),
            100.0 * (1.0 - kept as f64 / rest.len() as f64),
            100.0 * (1.0 - rest.len() as f64 / own.len() as f64)
        );
    }
    Ok(())
}

/// Photos of a place, with and without those that are held out, and points on its surfaces.
struct Place {
    name: String,
    fitted: Vec<Photo>,
    held_out: Vec<Photo>,
    points: PointCloud,
}

impl Place {
    fn load(place: &str, side: usize) -> Result<Self, Box<dyn Error>> {
        let (photos, points): (Vec<(bool, Photo)>, PointCloud) = match place.parse() {
            Ok(seed) => drawn(seed, side),
            Err(_) => {
                let hold_out = HoldOut::Every(8);
                let options = PosedOptions { long_side: Some(side), hold_out, ..PosedOptions::default() };
                let capture = posed::load(place, &options)?;
                (capture.photos.into_iter().map(|p| (p.held_out, p.photo)).collect(), capture.points)
            }
        };
        let of = |which| photos.iter().filter(move |(held_out, _)| *held_out == which).map(|(_, photo)| photo.clone());
        let (fitted, held_out) = (of(false).collect(), of(true).collect());
        let name = place.rsplit('/').next().unwrap_or(place).to_string();
        Ok(Self { name, fitted, held_out, points })
    }
}

fn drawn(seed: u64, side: usize) -> (Vec<(bool, Photo)>, PointCloud) {
    let drawn = scene(seed, &ProceduralOptions { width: side, height: side * 3 / 4, views: DRAWN });
    let photos = drawn.views.iter().map(|view| {
        let bytes = view.image.pixels.iter().map(|x| (255.0 * x).round().clamp(0.0, 255.0) as u8);
        let (name, rgb) = (view.name.clone(), bytes.collect::<Vec<u8>>().into());
        (view.held_out, Photo { name, camera: view.camera, rgb, mask: None, lens: None })
    });
    let positions: Vec<[f32; 3]> = drawn.points.iter().map(|point| point.as_vec3().to_array()).collect();
    let colors = vec![[128; 3]; positions.len()];
    (photos.collect(), PointCloud { positions, colors })
}

/// A scene with junk after it: [`PIECES`] of each of [`KINDS`].
fn planted(scene: &Gaussians, photos: &[Photo], settings: &FitSettings) -> Result<Gaussians, Box<dyn Error>> {
    let stream = Stream::new(settings.seed, 0, "example.planted");
    let mut draws = 0;
    let mut between = |from: f64, to: f64| {
        draws += 1;
        from + (to - from) * stream.uniform::<f64>(draws)
    };
    let raster = weaver_splat::RasterSettings::default();
    let mut junk = scene.clone();
    let middle = scene.means.iter().map(|mean| DVec3::from(mean.map(f64::from))).sum::<DVec3>() / scene.len() as f64;
    let mut far: Vec<f64> = scene.means.iter().map(|mean| middle.distance(mean.map(f64::from).into())).collect();
    far.sort_unstable_by(f64::total_cmp);
    let far = far[far.len() * 95 / 100];
    for kind in 0..KINDS.len() {
        for piece in 0..PIECES {
            let camera = photos[piece * photos.len() / PIECES].camera;
            let shown = contributions(scene, std::iter::once(camera), settings.background, &raster)?;
            let shown: Vec<usize> = (0..scene.len()).filter(|n| shown[*n] > 1.0).collect();
            let seen = shown[(between(0.0, 1.0) * shown.len() as f64) as usize];
            let [from, to] = [camera.pose.center(), scene.means[seen].map(f64::from).into()];
            let depth = from.distance(to);
            let pixel = depth / camera.intrinsics.fx;
            // Part of the way to a surface, size, and opacity.
            let (mean, scale, opacity) = match kind {
                0 => {
                    let part = between(0.1, 0.3);
                    (from.lerp(to, part), part * depth * between(0.02, 0.08), between(0.3, 0.9))
                }
                1 => (from.lerp(to, between(0.3, 0.7)), pixel * between(1.0, 3.0), between(0.3, 0.9)),
                _ => {
                    let away = DVec3::from([0, 1, 2].map(|_| between(-1.0, 1.0))).normalize();
                    (middle + away * far * between(1.0, 1.5), far * between(0.05, 0.2), between(0.1, 0.5))
                }
            };
            junk.means.push(mean.as_vec3().to_array());
            junk.log_scales.push([0, 1, 2].map(|_| (scale * between(0.7, 1.4)).ln() as f32));
            junk.quats.push([1.0, 0.0, 0.0, 0.0]);
            junk.opacity_logits.push((opacity / (1.0 - opacity)).ln() as f32);
            let color = [0, 1, 2].map(|_| between(-1.7, 1.7) as f32);
            let coefficients = scene.sh.len() / scene.len();
            junk.sh.extend(color.into_iter().chain(std::iter::repeat_n(0.0, coefficients - 3)));
        }
    }
    Ok(junk)
}

/// Mean PSNR of photos.
fn judge(fit: &mut Fit, photos: &[Photo]) -> Result<f64, Box<dyn Error>> {
    let mut sum = 0.0;
    for photo in photos {
        sum += Judge::psnr(&fit.render(&photo.camera)?, &photo.rgb, photo.mask.as_deref());
    }
    Ok(sum / photos.len() as f64)
}
