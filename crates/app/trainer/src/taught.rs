//! Photos without cameras, with cameras and depth from a teacher.

use crate::{DataConfig, Error};
use std::path::{Path, PathBuf};
use weaver_data::{Scene, View, capture};
use weaver_geometry::Camera;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_inference::published::{Geometry, Teacher};
use weaver_io::safetensors::Tensors;
use weaver_io::{Checksum, Image};
use weaver_scene::{CameraRows, CameraSlices, Model};

/// The file of the teacher's predictions, beside the photos.
const CACHE: &str = "teacher.safetensors";
/// Format name in the file.
const FORMAT: &str = "splatweaver-teacher-1";
/// Depth whose confidence is at most this quantile of its photo's is unknown, as in the published distillation.
const DOUBTFUL: f64 = 0.3;
/// One photo in this many is held out.
const HOLD_OUT: usize = 8;
/// Pixels between points that fix the scale.
const SPACING: usize = 4;

/// Loads photos without cameras at the network's size (H, W).
///
/// The teacher sees all photos of the folder at once; its predictions are kept in [`CACHE`] beside them, and are made
/// anew for other weights or other photos.
pub(crate) fn load(folder: &Path, weights: &Path, data: &DataConfig, size: [usize; 2]) -> Result<Scene, Error> {
    let images = folder.join("images");
    let photos = weaver_io::list_photos(if images.is_dir() { &images } else { folder })?;
    if photos.is_empty() {
        let message = format!("{}: photos: expected at least one, here or in images, found none", folder.display());
        return Err(Error::Input(message));
    }
    let teacher = Teacher::open(weights)?;
    let taught_size = teacher.size(size);
    let geometry = cached(folder, &teacher, &read(&photos, data.masks, taught_size)?)?;
    Ok(scene(folder, &photos, read(&photos, data.masks, size)?, &geometry, taught_size, data))
}

fn read(photos: &[PathBuf], masks: bool, [height, width]: [usize; 2]) -> Result<Vec<capture::MaskedImage>, Error> {
    if masks {
        return Ok(capture::load_masked_images(photos, width, height)?);
    }
    Ok(capture::load_images(photos, width, height)?.into_iter().map(|image| (image, None)).collect())
}

/// The teacher's predictions for the photos, from the folder's cache if it was made for these weights and photos.
fn cached(folder: &Path, teacher: &Teacher, photos: &[capture::MaskedImage]) -> Result<Geometry, Error> {
    let path = folder.join(CACHE);
    let (weights, seen) = (teacher.checksum(), checksum(photos));
    // Also a link that leads nowhere, which is not to be replaced.
    if weaver_io::is_taken(&path) {
        let found = Tensors::read(&path)?;
        let entry = |key: &str| found.metadata.get(key).map_or("", String::as_str);
        if entry("format") != FORMAT {
            let message = format!(
                "{}: expected what a teacher said of these photos, found another file: move it away",
                path.display()
            );
            return Err(Error::Input(message));
        }
        if entry("teacher") == weights && entry("photos") == seen {
            return stored(&found, photos);
        }
    }
    let images: Vec<Image> = photos.iter().map(|(image, _)| image.clone()).collect();
    let geometry = teacher.teach(&images)?;
    let [views, height, width] = [images.len(), images[0].height, images[0].width];
    let rows = CameraRows::new(&geometry.cameras);
    let mut tensors = Tensors::default();
    for (key, value) in [("format", FORMAT.to_string()), ("teacher", weights), ("photos", seen)] {
        tensors.metadata.insert(key.into(), value);
    }
    tensors.insert("viewmats", &[views, 3, 4], rows.viewmats);
    tensors.insert("intrinsics", &[views, 4], rows.intrinsics);
    tensors.insert("depth", &[views, height, width], geometry.depth);
    tensors.insert("confidence", &[views, height, width], geometry.confidence);
    tensors.write(&path)?;
    // By way of the file, whose rounding the next run will see.
    stored(&tensors, photos)
}

fn stored(tensors: &Tensors, photos: &[capture::MaskedImage]) -> Result<Geometry, Error> {
    let (width, height) = (photos[0].0.width, photos[0].0.height);
    let views = photos.len();
    let map = |key: &str| Ok::<_, Error>(tensors.values::<f32>(key, &[views, height, width])?.to_vec());
    let viewmats = tensors.values::<f32>("viewmats", &[views, 3, 4])?;
    let intrinsics = tensors.values::<f32>("intrinsics", &[views, 4])?;
    let cameras =
        CameraSlices { viewmats, intrinsics, background: &[], width, height, model: Model::Pinhole }.to_cameras();
    Ok(Geometry { cameras, depth: map("depth")?, confidence: map("confidence")? })
}

fn checksum(photos: &[capture::MaskedImage]) -> String {
    let mut sum = Checksum::default();
    for (image, _) in photos {
        sum.word(image.width as u64);
        sum.floats(&image.pixels);
    }
    sum.to_string()
}

/// The scene of photos at the network's size, with the teacher's predictions at the teacher's size.
fn scene(
    folder: &Path,
    paths: &[PathBuf],
    photos: Vec<capture::MaskedImage>,
    taught: &Geometry,
    [rows, columns]: [usize; 2],
    data: &DataConfig,
) -> Scene {
    let mut scene = Scene {
        name: folder.file_name().unwrap_or(folder.as_os_str()).to_string_lossy().into_owned(),
        views: Vec::new(),
        points: Vec::new(),
        visible: Vec::new(),
        scale: data.scene_scale,
        remarks: vec![format!("{}: cameras and depth of {} photos are the teacher's", folder.display(), paths.len())],
    };
    for (i, ((image, inside), path)) in photos.into_iter().zip(paths).enumerate() {
        if inside.as_ref().is_some_and(|inside| !inside.contains(&true)) {
            scene.remarks.push(format!("{}: it is masked altogether and not used", path.display()));
            continue;
        }
        let (width, height) = (image.width, image.height);
        let all = i * rows * columns..(i + 1) * rows * columns;
        let (depth, confidence) = (&taught.depth[all.clone()], &taught.confidence[all]);
        let least = weaver_kernels::order::quantile(&mut confidence.to_vec(), DOUBTFUL);
        let known = |at: usize| {
            let from = (at / width) * rows / height * columns + (at % width) * columns / width;
            let counts = confidence[from] > least && inside.as_ref().is_none_or(|inside| inside[at]);
            if counts { depth[from] } else { 0.0 }
        };
        let depth: Vec<f32> = (0..width * height).map(known).collect();
        let own = taught.cameras[i];
        let (sx, sy) = (width as f64 / columns as f64, height as f64 / rows as f64);
        let camera = Camera { intrinsics: own.intrinsics.resized(sx, sy), width, height, ..own };
        let first = scene.points.len() as u32;
        scene.points.extend(surface(&camera, &depth));
        scene.visible.push((first..scene.points.len() as u32).collect());
        scene.views.push(View {
            name: path.strip_prefix(folder).unwrap_or(path).display().to_string(),
            image,
            camera,
            inside,
            depth: Some(depth),
            instances: None,
            time: None,
            number: None,
            extras: std::collections::BTreeMap::new(),
            held_out: i % HOLD_OUT == 0,
        });
    }
    scene
}

/// Some points where depth is known.
fn surface(camera: &Camera, depth: &[f32]) -> Vec<DVec3> {
    let places =
        (0..camera.height).step_by(SPACING).flat_map(|y| (0..camera.width).step_by(SPACING).map(move |x| (x, y)));
    let known = places.filter(|(x, y)| depth[y * camera.width + x] > 0.0);
    let point = |(x, y): (usize, usize)| {
        camera.unproject(DVec2::new(x as f64 + 0.5, y as f64 + 0.5), f64::from(depth[y * camera.width + x]))
    };
    known.map(point).collect()
}
