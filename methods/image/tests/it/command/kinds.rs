//! Pictures of other depths and channels, very small or plain ones, and parts of files.

use crate::command::{refused, told, wave};
use std::fs::File;
use std::io::Write;
use std::path::Path;
use weaver_io::{Background, Image};

/// Writes a TIFF of one strip, not compressed: weaver-io writes nothing but eight bits and three channels.
fn tiff(path: &Path, [width, height]: [u16; 2], bits: u16, samples: u16, data: &[u8]) {
    let mut file = b"II*\0\x08\0\0\0".to_vec();
    let extra = samples == 2 || samples == 4;
    let photometric = if samples < 3 { 1 } else { 2 };
    let mut entries: Vec<(u16, u16, u32, u32)> = vec![
        (256, 3, 1, width.into()),
        (257, 3, 1, height.into()),
        (258, 3, 1, bits.into()),
        (259, 3, 1, 1),
        (262, 3, 1, photometric),
        (273, 4, 1, 0),
        (277, 3, 1, samples.into()),
        (278, 3, 1, height.into()),
        (279, 4, 1, data.len() as u32),
    ];
    if extra {
        entries.push((338, 3, 1, 2));
    }
    let end = 8 + 2 + 12 * entries.len() as u32 + 4;
    let several = samples > 2;
    let start = end + if several { 2 * u32::from(samples) } else { 0 };
    file.extend((entries.len() as u16).to_le_bytes());
    for (tag, kind, mut count, mut value) in entries {
        match tag {
            258 if several => (count, value) = (samples.into(), end),
            258 if samples == 2 => (count, value) = (2, u32::from(bits) * 0x10001),
            273 => value = start,
            _ => {}
        }
        file.extend(tag.to_le_bytes());
        file.extend(kind.to_le_bytes());
        file.extend(count.to_le_bytes());
        file.extend(value.to_le_bytes());
    }
    file.extend([0; 4]);
    if several {
        (0..samples).for_each(|_| file.extend(bits.to_le_bytes()));
    }
    file.extend(data);
    File::create(path).unwrap().write_all(&file).unwrap();
}

#[test]
fn what_a_fit_cannot_keep_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let data: Vec<u8> = (0..40 * 30 * 8).map(|i| (i % 251) as u8).collect();
    for (name, bits, samples, expected) in [
        ("gray.tif", 8, 1, "gray.tif: gray, fitted as three equal channels"),
        ("deep.tif", 16, 3, "deep.tif: numbers of 16 bits are taken to 8"),
        ("clear.tif", 8, 4, "clear.tif: transparent parts are black in the result"),
    ] {
        let length = 40 * 30 * usize::from(bits / 8 * samples);
        tiff(&here.join(name), [40, 30], bits, samples, &data[..length]);
        let line = told(here, &format!("fit @{name} -o @p.wgi --gaussians 20 --steps 5"));
        assert!(line.contains(expected), "{line}");
    }
    wave(80, 60, 0.0).write_png(here.join("plain.png")).unwrap();
    let line = told(here, "fit @plain.png -o @p.wgi --gaussians 20 --steps 5");
    assert_eq!(line.lines().count(), 1, "{line}");
    assert_ne!(told(here, "fit @plain.png -o @p.wgi --gaussians 20 --steps 5 --coarse"), line);
    refused(here, "fit @plain.png -o @p.wgi --coarse --published", "cannot be used with");
}

#[test]
fn plain_and_tiny_pictures_are_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    Image::filled(90, 70, [0.2, 0.4, 0.6]).write_png(here.join("one.png")).unwrap();
    let line = told(here, "fit @one.png -o @one.wgi --gaussians 300 --steps 40");
    assert!(line.contains("64 Gaussians in place of 300"), "{line}");
    told(here, "draw @one.wgi -o @back.png");
    let back = Image::read(here.join("back.png"), Background::Black).unwrap();
    let apart: f32 = back.pixels.iter().zip([0.2, 0.4, 0.6].iter().cycle()).map(|(a, b)| (a - b).abs()).sum();
    assert!(apart / (back.pixels.len() as f32) < 0.05, "{apart}");
    Image::filled(1, 1, [0.5; 3]).write_png(here.join("dot.png")).unwrap();
    let line = told(here, "fit @dot.png -o @dot.wgi --steps 20");
    assert!(line.contains("1 x 1 pixels: a PNG is hardly larger") && line.contains("1 Gaussians"), "{line}");
    refused(here, "fit @dot.png -o @dot.wgi --gaussians 2", "expected 1 to 1, one per pixel, found 2");
    refused(here, "fit @none.png -o @dot.wgi", "none.png");
    refused(here, "fit @dot.wgi -o @p.wgi", "a JPEG, PNG, TIFF or WebP image");
}

#[test]
fn a_region_reads_its_blocks_alone() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    wave(300, 240, 0.0).write_png(here.join("p.png")).unwrap();
    told(here, "fit @p.png -o @p.wgi --gaussians 9000 --steps 2");
    told(here, "draw @p.wgi -o @whole.png --scale 0.5");
    let line = told(here, "draw @p.wgi -o @part.png --scale 0.5 --region 4,6,20,10");
    let numbers: Vec<usize> = line.split(|c: char| !c.is_ascii_digit()).filter_map(|x| x.parse().ok()).collect();
    let (taken, length) = (numbers[3], numbers[4]);
    assert!(taken < length * 2 / 3, "{line}");
    let image = |name: &str| Image::read(here.join(name), Background::Black).unwrap();
    assert_eq!(image("part.png"), image("whole.png").crop(4, 6, 20, 10));
    refused(
        here,
        "draw @p.wgi -o @part.png --region 290,0,20,10",
        "--region: expected pixels of 300 x 240, found 20 x 10",
    );
    refused(
        here,
        "draw @p.wgi -o @part.png --scale 1000",
        "expected a drawing of at most 268435456 pixels, found 300000 x",
    );
    refused(here, "draw @p.wgi -o @part.jpg", "expected a name that ends with .png");
    refused(here, "fit @p.png -o @p.wgi --psnr nan", "--psnr: expected a number of decibels, found NaN");
    // A file that is read as a whole is read once.
    let line = told(here, "draw @p.wgi -o @part.png");
    assert!(line.contains(&format!(", {length} of {length} bytes read")), "{line}");
}
