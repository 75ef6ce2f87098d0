//! JPEGs that are decoded at a reduced scale equal the fully decoded photo, to within the bounds here.

use image::codecs::jpeg::JpegEncoder;
use image::metadata::Orientation;
use image::{DynamicImage, ImageEncoder};
use std::path::{Path, PathBuf};
use weaver_io::{Bitmap, PhotoFile};

/// Soft shapes in all colors with some detail, so that a shift by a part of a pixel shows.
fn picture(width: u32, height: u32) -> DynamicImage {
    let pixel = |x: u32, y: u32| {
        let (u, v) = (x as f32 / width as f32, y as f32 / height as f32);
        let wave = |a: f32, b: f32| (127.0 + 90.0 * (a * u + b * v).sin() + 20.0 * (20.0 * u * v).cos()) as u8;
        image::Rgb([wave(9.0, 4.0), wave(-3.0, 11.0), wave(14.0, -6.0)])
    };
    image::RgbImage::from_fn(width, height, pixel).into()
}

fn write(path: &Path, image: &DynamicImage, orientation: Orientation) {
    let mut exif = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
    exif.extend([orientation.to_exif(), 0, 0, 0, 0, 0, 0, 0]);
    let mut encoder = JpegEncoder::new_with_quality(std::fs::File::create(path).unwrap(), 95);
    encoder.set_exif_metadata(exif).unwrap();
    encoder.encode_image(image).unwrap();
}

/// Mean and largest difference of values.
fn apart(a: &Bitmap, b: &Bitmap) -> (f64, u8) {
    assert_eq!((a.width, a.height, a.pixels.len()), (b.width, b.height, b.pixels.len()));
    let apart = || a.pixels.iter().zip(&b.pixels).map(|(a, b)| a.abs_diff(*b));
    (apart().map(f64::from).sum::<f64>() / a.pixels.len() as f64, apart().max().unwrap())
}

fn whole(photo: &PhotoFile) -> PhotoFile {
    photo.clone().shrink_from(usize::MAX)
}

fn shrunk(photo: &PhotoFile) -> PhotoFile {
    photo.clone().shrink_from(0)
}

/// Sides that are no multiple of eight, at a half and at a quarter, whole and in part, whichever way up.
///
/// A photo that begins half a pixel too far to the left, as one does that is stored mirrored and padded at its right,
/// is off by more than 2 on average.
///
/// Promise (photos): a large JPEG that is decoded at a reduced scale gives the photo of the whole, whichever way up,
/// to within 1/255 on average.
#[test]
fn a_reduced_scale_gives_the_photo_of_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.jpg");
    for number in 1..=8 {
        let orientation = Orientation::from_exif(number).unwrap();
        for image in [picture(203, 149), DynamicImage::from(picture(150, 205).into_luma8())] {
            write(&path, &image, orientation);
            let photo = PhotoFile::at(&path).unwrap();
            let check = |what: &str, read: &dyn Fn(PhotoFile) -> Bitmap| {
                let [shrunk, whole] = [read(shrunk(&photo)), read(whole(&photo))];
                let (mean, most) = apart(&shrunk, &whole);
                assert_ne!(shrunk, whole, "{orientation:?}, {what}: nothing was shrunk");
                assert!(mean < 1.0 && most <= 6, "{orientation:?}, {what}: {mean} on average, {most} at most");
            };
            let (width, height) = photo.size();
            for by in [7, 13] {
                let (width, height) = (width / by, height / by);
                check("Lanczos", &|photo| photo.resize_whole(width, height).unwrap());
                check("cubic", &|photo| photo.resize_bicubic(width, height).unwrap());
            }
            check("a part", &|photo| photo.resize(12, 13, [11.5, 21.0, 130.25, 140.0]).unwrap());
        }
    }
}

/// Photos that are shrunk little, small ones, and kinds that only the other decoder supports keep the values that they
/// had.
///
/// Promise (photos): photos that are not large keep the values that they always had.
#[test]
fn other_photos_keep_their_values() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.jpg");
    write(&path, &picture(203, 149), Orientation::NoTransforms);
    let photo = PhotoFile::at(&path).unwrap();
    assert_eq!(photo.resize_whole(12, 9).unwrap(), whole(&photo).resize_whole(12, 9).unwrap(), "small");
    let [least, more] = [33, 34].map(|side| {
        [shrunk(&photo), whole(&photo)].map(|photo| photo.resize(side, 9, [0.0, 0.0, 200.0, 140.0]).unwrap())
    });
    assert!(least[0] != least[1] && more[0] == more[1], "a half is three times what is asked for, or it is not taken");
    assert_eq!(shrunk(&photo).read().unwrap(), whole(&photo).read().unwrap());
    let mask = folder.path().join("m.png");
    image::GrayImage::from_pixel(203, 149, image::Luma([255])).save(&mask).unwrap();
    let masked = |photo: PhotoFile| photo.masked(PhotoFile::at(&mask).unwrap()).resize_whole(12, 9).unwrap();
    assert_eq!(masked(shrunk(&photo)), masked(whole(&photo)), "masked");
    let cmyk = PhotoFile::at(fixture("cmyk.jpg")).unwrap();
    assert_eq!(shrunk(&cmyk).resize_whole(3, 2).unwrap(), whole(&cmyk).resize_whole(3, 2).unwrap(), "CMYK");
}

/// Promise of `a_reduced_scale_gives_the_photo_of_the_whole`.
#[test]
fn progressive_photos_are_shrunk_too() {
    let photo = PhotoFile::at(fixture("progressive.jpg")).unwrap();
    let [a, b] = [shrunk(&photo), whole(&photo)].map(|photo| photo.resize_whole(4, 2).unwrap());
    assert!(a != b && apart(&a, &b).1 <= 3, "{:?}", apart(&a, &b));
}

/// Colors that are stored as they are, which Adobe's segment says, are not taken for brightness and color differences.
#[test]
fn colors_stored_as_they_are_stay_what_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.jpg");
    write(&path, &picture(64, 64), Orientation::NoTransforms);
    let mut bytes = std::fs::read(&path).unwrap();
    let adobe = b"\xff\xee\0\x0eAdobe\0\x64\0\0\0\0\0";
    bytes.splice(2..2, *adobe);
    std::fs::write(&path, bytes).unwrap();
    let photo = PhotoFile::at(&path).unwrap();
    assert_eq!(shrunk(&photo).resize_whole(5, 5).unwrap(), whole(&photo).resize_whole(5, 5).unwrap());
}

/// A header that promises more than the file can hold takes no memory, at a reduced scale neither.
#[test]
fn false_headers_are_refused_at_any_scale() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.jpg");
    let mut bytes = std::fs::read(fixture("progressive.jpg")).unwrap();
    let frame = bytes.windows(2).position(|pair| pair == [0xff, 0xc2]).unwrap();
    bytes[frame + 5..frame + 9].copy_from_slice(&[0x20, 0, 0x20, 0]);
    std::fs::write(&path, bytes).unwrap();
    let photo = shrunk(&PhotoFile::at(&path).unwrap());
    let mut message = String::new();
    let used = allocation_counter::measure(|| message = photo.resize_whole(4, 4).unwrap_err().to_string());
    assert!(message.contains("8192 x 8192 pixels, as its header says"), "{message}");
    assert!(used.bytes_max < 1 << 20, "{} bytes", used.bytes_max);
}

/// A photo that was cut short is an error at any scale.
#[test]
fn a_cut_photo_is_an_error_at_any_scale() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.jpg");
    write(&path, &picture(203, 149), Orientation::NoTransforms);
    let bytes = std::fs::read(&path).unwrap();
    for end in [bytes.len() - 2, bytes.len() / 2] {
        std::fs::write(&path, &bytes[..end]).unwrap();
        let message = shrunk(&PhotoFile::at(&path).unwrap()).resize_whole(12, 9).unwrap_err().to_string();
        assert!(message.contains("a.jpg") && message.contains("cut short"), "{message}");
    }
}

fn fixture(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(name)
}
