use crate::shared;
use proptest::prelude::*;
use weaver_io::{Background, Bitmap, Image, PhotoFile, false_color, label_color};

fn ramp(width: usize, height: usize) -> Image {
    let bytes: Vec<u8> = (0..width * height * 3).map(|i| (i * 37 % 256) as u8).collect();
    Image::from_bytes(width, height, &bytes)
}

#[test]
fn png_round_trip_is_exact() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let image = ramp(7, 5);
    image.write_png(&path).unwrap();
    assert_eq!(Image::read(&path, Background::White).unwrap(), image);
    assert_eq!(Image::dimensions(&path).unwrap(), (7, 5));
    assert_eq!(image.to_png(), std::fs::read(&path).unwrap());
}

#[test]
fn a_jpeg_is_nearly_what_was_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.jpg");
    let value = |i: usize| (128.0 + 90.0 * ((i / 3) as f64 * 0.02 + (i % 3) as f64).sin()) as u8;
    let image = Bitmap { width: 33, height: 21, pixels: (0..33 * 21 * 3).map(value).collect() };
    std::fs::write(&path, image.to_jpeg(95).unwrap()).unwrap();
    let read = PhotoFile::at(&path).unwrap().read().unwrap();
    assert_eq!((read.width, read.height), (33, 21));
    let off = read.pixels.iter().zip(&image.pixels).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
    assert!(off <= 12, "{off}");
    let length = |quality: u8| image.to_jpeg(quality).unwrap().len();
    assert!(length(20) < length(95));
    assert!(Bitmap { width: 0, height: 0, pixels: Vec::new() }.to_jpeg(95).is_err());
}

#[test]
fn alpha_and_sixteen_bits() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let rgba = image::RgbaImage::from_raw(2, 1, vec![255, 0, 0, 255, 200, 100, 0, 0]).unwrap();
    rgba.save(&path).unwrap();
    let white = Image::read(&path, Background::White).unwrap();
    assert_eq!(white.pixels, [1.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
    let black = Image::read(&path, Background::Black).unwrap();
    assert_eq!(black.pixels, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);

    let gray = image::ImageBuffer::<image::Luma<u16>, _>::from_raw(1, 1, vec![13107u16]).unwrap();
    gray.save(&path).unwrap();
    for value in Image::read(&path, Background::White).unwrap().pixels {
        assert!((value - 0.2).abs() < 1e-6);
    }
}

#[test]
fn messages_name_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("broken.png");
    std::fs::write(&path, b"\x89PNG\r\n\x1a\nnot really").unwrap();
    let message = Image::read(&path, Background::White).unwrap_err().to_string();
    assert!(message.contains("broken.png") && message.contains("expected a JPEG, PNG, TIFF or WebP"), "{message}");
    let message = Image::read(folder.path().join("none.png"), Background::White).unwrap_err().to_string();
    assert!(message.contains("none.png"), "{message}");
}

#[test]
fn crop_and_mosaic() {
    let image = ramp(6, 4);
    let part = image.crop(2, 1, 3, 2);
    assert_eq!(part.pixels[..9], image.pixels[(6 + 2) * 3..(6 + 5) * 3]);
    let both = Image::mosaic(&[&part, &image]);
    assert_eq!((both.width, both.height), (9, 4));
    assert_eq!(both.crop(0, 0, 3, 2), part);
    assert_eq!(both.crop(3, 0, 6, 4), image);
    assert_eq!(both.crop(0, 2, 3, 2), Image::filled(3, 2, [0.0; 3]));
}

/// The filter by its definition in f64, without intermediate rounding.
fn lanczos_reference(image: &Image, width: usize, height: usize, [x0, y0, x1, y1]: [f64; 4]) -> Vec<f64> {
    let weights = |from: f64, to: f64, out: usize, o: usize, size: usize| {
        let scale = (to - from) / out as f64;
        let center = from + (o as f64 + 0.5) * scale;
        let kernel = |x: f64| {
            let sinc = |x: f64| {
                if x == 0.0 { 1.0 } else { (std::f64::consts::PI * x).sin() / (std::f64::consts::PI * x) }
            };
            if x.abs() < 3.0 { sinc(x) * sinc(x / 3.0) } else { 0.0 }
        };
        let all: Vec<f64> = (0..size).map(|i| kernel((i as f64 + 0.5 - center) / scale.max(1.0))).collect();
        let total: f64 = all.iter().sum();
        all.into_iter().map(|w| w / total).collect::<Vec<f64>>()
    };
    let mut out = Vec::new();
    for y in 0..height {
        let wy = weights(y0, y1, height, y, image.height);
        for x in 0..width {
            let wx = weights(x0, x1, width, x, image.width);
            for c in 0..3 {
                let mut sum = 0.0;
                for (j, wy) in wy.iter().enumerate() {
                    // The first pass clamps, as any pass over 8-bit values does.
                    let row: f64 =
                        (0..image.width).map(|i| wx[i] * f64::from(image.pixels[(j * image.width + i) * 3 + c])).sum();
                    sum += wy * row.clamp(0.0, 1.0);
                }
                out.push(sum.clamp(0.0, 1.0));
            }
        }
    }
    out
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 16))]

    #[test]
    fn lanczos_is_the_filter_by_definition(
        (w, h) in (4usize..24, 4usize..24), (ow, oh) in (1usize..20, 1usize..20), seed in 0u32..1000,
        (l, t) in (0.0..0.4f64, 0.0..0.4f64), (r, b) in (0.6..1.0f64, 0.6..1.0f64),
    ) {
        let bytes: Vec<u8> = (0..(w * h * 3) as u32).map(|i| (i.wrapping_mul(2654435761).wrapping_add(seed * 77) >> 13) as u8).collect();
        let image = Image::from_bytes(w, h, &bytes);
        let part = [l * w as f64, t * h as f64, r * w as f64, b * h as f64];
        let resized = image.resize(ow, oh, part);
        let reference = lanczos_reference(&image, ow, oh, part);
        // Rounding to 8 bits: half a step in the second pass, and half a step times sum |w| < 1.5 from the first.
        for (a, b) in resized.pixels.iter().zip(reference) {
            prop_assert!((f64::from(*a) - b).abs() < 1.3 / 255.0, "{a} {b}");
        }
    }

    #[test]
    fn constant_images_stay_constant(v in 0u8..=255, w in 1usize..40, h in 1usize..40, ow in 1usize..40, oh in 1usize..40) {
        let image = Image::from_bytes(w, h, &vec![v; w * h * 3]);
        prop_assert_eq!(image.resize(ow, oh, [0.0, 0.0, w as f64, h as f64]).to_bytes(), vec![v; ow * oh * 3]);
    }

    #[test]
    fn hostile_images_never_panic(at in 0.0..1.0f64, byte in any::<u8>(), keep in 0.0..1.0f64) {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.png", "a.jpg", "a.tif", "a.webp"] {
            let path = folder.path().join(name);
            image::RgbImage::from_raw(21, 18, ramp(21, 18).to_bytes()).unwrap().save(&path).unwrap();
            let mut bytes = std::fs::read(&path).unwrap();
            let index = (at * bytes.len() as f64) as usize;
            bytes[index] = byte;
            bytes.truncate((keep * 2.0 * bytes.len() as f64) as usize);
            std::fs::write(&path, &bytes).unwrap();
            let _ = Image::read(&path, Background::White);
            let _ = Image::dimensions(&path);
        }
    }
}

#[test]
fn same_size_is_the_identity() {
    let image = ramp(9, 8);
    assert_eq!(image.resize(9, 8, [0.0, 0.0, 9.0, 8.0]), image);
}

#[test]
fn colors() {
    let depth = false_color(&[0.0, 1.0, 9.0, f32::NAN], 4, 1, 0.0, 1.0);
    assert_eq!(depth.to_bytes()[..3], [68, 1, 84]);
    assert_eq!(depth.crop(1, 0, 1, 1), depth.crop(2, 0, 1, 1));
    assert_eq!(depth.crop(3, 0, 1, 1).to_bytes(), [0, 0, 0]);
    let labels = label_color(&[0, 1, 10], 3, 1);
    assert_eq!(labels.crop(0, 0, 1, 1), labels.crop(2, 0, 1, 1));
    assert_ne!(labels.crop(0, 0, 1, 1), labels.crop(1, 0, 1, 1));
}

#[test]
fn real_photographs() {
    let Some(folder) = shared::data("fox") else {
        return;
    };
    let path = folder.join("images/0001.jpg");
    let image = Image::read(&path, Background::White).unwrap();
    assert_eq!((image.width, image.height), (216, 384));
    assert_eq!(Image::dimensions(&path).unwrap(), (216, 384));
    let mean = image.pixels.iter().sum::<f32>() / image.pixels.len() as f32;
    let small = image.resize(64, 48, [0.0, 111.0, 216.0, 273.0]);
    let small_mean = small.pixels.iter().sum::<f32>() / small.pixels.len() as f32;
    assert!((0.1..0.9).contains(&mean) && (mean - small_mean).abs() < 0.2, "{mean} {small_mean}");
}

/// Promise (photos): a photo that was cut short, or promises more than its file can hold, is refused.
#[test]
fn a_jpeg_that_was_cut_short_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.jpg");
    image::RgbImage::from_raw(21, 18, ramp(21, 18).to_bytes()).unwrap().save(&path).unwrap();
    let whole = std::fs::read(&path).unwrap();
    // A segment with the end of a smaller picture in it, as cameras write them.
    let with_preview = [&whole[..2], &[0xff, 0xe1, 0, 4, 0xff, 0xd9], &whole[2..]].concat();
    for bytes in [&whole, &with_preview] {
        std::fs::write(&path, bytes).unwrap();
        Image::read(&path, Background::White).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() - 2]).unwrap();
        let message = Image::read(&path, Background::White).unwrap_err().to_string();
        assert!(message.contains("a.jpg: image: expected a whole JPEG image"), "{message}");
    }
}

/// A header that promises more than the file can hold is refused.
///
/// Promise of `a_jpeg_that_was_cut_short_is_refused`.
#[test]
fn headers_that_promise_too_much_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.jpg");
    image::RgbImage::from_raw(21, 18, ramp(21, 18).to_bytes()).unwrap().save(&path).unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    // The frame: marker, length, precision, height, width.
    let frame = bytes.windows(2).position(|pair| pair == [0xff, 0xc0]).unwrap();
    bytes[frame + 5..frame + 9].copy_from_slice(&[0x3f, 0xff, 0x3f, 0xff]);
    std::fs::write(&path, &bytes).unwrap();
    let used = allocation_counter::measure(|| {
        let message = Image::read(&path, Background::White).unwrap_err().to_string();
        assert!(message.contains("a.jpg: image: expected 16383 x 16383 pixels, as its header says"), "{message}");
    });
    assert!(used.bytes_max < 1 << 20, "{}", used.bytes_max);
    // A TIFF's first directory: values under a tag, a strip's length.
    let path = folder.path().join("a.tif");
    image::RgbImage::from_raw(21, 18, ramp(21, 18).to_bytes()).unwrap().save(&path).unwrap();
    let whole = std::fs::read(&path).unwrap();
    let entry = |tag: u16| {
        let start = [tag.to_le_bytes(), 4u16.to_le_bytes()].concat();
        whole.windows(4).position(|four| four == start).unwrap()
    };
    for (at, found) in [(entry(273) + 4, "found 50331648 values under tag 273"), (entry(279) + 8, "a.tif: image: ")] {
        let mut bytes = whole.clone();
        bytes[at..at + 4].copy_from_slice(&(3u32 << 24).to_le_bytes());
        std::fs::write(&path, &bytes).unwrap();
        let used = allocation_counter::measure(|| {
            let message = Image::read(&path, Background::White).unwrap_err().to_string();
            assert!(message.contains(found), "{message}");
        });
        assert!(used.bytes_max < 1 << 20, "{found}: {}", used.bytes_max);
    }
    // The densest there is: one color.
    let plain = folder.path().join("plain.png");
    Image::filled(4000, 500, [1.0; 3]).write_png(&plain).unwrap();
    assert_eq!(Image::read(&plain, Background::White).unwrap().width, 4000);
}
