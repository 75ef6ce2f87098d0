//! SPZ of every version, beside other tools' readings of the same files.

use crate::{fixtures, shared};
use flate2::Compression;
use flate2::write::GzEncoder;
use half::f16;
use ruzstd::encoding::{CompressionLevel, compress_to_vec};
use std::io::Write;
use weaver_io::{Drawing, SceneFile, SceneFormat, read_gaussians, read_gaussians_from, read_scene, write_scene};

/// A file of version 4 with one Gaussian of degree 0, with these extensions and arrays.
fn file(flags: u8, extensions: &[u8], streams: &[&[u8]]) -> Vec<u8> {
    let mut data = b"NGSP".to_vec();
    data.extend(4u32.to_le_bytes());
    data.extend(1u32.to_le_bytes());
    data.extend([0, 8, flags, streams.len() as u8]);
    data.extend((32 + extensions.len() as u32).to_le_bytes());
    data.extend([0; 12]);
    data.extend(extensions);
    let packed: Vec<_> = streams.iter().map(|s| compress_to_vec(*s, CompressionLevel::Fastest)).collect();
    for (packed, stream) in packed.iter().zip(streams) {
        data.extend((packed.len() as u64).to_le_bytes());
        data.extend((stream.len() as u64).to_le_bytes());
    }
    packed.iter().for_each(|packed| data.extend(packed));
    data
}

const POSITION: [u8; 9] = [0, 1, 0, 0x80, 0xff, 0xff, 0, 2, 0]; // 1, -0.5, 2
const STREAMS: [&[u8]; 5] = [&POSITION, &[51], &[255, 0, 51], &[160, 144, 0], &[0, 0, 0, 0xc0]];

fn read(data: &[u8]) -> weaver_io::Result<SceneFile> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.spz");
    std::fs::write(&path, data).unwrap();
    read_scene(&path)
}

fn message(data: &[u8]) -> String {
    read(data).unwrap_err().to_string()
}

#[test]
fn version_four_by_hand() {
    let scene = read(&file(0, &[], &STREAMS)).unwrap();
    assert_eq!((scene.gaussians.means[0], scene.gaussians.log_scales[0]), ([1.0, 0.5, -2.0], [0.0, -1.0, -10.0]));
    assert_eq!((scene.gaussians.quats[0], scene.drawing), ([1.0, 0.0, -0.0, -0.0], Drawing::default()));
    // Some encoders list harmonics that are not there.
    let [a, b, c, d, e] = STREAMS;
    assert_eq!(read(&file(0, &[], &[a, b, c, d, e, &[]])).unwrap(), scene);
}

#[test]
fn the_flag_of_training_is_passed_on() {
    assert!(read(&file(1, &[], &STREAMS)).unwrap().drawing.antialiased);
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.spz", "a.v4.spz", "a.ply", "a.compressed.ply"] {
        for antialiased in [false, true] {
            let path = folder.path().join(name);
            let gaussians = read(&file(1, &[], &STREAMS)).unwrap().gaussians;
            write_scene(&path, &gaussians, Drawing::antialiased(antialiased)).unwrap();
            assert_eq!(read_scene(&path).unwrap().drawing.antialiased, antialiased, "{name}");
        }
    }
}

#[test]
fn an_extension_names_the_axes() {
    let axes = |axes: u32| {
        [[1, 0, 0xad, 0x0b], [4, 0, 0, 0], [7; 4], 0xadbe_0003_u32.to_le_bytes(), [4, 0, 0, 0], axes.to_le_bytes()]
            .concat()
    };
    let mean = |axes: &[u8]| read(&file(2, axes, &STREAMS)).unwrap().gaussians.means[0];
    assert_eq!((mean(&axes(4)), mean(&axes(6))), ([1.0, 0.5, -2.0], [1.0, -0.5, 2.0]));
    let text = message(&file(2, &axes(9), &STREAMS));
    assert!(text.contains("expected axes right-up-back (4) or right-down-front (6), found 9"), "{text}");
    assert!(message(&file(2, &axes(4)[..14], &STREAMS)).contains("of an extension"));
}

#[test]
fn messages_say_what() {
    let [a, b, c, d, e] = STREAMS;
    let change = |at: usize, bytes: &[u8]| {
        let mut data = file(0, &[], &STREAMS);
        data[at..at + bytes.len()].copy_from_slice(bytes);
        message(&data)
    };
    let whole = file(0, &[], &STREAMS);
    let cases = [
        (change(4, &[5]), "expected version 4, found 5"),
        (change(8, &[0, 0, 0, 0xff]), "bytes of positions for 4278190080 Gaussians, found 9"),
        (change(15, &[4]), "expected 5 streams, found 4"),
        (change(16, &[0xff, 0xff, 0xff, 0xff]), "byte 16: expected a place of the table from 32"),
        (change(32, &[0xff; 8]), "bytes of positions, found 18446744073709551615"),
        (message(&file(0, &[], &[a, b, c, &[0; 4], e])), "expected 3 bytes of scales for 1 Gaussians, found 4"),
        (message(&whole[..whole.len() - 1]), "bytes of rotations"),
        (message(&[&whole[..], &[0]].concat()), "expected the end of the file, found 1 more bytes"),
        (message(&whole[..20]), "bytes of a header"),
        (change(112, &[0]), "expected a zstd stream of 9 bytes of positions"),
    ];
    for (message, expected) in cases {
        assert!(message.contains("a.spz: byte ") && message.contains(expected), "{message} for {expected}");
    }
    let _ = d;
}

/// A stream that goes on beyond its length is cut off there, not unpacked.
#[test]
fn no_more_is_unpacked_than_the_table_speaks_of() {
    let bomb = compress_to_vec(&vec![0; 64 << 20][..], CompressionLevel::Fastest);
    let mut data = file(0, &[], &STREAMS);
    let first = u64::from_le_bytes(data[32..40].try_into().unwrap()) as usize;
    data[32..40].copy_from_slice(&(bomb.len() as u64).to_le_bytes());
    data.splice(112..112 + first, bomb);
    assert!(message(&data).contains("expected a zstd stream of 9 bytes of positions"), "{}", message(&data));
}

#[test]
fn version_one_has_half_floats() {
    let mut data = b"NGSP".to_vec();
    data.extend(1u32.to_le_bytes());
    data.extend(1u32.to_le_bytes());
    data.extend([0, 0, 0, 0]);
    [1.5, -0.25, 100.0].iter().for_each(|x| data.extend(f16::from_f32(*x).to_le_bytes()));
    data.extend([51, 255, 0, 51, 160, 144, 0, 255, 0, 127]);
    let mut gzip = GzEncoder::new(Vec::new(), Compression::fast());
    gzip.write_all(&data).unwrap();
    let format: SceneFormat = "spz".parse().unwrap();
    let gaussians = read_gaussians_from(&gzip.finish().unwrap(), format).unwrap();
    assert_eq!((gaussians.means[0], gaussians.log_scales[0]), ([1.5, 0.25, -100.0], [0.0, -1.0, -10.0]));
}

/// Values that splat-transform reads from its fixtures.
///
/// Promise (kept): scenes that other tools have written are read as those tools read them.
#[test]
fn fixtures_of_splat_transform() {
    for name in ["minimal-v2.spz", "minimal-v3.spz", "minimal-v4.spz"] {
        let (found, expected) = (read_gaussians(fixtures::splats(name)).unwrap(), fixtures::decoded(name));
        fixtures::assert_same(name, &found, &expected, 1e-5);
    }
}

#[test]
fn version_four_of_a_real_scene_is_version_three() {
    let Some(folder) = shared::data("splat-files") else { return };
    let [three, four] = ["v3", "v4"].map(|v| read_gaussians(folder.join(format!("playbot-sh2.{v}.spz"))).unwrap());
    assert_eq!(three, four);
}
