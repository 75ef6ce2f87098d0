//! Short descriptions of files.

mod weights;

use crate::cameras::colmap::{self, CameraModel, Model, Point};
use crate::cameras::realestate::Clip;
use crate::files::file::{read_bytes, read_part};
use crate::gaussians::SCENE_IN_FOLDER;
use crate::gaussians::ply::{Table, is_scene};
use crate::pictures::photo_file::EXTENSIONS;
use crate::safetensors::Mapped;
use crate::{
    Background, Error, Image, LidarScan, Npy, Npz, OpenScene, Project, ProjectKind, Result, SceneFormat,
    TorchCheckpoint, Transforms,
};
use crate::{list_photos, open_scene, read_lidar_scan};
use std::fmt::Display;
use std::path::Path;
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Distortion, Intrinsics, Pose};

/// Describes a file or a folder: its format, how much it holds, and ranges of values.
///
/// Supports photos (JPEG, PNG, TIFF, WebP) and folders of them, Gaussians in every [format](crate::SCENE_FORMATS), PLY
/// point clouds, scans of lidars (.bin, .pcd), NPY and NPZ, safetensors, PyTorch checkpoints, transforms.json, COLMAP
/// models (a folder, a scene with `sparse/0`, or one of the files), [projects](crate::Project) of other programs and
/// RealEstate10K camera files.
pub fn info(path: impl AsRef<Path>) -> Result<String> {
    let path = path.as_ref();
    if std::fs::metadata(path).map_err(Error::io(path))?.is_dir() {
        if ["model.safetensors", "model.safetensors.index.json"].iter().any(|name| path.join(name).is_file()) {
            return Ok(weights::weights(&Mapped::open(path)?));
        }
        if SCENE_IN_FOLDER.iter().any(|name| path.join(name).is_file()) {
            return scene(path);
        }
        return folder(path);
    }
    let name = path.file_name().and_then(|n| n.to_str()).unwrap_or("").to_lowercase();
    let (stem, extension) = name.rsplit_once('.').unwrap_or((&name, ""));
    match (stem, extension) {
        (_, extension) if EXTENSIONS.contains(&extension) => image(path),
        // Of any other PLY file, its vertices are described.
        (_, "ply") => ply(path),
        _ if SceneFormat::of(path).is_ok() => scene(path),
        (_, "safetensors") => Ok(weights::weights(&Mapped::open(path)?)),
        (_, "json") if name.ends_with(".index.json") => Ok(weights::weights(&Mapped::open(path)?)),
        (_, "xml" | "csv" | "out" | "json") if ProjectKind::of(path)?.is_some() => {
            Ok(project(&Project::read_cameras(path)?))
        }
        // The cameras are worth describing where the photos are not at hand.
        (_, "json") => {
            let scene = Transforms::read(path);
            Ok(transforms(&scene.or_else(|error| Transforms::read_cameras(path).map_err(|_| error))?))
        }
        ("cameras", "bin" | "txt") => Ok(cameras(colmap::read_cameras(path)?.values())),
        ("images", "bin" | "txt") => Ok(images(&colmap::read_images(path)?)),
        ("points3d", "bin" | "txt") => Ok(points(&colmap::read_points(path)?)),
        (_, "txt") => Ok(clip(&Clip::read(path)?)),
        (_, "bin") => torch_or_scan(path),
        (_, "pcd") => Ok(scan(&read_lidar_scan(path)?)),
        (_, "ckpt" | "pt" | "pth") => TorchCheckpoint::open(path)?.describe(),
        (_, "npy") => Ok(format!("NPY, an array of {:?}", Npy::open(path)?.shape())),
        (_, "npz") => arrays(&Npz::open(path)?),
        _ => Err(Error::invalid(path, "file name", "a known extension", format!("{extension:?}"))),
    }
}

/// A folder without weights or a scene.
fn folder(path: &Path) -> Result<String> {
    let place = colmap::model_folder(path);
    if ["cameras.bin", "cameras.txt"].iter().any(|name| place.join(name).is_file()) {
        return Ok(model(&Model::read(place)?));
    }
    let file = path.join("transforms.json");
    if file.is_file() {
        return info(file);
    }
    let photos = list_photos(path)?;
    match photos.first() {
        Some(first) => Ok(format!("{} photos; the first, {}: {}", photos.len(), first.display(), image(first)?)),
        None => {
            let expected = "a run, a COLMAP model, transforms.json, meta.json, model.safetensors or photos";
            Err(Error::invalid(path, "folder", expected, "none of them"))
        }
    }
}

/// A checkpoint of PyTorch, or a scan of a lidar.
fn torch_or_scan(path: &Path) -> Result<String> {
    const ZIP: &[u8] = b"PK";
    if read_part(path, 0..ZIP.len() as u64).is_ok_and(|start| start == ZIP) {
        return TorchCheckpoint::open(path)?.describe();
    }
    let read = read_lidar_scan(path).map_err(|error| match error {
        Error::Invalid { path, place, expected, found } => {
            let expected =
                format!("a checkpoint of PyTorch 1.6 or later (a ZIP archive), or a scan of a lidar: {expected}");
            Error::Invalid { path, place, expected, found }
        }
        error => error,
    });
    Ok(scan(&read?))
}

fn scan(scan: &LidarScan) -> String {
    let LidarScan { points, times } = scan;
    let mut lines = format!("scan of a lidar, {} points", points.len());
    for (axis, name) in ["forward", "left", "up"].iter().enumerate() {
        // Points that the sensor did not see may be NaN.
        let values = points.iter().map(|point| f64::from(point[axis])).filter(|x| x.is_finite());
        lines += &format!("\n{name:<8} {} m", Range::of(values));
    }
    lines + if times.is_empty() { "" } else { "\nwith the time of each point" }
}

fn arrays(file: &Npz) -> Result<String> {
    let names = file.names();
    let mut lines = format!("NPZ, {} arrays", names.len());
    for name in names.iter().take(20) {
        lines += &format!("\n{name} {:?}", file.array(name)?.shape());
    }
    Ok(lines)
}

fn image(path: &Path) -> Result<String> {
    let image = Image::read(path, Background::Black)?;
    let mut lines = format!("image, {}x{} pixels", image.width, image.height);
    for (channel, name) in ["red", "green", "blue"].iter().enumerate() {
        let values = image.pixels.iter().skip(channel).step_by(3);
        lines += &format!("\n{name:<6} {}", Range::of(values.map(|&x| f64::from(x))));
    }
    Ok(lines)
}

fn ply(path: &Path) -> Result<String> {
    if is_scene(path)? {
        return scene(path);
    }
    let table = Table::read(path, &read_bytes(path)?)?;
    let mut lines = format!("PLY, {} vertices", table.rows);
    for (column, name) in table.names.iter().enumerate().take(20) {
        let values = (0..table.rows).map(|row| f64::from(table.row(row)[column]));
        lines += &format!("\n{name:<12} {}", Range::of(values));
    }
    Ok(lines)
}

fn scene(path: &Path) -> Result<String> {
    let OpenScene { gaussians, drawing } = open_scene(path)?;
    let (mut position, mut scale, mut opacity) = ([Range::default(); 3], Range::default(), Range::default());
    for rows in gaussians.blocks() {
        let block = gaussians.block(rows)?;
        for (axis, range) in position.iter_mut().enumerate() {
            range.extend(block.means.iter().map(|mean| f64::from(mean[axis])));
        }
        scale.extend(block.log_scales.as_flattened().iter().map(|&s| f64::from(s).exp()));
        opacity.extend(block.opacity_logits.iter().map(|&o| 1.0 / (1.0 + f64::from(-o).exp())));
    }
    let trained = if drawing.antialiased { ", trained antialiased" } else { "" };
    let mut lines = format!("Gaussians, {} of SH degree {}{trained}", gaussians.len(), gaussians.degree());
    for (name, range) in ["x", "y", "z"].iter().zip(position) {
        lines += &format!("\n{name:<8} {range}");
    }
    Ok(lines + &format!("\nscale    {scale}\nopacity  {opacity}"))
}

fn transforms(scene: &Transforms) -> String {
    let test = scene.test_filenames.as_ref().map_or(0, Vec::len);
    let splits = [("train", scene.train_filenames.len()), ("val", scene.val_filenames.len()), ("test", test)];
    let splits = splits.map(|(name, names)| format!("{names} {name}")).join(", ");
    let mut lines = format!("transforms.json, {} frames (split: {splits})", scene.frames.len());
    if let Some(frame) = scene.frames.first() {
        let Camera { intrinsics, width, height, .. } = frame.camera;
        lines += &format!("\nfirst: {}, {}", frame.name, camera([width, height], &intrinsics, frame.distortion));
    }
    lines + &centers(scene.frames.iter().map(|f| f.camera.pose))
}

fn project(project: &Project) -> String {
    let Project { kind, frames, points, .. } = project;
    let mut lines = format!("cameras of {}, {} photos, {} points", kind.name(), frames.len(), points.len());
    if let Some(frame) = frames.first() {
        let Camera { intrinsics, width, height, .. } = frame.camera;
        lines += &format!("\nfirst: {}, {}", frame.name, camera([width, height], &intrinsics, frame.distortion));
    }
    lines + &centers(frames.iter().map(|f| f.camera.pose))
}

fn clip(clip: &Clip) -> String {
    let mut lines = format!("RealEstate10K, {} cameras of {}", clip.frames.len(), clip.url);
    if let (Some(first), Some(last)) = (clip.frames.first(), clip.frames.last()) {
        let [fx, fy, cx, cy] = first.normalized;
        lines += &format!("\ntime {} to {} microseconds", first.timestamp, last.timestamp);
        lines += &format!("\nfirst: fx {fx} fy {fy} cx {cx} cy {cy} of the image's size");
    }
    lines + &centers(clip.frames.iter().map(|f| f.pose))
}

fn model(model: &Model) -> String {
    let parts = [cameras(model.cameras.values()), images(&model.images), points(&model.points)];
    format!("COLMAP model\n{}", parts.join("\n"))
}

fn cameras<'a>(cameras: impl ExactSizeIterator<Item = &'a CameraModel>) -> String {
    let mut lines = format!("COLMAP cameras, {}", cameras.len());
    for CameraModel { width, height, intrinsics, distortion } in cameras.take(5) {
        lines += &format!("\n{}", camera([*width, *height], intrinsics, *distortion));
    }
    lines
}

fn images(images: &[colmap::ImageRecord]) -> String {
    let observed = images.iter().flat_map(|i| &i.points).filter(|p| p.2.is_some()).count();
    let head = format!("COLMAP images, {} with {observed} observations of points", images.len());
    head + &centers(images.iter().map(|i| i.pose))
}

fn points(points: &[Point]) -> String {
    let mut lines = format!("COLMAP points, {}", points.len());
    for (axis, name) in ["x", "y", "z"].iter().enumerate() {
        lines += &format!("\n{name:<8} {}", Range::of(points.iter().map(|p| p.xyz[axis])));
    }
    lines + &format!("\nerror    {} pixels", Range::of(points.iter().map(|p| p.error)))
}

fn camera([width, height]: [usize; 2], k: &Intrinsics, distortion: Option<Distortion>) -> String {
    let Intrinsics { fx, fy, cx, cy } = k;
    let lens = match distortion {
        None => String::new(),
        Some(Distortion::Radial { k, p }) => format!(", distorted by k {k:?} p {p:?}"),
        Some(Distortion::Fisheye { k }) => format!(", a fisheye of k {k:?}"),
        Some(Distortion::ThinPrismFisheye { k, p, s }) => format!(", a fisheye of k {k:?} p {p:?} s {s:?}"),
        Some(Distortion::Fov { omega }) => format!(", a lens of field of view {omega}"),
        Some(Distortion::RadTanThinPrism { k, p, s }) => format!(", a fisheye of k {k:?} p {p:?} s {s:?}"),
    };
    format!("{width}x{height} pixels, fx {fx:.3} fy {fy:.3} cx {cx:.3} cy {cy:.3}{lens}")
}

fn centers(poses: impl Iterator<Item = Pose>) -> String {
    let centers: Vec<DVec3> = poses.map(|p| p.center()).collect();
    let Some(&first) = centers.first() else { return String::new() };
    let (low, high) = centers.iter().fold((first, first), |(l, h), c| (l.min(*c), h.max(*c)));
    format!("\ncamera centers from {low:.3} to {high:.3}")
}

/// Smallest, mean and largest of some numbers.
#[derive(Clone, Copy)]
struct Range {
    low: f64,
    high: f64,
    sum: f64,
    count: f64,
}

impl Default for Range {
    fn default() -> Self {
        Self { low: f64::INFINITY, high: f64::NEG_INFINITY, sum: 0.0, count: 0.0 }
    }
}

impl Range {
    fn of(values: impl Iterator<Item = f64>) -> Self {
        let mut range = Self::default();
        range.extend(values);
        range
    }

    fn extend(&mut self, values: impl Iterator<Item = f64>) {
        for x in values {
            self.low = self.low.min(x);
            self.high = self.high.max(x);
            self.sum += x;
            self.count += 1.0;
        }
    }
}

impl Display for Range {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.low > self.high {
            return write!(f, "no values");
        }
        write!(f, "{:.4} to {:.4}, mean {:.4}", self.low, self.high, self.sum / self.count)
    }
}
