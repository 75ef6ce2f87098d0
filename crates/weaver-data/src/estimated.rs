//! Photos without cameras: cameras by matching, as a capture on disk.

mod context;

use crate::Error;
use crate::undistorted::undistorted;
pub use context::EstimatedContext;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use weaver_geometry::glam::DVec2;
use weaver_geometry::{Camera, Distortion, Undistortion};
use weaver_io::colmap::{Model, Point};
use weaver_io::{Image, PhotoFile, Transforms};
use weaver_scene::Frame;
use weaver_sfm::{Confidence, Estimate, EstimateSettings, LeftOut, Observation, Photo, estimate};

/// The diagonal of the film that focal lengths are compared by, millimeters.
const FILM: f64 = 43.266_615;
/// Standard deviation of focal lengths that are told, as a part of them: cameras round them, and crop.
const TOLD: f64 = 0.05;
/// Proportions of photos that differ by less than this part are the same: sizes are rounded.
const SAME_PROPORTIONS: f64 = 0.01;
/// The folder of photos that are written without distortion.
const IMAGES: &str = "undistorted";
/// Width of a photo in the picture of points.
const THUMBNAIL: usize = 240;

/// How cameras of photo files are estimated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EstimateOptions {
    /// Photos are shrunk to this longest side for matching, pixels.
    pub long_side: usize,
    /// The focal length of all photos, in pixels of a photo whose longer side is 1; `None` asks the files, and estimates it where
    /// these do not tell.
    pub focal: Option<f64>,
    /// Whether what files tell of their focal length is used.
    pub exif: bool,
    /// Whether photos have one lens, and with it one focal length over their longer side: those of the same proportions, since
    /// of a crop the longer side is another one. Otherwise each has its own.
    pub shared: bool,
    /// Whether a radial distortion is found; photos are then written without it.
    pub distortion: bool,
}

impl Default for EstimateOptions {
    fn default() -> Self {
        Self { long_side: 640, focal: None, exif: true, shared: true, distortion: false }
    }
}

/// Photos with estimated cameras.
#[derive(Clone, Debug)]
pub struct EstimatedPhotos {
    /// The photos.
    pub paths: Vec<PathBuf>,
    /// The photos as they were matched.
    images: Vec<Image>,
    /// Width and height of the files.
    sizes: Vec<(usize, usize)>,
    /// Which are only located.
    located: Vec<bool>,
    /// The lens of each: a number, without gaps.
    lens_of: Vec<usize>,
    /// Of each photo, how its distortion is undone, if one was found.
    lenses: Vec<Option<Undistortion>>,
    /// Cameras and points; pixels are those of the photos as they were matched.
    pub estimate: Estimate,
}

/// Estimates the cameras of photo files by matching them.
///
/// ```no_run
/// use weaver_data::{EstimateOptions, estimate_photos};
///
/// let photos = ["a.jpg", "b.jpg", "c.jpg"].map(Into::into);
/// let found = estimate_photos(&photos, &[false; 3], &EstimateOptions::default())?;
/// println!("{} of 3 photos have a camera: {:?}", found.placed().len(), found.confidence());
/// found.write("capture".as_ref())?;
/// # Ok::<(), weaver_data::Error>(())
/// ```
///
/// Where `located` is true, a photo finds no points: its camera is found by those of the others.
///
/// # Errors
/// When a photo cannot be read.
///
/// # Panics
/// If `located` is not as long as `paths`.
pub fn estimate_photos(
    paths: &[PathBuf],
    located: &[bool],
    options: &EstimateOptions,
) -> Result<EstimatedPhotos, Error> {
    assert_eq!(paths.len(), located.len(), "as many photos as flags");
    let loaded: Vec<Result<Loaded, Error>> = paths.par_iter().map(|path| load(path, options)).collect();
    let loaded = loaded.into_iter().collect::<Result<Vec<_>, _>>()?;
    let lens_of = lenses_of(&loaded, options.shared);
    let photos: Vec<Photo<'_>> = (loaded.iter().zip(located).zip(&lens_of))
        .map(|((Loaded { image, focal, .. }, located), lens)| {
            let photo = Photo::new(&image.to_bytes(), [image.height, image.width]);
            Photo { focal: *focal, located: *located, lens: *lens, ..photo }
        })
        .collect();
    let focal_deviation = if options.focal.is_some() { 0.0 } else { TOLD };
    let settings = EstimateSettings { focal_deviation, distortion: options.distortion, ..EstimateSettings::default() };
    let estimate = estimate(&photos, &settings);
    let (images, sizes) = loaded.into_iter().map(|loaded| (loaded.image, loaded.size)).unzip();
    let lens = |(camera, k1): (&Result<Camera, LeftOut>, &f64)| {
        Undistortion::new(camera.ok()?, Distortion::radial(*k1).or_none()?)
    };
    let lenses = estimate.cameras.iter().zip(&estimate.k1).map(lens).collect();
    Ok(EstimatedPhotos { paths: paths.to_vec(), images, sizes, located: located.to_vec(), lens_of, lenses, estimate })
}

/// A photo for matching.
struct Loaded {
    image: Image,
    /// Width and height of the file.
    size: (usize, usize),
    /// The focal length as far as it is told, pixels of the image.
    focal: Option<f64>,
}

fn load(path: &Path, options: &EstimateOptions) -> Result<Loaded, Error> {
    let file = open(path)?;
    let size = file.size();
    let longest = size.0.max(size.1);
    let to = longest.min(options.long_side);
    let shrunk = |side: usize| ((side * to) as f64 / longest as f64).round().max(1.0) as usize;
    let image = file.resize_whole(shrunk(size.0), shrunk(size.1))?.to_image();
    let (w, h) = (image.width as f64, image.height as f64);
    let told = if options.exif { weaver_io::focal_35mm(path)? } else { None };
    let focal = options.focal.map(|f| f * w.max(h)).or(told.map(|mm| mm / FILM * w.hypot(h)));
    Ok(Loaded { image, size, focal })
}

/// The number of each photo's lens: one for all photos of the same proportions if they share lenses, else one a photo.
fn lenses_of(photos: &[Loaded], shared: bool) -> Vec<usize> {
    let mut lenses: Vec<f64> = Vec::new();
    let lens = |photo: &Loaded| {
        let (width, height) = photo.size;
        let proportions = width.max(height) as f64 / width.min(height) as f64;
        let same = |lens: &f64| shared && (proportions / lens).ln().abs() < SAME_PROPORTIONS;
        lenses.iter().position(same).unwrap_or_else(|| {
            lenses.push(proportions);
            lenses.len() - 1
        })
    };
    photos.iter().map(lens).collect()
}

/// Opens a photo as it will be opened again with the camera that is found for it: upright, if its size can tell.
fn open(path: &Path) -> Result<PhotoFile, Error> {
    let file = PhotoFile::at(path)?;
    let (width, height) = file.size();
    Ok(file.for_camera(width, height))
}

impl EstimatedPhotos {
    /// The photos that have a camera.
    pub fn placed(&self) -> Vec<PathBuf> {
        let placed = self.paths.iter().zip(&self.estimate.cameras).filter(|(_, camera)| camera.is_ok());
        placed.map(|(path, _)| path.clone()).collect()
    }

    /// The photos that have none, and why.
    pub fn left_out(&self) -> Vec<(&Path, LeftOut)> {
        let all = self.paths.iter().zip(&self.estimate.cameras);
        all.filter_map(|(path, camera)| Some((path.as_path(), camera.err()?))).collect()
    }

    /// How much the cameras are to be believed.
    pub fn confidence(&self) -> Confidence {
        self.estimate.confidence()
    }

    /// How many lenses the photos were taken to have: one if all have the same proportions and share it.
    pub fn lenses(&self) -> usize {
        self.lens_of.iter().max().map_or(0, |last| last + 1)
    }

    /// The focal length of the first camera over the longer side of its photo; not a number without a camera.
    pub fn focal(&self) -> f64 {
        let first = self.estimate.cameras.iter().find_map(|camera| camera.ok());
        first.map_or(f64::NAN, |c| c.intrinsics.fx / c.width.max(c.height) as f64)
    }

    /// Writes a capture into a folder: transforms.json, which names the located photos as those for testing, and a COLMAP model
    /// with points in sparse/0. Photos stay where they are, unless a distortion was found: they are then written to
    /// undistorted/ without it. Returns the photos that the cameras are of.
    ///
    /// # Errors
    /// When the folder cannot be written, or photos cannot be read again.
    pub fn write(&self, folder: &Path) -> Result<Vec<PathBuf>, Error> {
        let frames = self.frames(folder);
        let sparse = folder.join("sparse/0");
        weaver_io::create_folder(&sparse)?;
        for (number, frame) in &frames {
            if let Some(lens) = &self.lenses[*number] {
                if self.paths.iter().any(|path| std::path::absolute(path).ok() == std::path::absolute(&frame.path).ok())
                {
                    return Err(Error::unexpected(&frame.path, "photo", "a new file", "a photo that is matched"));
                }
                weaver_io::create_folder(folder.join(IMAGES))?;
                undistorted(lens, &open(&self.paths[*number])?.read()?).write_png(&frame.path)?;
            }
        }
        self.model(&frames).write_binary(&sparse)?;
        let tested = |(number, frame): &(usize, Frame)| self.located[*number].then(|| frame.name.clone());
        let test_filenames: Vec<String> = frames.iter().filter_map(tested).collect();
        let frames: Vec<Frame> = frames.into_iter().map(|(_, frame)| frame).collect();
        let paths = frames.iter().map(|frame| frame.path.clone()).collect();
        Transforms { frames, test_filenames, ..Transforms::default() }.write(folder.join("transforms.json"))?;
        Ok(paths)
    }

    /// Every photo with a camera, with the places of its points: green where these are exact, red where they are off by two pixels.
    pub fn picture(&self) -> Image {
        let [good, bad] = [[0.1, 0.9, 0.2], [1.0, 0.1, 0.1]];
        let e = &self.estimate;
        let mut shown: Vec<Option<Image>> = vec![None; self.images.len()];
        for (number, image) in self.images.iter().enumerate().filter(|(number, _)| e.cameras[*number].is_ok()) {
            let height = (image.height * THUMBNAIL / image.width).max(1);
            shown[number] = Some(image.resize(THUMBNAIL, height, [0.0, 0.0, image.width as f64, image.height as f64]));
        }
        for o in &e.observations {
            let (Some(shown), Some((_, off))) = (&mut shown[o.camera], self.seen(o)) else { continue };
            let t = (off / 2.0).min(1.0) as f32;
            let at = o.pixel * (shown.width as f64 / self.images[o.camera].width as f64);
            dot(shown, at, std::array::from_fn(|c| good[c] * (1.0 - t) + bad[c] * t));
        }
        let shown: Vec<Image> = shown.into_iter().flatten().collect();
        sheet(&shown)
    }

    /// Where an observation is in its photo without distortion, and how far off; `None` in photos without a camera.
    fn seen(&self, o: &Observation) -> Option<(DVec2, f64)> {
        let camera = self.estimate.cameras[o.camera].ok()?;
        let (camera, pixel) = match &self.lenses[o.camera] {
            Some(lens) => (lens.to, lens.undistorted(o.pixel)?),
            None => (camera, o.pixel),
        };
        let at = camera.intrinsics.project(camera.pose.apply(self.estimate.points[o.point]));
        Some((pixel, at.distance(pixel)))
    }

    /// The photos with a camera by number, with cameras of the files.
    fn frames(&self, folder: &Path) -> Vec<(usize, Frame)> {
        let mut taken = BTreeSet::new();
        let mut frame = |(number, camera): (usize, &Result<Camera, LeftOut>)| {
            let (camera, (width, height)) = (camera.ok()?, self.sizes[number]);
            let lens = self.lenses[number];
            let camera = lens.map_or(camera, |lens| lens.to);
            let (sx, sy) = (width as f64 / camera.width as f64, height as f64 / camera.height as f64);
            let camera = Camera { intrinsics: camera.intrinsics.resized(sx, sy), width, height, ..camera };
            let path = std::path::absolute(&self.paths[number]).unwrap_or_else(|_| self.paths[number].clone());
            let Some(_) = lens else {
                return Some((number, Frame { path: path.clone(), ..Frame::new(path.to_string_lossy(), camera) }));
            };
            let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            let mut name = format!("{IMAGES}/{stem}.png");
            if !taken.insert(name.to_lowercase()) {
                name = format!("{IMAGES}/{number:04}-{stem}.png");
            }
            Some((number, Frame { path: folder.join(&name), ..Frame::new(name, camera) }))
        };
        self.estimate.cameras.iter().enumerate().filter_map(&mut frame).collect()
    }

    /// The model of COLMAP, with points and tracks.
    fn model(&self, frames: &[(usize, Frame)]) -> Model {
        let e = &self.estimate;
        let mut model = Model::from_frames(&frames.iter().map(|(_, frame)| frame.clone()).collect::<Vec<_>>());
        let place = |number: usize| frames.iter().position(|(n, _)| *n == number);
        for (id, group) in e.observations.chunk_by(|a, b| a.point == b.point).enumerate() {
            let (mut track, mut errors, mut rgb) = (Vec::new(), 0.0, None);
            for o in group {
                let (Some(at), Some((pixel, off))) = (place(o.camera), self.seen(o)) else { continue };
                let scale = self.sizes[o.camera].0 as f64 / self.images[o.camera].width as f64;
                let image = &mut model.images[at];
                track.push((image.id, image.points.len() as u32));
                image.points.push((pixel.x * scale, pixel.y * scale, Some(id as u64 + 1)));
                errors += scale * off;
                rgb = rgb.or_else(|| color(&self.images[o.camera], o.pixel));
            }
            let error = errors / track.len().max(1) as f64;
            let xyz = e.points[group[0].point].to_array();
            model.points.push(Point { id: id as u64 + 1, xyz, rgb: rgb.unwrap_or_default(), error, track });
        }
        model
    }
}

fn color(image: &Image, pixel: DVec2) -> Option<[u8; 3]> {
    let at = 3 * ((pixel.y as usize).min(image.height - 1) * image.width + (pixel.x as usize).min(image.width - 1));
    image.pixels.get(at..at + 3).map(|c| [0, 1, 2].map(|i| (c[i] * 255.0).round() as u8))
}

/// Draws a dot of three by three pixels.
fn dot(image: &mut Image, at: DVec2, color: [f32; 3]) {
    for (dx, dy) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))) {
        let (x, y) = (at.x as isize + dx, at.y as isize + dy);
        if x >= 0 && y >= 0 && (x as usize) < image.width && (y as usize) < image.height {
            let place = 3 * (y as usize * image.width + x as usize);
            image.pixels[place..place + 3].copy_from_slice(&color);
        }
    }
}

/// Pictures side by side in rows.
fn sheet(images: &[Image]) -> Image {
    let columns = (images.len() as f64).sqrt().ceil().max(1.0) as usize;
    let height = images.iter().map(|i| i.height).max().unwrap_or(1);
    let rows = images.len().div_ceil(columns).max(1);
    let mut sheet = Image::filled(columns * THUMBNAIL, rows * height, [1.0; 3]);
    for (i, image) in images.iter().enumerate() {
        let (left, top) = (i % columns * THUMBNAIL, i / columns * height);
        for (y, row) in image.pixels.chunks_exact(3 * image.width).enumerate() {
            let at = 3 * ((top + y) * sheet.width + left);
            sheet.pixels[at..at + row.len()].copy_from_slice(row);
        }
    }
    sheet
}
