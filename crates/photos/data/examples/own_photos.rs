//! Makes copies of a capture that are like users' own photos: `cargo run --release -p weaver-data --example own_photos
//! CAPTURE OUT`.
//!
//! Each is a folder in OUT with photos as PNG and a COLMAP model as text, made of the capture's own, which must be
//! undistorted:
//!
//! | copy | its photos |
//! |---|---|
//! | `clean` | as they are |
//! | `distorted` | taken by a lens with k1, k2, p1 and p2, twice as large, so that making them costs no detail |
//! | `turned` | stored on their side, which EXIF says |
//! | `masked` | with noise in a rectangle, which `masks/` leaves out |
//! | `covered` | with the same masks and no noise |
//! | `whole` | without masks but for those that are held out |
//!
//! Every eighth photo, which loading holds out, has the same picture in all of them as in `clean`, so that all are
//! judged by the same photos. Loaded at 64 x 48 pixels, they have the same cameras: the focal length of `distorted` is
//! chosen so that undoing the lens leaves the same photos. Loaded at 64 x 48 pixels, they have the same cameras: the
//! lens of `distorted` has the focal length with which nothing else is left of its photos.

use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use weaver_data::capture::Crop;
use weaver_geometry::glam::DVec2;
use weaver_geometry::{Camera, Distortion, Pose, Undistortion};
use weaver_io::colmap::{self, CameraModel, Model};
use weaver_io::{Bitmap, PhotoFile};
use weaver_kernels::random::Stream;

/// The size at which cameras are to be the same.
const SIZE: [usize; 2] = [64, 48];
const LENS: Distortion = Distortion::Radial { k: [-0.28, 0.09, 0.0, 0.0, 0.0, 0.0], p: [0.003, -0.002] };
/// Factor on the size of distorted photos.
const LARGER: usize = 2;
/// Factor on the size of photos that a lens takes.
const ENLARGED: usize = 4;
/// The part of each side that a mask covers.
const COVERED: usize = 3;
const HELD_OUT: usize = 8;

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Clean,
    Distorted,
    Turned,
    Masked,
    Covered,
    Whole,
}

const COPIES: [(&str, Kind); 6] = [
    ("clean", Kind::Clean),
    ("distorted", Kind::Distorted),
    ("turned", Kind::Turned),
    ("masked", Kind::Masked),
    ("covered", Kind::Covered),
    ("whole", Kind::Whole),
];

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [capture, out] = &arguments[..] else { return Err("expected a capture and a folder for its copies".into()) };
    let (capture, out) = (Path::new(capture), Path::new(out));
    let mut model = Model::read(colmap::model_folder(capture))?;
    model.images.sort_by(|a, b| a.name.cmp(&b.name));
    for (name, kind) in COPIES {
        copy(&model, &capture.join("images"), kind, &out.join(name))?;
        println!("{}", out.join(name).display());
    }
    Ok(())
}

fn copy(model: &Model, photos: &Path, kind: Kind, out: &Path) -> Result<(), Box<dyn Error>> {
    fs::create_dir_all(out.join("sparse/0"))?;
    let mut copied = Model { points: model.points.clone(), ..Model::default() };
    for (i, record) in model.images.iter().enumerate() {
        let mut camera = *model.cameras.get(&record.camera_id).ok_or("a photo without a camera")?;
        if camera.distortion.is_some() {
            return Err(format!("{}: expected a photo without distortion", record.name).into());
        }
        let mut record = record.clone();
        let file = PhotoFile::at(photos.join(&record.name))?.for_camera(camera.width, camera.height);
        record.name = Path::new(&record.name).with_extension("png").display().to_string();
        let (path, held_out) = (place(out, "images", &record.name)?, i % HELD_OUT == 0);
        let covered = Rectangle::in_photo(camera.width, camera.height, i as u64);
        let mask = match kind {
            Kind::Masked | Kind::Covered => Some(covered),
            Kind::Whole => Some(if held_out { covered } else { Rectangle::default() }),
            _ => None,
        };
        if let Some(mask) = mask {
            let masked = mask.filled(&white(camera.width, camera.height), |_| 0);
            masked.write_png(place(out, "masks", &record.name)?)?;
        }
        match kind {
            Kind::Distorted if !held_out => {
                let pinhole = camera;
                camera = distorted(pinhole)?;
                taken(&file, &pinhole, &camera)?.write_png(path)?;
                for (x, y, _) in &mut record.points {
                    let at = pinhole.intrinsics.unproject(DVec2::new(*x, *y), 1.0).truncate();
                    [*x, *y] = camera.intrinsics.project(LENS.distort(at).extend(1.0)).to_array();
                }
            }
            Kind::Turned => write_turned(&path, &file.read()?, i % 2 == 0)?,
            Kind::Masked => {
                let noise = Stream::new(i as u64, 0, "noise");
                covered.filled(&file.read()?, |at| noise.bits(at as u64) as u8).write_png(path)?;
            }
            _ => file.read()?.write_png(path)?,
        }
        record.camera_id = record.id;
        copied.cameras.insert(record.id, camera);
        copied.images.push(record);
    }
    Ok(copied.write_text(out.join("sparse/0"))?)
}

/// A file of a copy, in a folder that is there.
fn place(out: &Path, kind: &str, name: &str) -> std::io::Result<PathBuf> {
    let path = out.join(kind).join(name);
    fs::create_dir_all(path.parent().unwrap_or(out))?;
    Ok(path)
}

fn white(width: usize, height: usize) -> Bitmap {
    Bitmap { width, height, pixels: vec![255; 3 * width * height] }
}

/// A part of a photo, pixels.
#[derive(Clone, Copy, Default)]
struct Rectangle {
    left: usize,
    top: usize,
    width: usize,
    height: usize,
}

impl Rectangle {
    /// Somewhere in the part of a photo that is looked at.
    fn in_photo(width: usize, height: usize, number: u64) -> Self {
        let [w, h] = [width.min(height * SIZE[0] / SIZE[1]), height.min(width * SIZE[1] / SIZE[0])];
        let place = Stream::new(number, 0, "mask");
        let within = |index, all: usize, seen: usize| (all - seen) / 2 + place.below(index, seen - seen / COVERED);
        Self { left: within(0, width, w), top: within(1, height, h), width: w / COVERED, height: h / COVERED }
    }

    /// The photo with these numbers in place of those inside.
    fn filled(&self, photo: &Bitmap, number: impl Fn(usize) -> u8) -> Bitmap {
        let mut filled = photo.clone();
        for y in self.top..self.top + self.height {
            let row = 3 * (y * photo.width + self.left);
            (row..row + 3 * self.width).for_each(|at| filled.pixels[at] = number(at));
        }
        filled
    }
}

/// The camera with a lens that becomes this pinhole camera once its distortion is undone.
fn distorted(pinhole: CameraModel) -> Result<CameraModel, String> {
    let CameraModel { width, height, intrinsics, .. } = pinhole;
    let crop = Crop::centered(width, height, SIZE[0], SIZE[1]);
    let longer = |factor: f64| {
        let mut longer = intrinsics;
        (longer.fx, longer.fy) = (factor * intrinsics.fx, factor * intrinsics.fy);
        longer
    };
    let is_longer = |factor: f64| {
        let seen = Camera {
            pose: Pose::IDENTITY,
            intrinsics: crop.intrinsics(&longer(factor)),
            width: SIZE[0],
            height: SIZE[1],
        };
        let lens = Undistortion::new(seen, LENS).ok_or("expected a lens that can be undone")?;
        Ok::<_, String>(lens.to.intrinsics.fx > crop.intrinsics(&intrinsics).fx)
    };
    let (mut short, mut long) = (0.5, 2.0);
    for _ in 0..50 {
        let middle = (short + long) / 2.0;
        *(if is_longer(middle)? { &mut long } else { &mut short }) = middle;
    }
    let larger = LARGER as f64;
    let intrinsics = longer(long).resized(larger, larger);
    Ok(CameraModel { width: LARGER * width, height: LARGER * height, intrinsics, distortion: Some(LENS) })
}

/// The photo as a camera with the lens takes it; beyond its borders, its colors go on.
fn taken(file: &PhotoFile, pinhole: &CameraModel, camera: &CameraModel) -> Result<Bitmap, Box<dyn Error>> {
    let enlarged = file.resize_whole(ENLARGED * pinhole.width, ENLARGED * pinhole.height)?;
    let mut taken = white(camera.width, camera.height);
    for (i, color) in taken.pixels.as_chunks_mut::<3>().0.iter_mut().enumerate() {
        let pixel = DVec2::new((i % camera.width) as f64 + 0.5, (i / camera.width) as f64 + 0.5);
        let seen = camera.intrinsics.unproject(pixel, 1.0).truncate();
        let at = ENLARGED as f64 * pinhole.intrinsics.project(straight(seen).extend(1.0));
        *color = color_at(&enlarged, at);
    }
    Ok(taken)
}

/// The direction that the lens sees there: a fixed point, which is found much faster than `Distortion::undistort` looks
/// for it in any lens.
fn straight(seen: DVec2) -> DVec2 {
    (0..40).fold(seen, |at, _| at + seen - LENS.distort(at))
}

/// The color at a place, between the four nearest pixels.
fn color_at(photo: &Bitmap, at: DVec2) -> [u8; 3] {
    let corner = (at - 0.5).floor();
    let part = at - 0.5 - corner;
    let mut sum = [0.0; 3];
    for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
        let within = |at: f64, size: usize| at.clamp(0.0, (size - 1) as f64) as usize;
        let from = 3 * (within(corner.y + dy, photo.height) * photo.width + within(corner.x + dx, photo.width));
        let weight = (1.0 - (dx - part.x).abs()) * (1.0 - (dy - part.y).abs());
        (0..3).for_each(|c| sum[c] += weight * f64::from(photo.pixels[from + c]));
    }
    sum.map(|x| x.round() as u8)
}

/// Stores a photo on its side, to the left or to the right, and how it is turned upright.
fn write_turned(path: &Path, photo: &Bitmap, left: bool) -> Result<(), Box<dyn Error>> {
    let (width, height) = (photo.height as u32, photo.width as u32);
    let upright = |x: usize, y: usize| if left { (photo.width - 1 - y, x) } else { (y, photo.height - 1 - x) };
    let pixel = |i: usize| {
        let (x, y) = upright(i % photo.height, i / photo.height);
        let from = 3 * (y * photo.width + x);
        [photo.pixels[from], photo.pixels[from + 1], photo.pixels[from + 2]]
    };
    let stored: Vec<u8> = (0..photo.width * photo.height).flat_map(pixel).collect();
    // A directory with nothing but the orientation: 6 is upright once it is turned to the right, 8 to the left.
    let exif = [&b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0"[..], &[if left { 6 } else { 8 }], &[0; 7]].concat();
    let mut encoder = PngEncoder::new(fs::File::create(path)?);
    encoder.set_exif_metadata(exif)?;
    Ok(encoder.write_image(&stored, width, height, ExtendedColorType::Rgb8)?)
}
