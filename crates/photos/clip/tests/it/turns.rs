//! Clips that are turned when they are shown.

use crate::drawing::{encode, frames, has_ffmpeg, mean, middles, patch, patches, set_matrix, turn, turned};
use std::path::Path;

const SIZE: (usize, usize) = (224, 160);

/// A clip of patches in a MOV.
fn clip(path: &Path, matrix: [f64; 4]) {
    // The planes of RGB are stored as G, B, R.
    let raw = patches(20, SIZE, |[r, g, b]| [g, b, r].map(|value| (255.0 * value).round() as u8));
    encode(&raw, SIZE, "-pixel_format gbrp -framerate 25", "-c:v ffv1", path);
    set_matrix(path, matrix);
}

/// Promise (photos): frames of phones are upright and turned once; other turns become the nearest quarter, with a
/// warning.
#[test]
fn frames_stand_upright() {
    if !has_ffmpeg("frames_stand_upright") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for (degrees, quarters, said) in [
        (0.0, 0, ""),
        (90.0, 1, ""),
        (180.0, 2, ""),
        (270.0, 3, ""),
        (30.0, 0, "expected a turn by 0, 90, 180 or 270 degrees in its record, found 30; its frames are turned by 0"),
        (110.0, 1, "found 110; its frames are turned by 90"),
        (-80.0, 3, "found 280; its frames are turned by 270"),
    ] {
        let path = folder.path().join(format!("{degrees}.mov"));
        clip(&path, turn(degrees));
        let found = frames(&path, 6).unwrap();
        let warnings = found.told.warnings.join("\n");
        assert!(warnings.contains(said) && warnings.is_empty() == said.is_empty(), "{degrees}: {warnings}");
        assert_eq!(found.photos.len(), 6);
        let shown = if quarters % 2 == 0 { SIZE } else { (SIZE.1, SIZE.0) };
        for (number, photo) in &found.photos {
            assert_eq!((photo.width, photo.height), shown, "{degrees}");
            for at in middles(*number, SIZE) {
                let seen = mean(photo, turned(at, SIZE, quarters), 4);
                let drawn = patch(at, *number).map(|value| 255.0 * value);
                assert!(
                    (0..3).all(|c| (seen[c] - drawn[c]).abs() < 4.0),
                    "{degrees} {number} {at:?}: {seen:?} {drawn:?}"
                );
            }
        }
        let info = weaver_clip::info(&path).unwrap();
        assert!(info.starts_with(&format!("clip of {}x{} pixels", shown.0, shown.1)), "{info}");
    }
}

/// Mirrored pictures are shown mirrored.
///
/// Promise of `frames_stand_upright`.
#[test]
fn mirrored_frames_are_mirrored() {
    if !has_ffmpeg("mirrored_frames_are_mirrored") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mov");
    clip(&path, [-1.0, 0.0, 0.0, 1.0]);
    for (number, photo) in frames(&path, 6).unwrap().photos {
        for [x, y] in middles(number, SIZE) {
            let (seen, drawn) = (mean(&photo, [SIZE.0 - 1 - x, y], 4), patch([x, y], number));
            assert!((0..3).all(|c| (seen[c] - 255.0 * drawn[c]).abs() < 4.0), "{number}: {seen:?}");
        }
    }
}
