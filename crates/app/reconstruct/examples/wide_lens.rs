//! Fits a drawn room to photos of a fisheye, through the lens and with its distortion undone, and compares both on
//! held-out photos: on the pixels that both see, and on the rest.
//!
//! `wide_lens FOLDER [DEGREES] [STEPS] [SIDE]`; the folder gets the photos, as a capture.

use rayon::prelude::*;
use std::error::Error;
use std::path::PathBuf;
use weaver_data::posed::{self, Lenses, PosedOptions};
use weaver_fit::{Fit, FitSettings, Judge, init};
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_geometry::lens::{self, Lens, LensCamera};
use weaver_geometry::trajectory::look_at;
use weaver_geometry::{Camera, Distortion, Undistortion};
use weaver_io::{Bitmap, Transforms};
use weaver_kernels::random::Stream;
use weaver_scene::{Frame, Model, Photo, PointCloud};

const VIEWS: usize = 32;
/// Every so many photos are held out.
const HELD_OUT: usize = 8;
/// Rays of a pixel, a side.
const SAMPLES: usize = 4;
/// Half of the sides of the room.
const ROOM: DVec3 = DVec3::new(3.0, 2.0, 3.0);
const BALLS: [(DVec3, f64); 4] = [
    (DVec3::new(-1.2, 1.2, 0.8), 0.8),
    (DVec3::new(1.5, 0.9, -1.0), 0.7),
    (DVec3::new(0.4, -1.2, 1.9), 0.5),
    (DVec3::new(-1.9, -0.6, -1.8), 0.6),
];

/// The point that a ray of length 1 from within the room meets.
fn hit(origin: DVec3, ray: DVec3) -> DVec3 {
    let wall = (0..3).map(|i| (ROOM[i] * ray[i].signum() - origin[i]) / ray[i]).fold(f64::INFINITY, f64::min);
    let ball = BALLS.iter().filter_map(|(center, radius)| {
        let (way, along) = (origin - *center, (origin - *center).dot(ray));
        let inside = along * along - way.length_squared() + radius * radius;
        (inside > 0.0 && -along - inside.sqrt() > 1e-6).then(|| -along - inside.sqrt())
    });
    origin + ray * ball.fold(wall, f64::min)
}

/// Patches of several sizes.
fn color(p: DVec3) -> DVec3 {
    let mut sum = DVec3::splat(0.5);
    for (octave, size) in [0.9, 0.31, 0.12].into_iter().enumerate() {
        let turned = DVec3::new(p.x + 0.37 * p.y, p.y - 0.29 * p.z, p.z + 0.23 * p.x) / size;
        let cell = turned.floor();
        let number = (cell.x as i64 * 73_856_093) ^ (cell.y as i64 * 19_349_663) ^ (cell.z as i64 * 83_492_791);
        let stream = Stream::new(octave as u64, number as u64, "wide_lens.color");
        let own = DVec3::new(stream.uniform(0), stream.uniform(1), stream.uniform(2)) - 0.5;
        sum += own * [0.5, 0.35, 0.25][octave];
    }
    sum.clamp(DVec3::ZERO, DVec3::ONE)
}

fn photograph(camera: &LensCamera) -> Bitmap {
    let Camera { pose, width, height, .. } = camera.camera;
    let (center, to_world) = (pose.center(), pose.rotation.transpose());
    let pixel = |at: usize| {
        let mut sum = DVec3::ZERO;
        for sample in 0..SAMPLES * SAMPLES {
            let part = DVec2::new((sample % SAMPLES) as f64 + 0.5, (sample / SAMPLES) as f64 + 0.5) / SAMPLES as f64;
            let at = DVec2::new((at % width) as f64, (at / width) as f64) + part;
            sum += camera.point(at, 1.0).map_or(DVec3::ZERO, |ray| color(hit(center, to_world * ray)));
        }
        (255.0 * sum / (SAMPLES * SAMPLES) as f64).to_array().map(|x| x.round() as u8)
    };
    let pixels = (0..width * height).into_par_iter().flat_map_iter(pixel).collect();
    Bitmap { width, height, pixels }
}

/// Writes the photos of the room, and returns points on its surfaces.
fn draw(folder: &std::path::Path, degrees: f64, side: usize) -> Result<PointCloud, Box<dyn Error>> {
    std::fs::create_dir_all(folder.join("images"))?;
    let stream = Stream::new(5, 0, "wide_lens");
    let intrinsics = lens::fisheye(degrees.to_radians(), side, side);
    let (mut frames, mut points) = (Vec::new(), PointCloud::default());
    for view in 0..VIEWS {
        let random = |i: u64| 2.0 * stream.uniform::<f64>(16 * view as u64 + i) - 1.0;
        let eye = DVec3::new(1.1 * random(0), 0.5 * random(1), 1.1 * random(2));
        let angle = std::f64::consts::TAU * view as f64 / VIEWS as f64 * 5.0;
        let target = eye + DVec3::new(angle.cos(), 0.4 * random(3), angle.sin());
        let camera = Camera { pose: look_at(eye, target, DVec3::Y), intrinsics, width: side, height: side };
        let name = format!("images/{view:02}.png");
        photograph(&LensCamera::new(camera, Some(Lens::EQUIDISTANT))).write_png(folder.join(&name))?;
        for i in 0..150 {
            let random = |k: u64| stream.normal::<f64>(100_000 + 1000 * view as u64 + 4 * i + k);
            let point = hit(eye, DVec3::new(random(0), random(1), random(2)).normalize());
            points.positions.push(point.as_vec3().to_array());
            points.colors.push((255.0 * color(point)).to_array().map(|x| x as u8));
        }
        let distortion = Some(Distortion::Fisheye { k: [0.0; 4] });
        frames.push(Frame { path: PathBuf::from(&name), distortion, ..Frame::new(name, camera) });
    }
    let held_out = (0..VIEWS).step_by(HELD_OUT).map(|view| frames[view].name.clone()).collect();
    Transforms { frames, test_filenames: Some(held_out), ..Transforms::default() }
        .write(folder.join("transforms.json"))?;
    Ok(points)
}

fn fitted(
    folder: &std::path::Path,
    lenses: Lenses,
    points: &PointCloud,
    steps: usize,
) -> Result<(Fit, Vec<Photo>), Box<dyn Error>> {
    let capture = posed::load(folder, &PosedOptions { lenses, ..PosedOptions::default() })?;
    let (test, training): (Vec<_>, Vec<_>) = capture.photos.into_iter().partition(|photo| photo.held_out);
    let [test, training] = [test, training].map(|all| all.into_iter().map(|p| p.photo).collect::<Vec<_>>());
    let settings = FitSettings { steps, gaussians: 20_000, ..FitSettings::default() };
    let mut fit = Fit::new(training, &init::from_points(points, &settings)?, settings)?;
    while fit.steps_done() < fit.settings().steps {
        fit.step()?;
    }
    Ok((fit, test))
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().ok_or("expected a folder for the photos")?);
    let degrees = arguments.next().map_or(Ok(180.0), |a| a.parse::<f64>())?;
    let steps = arguments.next().map_or(Ok(1500), |a| a.parse())?;
    let side = arguments.next().map_or(Ok(256), |a| a.parse())?;
    let points = draw(&folder, degrees, side)?;
    let (mut through, test) = fitted(&folder, Lenses::Keep, &points, steps)?;
    let (mut undone, straight) = fitted(&folder, Lenses::Undistort, &points, steps)?;

    // Both scenes are drawn through the lens and by the pinhole, and judged where both photos see.
    let mut sums = [0.0; 5];
    for (photo, straight) in test.iter().zip(&straight) {
        let undistortion = Undistortion::new(photo.camera, Distortion::Fisheye { k: [0.0; 4] }).ok_or("a lens")?;
        let (camera, pinhole) = (photo.lens_camera(), LensCamera::new(straight.camera, None));
        let inside = |at: DVec2| at.cmpge(DVec2::ZERO).all() && at.cmplt(DVec2::new(side as f64, side as f64)).all();
        let center = |at: usize| DVec2::new((at % side) as f64 + 0.5, (at / side) as f64 + 0.5);
        let ray = |at: usize| camera.point(center(at), 1.0);
        let both = |at: usize| ray(at).is_some_and(|ray| pinhole.see(ray).is_some_and(|(at, _)| inside(at)));
        let circle = |at: usize| ray(at).is_some_and(|ray| ray.z.acos() <= 0.5 * degrees.to_radians());
        let pixels = side * side;
        let common: Vec<bool> = (0..pixels).map(both).collect();
        let edge: Vec<bool> = (0..pixels).map(|at| circle(at) && !common[at]).collect();
        let lens = Model::Lens(Lens::EQUIDISTANT);
        let through_lens = through.render_through(lens, &photo.camera)?;
        let undone_through_lens = undone.render_through(lens, &photo.camera)?;
        let psnr = |image: &[f32], mask: &[bool]| Judge::psnr(image, &photo.rgb, Some(mask));
        sums[0] += psnr(&through_lens, &common);
        sums[1] += psnr(&undone_through_lens, &common);
        sums[2] += psnr(&through_lens, &edge);
        sums[3] += psnr(&undone_through_lens, &edge);
        // The pinhole's picture, looked up at the places of the lens's pixels.
        let plane = undone.render(&straight.camera)?;
        let mut bent = vec![0.0; 3 * pixels];
        for at in (0..pixels).filter(|at| common[*at]) {
            let Some(place) = undistortion.undistorted(center(at)) else { continue };
            let (x, y) = (place.x - 0.5, place.y - 0.5);
            let clamp = |v: f64| v.clamp(0.0, (side - 1) as f64) as usize;
            let (s, t) = ((x - x.floor()) as f32, (y - y.floor()) as f32);
            for c in 0..3 {
                let value = |dx: f64, dy: f64| plane[3 * (clamp(y.floor() + dy) * side + clamp(x.floor() + dx)) + c];
                let (top, bottom) = (
                    (1.0 - s) * value(0.0, 0.0) + s * value(1.0, 0.0),
                    (1.0 - s) * value(0.0, 1.0) + s * value(1.0, 1.0),
                );
                bent[3 * at + c] = (1.0 - t) * top + t * bottom;
            }
        }
        sums[4] += psnr(&bent, &common);
    }
    let [a, b, c, d, e] = sums.map(|sum| sum / test.len() as f64);
    println!(
        "{degrees} degrees, {steps} steps, held-out dB where both see: through the lens {a:.2}, undistorted {b:.2} \
        drawn through the lens, {e:.2} as a pinhole's picture; at the edge beyond: {c:.2}, undistorted {d:.2}"
    );
    Ok(())
}
