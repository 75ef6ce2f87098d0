//! Pictures of depth.

use exr::prelude::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, WritableImage};
use half::f16;
use std::path::Path;
use weaver_io::{DepthPicture, Error};

/// An OpenEXR file of these channels, 3x2.
fn write_exr(path: &Path, channels: Vec<(&str, FlatSamples)>) {
    let channels = channels.into_iter().map(|(name, samples)| AnyChannel::new(name, samples)).collect();
    let layer =
        Layer::new((3, 2), LayerAttributes::named("depth"), Encoding::FAST_LOSSLESS, AnyChannels::sort(channels));
    Image::from_layer(layer).write().to_file(path).unwrap();
}

/// Promise (photos): depth is read of 16-bit pictures in millimeters, and of OpenEXR in world units, whatever its
/// channel is called.
#[test]
fn pictures_of_depth() {
    let folder = tempfile::tempdir().unwrap();
    let png = folder.path().join("depth.png");
    image::ImageBuffer::<image::Luma<u16>, _>::from_raw(3, 2, vec![0, 1, 1500, 2000, 40_000, u16::MAX])
        .unwrap()
        .save(&png)
        .unwrap();
    let expected = [0.0, 0.001, 1.5, 2.0, 40.0, 65.535];
    let read = DepthPicture::read(&png).unwrap();
    assert_eq!((read.width, read.height, &read.depth[..]), (3, 2, &expected[..]));

    let exr = folder.path().join("depth.exr");
    let values: Vec<f32> = expected.to_vec();
    let half = || FlatSamples::F16(values.iter().map(|value| f16::from_f32(*value)).collect());
    let single = || FlatSamples::F32(values.clone());
    let other = || FlatSamples::F32(vec![9.0; 6]);
    for (channels, exact) in [
        (vec![("Z", single())], true),
        (vec![("V", single())], true),
        (vec![("anything", single())], true),
        (vec![("A", other()), ("Z", single()), ("Y", other())], true),
        (vec![("R", half()), ("G", other()), ("B", other())], false),
    ] {
        write_exr(&exr, channels);
        let read = DepthPicture::read(&exr).unwrap();
        let off = read.depth.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!((read.width, read.height) == (3, 2) && off <= if exact { 0.0 } else { 0.05 }, "{read:?}");
    }
}

#[test]
fn what_is_no_depth_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    image::RgbImage::from_pixel(3, 2, image::Rgb([1, 2, 3])).save(path("colors.png")).unwrap();
    std::fs::write(path("text.png"), "no picture").unwrap();
    std::fs::write(path("text.exr"), "no picture").unwrap();
    write_exr(&path("two.exr"), vec![("a", FlatSamples::F32(vec![1.0; 6])), ("b", FlatSamples::F32(vec![1.0; 6]))]);
    write_exr(&path("cut.exr"), vec![("Z", FlatSamples::F32((0..6_u8).map(f32::from).collect()))]);
    let bytes = std::fs::read(path("cut.exr")).unwrap();
    for (name, expected) in [
        ("colors.png", "depth: expected millimeters in 16 bits of gray"),
        ("text.png", "depth: expected millimeters"),
        ("text.exr", "depth: expected millimeters"),
        ("two.exr", "found channels a, b"),
        ("gone.png", "gone.png"),
        ("gone.exr", "gone.exr"),
    ] {
        let error = DepthPicture::read(path(name)).unwrap_err().to_string();
        assert!(error.contains(name) && error.contains(expected), "{error}");
    }
    for end in 0..bytes.len() {
        std::fs::write(path("cut.exr"), &bytes[..end]).unwrap();
        let error = DepthPicture::read(path("cut.exr")).unwrap_err();
        assert!(matches!(&error, Error::Invalid { .. } | Error::Io { .. }), "{end} bytes: {error}");
    }
}
