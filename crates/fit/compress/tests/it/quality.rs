//! Compression to a wanted quality.

use crate::scenes::{cameras, pictures, scene};
use weaver_codec::lite::{Quality, decode};
use weaver_compress::{CompressError, Judge, MOST_DECIBELS, compress};
use weaver_scene::{Gaussians, orbit};

#[test]
fn the_quality_wanted_is_reached_and_hardly_passed() {
    let gaussians = scene(600, 3);
    let cameras = cameras(&gaussians);
    let mut judge = Judge::new(&gaussians, &pictures(&cameras)).unwrap();
    let mut before = usize::MAX;
    for wanted in [48.0, 40.0, 34.0] {
        let mut rounds = Vec::new();
        let compressed = compress(&gaussians, wanted, &mut judge, |round| rounds.push(round)).unwrap();
        let decoded = decode(&compressed.bytes).unwrap();
        assert_eq!(judge.psnr(&decoded).unwrap(), compressed.psnr, "what is said is what is written");
        assert!(compressed.psnr >= wanted && compressed.psnr < wanted + 1.0, "{} of {wanted} dB", compressed.psnr);
        assert!(compressed.bytes.len() < before, "fewer bytes for less quality");
        before = compressed.bytes.len();
        assert!(rounds.is_sorted_by_key(|round| round.done) && rounds.last().is_some_and(|last| last.done == last.of));
    }
}

#[test]
fn what_no_picture_shows_takes_the_largest_step() {
    let thin = scene(300, 5);
    // Balls look the same however they are turned.
    let balls = Gaussians { log_scales: thin.log_scales.iter().map(|[x, ..]| [*x; 3]).collect(), ..thin.clone() };
    let step = |gaussians: &Gaussians| {
        let cameras = cameras(gaussians);
        let mut judge = Judge::new(gaussians, &pictures(&cameras)).unwrap();
        compress(gaussians, 40.0, &mut judge, |_| {}).unwrap().quality.rotation_step
    };
    // Rotations' steps reach their bound for balls, and about half of it for thin Gaussians.
    let [balls, thin] = [step(&balls), step(&thin)];
    assert_eq!(balls, 0.2);
    assert!(thin < 0.6 * balls && balls > 10.0 * Quality::default().rotation_step, "{thin}");
}

#[test]
fn the_same_bytes_at_any_number_of_threads() {
    let gaussians = scene(400, 7);
    let cameras = cameras(&gaussians);
    let bytes = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut judge = Judge::new(&gaussians, &pictures(&cameras)).unwrap();
            compress(&gaussians, 42.0, &mut judge, |_| {}).unwrap().bytes
        })
    };
    assert_eq!(bytes(1), bytes(3));
}

#[test]
fn bad_input_is_named() {
    let gaussians = scene(20, 1);
    let cameras = cameras(&gaussians);
    assert!(matches!(Judge::new(&gaussians, &pictures(&[])), Err(CompressError::NoCameras)));
    let mut judge = Judge::new(&gaussians, &pictures(&cameras)).unwrap();
    for wrong in [0.0, -3.0, f64::NAN, f64::INFINITY, MOST_DECIBELS + 1.0] {
        let error = compress(&gaussians, wrong, &mut judge, |_| {}).unwrap_err();
        assert!(error.to_string().contains("decibels"), "{error}");
    }
    let mut broken = gaussians.clone();
    broken.means[3][1] = f32::NAN;
    assert!(matches!(compress(&broken, 40.0, &mut judge, |_| {}), Err(CompressError::Codec(_))));
    // One Gaussian, and many in one place.
    for count in [1, 50] {
        let mut same = scene(count, 2);
        let first = same.means[0];
        same.means.fill(first);
        let cameras = orbit(&same, 2, [32, 32]).unwrap();
        let mut judge = Judge::new(&same, &pictures(&cameras)).unwrap();
        assert!(compress(&same, 40.0, &mut judge, |_| {}).unwrap().psnr >= 40.0);
    }
}
