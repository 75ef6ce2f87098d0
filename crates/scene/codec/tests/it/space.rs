//! Morton codes, octree and RAHT against slow twins and identities.

use proptest::prelude::*;
use weaver_codec::{
    CodeLength, Coder, Raht, RangeDecoder, RangeEncoder, code_octree, from_morton2, from_morton3, morton2, morton3,
};
use weaver_kernels::random::Stream;

/// Interleaves bit by bit.
fn slow(coordinates: &[u32], bits: u32) -> u64 {
    let n = coordinates.len() as u32;
    (0..bits)
        .flat_map(|b| (0..n).map(move |c| (b, c)))
        .fold(0, |code, (b, c)| code | u64::from(coordinates[c as usize] >> b & 1) << (b * n + c))
}

fn decoded(bytes: &[u8], depth: u32, count: usize) -> Option<Vec<u64>> {
    let mut decoder = RangeDecoder::new(bytes);
    code_octree(&mut decoder, depth, count, &[]).ok().filter(|_| decoder.is_whole())
}

proptest! {
    #[test]
    fn morton_codes_interleave(x in any::<u32>(), y in any::<u32>(), z in any::<u32>()) {
        prop_assert_eq!(morton2([x, y]), slow(&[x, y], 32));
        prop_assert_eq!(from_morton2(morton2([x, y])), [x, y]);
        let voxel = [x, y, z].map(|c| c >> 11);
        prop_assert_eq!(morton3(voxel), slow(&voxel, 21));
        prop_assert_eq!(from_morton3(morton3(voxel)), voxel);
    }

    #[test]
    fn points_come_back(mut points in prop::collection::vec(any::<u64>(), 0..60), depth in 0..22_u32, near in 0..62_u32) {
        for point in &mut points {
            *point = (*point >> 1 >> near.min(3 * depth)) & ((1 << (3 * depth)) - 1);
        }
        points.sort_unstable();
        let mut encoder = RangeEncoder::default();
        prop_assert_eq!(&code_octree(&mut encoder, depth, points.len(), &points).unwrap(), &points);
        let bytes = encoder.finish();
        prop_assert_eq!(decoded(&bytes, depth, points.len()), Some(points.clone()));
        if points.len() > 1 {
            prop_assert_eq!(decoded(&bytes, depth, points.len() - 1), None);
        }
    }

    #[test]
    fn any_bytes_decode_to_the_count_or_fail(bytes in prop::collection::vec(any::<u8>(), 0..200), count in 0..300_usize) {
        let mut decoder = RangeDecoder::new(&bytes);
        if let Ok(points) = code_octree(&mut decoder, 12, count, &[]) {
            prop_assert!(points.len() == count && points.is_sorted());
        }
    }

    #[test]
    fn raht_keeps_energy_and_has_an_inverse(mut codes in prop::collection::vec(0..1_u64 << 40, 1..80), spread in 0..38, seed in 0..1000_u64) {
        codes.iter_mut().for_each(|code| *code >>= spread);
        codes.sort_unstable();
        let random = Stream::new(seed, 0, "codec.raht");
        let weights: Vec<f64> = (0..codes.len()).map(|i| 0.5 + random.uniform::<f64>(i as u64)).collect();
        let values: Vec<f64> = (0..3 * codes.len()).map(|i| random.normal::<f64>(1000 + i as u64)).collect();
        let raht = Raht::new(&codes, &weights).unwrap();
        let mut turned = values.clone();
        raht.forward(&mut turned, 3);
        // Every coefficient once, the mean first.
        let order = raht.order();
        let mut sorted = order.clone();
        sorted.sort_unstable();
        prop_assert!(order[0] == 0 && sorted.into_iter().eq(0..codes.len()));
        let energy = |values: &[f64]| values.iter().map(|x| x * x).sum::<f64>();
        prop_assert!((energy(&turned) / energy(&values) - 1.0).abs() < 1e-12);
        raht.inverse(&mut turned, 3);
        prop_assert!(turned.iter().zip(&values).all(|(a, b)| (a - b).abs() < 1e-12));
        // √w is the one vector that the first coefficient alone holds.
        let mut constant: Vec<f64> = weights.iter().map(|w| w.sqrt()).collect();
        raht.forward(&mut constant, 1);
        let total = weights.iter().sum::<f64>().sqrt();
        prop_assert!((constant[0] - total).abs() < 1e-12 * total * 100.0);
        prop_assert!(constant[1..].iter().all(|x| x.abs() < 1e-12));
    }
}

#[test]
fn a_surface_takes_fewer_bits_than_its_points_alone() {
    let random = Stream::new(3, 0, "codec.surface");
    let count = 20_000;
    let mut points: Vec<u64> = (0..count as u64)
        .map(|i| {
            let [a, b] = [2 * i, 2 * i + 1].map(|i| random.uniform::<f64>(i));
            let height = 0.5 + 0.2 * (6.0 * a).sin() * (5.0 * b).cos();
            morton3([a, b, height].map(|x| (x * 1024.0) as u32))
        })
        .collect();
    points.sort_unstable();
    let mut length = CodeLength::default();
    code_octree(&mut length, 10, count, &points).unwrap();
    let bits = length.bits / count as f64;
    // Anywhere in the cube points take 30 bits less log2(N!) / N = 12.8, on a surface that is known 20 less 12.8.
    assert!(bits < 12.0, "{bits}");
    let mut raw = CodeLength::default();
    raw.raw(30, 0);
    assert!((raw.bits - 30.0).abs() < 1e-9);
}

#[test]
fn what_does_not_fit_is_refused() {
    assert!(code_octree(&mut CodeLength::default(), 22, 1, &[0]).is_err());
    assert!(Raht::new(&[1, 0], &[1.0; 2]).is_err());
    assert!(Raht::new(&[0, 1], &[1.0]).is_err());
    assert!(Raht::new(&[0], &[f64::NAN]).is_err());
    assert!(Raht::new(&[], &[]).is_ok());
}
