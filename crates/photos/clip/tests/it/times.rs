//! Clips of variable rate.

use crate::drawing::{convert, encode, frames, has_ffmpeg, mean, middles, patch, patches};
use std::path::Path;

const SIZE: (usize, usize) = (224, 160);
/// Milliseconds from one picture to the next, again and again.
const STEPS: [usize; 5] = [17, 33, 50, 16, 250];

/// When a picture is shown, milliseconds.
fn time(number: usize) -> usize {
    (0..number).map(|i| STEPS[i % STEPS.len()]).sum()
}

/// A clip whose pictures are shown at these times, milliseconds.
fn clip(path: &Path, raw: &[u8], times: &[usize]) {
    // A sum with one term for each picture.
    let terms = times.iter().enumerate().map(|(number, time)| format!("{time}*eq(N,{number})"));
    let times = terms.collect::<Vec<_>>().join("+").replace(',', "\\,");
    encode(
        raw,
        SIZE,
        "-pixel_format gbrp -framerate 1000",
        &format!("-vf settb=1/1000,setpts={times} -c:v ffv1"),
        path,
    );
}

fn drawn(count: usize) -> Vec<u8> {
    patches(count, SIZE, |[r, g, b]| [g, b, r].map(|value| (255.0 * value).round() as u8))
}

/// Promise (photos): frames of clips of variable rate are chosen by their time stamps and keep their times.
#[test]
fn frames_have_the_times_of_their_pictures() {
    if !has_ffmpeg("frames_have_the_times_of_their_pictures") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let times: Vec<usize> = (0..24).map(time).collect();
    let paths = ["a.mkv", "a.mov"].map(|name| folder.path().join(name));
    clip(&paths[0], &drawn(24), &times);
    // Some versions write a MOV at a constant rate unless they copy.
    convert(&paths[0], "-c copy", &paths[1]);
    for path in paths {
        let name = path.display();
        let found = frames(&path, 8).unwrap();
        assert_eq!(found.photos.len(), 8, "{name}: {:?}", found.told.notes);
        for (number, photo) in &found.photos {
            let (found, expected) = (found.times[number], times[*number] as f64 / 1000.0);
            assert!((found - expected).abs() < 1e-4, "{name} {number}: {found} s in place of {expected} s");
            for at in middles(*number, SIZE) {
                let (seen, drawn) = (mean(photo, at, 4), patch(at, *number));
                assert!((0..3).all(|c| (seen[c] - 255.0 * drawn[c]).abs() < 4.0), "{name} {number}: {seen:?}");
            }
        }
    }
}

/// Pictures that a clip repeats, as where its rate was made constant, become one photo, also around jumps.
///
/// Promise of `frames_have_the_times_of_their_pictures`.
#[test]
fn a_picture_that_is_repeated_is_one_frame() {
    if !has_ffmpeg("a_picture_that_is_repeated_is_one_frame") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mkv");
    let picture = 3 * SIZE.0 * SIZE.1;
    let all = drawn(60);
    // A slow way, and long jumps of the camera at the end.
    let shown: Vec<usize> = (0..10).chain([22, 34, 46, 58]).flat_map(|number| [number; 4]).collect();
    let raw: Vec<u8> = shown.iter().flat_map(|n| &all[n * picture..(n + 1) * picture]).copied().collect();
    let times: Vec<usize> = (0..shown.len()).map(|i| 20 * i).collect();
    clip(&path, &raw, &times);
    for most in [5, 10, 50] {
        let found = frames(&path, most).unwrap();
        let mut pictures: Vec<usize> = found.photos.keys().map(|number| shown[*number]).collect();
        let chosen = pictures.clone();
        pictures.dedup();
        assert!(pictures.len() >= 4 && pictures == chosen, "{most}: {chosen:?}");
    }
}
