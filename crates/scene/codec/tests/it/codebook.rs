//! Vector quantization: planted clusters, importance, dead codes.

use weaver_codec::Codebook;
use weaver_kernels::random::Stream;

/// Three dimensions, eight clusters, a tenth of their distance wide.
fn planted(count: usize) -> (Vec<f64>, Vec<f64>) {
    let random = Stream::new(4, 0, "codec.planted");
    let centers: Vec<f64> = (0..24).map(|i| f64::from(((i as u8 / 3) >> (i % 3)) & 1)).collect();
    let draw = |i: usize| centers[(i / 3 % 8) * 3 + i % 3] + 0.05 * random.normal::<f64>(i as u64);
    ((0..3 * count).map(draw).collect(), centers)
}

#[test]
fn planted_clusters_are_found() {
    let (vectors, centers) = planted(800);
    let book = Codebook::fit(&vectors, 3, &[1.0; 800], 24, 60).unwrap();
    for center in centers.chunks_exact(3) {
        let code = &book.codes[3 * book.nearest(center)..][..3];
        let distance: f64 = code.iter().zip(center).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        assert!(distance < 0.08, "{code:?} for {center:?}");
    }
}

#[test]
fn same_bits_at_any_number_of_threads() {
    let (vectors, _) = planted(500);
    let at = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| Codebook::fit(&vectors, 3, &[1.0; 500], 16, 10).unwrap())
    };
    assert_eq!(at(1), at(3));
}

#[test]
fn codes_go_to_the_important() {
    // With one code it is the weighted mean.
    let book = Codebook::fit(&[0.0, 1.0], 1, &[1.0, 3.0], 1, 80).unwrap();
    assert!((book.codes[0] - 0.75).abs() < 1e-6);
    // Equal beginnings die but for one, and the most important vector that is not met takes their place.
    let vectors = [1.0, 1.0, 1.0, 1.0, 7.0, 9.0];
    let book = Codebook::fit(&vectors, 1, &[5.0, 5.0, 5.0, 5.0, 2.0, 1.0], 3, 80).unwrap();
    let mut codes = book.codes;
    codes.sort_by(f64::total_cmp);
    assert!(codes.iter().zip([1.0, 7.0, 9.0]).all(|(a, b)| (a - b).abs() < 1e-6), "{codes:?}");
}

#[test]
fn what_does_not_fit_is_refused() {
    assert!(Codebook::fit(&[], 1, &[], 1, 1).is_err());
    assert!(Codebook::fit(&[1.0], 0, &[1.0], 1, 1).is_err());
    assert!(Codebook::fit(&[1.0, 2.0], 1, &[1.0], 1, 1).is_err());
    assert!(Codebook::fit(&[f64::NAN], 1, &[1.0], 1, 1).is_err());
    assert!(Codebook::fit(&[1.0], 1, &[-1.0], 1, 1).is_err());
    assert!(Codebook::fit(&[1.0], 1, &[0.0], 5, 3).is_ok());
}
