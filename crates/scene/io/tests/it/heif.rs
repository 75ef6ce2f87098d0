//! HEIC and AVIF: their containers, and pixels that another program decoded.

use crate::color_profiles::{of_display_p3, write_display_p3};
use std::path::{Path, PathBuf};
use weaver_io::{Bitmap, HeifPhoto, PhotoFile, Turned, focal_35mm};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../tests/fixtures/heic").join(name)
}

/// The ramp of `tiles.heic`, upright, in its own colors.
fn upright() -> Bitmap {
    let (width, height) = (96, 128);
    let pixel = |i: usize| [40 + i % width * 160 / width, 30 + i / width * 180 / height, 128].map(|x| x as u8);
    Bitmap { width, height, pixels: (0..width * height).flat_map(pixel).collect() }
}

/// The pixels as `tiles.heic` stores them: a quarter turn to the left.
fn stored(upright: &Bitmap) -> Bitmap {
    let (width, height) = (upright.height, upright.width);
    let pixel = |i: usize| {
        let at = 3 * (i % width * upright.width + upright.width - 1 - i / width);
        [upright.pixels[at], upright.pixels[at + 1], upright.pixels[at + 2]]
    };
    Bitmap { width, height, pixels: (0..width * height).flat_map(pixel).collect() }
}

#[test]
fn containers_tell_size_orientation_and_focal_length() {
    let photo = HeifPhoto::read(fixture("tiles.heic")).unwrap();
    assert_eq!((photo.kind(), photo.size()), ("HEIC", (96, 128)));
    assert_eq!(focal_35mm(fixture("tiles.heic")).unwrap(), Some(26.0));
    let photo = HeifPhoto::read(fixture("turned.avif")).unwrap();
    assert_eq!((photo.kind(), photo.size()), ("AVIF", (64, 96)));
    assert!(HeifPhoto::is_at(fixture("tiles.heic")) && !HeifPhoto::is_at(fixture("none.heic")));
}

/// Promise (photos): a decoded HEIC is turned once, whether the program that decoded it turned it or not, and has the
/// colors of its profile.
#[test]
fn decoded_photos_are_turned_once() {
    let folder = tempfile::tempdir().unwrap();
    let (photo, upright) = (HeifPhoto::read(fixture("tiles.heic")).unwrap(), upright());
    let expected = of_display_p3(&upright);
    let path = folder.path().join("decoded.png");
    for bitmap in [&upright, &stored(&upright)] {
        for with_profile in [true, false] {
            match with_profile {
                true => write_display_p3(&path, bitmap),
                // The container's profile then counts.
                false => bitmap.write_png(&path).unwrap(),
            }
            for turned in [Turned::Always, Turned::Never, Turned::AsTagged] {
                let found = photo.decoded(&path, turned).unwrap();
                assert_eq!((found.width, found.height), (96, 128));
                let off = found.pixels.iter().zip(&expected).map(|(a, b)| a.abs_diff(*b)).max();
                assert!(off <= Some(1), "{turned:?} {with_profile}: {off:?}");
            }
        }
    }
    // A program that does not know of tiles decodes one.
    Bitmap { width: 64, height: 64, pixels: vec![0; 64 * 64 * 3] }.write_png(&path).unwrap();
    let message = photo.decoded(&path, Turned::Always).unwrap_err().to_string();
    for part in ["tiles.heic", "expected 96x128", "found 64x64"] {
        assert!(message.contains(part), "{message}");
    }
}

/// Promise (photos): a converted HEIC keeps its size, its pixels and its focal length.
#[test]
fn converted_photos_are_jpegs_with_a_focal_length() {
    let folder = tempfile::tempdir().unwrap();
    let (photo, upright, path) =
        (HeifPhoto::read(fixture("tiles.heic")).unwrap(), upright(), folder.path().join("a.jpg"));
    std::fs::write(&path, photo.to_jpeg(&upright, 95).unwrap()).unwrap();
    assert_eq!(focal_35mm(&path).unwrap(), Some(26.0));
    let found = PhotoFile::at(&path).unwrap();
    assert_eq!((found.size(), found.has_ambiguous_orientation()), ((96, 128), false));
    let off = found.read().unwrap().pixels.iter().zip(&upright.pixels).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(off <= Some(6), "{off:?}");
    // Of a photo without one.
    std::fs::write(&path, HeifPhoto::read(fixture("turned.avif")).unwrap().to_jpeg(&upright, 95).unwrap()).unwrap();
    assert_eq!(focal_35mm(&path).unwrap(), None);
}

/// Every beginning of a container, and changed bytes, are errors or photos.
#[test]
fn damaged_containers_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.heic");
    for name in ["tiles.heic", "turned.avif"] {
        let whole = std::fs::read(fixture(name)).unwrap();
        let meta = whole.len().min(1100);
        for end in 0..meta {
            std::fs::write(&path, &whole[..end]).unwrap();
            if let Err(error) = HeifPhoto::read(&path) {
                assert!(error.to_string().contains("a.heic"), "{error}");
            }
            for value in [0, 0xff] {
                let mut changed = whole.clone();
                changed[end] = value;
                std::fs::write(&path, changed).unwrap();
                let _ = HeifPhoto::read(&path);
            }
        }
    }
    std::fs::write(&path, b"\0\0\0\x18ftypheic\0\0\0\0mif1heic").unwrap();
    let message = HeifPhoto::read(&path).unwrap_err().to_string();
    assert!(message.contains("a.heic") && message.contains("copied whole"), "{message}");
}
