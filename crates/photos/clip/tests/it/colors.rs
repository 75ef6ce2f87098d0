//! Colors of clips: HDR, and the matrices and ranges of others.

use crate::drawing::{Frames, convert, encode, frames, has_ffmpeg, mean, middles, patch, patches};
use crate::drawing::{set_matrix, turn, turned};
use std::path::Path;

const SIZE: (usize, usize) = (224, 160);
/// Weights of red and blue in luma.
const BT601: [f64; 2] = [0.299, 0.114];
const BT709: [f64; 2] = [0.2126, 0.0722];
const BT2020: [f64; 2] = [0.2627, 0.0593];
/// The record of a clip in BT.2020, but for its transfer.
const TAGS: &str = "-colorspace bt2020nc -color_primaries bt2020 -color_range tv";
/// Largest error of the mean of a patch, of 255: rounding in the clip, in the conversion and in the JPEG.
const ROUNDED: f64 = 3.0;

/// Y'CbCr of R'G'B' as numbers from 0 to 1 and from -0.5 to 0.5.
fn to_ycc([r, g, b]: [f64; 3], [red, blue]: [f64; 2]) -> [f64; 3] {
    let y = red * r + (1.0 - red - blue) * g + blue * b;
    [y, (b - y) / (2.0 - 2.0 * blue), (r - y) / (2.0 - 2.0 * red)]
}

/// Codes of so many bits, in limited or full range.
///
/// Source: Recommendation ITU-R BT.2100, table 9.
fn code([y, cb, cr]: [f64; 3], bits: u32, full: bool) -> [u16; 3] {
    let scale = f64::from(1 << (bits - 8));
    let top = f64::from((1 << bits) - 1);
    let all = match full {
        true => [top * y, top * cb + 128.0 * scale, top * cr + 128.0 * scale],
        false => [(219.0 * y + 16.0) * scale, (224.0 * cb + 128.0) * scale, (224.0 * cr + 128.0) * scale],
    };
    all.map(|value| value.round().clamp(0.0, top) as u16)
}

/// Luminance of a PQ signal, cd/m^2.
///
/// Source: Recommendation ITU-R BT.2100, table 4.
fn pq(signal: f64) -> f64 {
    let (m1, m2) = (2610.0 / 16384.0, 2523.0 / 4096.0 * 128.0);
    let (c1, c2, c3) = (3424.0 / 4096.0, 2413.0 / 4096.0 * 32.0, 2392.0 / 4096.0 * 32.0);
    let power = signal.powf(1.0 / m2);
    10_000.0 * ((power - c1).max(0.0) / (c2 - c3 * power)).powf(1.0 / m1)
}

/// Luminances of an HLG signal on a display of 1000 cd/m^2.
///
/// Source: Recommendation ITU-R BT.2100, table 5.
fn hlg(signal: [f64; 3]) -> [f64; 3] {
    let (a, b, c) = (0.178_832_77, 0.284_668_92, 0.559_910_73);
    let scene = signal.map(|x| if x <= 0.5 { x * x / 3.0 } else { (((x - c) / a).exp() + b) / 12.0 });
    let luma = BT2020[0] * scene[0] + (1.0 - BT2020[0] - BT2020[1]) * scene[1] + BT2020[1] * scene[2];
    scene.map(|x| 1000.0 * luma.max(1e-9).powf(0.2) * x)
}

/// Linear colors of BT.709 by BT.2020's.
///
/// Source: Report ITU-R BT.2407, 2.2.
fn to_bt709(c: [f64; 3]) -> [f64; 3] {
    let rows = [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]];
    rows.map(|row| (0..3).map(|i| row[i] * c[i]).sum())
}

/// The curve of the tone mapping: as it is up to 0.3, and from there to 1 at the peak, smoothly.
fn compressed(x: f64, peak: f64) -> f64 {
    let knee = 0.3;
    if x <= knee {
        return x;
    }
    // (p x + q) / (x + r) with slope 1 at the knee, and 1 at the peak.
    let r = (knee * knee - 2.0 * knee * peak + peak) / (peak - 1.0);
    ((2.0 * knee + r) * x - knee * knee) / (x + r)
}

fn srgb(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    255.0 * if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

/// The color in sRGB of luminances in BT.2020, whose white is 203 cd/m^2 and whose peak is 1000.
fn mapped(luminance: [f64; 3]) -> [f64; 3] {
    let linear = to_bt709(luminance.map(|x| x / 203.0));
    let most = linear.into_iter().fold(1e-9, f64::max);
    linear.map(|x| srgb(x * compressed(most, 1000.0 / 203.0) / most))
}

/// The signal of a patch of an HDR clip, up to a part of its range.
fn signal(patch: [f64; 3], most: f64) -> [f64; 3] {
    // Half of it gray, so that few colors are beyond sRGB.
    patch.map(|value| most * (0.1 + 0.6 * patch[0] + 0.3 * value))
}

/// Encodes patches as 10 bits of limited range in BT.2020.
pub fn encode_hdr(most: f64, transfer: &str, path: &Path) {
    encode_as(most, &format!("{TAGS} -color_trc {transfer}"), path);
}

/// Encodes them with this record.
fn encode_as(most: f64, record: &str, path: &Path) {
    let raw = patches(16, SIZE, |patch| code(to_ycc(signal(patch, most), BT2020), 10, false).map(u16::to_le_bytes));
    let output = format!("-c:v ffv1 {record}");
    encode(raw.as_flattened(), SIZE, "-pixel_format yuv444p10le -framerate 25", &output, path);
}

/// The largest difference of a patch of frames, turned by so many quarters, to its color of 255.
fn worst(found: &Frames, size: (usize, usize), quarters: usize, color: impl Fn([f64; 3]) -> [f64; 3]) -> f64 {
    let mut worst = 0.0f64;
    for (number, photo) in &found.photos {
        for at in middles(*number, size) {
            let (seen, expected) = (mean(photo, turned(at, size, quarters), 4), color(patch(at, *number)));
            worst = (0..3).map(|c| (seen[c] - expected[c]).abs()).fold(worst, f64::max);
        }
    }
    worst
}

/// The largest difference of a patch of a clip in PQ.
pub fn worst_of_pq(found: &Frames, most: f64) -> f64 {
    worst(found, SIZE, 0, |patch| mapped(signal(patch, most).map(pq)))
}

/// True if zscale converts HLG as BT.2100 has it, which it does from version 3.0.4 of its library on; says so where it
/// does not.
fn has_exact_hlg(test: &str) -> bool {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("gray.raw");
    let gray = code([0.5, 0.0, 0.0], 10, false).map(u16::to_le_bytes).concat();
    let linear = "zscale=tin=arib-std-b67:pin=bt2020:min=bt2020nc:t=linear:p=bt2020:m=gbr:npl=1000:agamma=0";
    let output = format!("-vf {linear},format=gbrpf32le,zscale=t=iec61966-2-1:r=full,format=gbrp -f rawvideo");
    encode(&gray, (1, 1), "-pixel_format yuv444p10le", &output, &path);
    let exact =
        std::fs::read(&path).unwrap().iter().all(|value| f64::from(*value) - srgb(hlg([0.5; 3])[0] / 1000.0) < 2.0);
    if !exact {
        println!("skipped: no ffmpeg with zimg 3.0.4 ({test})");
    }
    exact
}

/// Promise (photos): HDR clips (PQ, HLG) become sRGB as BT.2100 and the curve of the tone mapping have it, to 3 of 255.
#[test]
fn hdr_clips_become_srgb() {
    if !has_ffmpeg("hdr_clips_become_srgb") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let transfer = "-color_trc smpte2084";
    let [whole, hlg_too] = [transfer, "-color_trc arib-std-b67"].map(|transfer| format!("{TAGS} {transfer}"));
    // Some files hold nothing but the transfer.
    for (name, record, most) in [("PQ", whole.as_str(), 0.75), ("PQ", transfer, 0.75), ("HLG", &hlg_too, 0.95)] {
        let path = folder.path().join(format!("{name}.mkv"));
        encode_as(most, record, &path);
        let found = frames(&path, 6).unwrap();
        let note = format!("clip: HDR colors ({name}) of {} become sRGB by ", path.display());
        assert!(found.told.notes[0].starts_with(&note) && found.told.warnings.is_empty(), "{:?}", found.told.notes);
        if !found.told.notes[0].contains("zscale") {
            println!("skipped: no ffmpeg with zscale (hdr_clips_become_srgb)");
            return;
        }
        let off = match name {
            "PQ" => worst_of_pq(&found, most),
            _ if has_exact_hlg("hdr_clips_become_srgb") => worst(&found, SIZE, 0, |p| mapped(hlg(signal(p, most)))),
            _ => continue,
        };
        assert!(off < ROUNDED, "{name}: off by {off:.2}");
    }
}

/// Promise (photos): matrices of BT.601, BT.709 and BT.2020 in limited and full range become the same sRGB; pictures of
/// HD without a record of their matrix have BT.709's.
#[test]
fn matrices_and_ranges_come_out_right() {
    if !has_ffmpeg("matrices_and_ranges_come_out_right") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    // More than 576 lines are HD.
    let hd = (224, 608);
    for (name, size, weights, matrix, full) in [
        ("601 limited", SIZE, BT601, "-colorspace smpte170m", false),
        ("601 full", SIZE, BT601, "-colorspace bt470bg", true),
        ("709 limited", SIZE, BT709, "-colorspace bt709", false),
        ("709 full", SIZE, BT709, "-colorspace bt709", true),
        ("2020 limited", SIZE, BT2020, "-colorspace bt2020nc", false),
        ("2020 full", SIZE, BT2020, "-colorspace bt2020nc", true),
        ("SD without a record", SIZE, BT601, "", false),
        ("HD without a record", hd, BT709, "", false),
        ("HD without a record, full", hd, BT709, "", true),
    ] {
        let path = folder.path().join("a.mkv");
        let raw = patches(12, size, |patch| code(to_ycc(patch, weights), 8, full).map(|value| value as u8));
        let output = format!("-c:v ffv1 {matrix} -color_range {}", if full { "pc" } else { "tv" });
        encode(&raw, size, "-pixel_format yuv444p -framerate 25", &output, &path);
        let found = frames(&path, 4).unwrap();
        assert!(found.told.notes.len() == 1 && found.told.warnings.is_empty(), "{name}: {:?}", found.told.notes);
        let off = worst(&found, size, 0, |patch| patch.map(|value| 255.0 * value));
        assert!(off < ROUNDED, "{name}: off by {off:.2}");
    }
}

/// Colors of BT.2020 without HDR: grays stay, and others become sRGB.
///
/// Promise of `matrices_and_ranges_come_out_right`.
#[test]
fn wide_colors_become_srgb() {
    if !has_ffmpeg("wide_colors_become_srgb") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mkv");
    encode_hdr(1.0, "bt2020-10", &path);
    let found = frames(&path, 6).unwrap();
    let note = &found.told.notes[0];
    assert!(note.contains("wide colors of ") && note.contains(" become sRGB by "), "{note}");
    // The display of BT.1886, and back.
    let color =
        |patch| to_bt709(signal(patch, 1.0).map(|x| x.powf(2.4))).map(|x| 255.0 * x.clamp(0.0, 1.0).powf(1.0 / 2.4));
    let off = worst(&found, SIZE, 0, color);
    assert!(off < ROUNDED, "off by {off:.2}");
}

/// A clip as phones make them: HLG, on its side, and of variable rate.
///
/// Promise of `hdr_clips_become_srgb`.
#[test]
fn a_clip_of_a_phone_has_all_at_once() {
    if !has_ffmpeg("a_clip_of_a_phone_has_all_at_once") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let [even, uneven, path] = ["even.mkv", "uneven.mkv", "phone.mov"].map(|name| folder.path().join(name));
    encode_hdr(0.95, "arib-std-b67", &even);
    let tags = format!("{TAGS} -color_trc arib-std-b67");
    let uneven_times = "-vf settb=1/1000,setpts=40*N+25*mod(N\\,2) -enc_time_base 1/1000";
    convert(&even, &format!("{uneven_times} -c:v ffv1 {tags}"), &uneven);
    convert(&uneven, "-c copy", &path);
    set_matrix(&path, turn(90.0));
    let found = frames(&path, 6).unwrap();
    assert!(found.told.notes[0].contains("HDR colors (HLG)"), "{:?}", found.told.notes);
    for (number, time) in &found.times {
        let expected = 0.04 * *number as f64 + 0.025 * (number % 2) as f64;
        assert!((time - expected).abs() < 1e-4, "{number}: {time} s");
    }
    assert_eq!((found.photos.len(), found.times.len()), (6, 6));
    if found.told.notes[0].contains("zscale") && has_exact_hlg("a_clip_of_a_phone_has_all_at_once") {
        let off = worst(&found, SIZE, 1, |patch| mapped(hlg(signal(patch, 0.95))));
        assert!(off < ROUNDED, "off by {off:.2}");
    }
}
