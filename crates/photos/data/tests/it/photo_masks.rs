//! Masks of photos whose cameras are estimated, and masks of empty space.

use crate::claimed;
use std::fs;
use std::path::{Path, PathBuf};
use weaver_data::capture::{MaskOptions, PhotoMasks};
use weaver_data::posed::{self, Masked, PosedOptions};
use weaver_data::{EstimatePhotosOptions, EstimatedPhotos, estimate_masked_photos, estimate_photos};
use weaver_geometry::Pose;
use weaver_io::{Background, Image, PhotoFile, Transforms};
use weaver_procedural::{ProceduralOptions, scene};

const WIDTH: usize = 128;
const HEIGHT: usize = 96;
const PHOTOS: usize = 5;

/// True if a pixel counts: the left third is masked.
fn counts(i: usize) -> bool {
    i % WIDTH >= WIDTH / 3
}

/// Photos of a place, with the same poster in the left third of each, as a sticker on the lens would be; masks are in
/// `masks`, black where it is.
fn photos(folder: &Path) -> (Vec<PathBuf>, Vec<Pose>) {
    let truth = scene(3, &ProceduralOptions { width: WIDTH, height: HEIGHT, views: 8 });
    let poster = scene(5, &ProceduralOptions { width: WIDTH, height: HEIGHT, views: 1 }).views[0].image.clone();
    for name in ["photos", "masks"] {
        fs::create_dir_all(folder.join(name)).unwrap();
    }
    let write = |view: usize| {
        let mut photo = truth.views[view].image.clone();
        let mut mask = Image::filled(WIDTH, HEIGHT, [1.0; 3]);
        for i in (0..WIDTH * HEIGHT).filter(|i| !counts(*i)) {
            photo.pixels[3 * i..3 * i + 3].copy_from_slice(&poster.pixels[3 * i..3 * i + 3]);
            mask.pixels[3 * i..3 * i + 3].fill(0.0);
        }
        mask.write_png(folder.join(format!("masks/{view}.png"))).unwrap();
        let path = folder.join(format!("photos/{view}.png"));
        photo.write_png(&path).unwrap();
        path
    };
    ((0..PHOTOS).map(write).collect(), truth.views.iter().map(|view| view.camera.pose).collect())
}

fn options() -> EstimatePhotosOptions {
    let camera = scene(3, &ProceduralOptions { width: WIDTH, height: HEIGHT, views: 8 }).views[0].camera;
    let focal = Some(camera.intrinsics.fx / camera.width as f64);
    EstimatePhotosOptions { focal, ..EstimatePhotosOptions::default() }
}

fn estimated(paths: &[PathBuf], masks: &MaskOptions) -> EstimatedPhotos {
    let masks = PhotoMasks::find(paths, masks).unwrap();
    estimate_masked_photos(paths, &vec![false; paths.len()], Some(&masks), &options()).unwrap()
}

/// The largest rotation between estimated cameras and true ones, relative to the first, degrees.
fn off(found: &EstimatedPhotos, truth: &[Pose]) -> f64 {
    let poses: Vec<Pose> = found.estimate.cameras.iter().map(|camera| camera.unwrap().pose).collect();
    let turned = |i: usize| poses[i].relative_to(&poses[0]).angle_to(&truth[i].relative_to(&truth[0])).to_degrees();
    (1..poses.len()).map(turned).fold(0.0, f64::max)
}

/// Promise (photos): `cameras --masks` matches nothing that masks leave out, and names the masks in transforms.json.
#[test]
fn nothing_that_masks_leave_out_is_matched() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let (paths, truth) = photos(folder);
    let at_masks = |found: &EstimatedPhotos| {
        let masked = |pixel: weaver_geometry::glam::DVec2| !counts(pixel.x as usize);
        found.estimate.observations.iter().filter(|o| masked(o.pixel)).count()
    };
    let seen = estimate_photos(&paths, &[false; PHOTOS], &options()).unwrap();
    assert!(at_masks(&seen) > 0, "the poster is there to be matched");
    let found = estimated(&paths, &MaskOptions::default());
    assert_eq!((found.placed().len(), at_masks(&found)), (PHOTOS, 0));
    assert!(off(&found, &truth) < 1.5, "{} degrees", off(&found, &truth));
    let out = folder.join("found");
    found.write(&claimed(&out)).unwrap();
    let frames = Transforms::read(out.join("transforms.json")).unwrap().frames;
    assert_eq!(frames[1].mask.as_deref(), Some(Path::new("../masks/1.png")));
    let fitted = posed::load(&out, &PosedOptions { masks: true, ..PosedOptions::default() }).unwrap();
    let mask: Vec<bool> = (0..WIDTH * HEIGHT).map(counts).collect();
    assert!(fitted.photos.iter().all(|photo| photo.photo.mask.as_ref() == Some(&mask)));
}

/// Promise (photos): with `--invert-masks` black counts, and the masks of the written capture are as other
/// programs read them.
#[test]
fn masks_whose_black_counts_are_written_the_other_way() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let (paths, _) = photos(folder);
    let expected = estimated(&paths, &MaskOptions::default());
    fs::create_dir(folder.join("negatives")).unwrap();
    for view in 0..PHOTOS {
        let negative = PhotoFile::at(folder.join(format!("masks/{view}.png"))).unwrap().inverted().read().unwrap();
        negative.write_png(folder.join(format!("negatives/{view}.png.png"))).unwrap();
    }
    let found = estimated(&paths, &MaskOptions { folder: Some(folder.join("negatives")), inverted: true });
    assert_eq!(found.estimate.cameras, expected.estimate.cameras);
    let out = folder.join("found");
    found.write(&claimed(&out)).unwrap();
    let frames = Transforms::read(out.join("transforms.json")).unwrap().frames;
    assert_eq!(frames[1].mask.as_deref(), Some(Path::new("masks/1.png")));
    let read = |path: PathBuf| Image::read(path, Background::White).unwrap();
    assert_eq!(read(out.join("masks/1.png")), read(folder.join("masks/1.png")));
}

/// Promise (photos): masks that are missing, of another size, of no photo or black all over are named with what to do.
#[test]
fn unusable_masks_are_named() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let (paths, _) = photos(folder);
    let masks = folder.join("own");
    let given = MaskOptions { folder: Some(masks.clone()), inverted: false };
    let find = || PhotoMasks::find(&paths, &given);
    let says = |expected: &[&str]| {
        let found = find().and_then(|masks| {
            estimate_masked_photos(&paths, &[false; PHOTOS], Some(&masks), &options()).map(|found| found.remarks)
        });
        let text = found.map_or_else(|error| error.to_string(), |remarks| remarks.join("\n")).replace('\\', "/");
        expected.iter().for_each(|part| assert!(text.contains(part), "{part}: {text}"));
    };
    says(&["own: masks: expected a folder of masks", "no such folder"]);
    fs::create_dir(&masks).unwrap();
    says(&["photos/0.png: mask: expected", "own/0.png", "no such file, and no alpha"]);
    for view in 0..PHOTOS {
        fs::copy(folder.join(format!("masks/{view}.png")), masks.join(format!("{view}.png"))).unwrap();
    }
    Image::filled(WIDTH, HEIGHT, [1.0; 3]).write_png(masks.join("9.png")).unwrap();
    Image::filled(WIDTH, HEIGHT, [0.0; 3]).write_png(masks.join("4.png")).unwrap();
    says(&["no photo has the name of", "own/9.png", "masks cover all of", "photos/4.png"]);
    Image::filled(WIDTH / 2, HEIGHT / 2, [1.0; 3]).write_png(masks.join("2.png")).unwrap();
    says(&["own/2.png: image size: expected 128x96, its photo's, found 64x48"]);
    for view in 0..PHOTOS {
        Image::filled(WIDTH, HEIGHT, [0.0; 3]).write_png(masks.join(format!("{view}.png"))).unwrap();
    }
    says(&["photos/0.png: mask", "black all over, in the masks of all photos", "--invert-masks"]);
    // Photos are no masks of themselves.
    let itself = MaskOptions { folder: Some(folder.join("photos")), inverted: false };
    let message = PhotoMasks::find(&paths, &itself).unwrap_err().to_string();
    assert!(message.contains("photos/0.png: mask: expected a file beside it, found the photo itself"), "{message}");
}

/// Promise (photos): pixels that masks call empty show the background and count, as transparent ones do.
#[test]
fn masked_pixels_may_be_empty_space() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let (paths, _) = photos(folder);
    let out = folder.join("found");
    estimated(&paths, &MaskOptions::default()).write(&claimed(&out)).unwrap();
    let background = [0.0, 0.0, 1.0];
    for invert_masks in [false, true] {
        let empty =
            PosedOptions { masks: true, masked: Masked::Empty, invert_masks, background, ..PosedOptions::default() };
        let loaded = posed::load(&out, &empty).unwrap();
        assert!(loaded.transparent && loaded.remarks.is_empty(), "{:?}", loaded.remarks);
        for (photo, path) in loaded.photos.iter().zip(&paths) {
            let as_it_is = PhotoFile::at(path).unwrap().read().unwrap().pixels;
            assert_eq!(photo.photo.mask, None);
            for (i, (color, own)) in photo.photo.rgb.chunks(3).zip(as_it_is.chunks(3)).enumerate() {
                let expected = if counts(i) == invert_masks { &[0, 0, 255] } else { own };
                assert_eq!(color, expected, "{i}");
            }
        }
    }
    // A mask is not read unless it is asked for.
    let plain = posed::load(&out, &PosedOptions { masked: Masked::Empty, ..PosedOptions::default() }).unwrap();
    assert!(!plain.transparent && plain.photos[0].photo.mask.is_none());
}
