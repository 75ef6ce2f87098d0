//! `splatweaver bench compress`: methods of compression on the same pictures.

mod peers;
mod table;

use crate::arguments::BenchCompress;
use serde_json::json;
use std::path::Path;
use std::time::Instant;
use table::{Coded, Row, page, table};
use weaver_command::camera_files::{self, Size};
use weaver_command::{Console, DrawingOptions, Failure, Progress};
use weaver_compress::{CompressError, Judge, METHODS, Pictures, Point, Surface, Task, formats};
use weaver_data::posed::{self, PosedOptions};
use weaver_geometry::Camera;
use weaver_io::{SceneFile, check_output_file, read_scene};
use weaver_scene::{Gaussians, Photo};
use weaver_splat::RasterSettings;

/// Pictures of an orbit that judge, those that methods learn from beside each, and their side.
const ORBIT: (usize, usize, usize) = (6, 3, 256);
/// One camera of so many judges.
const JUDGES: usize = 8;
/// Longest side of pictures from cameras of a file, and of photos.
const LONG_SIDE: usize = 384;

/// Views of a scene: those that methods learn from, and those that judge.
#[derive(Default)]
struct Views {
    training: Vec<Camera>,
    judging: Vec<Camera>,
    /// Photos of the training cameras, and of the judging ones; none without a capture.
    photos: [Vec<Photo>; 2],
}

/// Compares methods on scenes, and prints a table or JSON.
pub fn run(arguments: &BenchCompress, console: &mut Console) -> Result<(), Failure> {
    let points = points(&arguments.methods)?;
    let inputs = || arguments.scenes.iter().chain(&arguments.peer);
    arguments.html.as_ref().map_or(Ok(()), |page| check_output_file(page, inputs()))?;
    let peers = peers::read(&arguments.peer, &arguments.scenes)?;
    let mut rows = Vec::new();
    let (mut done, all) = (0, arguments.scenes.len() * points.len() + peers.len());
    let mut progress = Progress::new("bench", 0, all, console);
    for path in &arguments.scenes {
        let SceneFile { gaussians, drawing } = read_scene(path)?;
        let drawing = DrawingOptions::default().beside(path, drawing)?;
        let views = views(arguments, &gaussians)?;
        let named = |error: CompressError| Failure::message(format!("{}: {error}", path.display()));
        let mut bench = Bench::new((path, &gaussians), &views, drawing, arguments.chamfer).map_err(named)?;
        for (name, point) in &points {
            let pictures = pictures(&views.training, drawing);
            let (steps, seed, photos) = (arguments.steps, arguments.seed, &views.photos[0]);
            let task = Task { gaussians: &gaussians, pictures, photos, steps, seed };
            let row = bench.measured(name, point, &task);
            rows.push(row.map_err(|error| Failure::message(format!("{}: {name}: {error}", path.display())))?);
            done += 1;
            progress.at(done, all, || format!("{name} {}", point.setting), console);
        }
        for peer in &peers {
            rows.push(bench.judged(peer.result(), &peer.gaussians).map_err(named)?);
            done += 1;
            progress.at(done, all, || peer.name.clone(), console);
        }
    }
    progress.finish();
    if let Some(file) = &arguments.html {
        page(&rows).write(file)?;
        console.note(&format!("page: {}", file.display()));
    }
    if arguments.json {
        let row = |r: &Row| {
            let Coded { method, setting, bytes, seconds: [encode, decode] } = &r.coded;
            json!({"scene": r.scene, "method": method, "setting": setting, "gaussians": r.gaussians, "bytes": bytes,
                "bits_per_gaussian": r.bits, "psnr": r.psnr, "psnr_of_photos": r.photos, "chamfer": r.chamfer,
                "encode_seconds": encode, "decode_seconds": decode, "seed": arguments.seed, "steps": arguments.steps})
        };
        return console.print(&serde_json::to_string_pretty(&rows.iter().map(row).collect::<Vec<_>>())?);
    }
    console.print(&table(&rows))
}

/// The methods asked for, or all, with their constants.
fn points(asked: &[String]) -> Result<Vec<(&'static str, Point)>, Failure> {
    let families = METHODS.iter().flat_map(|family| (family.points)().into_iter().map(|point| (family.name, point)));
    let mut all: Vec<(&str, Point)> = formats().into_iter().chain(families).collect();
    if let Some(wrong) = asked.iter().find(|name| !all.iter().any(|(known, _)| *known == name.as_str())) {
        let mut names: Vec<&str> = all.iter().map(|(name, _)| *name).collect();
        names.dedup();
        return Err(Failure::Usage(format!("--methods: expected some of {}, found {wrong}", names.join(", "))));
    }
    let place = |name: &str| asked.iter().position(|other| other == name);
    if !asked.is_empty() {
        all.retain(|(name, _)| place(name).is_some());
        all.sort_by_key(|(name, _)| place(name));
    }
    Ok(all)
}

/// Color behind a scene, and settings of drawing it.
type Drawing = ([f32; 3], RasterSettings);

fn pictures(cameras: &[Camera], (background, settings): Drawing) -> Pictures<'_> {
    Pictures { cameras, background, settings }
}

/// The views of the capture, of the file of cameras, or of an orbit.
fn views(arguments: &BenchCompress, gaussians: &Gaussians) -> Result<Views, Failure> {
    let mut views = Views::default();
    if let Some(data) = &arguments.data {
        let options = PosedOptions { long_side: Some(LONG_SIDE), background: [1.0; 3], ..PosedOptions::default() };
        for posed in posed::load(data, &options)?.photos.into_iter().filter(|posed| !posed.photo.is_masked()) {
            views.photos[usize::from(posed.held_out)].push(posed.photo);
        }
        if views.photos[1].is_empty() {
            let found = "none held out";
            return Err(Failure::message(format!(
                "{}: expected photos that are held out, found {found}",
                data.display()
            )));
        }
        let cameras = |photos: &[Photo]| photos.iter().map(|photo| photo.camera).collect();
        (views.training, views.judging) = (cameras(&views.photos[0]), cameras(&views.photos[1]));
        return Ok(views);
    }
    let (every, all) = match &arguments.cameras {
        Some(file) => {
            let frames = camera_files::read(file, Size::default())?;
            (JUDGES, frames.iter().map(|frame| frame.camera.shrunk(LONG_SIDE)).collect::<Vec<_>>())
        }
        None => {
            let (judges, others, side) = ORBIT;
            (1 + others, weaver_scene::orbit(gaussians, judges * (1 + others), [side; 2]).unwrap_or_default())
        }
    };
    for (i, camera) in all.iter().enumerate() {
        let place = if i % every == 0 { &mut views.judging } else { &mut views.training };
        place.push(*camera);
    }
    if views.training.is_empty() {
        // A single camera has to do both.
        views.training.clone_from(&views.judging);
    }
    Ok(views)
}

struct Bench<'a> {
    path: &'a Path,
    /// Gaussians of the scene.
    count: usize,
    judge: Judge,
    held_out: &'a [Photo],
    surface: Option<Surface>,
}

impl<'a> Bench<'a> {
    fn new(
        (path, gaussians): (&'a Path, &Gaussians),
        views: &'a Views,
        drawing: Drawing,
        geometry: bool,
    ) -> Result<Self, CompressError> {
        let all: Vec<Camera> = views.training.iter().chain(&views.judging).copied().collect();
        let surface = geometry.then(|| Surface::new(gaussians, &pictures(&all, drawing))).transpose()?;
        let judge = Judge::new(gaussians, &pictures(&views.judging, drawing))?;
        Ok(Self { path, count: gaussians.len(), judge, held_out: &views.photos[1], surface })
    }

    fn measured(&mut self, name: &'static str, point: &Point, task: &Task<'_>) -> Result<Row, CompressError> {
        let start = Instant::now();
        let bytes = point.method.encode(task)?;
        let (encoding, start) = (start.elapsed().as_secs_f64(), Instant::now());
        let decoded = point.method.decode(&bytes)?;
        let seconds = [Some(encoding), Some(start.elapsed().as_secs_f64())];
        let setting = point.setting.clone();
        self.judged(Coded { method: name.into(), setting, bytes: bytes.len() as u64, seconds }, &decoded)
    }

    /// The row of a method or a file whose Gaussians these are.
    fn judged(&mut self, coded: Coded, decoded: &Gaussians) -> Result<Row, CompressError> {
        let photos = (!self.held_out.is_empty()).then(|| self.judge.psnr_of_photos(decoded, self.held_out));
        Ok(Row {
            scene: self.path.display().to_string(),
            gaussians: decoded.len(),
            // Of the scene as it was, whatever is left of it.
            bits: 8.0 * coded.bytes as f64 / self.count.max(1) as f64,
            psnr: self.judge.psnr(decoded)?,
            photos: photos.transpose()?,
            chamfer: self.surface.as_ref().map(|surface| surface.chamfer(decoded)).transpose()?,
            coded,
        })
    }
}
