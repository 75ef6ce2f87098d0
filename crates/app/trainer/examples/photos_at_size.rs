//! Four photos of captures at 256 x 192: the nearest photo copied, the photo network before and after training, and a
//! fit that begins on the surface that photos agree about, after 1, 100 and 200 steps.
//!
//! `cargo run --release -p weaver-trainer --example photos_at_size -- [checkpoint.safetensors ...] CAPTURE ...`
//!
//! `SIZE=WxH` and `BUDGET=B` in the environment change the size and the Gaussians per kept pixel, `FITS=0` leaves out
//! the fits. Each line: PSNR in dB, SSIM, seconds and Gaussians, means over the held-out views of a capture; seconds
//! leave out cameras.

use std::path::{Path, PathBuf};
use std::time::Instant;
use weaver_data::capture::{self, CaptureOptions};
use weaver_data::{SparsePoints, evaluation_tuples};
use weaver_fit::{Fit, FitSettings, init};
use weaver_geometry::Camera;
use weaver_inference::{CameraSource, Checkpoint, Density, Photos, Predictor, Resizable, planar};
use weaver_io::Image;
use weaver_kernels::random::Stream;
use weaver_losses::metrics;
use weaver_photo::{PhotoConfig, PhotoPredictor};
use weaver_router::AllocationKind;
use weaver_scene::{Gaussians, Photo, PointCloud};
use weaver_stereo::{Stereo, StereoSettings};
use weaver_trainer::Example;

type Failure = Box<dyn std::error::Error>;

/// Held-out views of a capture that are judged at most.
const VIEWS: usize = 3;
/// Steps after which a fit is judged.
const STEPS: [usize; 3] = [1, 100, 200];

/// A row of figures: its name, and PSNR, SSIM, seconds, Gaussians and number of views, summed.
struct Row {
    name: String,
    sums: [f64; 5],
}

#[derive(Default)]
struct Table(Vec<Row>);

impl Table {
    fn add(&mut self, name: &str, image: &Image, truth: &Image, seconds: f64, gaussians: usize) {
        let [shown, photo] = [image, truth].map(|image| planar([image]));
        let ssim = metrics::ssim(&shown, &photo, [3, truth.height, truth.width]);
        let numbers = [metrics::psnr(&shown, &photo), ssim, seconds, gaussians as f64, 1.0];
        let at = self.0.iter().position(|row| row.name == name).unwrap_or_else(|| {
            self.0.push(Row { name: name.into(), sums: [0.0; 5] });
            self.0.len() - 1
        });
        self.0[at].sums.iter_mut().zip(numbers).for_each(|(sum, x)| *sum += x);
    }

    fn join(&mut self, other: &Self) {
        for Row { name, sums } in &other.0 {
            let mean = sums.map(|sum| sum / sums[4]);
            match self.0.iter_mut().find(|row| row.name == *name) {
                Some(row) => row.sums.iter_mut().zip(mean).for_each(|(sum, x)| *sum += x),
                None => self.0.push(Row { name: name.clone(), sums: mean }),
            }
        }
    }

    fn print(&self, title: &str) {
        println!("{title}");
        for Row { name, sums } in &self.0 {
            let [psnr, ssim, seconds, gaussians, _] = sums.map(|sum| sum / sums[4]);
            println!("  {name:<44} {psnr:6.2} dB  {ssim:.3}  {seconds:6.2} s  {gaussians:8.0} Gaussians");
        }
    }
}

fn main() -> Result<(), Failure> {
    let setting = |name: &str, usual: &str| std::env::var(name).unwrap_or_else(|_| usual.into());
    let size = setting("SIZE", "256x192");
    let (width, height) = size.split_once('x').ok_or("SIZE: expected WxH")?;
    let size = [height.parse()?, width.parse()?];
    let budget: f64 = setting("BUDGET", "0.5").parse()?;
    let (files, folders): (Vec<PathBuf>, Vec<PathBuf>) =
        std::env::args().skip(1).map(PathBuf::from).partition(|path| path.is_file());
    let config = PhotoConfig::preset("photo-192").ok_or("no such preset")?;
    let untrained = PhotoPredictor::untrained(config, AllocationKind::Quadtree, budget);
    let mut networks = vec![("photos on compared depth".to_string(), untrained)];
    for file in &files {
        let checkpoint = Checkpoint::read(file)?;
        let network = PhotoPredictor::from_checkpoint(&checkpoint)?;
        networks.push((format!("network after {} steps", checkpoint.step), network));
    }
    networks.iter_mut().for_each(|(_, network)| network.resize(size));
    let mut all = Table::default();
    for folder in &folders {
        let of_capture = judged(folder, size, budget, &mut networks)?;
        of_capture.print(&folder.file_name().unwrap_or_default().to_string_lossy());
        all.join(&of_capture);
    }
    all.print("mean of the captures");
    Ok(())
}

fn judged(
    folder: &Path,
    [height, width]: [usize; 2],
    budget: f64,
    networks: &mut [(String, PhotoPredictor)],
) -> Result<Table, Failure> {
    let scene = capture::load(folder, &CaptureOptions { width, height, ..CaptureOptions::default() })?;
    let mut table = Table::default();
    let mut tuples = evaluation_tuples(&scene, 0, 4);
    let every = tuples.len().div_ceil(VIEWS).max(1);
    tuples = tuples.into_iter().step_by(every).collect();
    for tuple in tuples {
        let target = &scene.views[tuple.targets[0]].image;
        let nearest = &scene.views[tuple.context[0]].image;
        table.add("nearest photo, copied", nearest, target, 0.0, 0);
        let (example, _) = Example::for_evaluation(&scene, tuple)?;
        let Some(points) = example.points(&scene) else { return Err("no points".into()) };
        let source = CameraSource::GivenWithPoints { cameras: example.context(), points: &points };
        let camera = example.targets()[0];
        let density = Density { budget: Some(budget), ..Density::default() };
        for (name, network) in networks.iter_mut() {
            let start = Instant::now();
            let stream = Stream::new(0, 0, "study");
            let made = network.predict(example.context_photos(), source, density, stream)?;
            let seconds = start.elapsed().as_secs_f64();
            let image = network.render(&made, &[camera])?.remove(0);
            table.add(name, &image, target, seconds, made.gaussians.opacities.len());
        }
        if std::env::var("FITS").is_ok_and(|fits| fits == "0") {
            continue;
        }
        for (name, image, seconds, gaussians) in fitted(&example, &points, camera, budget)? {
            table.add(&name, &image, target, seconds, gaussians);
        }
    }
    Ok(table)
}

/// Pictures of fits that begin on surfaces, after each number of steps, with the time until then.
fn fitted(
    example: &Example,
    points: &SparsePoints,
    target: Camera,
    budget: f64,
) -> Result<Vec<(String, Image, f64, usize)>, Failure> {
    let photos = photos(example.context_photos(), example.context());
    let count = (budget * example.depth.len() as f64) as usize;
    // Colors of points are not kept by a scene: those of the first photo that sees them.
    let mut colors = vec![[128; 3]; points.positions.len()];
    for (photo, visible) in photos.iter().zip(&points.visible) {
        for &point in visible {
            let local = photo.camera.pose.apply(points.positions[point as usize]);
            let pixel = photo.camera.intrinsics.project(local);
            let at =
                (pixel.y as usize).min(target.height - 1) * target.width + (pixel.x as usize).min(target.width - 1);
            colors[point as usize].copy_from_slice(&photo.rgb[3 * at..3 * at + 3]);
        }
    }
    let cloud = PointCloud { positions: points.positions.iter().map(|p| p.as_vec3().to_array()).collect(), colors };
    let mut found = Vec::new();
    for steps in STEPS {
        let start = Instant::now();
        let settings = FitSettings { steps, gaussians: count, ..FitSettings::default() };
        let stereo = Stereo::of(&photos, &cloud, &points.visible, &StereoSettings::default());
        let sparse = init::from_points(&stereo.unexplained(), &settings).unwrap_or_default();
        let dense = stereo.surface().gaussians(init::room(&settings).saturating_sub(sparse.len()));
        let initial = init::from_gaussians(&Gaussians::joined(&[dense, sparse]), &settings)?;
        let mut fit = Fit::new(photos.clone(), &initial, settings)?;
        while fit.steps_done() < steps {
            fit.step()?;
        }
        let seconds = start.elapsed().as_secs_f64();
        let mut pixels = fit.render(&target)?;
        pixels.iter_mut().for_each(|x| *x = x.clamp(0.0, 1.0));
        let image = Image { width: target.width, height: target.height, pixels };
        found.push((format!("fit --init dense, {steps} steps"), image, seconds, fit.gaussians().means.len()));
    }
    Ok(found)
}

fn photos(photos: Photos<'_>, cameras: &[Camera]) -> Vec<Photo> {
    let pixels = photos.height * photos.width;
    let rgb = |planes: &[f32]| -> Vec<u8> {
        (0..3 * pixels).map(|i| (planes[i % 3 * pixels + i / 3] * 255.0).round() as u8).collect()
    };
    let all = photos.planes.chunks_exact(3 * pixels).zip(cameras).enumerate();
    all.map(|(i, (planes, camera))| Photo {
        name: i.to_string(),
        camera: *camera,
        rgb: rgb(planes).into(),
        mask: None,
        lens: None,
    })
    .collect()
}
