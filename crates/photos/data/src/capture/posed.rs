//! Photos at their own size with their cameras: the part of a capture for fitting a scene, or judging one.

pub use super::lenses::Lenses;
use super::masks::{self, Mask};
use super::photo::{self, Photos, straight, straight_camera};
use super::visible::visible_points;
use super::{HoldOut, folder, name, photo_cameras, read_split_photos};
use crate::unreadable::{Fault, Needed, without_unreadable};
use crate::{Error, remarks, uniform};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use weaver_geometry::Camera;
use weaver_geometry::geodesy::Origin;
use weaver_geometry::glam::DVec2;
use weaver_io::{PhotoFile, ScratchFile};
use weaver_scene::{Frame, Photo, PointCloud};

/// Meaning of masked pixels for the scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Masked {
    /// Nothing: they do not count.
    #[default]
    Unknown,
    /// That nothing stands there: they show the background, as transparent pixels do.
    Empty,
}

/// Options of loading photos with their cameras.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PosedOptions {
    /// Longest side after shrinking, pixels; photos that are no larger, and all if `None`, keep their size.
    pub long_side: Option<usize>,
    /// The photos to hold out.
    pub hold_out: HoldOut,
    /// Leaves out the photos that are not held out; where none is held out, all are loaded.
    pub held_out_only: bool,
    /// Loads at most so many of the photos that are not held out, evenly spread in the capture's order, and none that
    /// are.
    pub sample: Option<usize>,
    /// Reads masks: `mask_path` of a frame, or a file in `masks/` beside the camera file with the photo's path or the
    /// end of it, with its own extension, `.png` in its place, or `.png` behind it; else the photo's alpha. Black is
    /// masked, and transparent.
    pub masks: bool,
    /// White is masked in these files, and black counts.
    pub invert_masks: bool,
    /// Meaning of masked pixels for the scene.
    pub masked: Masked,
    /// The color behind transparent pixels.
    pub background: [f32; 3],
    /// Treatment of lenses. Pixels outside of the circle of a lens that is kept are masked.
    pub lenses: Lenses,
}

impl PosedOptions {
    /// The camera of a photo of the size that it is loaded at.
    fn shrunk(&self, camera: &Camera) -> Camera {
        self.long_side.map_or(*camera, |side| camera.shrunk(side))
    }
}

impl Default for PosedOptions {
    fn default() -> Self {
        Self {
            long_side: None,
            hold_out: HoldOut::Listed,
            held_out_only: false,
            sample: None,
            masks: false,
            invert_masks: false,
            masked: Masked::Unknown,
            background: [1.0; 3],
            lenses: Lenses::Undistort,
        }
    }
}

/// A photo of a capture, as it is fitted and as it is on disk.
#[derive(Clone, Debug, PartialEq)]
pub struct PosedPhoto {
    /// Its pixels with their camera: without distortion, or with its lens.
    pub photo: Photo,
    /// The image file: its path, its camera with the distortion that is undone in [`photo`](Self::photo), and the
    /// capture's entries for it. The mask is the file that was read, if masks were requested.
    pub frame: Frame,
    /// Kept from training, for evaluation.
    pub held_out: bool,
    /// Indices of the capture's [points](PosedPhotos::points) that it sees, ascending: by the capture's tracks, else
    /// the points that no nearer one hides.
    pub visible: Vec<u32>,
}

/// The photos of a capture, and its points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PosedPhotos {
    /// The capture's name.
    pub name: String,
    /// The photos in order of their paths.
    pub photos: Vec<PosedPhoto>,
    /// Points on surfaces; empty if the capture has none.
    pub points: PointCloud,
    /// The origin of the world on the Earth or in a survey's frame, where the capture has one.
    pub origin: Option<Origin>,
    /// True if parts of photos are transparent, and no mask leaves them out, or [empty](Masked::Empty): they show
    /// [`PosedOptions::background`].
    pub transparent: bool,
    /// Remarks for the user about how they were loaded.
    pub remarks: Vec<String>,
}

/// Loads the photos of a capture, in any layout that [`capture::load`](super::load) takes.
///
/// # Errors
/// As [`capture::load`](super::load); also a mask that is missing or of another size than its photo.
pub fn load(path: impl AsRef<Path>, options: &PosedOptions) -> Result<PosedPhotos, Error> {
    load_kept(path, options, None)
}

/// Loads the photos of a capture as [`load`] does, and keeps their pixels in a file, if one is given, in place of
/// memory.
///
/// # Errors
/// As [`load`]; when that file has no room for them.
pub fn load_kept(
    path: impl AsRef<Path>,
    options: &PosedOptions,
    scratch: Option<&ScratchFile>,
) -> Result<PosedPhotos, Error> {
    let path = path.as_ref();
    let mut capture = read_split_photos(path, options.hold_out)?;
    // Whether too many photos are unreadable is a question of the whole capture, not of the requested part.
    let needed = Needed { least: 1, all: capture.photos.len() };
    if options.held_out_only && capture.photos.iter().any(|photo| photo.held_out) {
        capture.photos.retain(|photo| photo.held_out);
    }
    if let Some(most) = options.sample {
        capture.photos.retain(|photo| !photo.held_out);
        let chosen = uniform(capture.photos.len(), most.min(capture.photos.len()));
        capture.photos = chosen.iter().map(|i| capture.photos[*i].clone()).collect();
    }
    let folder = folder(path);
    let masks = options.masks.then(|| masks::of_capture(&capture.photos, folder)).transpose()?;
    let loaded = load_photos(&capture, masks.as_deref(), options, scratch);
    let (loaded, unreadable) = without_unreadable(capture.paths(), loaded, needed)?;
    let loaded: Vec<Loaded> = loaded.into_iter().flatten().collect();
    let Photos { points, colors, synthetic, origin, mut remarks, .. } = capture;
    remarks.extend(unreadable);
    if !options.masks && !synthetic {
        let transparent = loaded.iter().filter(|loaded| loaded.transparent);
        remarks.extend(remarks::transparent(
            &transparent.map(|loaded| loaded.photo.frame.name.clone()).collect::<Vec<_>>(),
        ));
    }
    let canonical = folder.canonicalize().unwrap_or_else(|_| folder.to_path_buf());
    Ok(PosedPhotos {
        transparent: loaded.iter().any(|loaded| loaded.transparent),
        name: name(&canonical),
        photos: loaded.into_iter().map(|loaded| loaded.photo).collect(),
        points: PointCloud { positions: points.iter().map(|p| p.as_vec3().to_array()).collect(), colors },
        origin,
        remarks,
    })
}

/// Loads photos with the cameras that a file gives their names, in the world of the file: a transforms.json, a folder
/// with a COLMAP model, or a RealEstate10K file, matched as [`load_cameras`](super::load_cameras) does.
///
/// A camera of another size takes the size of its photo if their proportions agree to 1 %.
///
/// # Errors
/// As [`load_cameras`](super::load_cameras); when proportions differ.
pub fn load_named(file: &Path, photos: &[PathBuf], options: &PosedOptions) -> Result<Vec<PosedPhoto>, Error> {
    load_frames(photo_cameras::frames(file, photos)?, file, options)
}

/// Loads photos, the frames' paths, with the frames' cameras, as [`load_named`] does. Masks are looked for beside
/// `file`.
///
/// # Errors
/// As [`load_named`].
pub fn load_frames(frames: Vec<Frame>, file: &Path, options: &PosedOptions) -> Result<Vec<PosedPhoto>, Error> {
    let mut capture = Photos::without_points(frames);
    for photo in &mut capture.photos {
        take_size(photo)?;
    }
    let masks = options.masks.then(|| masks::of_known(&capture.photos, file)).transpose()?;
    load_photos(&capture, masks.as_deref(), options, None).into_iter().map(|loaded| Ok(loaded?.photo)).collect()
}

/// Largest difference of a camera's proportions from its photo's.
const SAME_PROPORTIONS: f64 = 0.01;

/// Gives a photo's camera the size of the file.
fn take_size(photo: &mut photo::Photo) -> Result<(), Error> {
    let Frame { path, camera, .. } = &mut photo.frame;
    let (width, height) = PhotoFile::at(&*path)?.for_camera(camera.width, camera.height).size();
    let (sx, sy) = (width as f64 / camera.width as f64, height as f64 / camera.height as f64);
    // A file without sizes has units of the image's sides.
    let sized = (camera.width, camera.height) != (1, 1);
    if sized && (sx / sy).ln().abs() > SAME_PROPORTIONS {
        let expected = format!("the proportions of its camera, {}x{}, within 1 %", camera.width, camera.height);
        return Err(Error::unexpected(path, "image size", expected, format!("{width}x{height}")));
    }
    *camera = Camera { intrinsics: camera.intrinsics.resized(sx, sy), width, height, ..*camera };
    Ok(())
}

/// A photo that was read.
struct Loaded {
    photo: PosedPhoto,
    /// True if some of it shows the background, and counts.
    transparent: bool,
}

fn load_photos(
    capture: &Photos,
    masks: Option<&[Mask]>,
    options: &PosedOptions,
    scratch: Option<&ScratchFile>,
) -> Vec<Result<Loaded, Fault>> {
    let load = |(i, photo): (usize, &photo::Photo)| {
        let mask = masks.map(|masks| masks[i].with_inverted(options.invert_masks));
        let mut loaded = load_photo(photo, mask.as_ref(), options)?;
        if let Some(scratch) = scratch {
            let kept = scratch.keep(&loaded.photo.photo.rgb).map_err(Error::from)?;
            loaded.photo.photo.rgb = kept;
        }
        loaded.photo.visible = visible_points(&loaded.photo.photo.lens_camera(), capture, photo).0;
        Ok(loaded)
    };
    capture.photos.par_iter().enumerate().map(load).collect()
}

/// The cameras of a capture, read once, for photos of any size.
#[derive(Clone, Debug)]
pub struct CaptureCameras(Vec<photo::Photo>);

impl CaptureCameras {
    /// Reads a capture's camera files, without reading a photo.
    ///
    /// # Errors
    /// When these files are missing or malformed.
    pub fn read(path: impl AsRef<Path>, hold_out: HoldOut) -> Result<Self, Error> {
        Ok(Self(read_split_photos(path.as_ref(), hold_out)?.photos))
    }

    /// The cameras that [`load`] gives the photos at a [longest side](PosedOptions::long_side) and with a [choice of
    /// lenses](PosedOptions::lenses), and which of them are held out: also the cameras of photos that cannot be read.
    ///
    /// # Errors
    /// When a distortion leaves no photo.
    pub fn at(&self, long_side: Option<usize>, lenses: Lenses) -> Result<Vec<(Camera, bool)>, Error> {
        let options = PosedOptions { long_side, ..PosedOptions::default() };
        let camera = |photo: &photo::Photo| {
            let camera = options.shrunk(&photo.frame.camera);
            let lens = if photo.kept_lens(lenses).is_some() { None } else { photo.lens(camera)? };
            Ok((straight_camera(camera, lens.as_ref()), photo.held_out))
        };
        self.0.iter().map(camera).collect()
    }
}

fn load_photo(photo: &photo::Photo, mask: Option<&Mask>, options: &PosedOptions) -> Result<Loaded, Fault> {
    let frame = &photo.frame;
    let file = photo.open()?.over(options.background);
    let camera = options.shrunk(&frame.camera);
    let kept = photo.kept_lens(options.lenses);
    let lens = if kept.is_some() { None } else { photo.lens(camera)? };
    let shrink = frame.camera.width as f64 / camera.width as f64;
    let read = |file: &PhotoFile| -> Result<Vec<u8>, weaver_io::Error> {
        let at = |times: usize| file.resize_whole(camera.width * times, camera.height * times);
        Ok(straight(lens.as_ref(), shrink, at)?.pixels)
    };
    let opened = mask.map(|mask| mask.open(&frame.path, file.clone())).transpose()?;
    let empty = mask.is_some() && options.masked == Masked::Empty;
    // Alpha has laid the photo over the background already.
    let over = opened.clone().filter(|_| empty && mask.is_some_and(|mask| mask.file.is_some()));
    let shown = over.map_or(file.clone(), |mask| file.clone().masked(mask));
    let rgb = read(&shown).map_err(Fault::unreadable)?;
    let transparent = empty || (mask.is_none() && file.was_transparent());
    let inside = opened.filter(|_| !empty).map(|mask| read(&mask)).transpose().map_err(Error::from)?;
    let counts = |mask: Vec<u8>| mask.chunks_exact(3).map(|p| p[0] >= 128).collect();
    let mut loaded = Photo {
        name: frame.name.clone(),
        camera: straight_camera(camera, lens.as_ref()),
        rgb: rgb.into(),
        mask: inside.map(counts),
        lens: kept,
    };
    mask_beyond_lens(&mut loaded);
    let posed = PosedPhoto {
        photo: loaded,
        frame: Frame { mask: mask.and_then(|mask| mask.file.clone()), ..frame.clone() },
        held_out: photo.held_out,
        visible: Vec::new(),
    };
    Ok(Loaded { photo: posed, transparent })
}

/// Masks the pixels that a kept lens sees nothing at.
fn mask_beyond_lens(photo: &mut Photo) {
    if photo.lens.is_none() {
        return;
    }
    let (camera, width) = (photo.lens_camera(), photo.camera.width);
    let center = |at: usize| DVec2::new((at % width) as f64 + 0.5, (at / width) as f64 + 0.5);
    let pixels = 0..width * photo.camera.height;
    let seen: Vec<bool> = pixels.into_par_iter().map(|at| camera.point(center(at), 1.0).is_some()).collect();
    if seen.contains(&false) {
        let counts = photo.mask.take().unwrap_or_else(|| vec![true; seen.len()]);
        photo.mask = Some(counts.iter().zip(seen).map(|(counts, seen)| *counts && seen).collect());
    }
}
