//! Photos of every kind and every way up.

use image::metadata::Orientation;
use image::{DynamicImage, ImageEncoder, codecs::png::PngEncoder};
use std::path::{Path, PathBuf};
use weaver_io::{Background, Bitmap, Image, PhotoFile, PhotoFolder, list_photos};

/// The ramp of the fixtures: red grows to the right, green downward.
fn ramp() -> Bitmap {
    let pixels = (0..16u8).flat_map(|y| (0..24u8).flat_map(move |x| [20 + 9 * x, 30 + 12 * y, 128])).collect();
    Bitmap { width: 24, height: 16, pixels }
}

fn dynamic(bitmap: &Bitmap) -> DynamicImage {
    image::RgbImage::from_raw(bitmap.width as u32, bitmap.height as u32, bitmap.pixels.clone()).unwrap().into()
}

fn most_apart(a: &Bitmap, b: &Bitmap) -> u8 {
    assert_eq!((a.width, a.height, a.pixels.len()), (b.width, b.height, b.pixels.len()));
    a.pixels.iter().zip(&b.pixels).map(|(a, b)| a.abs_diff(*b)).max().unwrap()
}

/// A PNG with an EXIF orientation.
fn write_oriented(path: &Path, stored: &DynamicImage, orientation: Orientation) {
    let mut exif = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
    exif.extend([orientation.to_exif(), 0, 0, 0, 0, 0, 0, 0]);
    let mut encoder = PngEncoder::new(std::fs::File::create(path).unwrap());
    encoder.set_exif_metadata(exif).unwrap();
    encoder.write_image(stored.as_bytes(), stored.width(), stored.height(), stored.color().into()).unwrap();
}

const TURNS: [Orientation; 8] = [
    Orientation::NoTransforms,
    Orientation::FlipHorizontal,
    Orientation::Rotate180,
    Orientation::FlipVertical,
    Orientation::Rotate90FlipH,
    Orientation::Rotate90,
    Orientation::Rotate270FlipH,
    Orientation::Rotate270,
];

/// Photos are read upright unless a camera says otherwise.
///
/// Promise (photos): photos are read upright, whichever way they are stored; with cameras only if these are for the
/// upright photo.
#[test]
fn photos_are_read_upright() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let stored = ramp();
    for orientation in TURNS {
        write_oriented(&path, &dynamic(&stored), orientation);
        let mut upright = dynamic(&stored);
        upright.apply_orientation(orientation);
        let size = (upright.width() as usize, upright.height() as usize);
        let upright = Bitmap { width: size.0, height: size.1, pixels: upright.into_rgb8().into_raw() };
        let photo = PhotoFile::at(&path).unwrap();
        assert_eq!((photo.size(), photo.stored_size()), (size, (24, 16)), "{orientation:?}");
        assert_eq!(Image::dimensions(&path).unwrap(), size);
        assert_eq!(photo.read().unwrap(), upright, "{orientation:?}");
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(Image::decode(&bytes, "bytes", Background::White).unwrap(), upright.to_image(), "{orientation:?}");
        // Resizing sees the same photo.
        let part = [0.5, 1.0, 14.5, 15.0];
        assert_eq!(photo.resize(5, 4, part).unwrap().to_image(), upright.to_image().resize(5, 4, part));
        assert_eq!(photo.resize_bicubic(5, 4).unwrap().to_image(), upright.to_image().resize_bicubic(5, 4));
        // Of a camera of the stored photo, of the upright one, and of neither.
        assert_eq!(photo.clone().for_camera(24, 16).read().unwrap(), stored, "{orientation:?}");
        let turned = if size == (16, 24) { &upright } else { &stored };
        assert_eq!(&photo.clone().for_camera(16, 24).read().unwrap(), turned, "{orientation:?}");
        assert_eq!(photo.for_camera(12, 8).size(), (24, 16), "{orientation:?}");
    }
}

/// A square photo with a camera is left as it is stored.
#[test]
fn square_photos_with_cameras_stay_as_stored() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let image = dynamic(&ramp()).crop_imm(0, 0, 16, 16);
    write_oriented(&path, &image, Orientation::Rotate90);
    let photo = PhotoFile::at(&path).unwrap();
    assert_ne!(photo.read().unwrap().pixels, image.as_bytes());
    assert_eq!(photo.for_camera(16, 16).read().unwrap().pixels, image.as_bytes());
}

/// Promise (photos): JPEG (progressive, CMYK), PNG, TIFF and WebP of 8 and 16 bits are read, with or without alpha.
#[test]
fn every_kind_of_photo_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let rgb = dynamic(&ramp());
    for name in ["a.png", "a.tif", "a.webp"] {
        for (kind, image) in [("rgb8", rgb.clone()), ("rgb16", rgb.to_rgb16().into()), ("rgba8", rgb.to_rgba8().into())]
        {
            if name == "a.webp" && kind == "rgb16" {
                continue;
            }
            let path = folder.path().join(name);
            image.save(&path).unwrap();
            let photo = PhotoFile::at(&path).unwrap();
            assert_eq!(photo.read().unwrap(), ramp(), "{name} {kind}");
            assert_eq!(photo.alpha().is_some(), kind == "rgba8", "{name} {kind}");
        }
    }
    let fixtures = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    for (name, most) in [("progressive.jpg", 4), ("cmyk.jpg", 4), ("lossy.webp", 12)] {
        let photo = PhotoFile::at(fixtures.join(name)).unwrap();
        assert!(most_apart(&photo.read().unwrap(), &ramp()) <= most, "{name}");
    }
}

/// Promise of `every_kind_of_photo_is_read`.
#[test]
fn alpha_is_composited_or_read_by_itself() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    image::RgbaImage::from_raw(3, 1, vec![9, 8, 7, 255, 200, 100, 0, 0, 200, 100, 0, 51]).unwrap().save(&path).unwrap();
    let photo = || PhotoFile::at(&path).unwrap();
    assert_eq!(photo().read().unwrap().pixels, [9, 8, 7, 255, 255, 255, 244, 224, 204]);
    assert_eq!(photo().over([0.0, 0.0, 1.0]).read().unwrap().pixels, [9, 8, 7, 0, 0, 255, 40, 20, 204]);
    let alpha = photo().alpha().unwrap().read().unwrap();
    assert_eq!(alpha.pixels, [255, 255, 255, 0, 0, 0, 51, 51, 51]);
}

/// Promise (photos): where HEIC and AVIF are not decoded, they get an error with the command that converts them.
#[test]
fn what_cannot_be_read_says_why_and_how_to_convert_it() {
    let folder = tempfile::tempdir().unwrap();
    let says = |name: &str, bytes: &[u8], parts: &[&str]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let message = PhotoFile::at(&path).unwrap_err().to_string();
        parts.iter().chain([&name]).for_each(|part| assert!(message.contains(part), "{part}: {message}"));
    };
    says(
        "a.heic",
        b"\0\0\0\x18ftypheic\0\0\0\0mif1heic",
        &["found HEIC: convert it to JPEG", "to JPEG, for instance with `"],
    );
    // By content, under any name.
    says("b.jpg", b"\0\0\0\x18ftypmif1\0\0\0\0mif1heic", &["HEIC"]);
    says("c.avif", b"\0\0\0\x18ftypavif\0\0\0\0avif", &["AVIF"]);
    says("d.png", b"no photo at all", &["expected a JPEG, PNG, TIFF or WebP image"]);
    assert!(PhotoFile::at(folder.path().join("none.png")).unwrap_err().to_string().contains("none.png"));
    // A file that has to be converted is listed, so that it is not left out without a word.
    std::fs::write(folder.path().join("notes.txt"), "").unwrap();
    let names: Vec<_> = list_photos(folder.path()).unwrap();
    let names: Vec<_> = names.iter().map(|path| path.file_name().unwrap().to_str().unwrap()).collect();
    assert_eq!(names, ["a.heic", "b.jpg", "c.avif", "d.png"]);
}

/// A photo that changes after it was opened is an error.
#[test]
fn a_photo_that_changes_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    dynamic(&ramp()).save(&path).unwrap();
    let photo = PhotoFile::at(&path).unwrap();
    Image::filled(3, 3, [0.0; 3]).write_png(&path).unwrap();
    let message = photo.read().unwrap_err().to_string();
    assert!(message.contains("expected 24x16 as before, found 3x3"), "{message}");
}

/// A mask covers the photo as it is seen whichever way up either is stored.
#[test]
fn masks_cover_photos_as_they_are_seen() {
    let folder = tempfile::tempdir().unwrap();
    let [path, mask] = ["a.png", "m.png"].map(|name| folder.path().join(name));
    for orientation in TURNS {
        write_oriented(&path, &dynamic(&ramp()), orientation);
        let upright = PhotoFile::at(&path).unwrap().read().unwrap();
        let (width, height) = (upright.width, upright.height);
        let part = |i: usize| [0, 255, 102][(i % width + i / width) % 3];
        image::GrayImage::from_fn(width as u32, height as u32, |x, y| {
            image::Luma([part((y as usize) * width + x as usize)])
        })
        .save(&mask)
        .unwrap();
        let photo = PhotoFile::at(&path).unwrap().over([0.0, 0.0, 1.0]);
        let masked = photo.masked(PhotoFile::at(&mask).unwrap()).read().unwrap();
        for (i, (found, color)) in masked.pixels.chunks(3).zip(upright.pixels.chunks(3)).enumerate() {
            let share = f32::from(part(i)) / 255.0;
            let over = |c: usize| (f32::from(color[c]) * share + [0.0, 0.0, 255.0][c] * (1.0 - share)).round() as u8;
            assert!((0..3).all(|c| found[c].abs_diff(over(c)) <= 1), "{orientation:?} {i}: {found:?}");
        }
    }
    image::GrayImage::new(5, 7).save(&mask).unwrap();
    let other = PhotoFile::at(&path).unwrap().masked(PhotoFile::at(&mask).unwrap()).read();
    let message = other.unwrap_err().to_string();
    assert!(message.contains("m.png") && message.contains("its photo's") && message.contains("5x7"), "{message}");
}

/// Hidden files are no photos and links that lead nowhere are listed.
///
/// Promise of `a_few_unreadable_photos_are_left_out`.
#[test]
fn hidden_files_and_broken_links() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.jpg", "._a.jpg", ".b.png"] {
        std::fs::write(folder.path().join(name), "").unwrap();
    }
    std::fs::create_dir(folder.path().join("folder.jpg")).unwrap();
    #[cfg(unix)]
    std::os::unix::fs::symlink("gone.jpg", folder.path().join("link.jpg")).unwrap();
    let names: Vec<_> = list_photos(folder.path()).unwrap();
    let names: Vec<_> = names.iter().map(|path| path.file_name().unwrap().to_str().unwrap()).collect();
    assert_eq!(names, if cfg!(unix) { vec!["a.jpg", "link.jpg"] } else { vec!["a.jpg"] });
}

/// A photo says whether its orientation follows from its size.
///
/// Promise (photos): photos that are mirrored, upside down, or square and on their side are matched and written
/// upright.
#[test]
fn a_size_may_not_tell_which_way_is_up() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let stored = dynamic(&ramp());
    for orientation in TURNS {
        write_oriented(&path, &stored, orientation);
        let keeps_size =
            matches!(orientation, Orientation::FlipHorizontal | Orientation::FlipVertical | Orientation::Rotate180);
        assert_eq!(PhotoFile::at(&path).unwrap().has_ambiguous_orientation(), keeps_size, "{orientation:?}");
        write_oriented(&path, &stored.crop_imm(0, 0, 16, 16), orientation);
        let turned = orientation != Orientation::NoTransforms;
        assert_eq!(PhotoFile::at(&path).unwrap().has_ambiguous_orientation(), turned, "{orientation:?}, square");
    }
}

/// A photo that was read says whether it is transparent.
///
/// Promise (photos): photos with transparent parts are named where masks are not read, but for synthetic scenes.
#[test]
fn photos_know_if_they_are_transparent() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let mut rgba = dynamic(&ramp()).into_rgba8();
    for (alpha, transparent) in [(255, false), (254, true)] {
        rgba.get_pixel_mut(20, 15).0[3] = alpha;
        rgba.save(&path).unwrap();
        let photo = PhotoFile::at(&path).unwrap();
        assert!(!photo.was_transparent(), "nothing was read");
        // Transparency counts in the whole file, outside the requested part too.
        photo.clone().resize(2, 2, [0.0, 0.0, 4.0, 4.0]).unwrap();
        assert_eq!(photo.was_transparent(), transparent);
    }
}

/// Folders of a camera's card are found below a folder, and masks, hidden folders and links are not.
///
/// Promise (files): photos in folders below the one that is given are named.
#[test]
fn photos_in_folders_below_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str| {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, "").unwrap();
    };
    let photos = ["DCIM/100APPLE/a.jpg", "DCIM/100APPLE/b.HEIC", "DCIM/101APPLE/c.jpg", "masks/a.png", ".thumbs/a.jpg"];
    photos.into_iter().chain(["a.bmp", "b.BMP", "notes.txt"]).for_each(write);
    #[cfg(unix)]
    std::os::unix::fs::symlink(folder.path(), folder.path().join("loop")).unwrap();
    let found = PhotoFolder::open(folder.path()).unwrap();
    let below = |name: &str, count: usize| (folder.path().join(name), count);
    assert_eq!((found.photos.len(), found.below), (0, vec![below("DCIM/100APPLE", 2), below("DCIM/101APPLE", 1)]));
    assert_eq!(found.others, [("bmp".to_string(), 2), ("txt".to_string(), 1)]);
    write("top.jpg");
    let found = PhotoFolder::open(folder.path()).unwrap();
    assert_eq!((found.photos.len(), found.below.len()), (1, 2));
}

/// Photos whose names are numbers are listed in the order of the numbers.
///
/// Promise of `scans_are_taken_in_the_order_of_their_numbers`.
#[test]
fn photos_are_listed_by_their_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let names = ["a2b1", "scan1", "scan2", "scan10", "scan011", "scan100", "tail"].map(|name| format!("{name}.png"));
    names.iter().for_each(|name| std::fs::write(folder.path().join(name), "").unwrap());
    assert_eq!(list_photos(&folder).unwrap(), names.map(|name| folder.path().join(name)));
}
