//! Photos with ICC profiles, which are written here as the specification says (ICC.1, version 4).

use image::codecs::{jpeg::JpegEncoder, png::PngEncoder, tiff::TiffEncoder, webp::WebPEncoder};
use image::{DynamicImage, ImageEncoder};
use std::path::Path;
use weaver_io::{Background, Bitmap, Image, PhotoFile};

/// Red, green and blue of a space as XYZ under D50.
type Colorants = [[f64; 3]; 3];
const DISPLAY_P3: Colorants = [[0.51512, 0.24120, -0.00105], [0.29198, 0.69225, 0.04189], [0.15710, 0.06657, 0.78407]];
const ADOBE_RGB: Colorants = [[0.60974, 0.31111, 0.01947], [0.20528, 0.62567, 0.06087], [0.14919, 0.06322, 0.74457]];
const SRGB: Colorants = [[0.43607, 0.22249, 0.01392], [0.38515, 0.71687, 0.09708], [0.14307, 0.06061, 0.71410]];

/// Curve of a space.
#[derive(Clone, Copy)]
enum Curve {
    Srgb,
    Gamma(f64),
}

impl Curve {
    fn linear(self, value: f64) -> f64 {
        match self {
            Self::Srgb if value <= 0.04045 => value / 12.92,
            Self::Srgb => ((value + 0.055) / 1.055).powf(2.4),
            Self::Gamma(gamma) => value.powf(gamma),
        }
    }

    fn encoded(self) -> Vec<u8> {
        let (kind, numbers) = match self {
            Self::Srgb => (3, vec![2.4, 1.0 / 1.055, 0.055 / 1.055, 1.0 / 12.92, 0.04045]),
            Self::Gamma(gamma) => (0, vec![gamma]),
        };
        [b"para\0\0\0\0".to_vec(), vec![0, kind, 0, 0], fixed(&numbers)].concat()
    }
}

/// Numbers of 16 bits before the point and 16 behind it.
fn fixed(numbers: &[f64]) -> Vec<u8> {
    numbers.iter().flat_map(|x| ((x * 65536.0).round() as i32).to_be_bytes()).collect()
}

/// A profile with these tags; `spaces` are the device's and the connection's.
fn profile(class: &[u8; 4], spaces: &[u8; 8], tags: &[(&[u8; 4], Vec<u8>)]) -> Vec<u8> {
    let mut at = 132 + 12 * tags.len();
    let (mut table, mut data) = ((tags.len() as u32).to_be_bytes().to_vec(), Vec::new());
    for (name, content) in tags {
        table.extend_from_slice(*name);
        table.extend([at as u32, content.len() as u32].iter().flat_map(|x| x.to_be_bytes()));
        data.extend_from_slice(content);
        data.resize(data.len().next_multiple_of(4), 0);
        at = 132 + 12 * tags.len() + data.len();
    }
    let mut bytes = [(at as u32).to_be_bytes().to_vec(), vec![0; 4], vec![4, 0, 0, 0]].concat();
    bytes.extend([&class[..], &spaces[..], &[0; 12], b"acsp", &[0; 28]].concat());
    bytes.extend(fixed(&[0.9642, 1.0, 0.8249]));
    bytes.resize(128, 0);
    [bytes, table, data].concat()
}

fn xyz(numbers: &[f64]) -> Vec<u8> {
    [b"XYZ \0\0\0\0".to_vec(), fixed(numbers)].concat()
}

fn rgb_profile(colorants: &Colorants, curve: Curve) -> Vec<u8> {
    let [r, g, b] = colorants.map(|color| xyz(&color));
    let curve = || curve.encoded();
    let white = xyz(&[0.9642, 1.0, 0.8249]);
    let tags: [(&[u8; 4], Vec<u8>); 7] = [
        (b"wtpt", white),
        (b"rXYZ", r),
        (b"gXYZ", g),
        (b"bXYZ", b),
        (b"rTRC", curve()),
        (b"gTRC", curve()),
        (b"bTRC", curve()),
    ];
    profile(b"mntr", b"RGB XYZ ", &tags)
}

fn gray_profile(gamma: f64) -> Vec<u8> {
    let tags: [(&[u8; 4], Vec<u8>); 2] =
        [(b"wtpt", xyz(&[0.9642, 1.0, 0.8249])), (b"kTRC", Curve::Gamma(gamma).encoded())];
    profile(b"mntr", b"GRAYXYZ ", &tags)
}

/// A profile in which all inks are a gray of this lightness.
fn ink_profile(lightness: u8) -> Vec<u8> {
    let ramp: Vec<u8> = (0..=255).collect();
    let mut table = b"mft1\0\0\0\0".to_vec();
    table.extend([4, 3, 2, 0]);
    table.extend(fixed(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]));
    table.extend(ramp.repeat(4));
    table.extend([lightness, 128, 128].repeat(16));
    table.extend(ramp.repeat(3));
    profile(b"prtr", b"CMYKLab ", &[(b"A2B0", table)])
}

/// The sRGB values of a color of a space, from 0 to 255.
fn expected(color: [f64; 3], colorants: &Colorants, curve: Curve) -> [f64; 3] {
    let linear = color.map(|value| curve.linear(value));
    let xyz: [f64; 3] = std::array::from_fn(|i| (0..3).map(|c| linear[c] * colorants[c][i]).sum());
    solve(&SRGB, xyz).map(|value| {
        let value = value.clamp(0.0, 1.0);
        255.0 * if value <= 0.0031308 { 12.92 * value } else { 1.055 * value.powf(1.0 / 2.4) - 0.055 }
    })
}

/// Parts of three colors that give XYZ, by Cramer's rule.
fn solve(colors: &Colorants, xyz: [f64; 3]) -> [f64; 3] {
    let det = |m: &Colorants| {
        m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[1][0] * (m[0][1] * m[2][2] - m[0][2] * m[2][1])
            + m[2][0] * (m[0][1] * m[1][2] - m[0][2] * m[1][1])
    };
    std::array::from_fn(|c| {
        let mut other = *colors;
        other[c] = xyz;
        det(&other) / det(colors)
    })
}

/// Colors with and without saturation, dark and light.
fn colors() -> Vec<u8> {
    let levels = [0u8, 9, 60, 128, 200, 255];
    let all = levels.iter().flat_map(|r| levels.iter().flat_map(move |g| levels.map(|b| [*r, *g, b])));
    all.flatten().collect()
}

/// A picture of 36 pixels in a row of the colors.
fn picture(pixels: Vec<u8>) -> DynamicImage {
    image::RgbImage::from_raw(36, (pixels.len() / 108) as u32, pixels).unwrap().into()
}

fn encoded(mut encoder: impl ImageEncoder, picture: &DynamicImage, icc: &[u8]) {
    encoder.set_icc_profile(icc.to_vec()).unwrap();
    encoder.write_image(picture.as_bytes(), picture.width(), picture.height(), picture.color().into()).unwrap();
}

fn png(picture: &DynamicImage, icc: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    encoded(PngEncoder::new(&mut bytes), picture, icc);
    bytes
}

fn decoded(bytes: &[u8]) -> Vec<u8> {
    Image::decode(bytes, "memory", Background::White).unwrap().to_bytes()
}

#[track_caller]
fn check(found: &[u8], colors: &[u8], of: impl Fn([f64; 3]) -> [f64; 3], tolerance: f64) {
    assert_eq!(found.len(), colors.len());
    for (found, color) in found.chunks(3).zip(colors.chunks(3)) {
        let wanted = of([0, 1, 2].map(|c| f64::from(color[c]) / 255.0));
        let off = (0..3).map(|c| (f64::from(found[c]) - wanted[c]).abs()).fold(0.0, f64::max);
        assert!(off <= tolerance, "{color:?} became {found:?}, expected {wanted:?}");
    }
}

/// Promise (photos): colors of photos with a profile of another space, as Display P3 or Adobe RGB, become sRGB, in
/// every format and of 8 and 16 bits.
#[test]
fn colors_of_other_spaces_become_srgb() {
    let colors = colors();
    let spaces =
        [(&DISPLAY_P3, Curve::Srgb), (&ADOBE_RGB, Curve::Gamma(563.0 / 256.0)), (&DISPLAY_P3, Curve::Gamma(1.0))];
    for (colorants, curve) in spaces {
        let (icc, of) = (rgb_profile(colorants, curve), |color| expected(color, colorants, curve));
        let (eight, sixteen) = (picture(colors.clone()), DynamicImage::from(picture(colors.clone()).into_rgb16()));
        check(&decoded(&png(&eight, &icc)), &colors, of, 1.0);
        check(&decoded(&png(&sixteen, &icc)), &colors, of, 1.0);
        check(&decoded(&png(&DynamicImage::from(eight.to_rgba8()), &icc)), &colors, of, 1.0);
        check(&decoded(&png(&DynamicImage::from(sixteen.to_rgba16()), &icc)), &colors, of, 1.0);
        let mut tiff = std::io::Cursor::new(Vec::new());
        // Of a TIFF, the decoder allows a profile no more memory than the picture.
        let many = colors.repeat(20);
        encoded(TiffEncoder::new(&mut tiff), &picture(many.clone()).into_rgb16().into(), &icc);
        check(&decoded(tiff.get_ref()), &many, of, 1.0);
        let mut webp = Vec::new();
        encoded(WebPEncoder::new_lossless(&mut webp), &eight, &icc);
        check(&decoded(&webp), &colors, of, 1.0);
    }
    // Alpha is no color.
    let icc = rgb_profile(&DISPLAY_P3, Curve::Srgb);
    let half = image::RgbaImage::from_raw(1, 1, vec![0, 0, 0, 51]).unwrap();
    assert_eq!(decoded(&png(&half.into(), &icc)), [204; 3]);
}

/// Dark colors of a linear profile need more than 8 bits.
#[test]
fn sixteen_bits_are_rounded_once_they_are_srgb() {
    let dark: Vec<u16> = (0..30).flat_map(|level| [level * 10; 3]).collect();
    let picture = DynamicImage::from(image::ImageBuffer::<image::Rgb<u16>, _>::from_raw(30, 1, dark.clone()).unwrap());
    let found = decoded(&png(&picture, &rgb_profile(&SRGB, Curve::Gamma(1.0))));
    for (found, dark) in found.iter().zip(&dark) {
        let wanted = 255.0 * 12.92 * f64::from(*dark) / 65535.0;
        assert!((f64::from(*found) - wanted).abs() <= 0.6, "{dark} became {found}, expected {wanted}");
    }
}

/// Promise (photos): photos in sRGB, with a profile that says so or with none, keep their values to the bit.
#[test]
fn srgb_stays_as_it_is() {
    let colors = colors();
    let mut rounded = SRGB;
    rounded[0][0] += 0.0001;
    for icc in [rgb_profile(&SRGB, Curve::Srgb), rgb_profile(&rounded, Curve::Srgb), b"no profile".to_vec(), Vec::new()]
    {
        let plain = picture(colors.clone());
        assert_eq!(decoded(&png(&plain, &icc)), colors);
        let (mut jpeg, mut without) = (Vec::new(), Vec::new());
        encoded(JpegEncoder::new_with_quality(&mut jpeg, 90), &plain, &icc);
        plain.write_with_encoder(JpegEncoder::new_with_quality(&mut without, 90)).unwrap();
        assert_eq!(decoded(&jpeg), decoded(&without));
    }
}

/// Gray photos with a gray profile, and with others.
#[test]
fn gray_photos_have_gray_profiles() {
    let levels: Vec<u8> = (0..=255).collect();
    let gray = DynamicImage::from(image::GrayImage::from_raw(256, 1, levels.clone()).unwrap());
    let colors: Vec<u8> = levels.iter().flat_map(|gray| [*gray; 3]).collect();
    for gamma in [1.8, 2.2] {
        let of = |color| expected(color, &SRGB, Curve::Gamma(gamma));
        let icc = gray_profile(gamma);
        check(&decoded(&png(&gray, &icc)), &colors, of, 1.0);
        check(&decoded(&png(&DynamicImage::from(gray.to_luma16()), &icc)), &colors, of, 1.0);
        check(&decoded(&png(&DynamicImage::from(gray.to_luma_alpha8()), &icc)), &colors, of, 1.0);
        check(&decoded(&png(&gray, &rgb_profile(&SRGB, Curve::Gamma(gamma)))), &colors, of, 1.0);
        // A gray profile says nothing about colors, nor does one of inks.
        let colored = picture(self::colors());
        for other in [&icc, &ink_profile(128)] {
            assert_eq!(decoded(&png(&colored, other)), self::colors());
        }
    }
}

/// A JPEG with a profile in front of everything else.
fn with_profile(jpeg: &[u8], icc: &[u8]) -> Vec<u8> {
    let content = [b"ICC_PROFILE\0\x01\x01", icc].concat();
    let length = (content.len() as u16 + 2).to_be_bytes();
    [&jpeg[..2], &[0xff, 0xe2], &length, &content, &jpeg[2..]].concat()
}

/// Inks become the colors that the profile gives them, here all the same.
#[test]
fn cmyk_follows_its_profile() {
    let cmyk = include_bytes!("../fixtures/cmyk.jpg");
    let plain = decoded(cmyk);
    // Lightness 128 / 255 of 100 in sRGB.
    let found = decoded(&with_profile(cmyk, &ink_profile(128)));
    assert_eq!(found.len(), plain.len());
    assert!(found.iter().all(|value| value.abs_diff(120) <= 2), "{:?}", &found[..6]);
    // Of another kind of colors.
    assert_eq!(decoded(&with_profile(cmyk, &gray_profile(1.8))), plain);
}

/// A JPEG that is decoded at a reduced scale is converted, too.
#[test]
fn shrunk_photos_follow_their_profile() {
    let folder = tempfile::tempdir().unwrap();
    let smooth = image::RgbImage::from_fn(160, 120, |x, y| image::Rgb([60 + x as u8, 250 - y as u8, 40]));
    let mut bytes = Vec::new();
    encoded(JpegEncoder::new_with_quality(&mut bytes, 98), &smooth.into(), &rgb_profile(&DISPLAY_P3, Curve::Srgb));
    let path = folder.path().join("a.jpg");
    std::fs::write(&path, bytes).unwrap();
    let read = |from: usize| PhotoFile::at(&path).unwrap().shrink_from(from).resize_whole(20, 15).unwrap();
    let (whole, shrunk) = (read(usize::MAX), read(0));
    assert_ne!(whole, shrunk, "another decoder");
    let off = whole.pixels.iter().zip(&shrunk.pixels).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(off <= Some(3), "{off:?}");
}

/// The pixels of a picture in Display P3, as they are read.
pub fn of_display_p3(bitmap: &Bitmap) -> Vec<u8> {
    let color = |color: &[u8]| expected([0, 1, 2].map(|c| f64::from(color[c]) / 255.0), &DISPLAY_P3, Curve::Srgb);
    bitmap.pixels.chunks(3).flat_map(color).map(|value| value.round() as u8).collect()
}

/// Writes a PNG in Display P3.
pub fn write_display_p3(path: &Path, bitmap: &Bitmap) {
    let picture = image::RgbImage::from_raw(bitmap.width as u32, bitmap.height as u32, bitmap.pixels.clone()).unwrap();
    std::fs::write(path, png(&picture.into(), &rgb_profile(&DISPLAY_P3, Curve::Srgb))).unwrap();
}
