//! Labels from peaks.

use weaver_fixtures::{Fixture, Tolerance};
use weaver_vad::{Rule, Splatting, resample, topographic_peaks, window_peaks};

const WORKED: [f64; 10] = [0.1, 0.1, 0.2, 0.5, 0.9, 0.6, 0.3, 0.1, 0.1, 0.1];

#[test]
fn labels_equal_the_reference() {
    let file = Fixture::open("vad_splat_metrics.safetensors").with(Tolerance::DOUBLE);
    for n in 0..11 {
        let scores = file.f64(&format!("in.curve{n}"));
        let peaks: Vec<f64> = window_peaks(&scores, 0.2).into_iter().map(|at| at as f64).collect();
        assert_eq!(peaks, file.f64(&format!("out.curve{n}.peaks")), "curve {n}");
        let peaks = topographic_peaks(&scores, 0.2, 0.5);
        let places: Vec<f64> = peaks.iter().map(|peak| peak.at as f64).collect();
        assert_eq!(places, file.f64(&format!("out.curve{n}.topographic_peaks")), "curve {n}");
        let heights: Vec<f64> = peaks.iter().map(|peak| peak.prominence).collect();
        file.assert_close(&format!("out.curve{n}.prominence"), &heights);
        for rule in Rule::ALL {
            let labels = Splatting::with(rule).labels(&scores);
            file.assert_close(&format!("out.curve{n}.{}", rule.letter()), &labels);
        }
    }
}

#[test]
fn the_worked_example() {
    assert_eq!(window_peaks(&WORKED, 0.2), [4]);
    let literal = Splatting::with(Rule::Literal).labels(&WORKED);
    assert_eq!(literal[4], 1.0);
    // A neighbor is within sigma of no score.
    assert!(literal.iter().enumerate().all(|(t, y)| t == 4 || *y < 1e-5), "{literal:?}");
    let expected = [0.0, 0.014439, 0.038984, 0.346643, 1.0, 0.551041, 0.092201, 0.014439, 0.0, 0.0];
    let found = Splatting::with(Rule::Score).labels(&WORKED);
    assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}");
}

/// Plateaus count once, flat curves have no labels, and labels are at most one.
#[test]
fn plateaus_count_once_and_flat_curves_never() {
    let plateau = [0.1, 0.1, 0.8, 0.8, 0.1, 0.1];
    assert_eq!(topographic_peaks(&plateau, 0.2, 0.5).len(), 1);
    assert_eq!(window_peaks(&plateau, 0.2).len(), 1);
    for rule in Rule::ALL {
        assert_eq!(Splatting::with(rule).labels(&[0.6; 9]), [0.0; 9]);
        assert_eq!(Splatting::with(rule).labels(&[]), [0.0; 0]);
        let close = [0.1, 0.9, 0.4, 0.9, 0.1, 0.9, 0.4, 0.9, 0.1];
        let labels = Splatting::with(rule).labels(&close);
        assert!(labels.iter().all(|y| (0.0..=1.0).contains(y)), "{labels:?}");
        assert_eq!(labels[1], 1.0);
    }
}

#[test]
fn resampling_equals_the_reference() {
    let file = Fixture::open("vad_splat_metrics.safetensors").with(Tolerance::DOUBLE);
    for (from, to) in [(7, 7), (7, 16), (33, 16), (200, 32), (1, 4)] {
        let x: Vec<f32> = file.f64(&format!("in.resample{from}to{to}")).iter().map(|x| *x as f32).collect();
        let found = resample(&x, 3, to);
        if from == to {
            assert_eq!(found, x);
        }
        let found: Vec<f64> = found.iter().map(|x| f64::from(*x)).collect();
        file.assert_close(&format!("out.resample{from}to{to}"), &found);
    }
}
