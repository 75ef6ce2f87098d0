//! The page of the file's layout: a Python reader written from it gives the same Gaussians.

use crate::random::gaussians;
use std::process::Command;
use weaver_image::{CUT, Fitted, decode, encode_in_blocks};

#[test]
fn a_reader_of_the_documented_layout_agrees() {
    let reader = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/reader.py");
    if Command::new("python3").arg("--version").output().is_err() {
        println!("skipped: no python3 (a_reader_of_the_documented_layout_agrees)");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("picture.wgi");
    for (count, size, most) in [(0, [20, 20], 9), (1, [9, 4000], 9), (300, [300, 200], 300), (300, [300, 200], 40)] {
        let fitted = Fitted { gaussians: gaussians(count as u64, count, size, [0.3, 60.0]), cut: CUT, reset: 0 };
        let bytes = encode_in_blocks(&fitted, size[0], size[1], most).unwrap();
        let expected = decode(&bytes).unwrap().fitted.gaussians;
        std::fs::write(&file, &bytes).unwrap();
        let done = Command::new("python3").arg(reader).arg(&file).output();
        let done = done.unwrap();
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        let text = String::from_utf8(done.stdout).unwrap();
        assert_eq!(text.lines().count(), count);
        for (i, line) in text.lines().enumerate() {
            let found: Vec<f32> = line.split(' ').map(|x| x.parse().unwrap()).collect();
            let known = [
                &expected.centers[2 * i..2 * i + 2],
                &expected.scales[2 * i..2 * i + 2],
                &expected.angles[i..=i],
                &expected.colors[3 * i..3 * i + 3],
            ]
            .concat();
            let same = found.iter().zip(&known).all(|(a, b)| (a - b).abs() <= 1e-5 * (1.0 + b.abs()));
            assert!(same && found.len() == 8, "Gaussian {i}: {found:?}, expected {known:?}");
        }
    }
}
