//! Interlaced clips.

use crate::drawing::{Frames, encode, frames, has_ffmpeg, set_matrix, smooth, turn, turned};
use std::path::Path;
use weaver_io::Bitmap;

const SIZE: (usize, usize) = (352, 288);
/// Pixels that the window moves from one field to the next.
const STEP: f64 = 3.0;
const CELL: f64 = 9.0;

/// The value of a pixel at the time of a field, of 255.
fn drawn(x: usize, y: usize, field: f64) -> f64 {
    40.0 + 170.0 * smooth(x as f64 + STEP * field, y as f64 + 0.2 * STEP * field, CELL)
}

/// Pictures whose lines were taken at two times: of the top field so many fields after the picture's time, and of the
/// bottom one.
fn pictures(count: usize, [top, bottom]: [f64; 2]) -> Vec<u8> {
    let line = |picture: usize, y: usize| {
        let field = 2.0 * picture as f64 + if y.is_multiple_of(2) { top } else { bottom };
        (0..SIZE.0).map(move |x| drawn(x, y, field).round() as u8)
    };
    (0..count).flat_map(|picture| (0..SIZE.1).flat_map(move |y| line(picture, y))).collect()
}

const TOP_FIRST: [f64; 2] = [0.0, 1.0];
const BOTTOM_FIRST: [f64; 2] = [1.0, 0.0];
const WHOLE: [f64; 2] = [0.0, 0.0];

fn luma(photo: &Bitmap, x: usize, y: usize) -> f64 {
    f64::from(photo.pixels[3 * (y * photo.width + x) + 1])
}

/// Mean difference of neighboring lines over the difference of every second one: of smooth pictures half, of combed
/// ones more than 1.
fn combing(photo: &Bitmap) -> f64 {
    let difference = |apart: usize| -> f64 {
        let line = |y: usize| (0..photo.width).map(move |x| (luma(photo, x, y) - luma(photo, x, y + apart)).abs());
        (8..photo.height - 8).flat_map(line).sum()
    };
    difference(1) / difference(2)
}

/// Mean difference to the picture that was drawn for the time of a frame's first field.
fn off(photo: &Bitmap, number: usize) -> f64 {
    let at = |x: usize, y: usize| {
        // Values of video, from 16 to 235.
        let drawn = (drawn(x, y, 2.0 * number as f64) - 16.0) * 255.0 / 219.0;
        (luma(photo, x, y) - drawn).abs()
    };
    let all = (8..photo.height - 8).flat_map(|y| (8..photo.width - 8).map(move |x| at(x, y)));
    all.sum::<f64>() / ((photo.width - 16) * (photo.height - 16)) as f64
}

/// The frames of pictures with these times of their fields; the values that are drawn are luma.
fn clip(path: &Path, fields: [f64; 2], input: &str, output: &str) -> Frames {
    let gray = vec![128; SIZE.0 * SIZE.1 / 2];
    let luma = pictures(24, fields);
    let raw: Vec<u8> = luma.chunks_exact(SIZE.0 * SIZE.1).flat_map(|luma| [luma, &gray].concat()).collect();
    encode(&raw, SIZE, &format!("-pixel_format yuv420p {input}"), output, path);
    frames(path, 8).unwrap()
}

fn told(frames: &Frames) -> String {
    [frames.told.notes.clone(), frames.told.warnings.clone()].concat().join("\n")
}

/// Promise (photos): interlaced clips of 50 and 60 Hz are deinterlaced, whichever field is first and whether the file,
/// its pictures or nothing says so; a record that lies is overruled, and the user is told in a line.
#[test]
fn interlaced_clips_have_frames_without_combs() {
    if !has_ffmpeg("interlaced_clips_have_frames_without_combs") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let mpeg = "-c:v mpeg2video -q:v 2 -flags +ildct+ilme";
    let (pal, ntsc) = ("-framerate 25", "-framerate 30000/1001");
    for (name, fields, input, output, said) in [
        // The order in the record and in the marks of the pictures.
        ("pal.mpg", TOP_FIRST, pal, format!("-vf setfield=tff {mpeg}"), "interlaced, the top field first; bwdif"),
        ("pal.mkv", BOTTOM_FIRST, pal, format!("-vf setfield=bff {mpeg}"), "the bottom field first; bwdif"),
        ("ntsc.mpg", TOP_FIRST, ntsc, format!("-vf setfield=tff {mpeg}"), "the top field first; bwdif"),
        ("dv.mov", BOTTOM_FIRST, ntsc, "-vf setfield=bff -c:v ffv1".into(), "the bottom field first; bwdif"),
        // Neither the file nor its pictures say anything, or they lie.
        ("unmarked.avi", TOP_FIRST, pal, "-c:v ffv1".into(), "pictures show; it is marked as progressive; bwdif"),
        ("unmarked-2.avi", BOTTOM_FIRST, ntsc, "-c:v ffv1".into(), "bottom field first, as its pictures show"),
        ("lie.mkv", BOTTOM_FIRST, pal, "-vf setfield=tff -c:v ffv1".into(), "bottom field first, as its pictures"),
    ] {
        let found = clip(&folder.path().join(name), fields, input, &output);
        let text = told(&found);
        assert!(text.contains(said) && found.told.warnings.is_empty(), "{name}: {text}");
        assert!(found.photos.len() == 8, "{name}: {text}");
        for (number, photo) in &found.photos {
            assert_eq!((photo.width, photo.height), SIZE);
            let (combing, off) = (combing(photo), off(photo, *number));
            assert!(combing < 0.55 && off < 2.0, "{name} {number}: combing {combing:.2}, off by {off:.1}");
        }
    }
}

/// Pictures that are whole stay as they are, also where they are marked as interlaced, and combs are measured here.
///
/// Promise of `interlaced_clips_have_frames_without_combs`.
#[test]
fn whole_pictures_stay_whole() {
    if !has_ffmpeg("whole_pictures_stay_whole") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for (name, output, notes) in [
        ("whole.mkv", "-c:v ffv1", 1),
        ("psf.mkv", "-vf setfield=tff -c:v ffv1", 2),
        ("psf.mov", "-vf setfield=bff -c:v ffv1", 2),
    ] {
        let found = clip(&folder.path().join(name), WHOLE, "-framerate 25", output);
        let text = told(&found);
        assert_eq!(found.told.notes.len(), notes, "{name}: {text}");
        assert_eq!(
            text.contains("is progressive, as its pictures show; it is marked as interlaced"),
            notes == 2,
            "{text}"
        );
        for (number, photo) in &found.photos {
            let off = off(photo, *number);
            assert!(off < 1.0, "{name} {number}: off by {off:.1}");
        }
    }
    let combed = pictures(1, TOP_FIRST).iter().flat_map(|value| [*value; 3]).collect();
    let combed = combing(&Bitmap { width: SIZE.0, height: SIZE.1, pixels: combed });
    assert!(combed > 1.0, "{combed:.2}");
}

/// Fields are joined before pictures are turned.
///
/// Promise of `interlaced_clips_have_frames_without_combs`.
#[test]
fn interlaced_clips_are_turned_without_combs() {
    if !has_ffmpeg("interlaced_clips_are_turned_without_combs") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mov");
    clip(&path, TOP_FIRST, "-framerate 25", "-vf setfield=tff -c:v ffv1");
    for quarters in 1..4 {
        set_matrix(&path, turn(90.0 * quarters as f64));
        let found = frames(&path, 4).unwrap();
        for (number, photo) in found.photos {
            let shown = if quarters == 2 { SIZE } else { (SIZE.1, SIZE.0) };
            assert_eq!((photo.width, photo.height), shown);
            let back = |[x, y]: [usize; 2]| photo.pixels[3 * (y * photo.width + x)..][..3].to_vec();
            let all = (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| [x, y]));
            let pixels = all.flat_map(|at| back(turned(at, SIZE, quarters))).collect();
            let stored = Bitmap { width: SIZE.0, height: SIZE.1, pixels };
            let (combing, off) = (combing(&stored), off(&stored, number));
            assert!(combing < 0.55 && off < 2.0, "{quarters} {number}: combing {combing:.2}, off by {off:.1}");
        }
    }
}
