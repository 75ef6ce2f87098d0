//! Panoramas among photos: recognized, cut into faces, and masked.

use std::path::{Path, PathBuf};
use weaver_data::capture::{MaskOptions, PhotoMasks};
use weaver_data::{
    EstimatePhotosOptions, EstimatedPhotos, OutputFolder, PhotoSet, Projection, SphereOptions, estimate_set,
};
use weaver_geometry::glam::{DMat3, DVec2, DVec3};
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_io::{Bitmap, Image, Observe, PhotoFile, Transforms, jpeg_of_panorama};
use weaver_procedural::{ProceduralOptions, Walk};

/// An observer that keeps notes.
#[derive(Default)]
struct Told(Vec<String>);

impl Observe for Told {
    fn note(&mut self, text: &str) {
        self.0.push(text.into());
    }
}

fn turn(face: usize) -> DMat3 {
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    let (right, down) = [(x, y), (-z, y), (-x, y), (z, y), (x, z), (x, -z)][face];
    DMat3::from_cols(right, down, right.cross(down)).transpose()
}

/// A panorama of this width, colors by directions.
fn panorama(width: usize, color: impl Fn(DVec3) -> [u8; 3]) -> Bitmap {
    let angle = |x: f64| (x + 0.5) / width as f64 * std::f64::consts::TAU;
    let pixel = |i: usize| {
        let longitude = angle((i % width) as f64) - std::f64::consts::PI;
        let latitude = angle((i / width) as f64) - std::f64::consts::FRAC_PI_2;
        color(DVec3::new(latitude.cos() * longitude.sin(), latitude.sin(), latitude.cos() * longitude.cos()))
    };
    Bitmap { width, height: width / 2, pixels: (0..width * (width / 2)).flat_map(pixel).collect() }
}

fn gray(value: u8, width: usize) -> Bitmap {
    panorama(width, |_| [value; 3])
}

fn write(path: &Path, picture: &Bitmap, recorded: bool) {
    let jpeg = picture.to_jpeg(95).unwrap();
    let size = (picture.width, picture.height);
    std::fs::write(path, if recorded { jpeg_of_panorama(jpeg, size) } else { jpeg }).unwrap();
}

/// Cuts photos, into the folder `out` beside them.
fn cut(
    paths: &[PathBuf],
    options: &SphereOptions,
    masks: Option<PhotoMasks>,
) -> (Result<PhotoSet, String>, Vec<String>) {
    let out = paths[0].parent().unwrap().parent().unwrap().join("out");
    let out = OutputFolder::claim(out, "cameras", paths).unwrap();
    let mut told = Told::default();
    let set = PhotoSet::new(paths, &vec![false; paths.len()], masks).cut(paths, options, &out, &mut told);
    (set.map_err(|error| error.to_string()), told.0)
}

fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let photos = folder.path().join("photos");
    std::fs::create_dir(&photos).unwrap();
    (folder, photos)
}

/// Promise (photos): a photo that is twice as wide as high is no panorama unless its file or a flag says so.
#[test]
fn only_records_and_flags_make_panoramas() {
    let (_folder, photos) = folder();
    let paths = ["a.jpg", "b.jpg", "c.jpg"].map(|name| photos.join(name));
    paths.iter().zip([true, false, true]).for_each(|(path, recorded)| write(path, &gray(120, 128), recorded));
    let (set, told) = cut(&paths, &SphereOptions::default(), None);
    let names = |set: &PhotoSet| -> Vec<String> {
        set.paths.iter().map(|path| path.file_stem().unwrap().to_string_lossy().into_owned()).collect()
    };
    let set = set.unwrap();
    assert_eq!(set.paths.len(), 13);
    assert_eq!(&names(&set)[..7], ["a-front", "a-right", "a-back", "a-left", "a-up", "a-down", "b"]);
    assert_eq!((&set.originals[0], &set.originals[6], set.masks.is_none()), (&paths[0], &paths[1], true));
    assert!(
        told.iter().any(|note| note.contains("b.jpg") && note.contains("--projection equirectangular")),
        "{told:?}"
    );
    let asked = SphereOptions { projection: Some(Projection::Equirectangular), ..SphereOptions::default() };
    assert_eq!(cut(&paths, &asked, None).0.unwrap().paths.len(), 18);
    let never = SphereOptions { projection: Some(Projection::Pinhole), ..SphereOptions::default() };
    assert_eq!(cut(&paths, &never, None).0.unwrap().paths, paths);
}

#[test]
fn panoramas_that_are_none_are_named() {
    let (_folder, photos) = folder();
    let paths = ["a.jpg", "b.jpg"].map(|name| photos.join(name));
    paths.iter().for_each(|path| Image::filled(40, 30, [0.4; 3]).write_png(path).unwrap());
    let asked = SphereOptions { projection: Some(Projection::Equirectangular), ..SphereOptions::default() };
    let error = cut(&paths, &asked, None).0.unwrap_err();
    assert!(error.contains("a.jpg") && error.contains("twice as wide as high") && error.contains("40 x 30"), "{error}");
    write(&paths[0], &gray(90, 64), true);
    let error = cut(&paths[..1], &SphereOptions::default(), None).0.unwrap_err();
    assert!(error.contains("a.jpg") && error.contains("panoramas from at least two places"), "{error}");
}

/// The part of a mask that is white.
fn white(mask: &Path) -> f64 {
    let mask = PhotoFile::at(mask).unwrap().read().unwrap();
    mask.pixels.iter().filter(|x| **x == 255).count() as f64 / mask.pixels.len() as f64
}

fn masks_of(out: &Path, name: &str) -> f64 {
    white(&out.join(format!("faces/masks/{name}.png")))
}

/// Promise (photos): masks of panoramas are cut as they are, and `--nadir` leaves out what stands below the camera.
#[test]
fn faces_have_the_masks_of_panoramas() {
    let (folder, photos) = folder();
    let out = folder.path().join("out");
    let paths = ["a.jpg", "b.jpg", "c.png"].map(|name| photos.join(name));
    paths[..2].iter().for_each(|path| write(path, &gray(120, 128), true));
    Image::filled(40, 30, [0.4; 3]).write_png(&paths[2]).unwrap();
    let nadir = SphereOptions { nadir: Some(30.0), ..SphereOptions::default() };
    let set = cut(&paths, &nadir, None).0.unwrap();
    assert!(set.masks.is_some());
    let down = masks_of(&out, "a-down");
    // A circle of 30 degrees in a square of 95.
    let expected = 1.0 - std::f64::consts::PI * (30_f64.to_radians().tan() / 47.5_f64.to_radians().tan() / 2.0).powi(2);
    assert!((down - expected).abs() < 0.03, "{down}, not {expected}");
    assert_eq!((masks_of(&out, "a-front"), masks_of(&out, "b-up"), masks_of(&out, "c")), (1.0, 1.0, 1.0));
    // What is to the right does not count; in one mask.
    std::fs::create_dir(photos.join("masks")).unwrap();
    for name in ["a.png", "b.png"] {
        let counts = |x: f64| if name == "a.png" && x > 0.0 { 0 } else { 255 };
        panorama(128, |direction| [counts(direction.x); 3]).write_png(photos.join("masks").join(name)).unwrap();
    }
    Image::filled(40, 30, [1.0; 3]).write_png(photos.join("masks/c.png")).unwrap();
    let masks = PhotoMasks::find(&paths, &MaskOptions::default()).unwrap();
    let keep = SphereOptions { nadir: Some(0.0), ..SphereOptions::default() };
    let set = cut(&paths, &keep, Some(masks)).0.unwrap();
    let latest = |name: &str| {
        let of = |path: &&PathBuf| path.file_stem().is_some_and(|stem| stem == name);
        let path = set.paths.iter().find(of).unwrap();
        path.parent().unwrap().join("masks")
    };
    let folder = latest("a-right");
    let white_of = |name: &str| {
        let numbered = folder.join(format!("{name}-2.png"));
        white(&if numbered.is_file() { numbered } else { folder.join(format!("{name}.png")) })
    };
    assert_eq!((white_of("a-right"), white_of("a-left"), white_of("b-right")), (0.0, 1.0, 1.0));
    assert!((white_of("a-front") - 0.5).abs() < 0.03);
}

/// A panorama without its upper half: nothing is above, and half of each side is masked.
#[test]
fn a_part_of_a_sphere_has_masked_faces() {
    let (folder, photos) = folder();
    let paths = ["a.jpg", "b.jpg"].map(|name| photos.join(name));
    for path in &paths {
        let lower = Bitmap { width: 128, height: 32, pixels: vec![100; 3 * 128 * 32] };
        let record = "GPano:ProjectionType=\"equirectangular\" GPano:FullPanoWidthPixels=\"128\" \
                      GPano:FullPanoHeightPixels=\"64\" GPano:CroppedAreaTopPixels=\"32\"";
        let content = [b"http://ns.adobe.com/xap/1.0/\0", record.as_bytes()].concat();
        let segment = [&[0xff, 0xe1][..], &((content.len() + 2) as u16).to_be_bytes(), &content].concat();
        let jpeg = lower.to_jpeg(95).unwrap();
        std::fs::write(path, [&jpeg[..2], &segment, &jpeg[2..]].concat()).unwrap();
    }
    let set = cut(&paths, &SphereOptions { nadir: Some(0.0), ..SphereOptions::default() }, None).0.unwrap();
    assert_eq!(set.paths.len(), 10, "{:?}", set.paths);
    let out = folder.path().join("out");
    assert!((masks_of(&out, "a-front") - 0.5).abs() < 0.03 && masks_of(&out, "b-down") > 0.99);
}

/// Faces of four panoramas along a street, through files, with what their cameras are written as.
///
/// Promise (photos): cameras of panoramas are written for their faces, which name the panorama.
#[test]
fn cameras_of_panoramas_are_written_for_faces() {
    let (folder, photos) = folder();
    let walk = Walk::street(3, &ProceduralOptions { width: 64, height: 48, views: 60 });
    let paths: Vec<PathBuf> = (0..4).map(|i| photos.join(format!("{i}.jpg"))).collect();
    for (i, path) in paths.iter().enumerate() {
        let side = 240;
        let intrinsics = Intrinsics { fx: 110.0, fy: 110.0, cx: 120.0, cy: 120.0 };
        let camera = |face: usize| {
            let pose = Pose::new(turn(face), DVec3::ZERO).compose(&walk.cameras()[3 + 2 * i].pose);
            Camera { pose, intrinsics, width: side, height: side }
        };
        let faces: Vec<Image> = (0..6).map(|face| walk.seen_by(&camera(face), 6 * i + face).image).collect();
        let color = |direction: DVec3| {
            let face = (0..6).max_by(|a, b| (turn(*a) * direction).z.total_cmp(&(turn(*b) * direction).z)).unwrap();
            let at: DVec2 = intrinsics.project(turn(face) * direction);
            let pixel = 3 * ((at.y as usize).min(side - 1) * side + (at.x as usize).min(side - 1));
            std::array::from_fn(|c| (255.0 * faces[face].pixels[pixel + c]) as u8)
        };
        write(path, &panorama(512, color), true);
    }
    let out = OutputFolder::claim(folder.path().join("out"), "cameras", &paths).unwrap();
    let set = PhotoSet::new(&paths, &[false; 4], None).cut(&paths, &SphereOptions::default(), &out, &mut ()).unwrap();
    EstimatedPhotos::check(&out, &set.paths).unwrap();
    let found = estimate_set(&set, &EstimatePhotosOptions::default()).unwrap();
    assert_eq!((found.placed().len(), found.left_out(), found.lenses()), (24, vec![], 0));
    found.write(&out).unwrap();
    set.remove_earlier_faces(&out).unwrap();
    let read = Transforms::read(folder.path().join("out/transforms.json")).unwrap();
    assert_eq!(read.frames.len(), 24);
    for (frame, name) in read.frames.iter().zip(["front", "right", "back", "left", "up", "down"].iter().cycle()) {
        assert_eq!(frame.extras["face"], format!("\"{name}\""));
        assert!(frame.extras["panorama"].contains("photos/"), "{:?}", frame.extras);
        let k = frame.camera.intrinsics;
        assert!((k.fx * 47.5_f64.to_radians().tan() - frame.camera.width as f64 / 2.0).abs() < 1e-6 && k.fx == k.fy);
        assert!(frame.distortion.is_none() && PhotoFile::at(&frame.path).is_ok());
    }
    for rig in read.frames.chunks(6) {
        let center = rig[0].camera.pose.center();
        assert!(rig.iter().all(|frame| frame.camera.pose.center().distance(center) < 1e-6));
    }
}
