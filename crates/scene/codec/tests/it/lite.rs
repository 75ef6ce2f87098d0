//! Scenes: errors bounded by steps, bad input refused, any bytes borne, same bytes at any threads.

use proptest::prelude::*;
use weaver_codec::lite::{Quality, decode, decode_start, encode, order, rounded, rounded_in_place};
use weaver_codec::{CodecError, Container, Stream};
use weaver_geometry::glam::{DMat3, DQuat, DVec3};
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_kernels::random::Stream as Random;
use weaver_scene::{Gaussians, forms};
use weaver_splat::{RasterSettings, Workspace, render};

/// A cloud on a sphere.
fn cloud(count: usize, degree: usize) -> Gaussians {
    let random = Random::new(5, 0, "codec.cloud");
    let normal = |i: usize, k: u64| random.fork(k).normal::<f64>(i as u64) as f32;
    let mut gaussians = Gaussians { degree, ..Gaussians::default() };
    for i in 0..count {
        let place = [normal(i, 0), normal(i, 1), normal(i, 2)];
        let length = place.iter().map(|x| x * x).sum::<f32>().sqrt();
        gaussians.means.push(place.map(|x| 2.0 * x / length + 7.0));
        gaussians.log_scales.push([-4.0 + normal(i, 3), -5.0 + normal(i, 4), -5.5 + normal(i, 5)]);
        gaussians.quats.push([6, 7, 8, 9].map(|k| normal(i, k)));
        gaussians.opacity_logits.push(2.0 * normal(i, 10));
    }
    let per_row = 3 * gaussians.coefficients();
    gaussians.sh = (0..count * per_row).map(|i| 0.2 * normal(i, 11)).collect();
    gaussians
}

/// Pairs of Gaussians before and after: nearest in all three coordinates together.
fn pairs(before: &Gaussians, after: &Gaussians) -> Vec<(usize, usize)> {
    let distance = |a: [f32; 3], b: [f32; 3]| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f32>();
    let near = |i: usize| {
        let far = |j: &usize| distance(before.means[i], after.means[*j]);
        (0..after.len()).min_by(|a, b| far(a).total_cmp(&far(b))).unwrap()
    };
    (0..before.len()).map(|i| (i, near(i))).collect()
}

#[test]
fn errors_are_within_half_a_step() {
    let before = cloud(300, 2);
    for mut quality in Quality::SETTINGS {
        quality.dead_zone = 0.0;
        quality.position = quality.position.min(0.05);
        let after = decode(&encode(&before, &quality).unwrap()).unwrap();
        let logs = before.log_scales.as_flattened();
        let cell = quality.position * (logs.iter().map(|s| f64::from(*s)).sum::<f64>() / logs.len() as f64).exp();
        for (i, j) in pairs(&before, &after) {
            for axis in 0..3 {
                let error = f64::from(before.means[i][axis] - after.means[j][axis]).abs();
                assert!(error <= 0.5 * cell + 1e-5, "{error} of {cell}");
            }
            let mut sorted = before.log_scales[i];
            sorted.sort_by(|a, b| b.total_cmp(a));
            let scale = sorted.iter().zip(after.log_scales[j]).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(f64::from(scale) <= 0.5 * quality.scale_step + 1e-4);
            let [a, b] = [before.opacity_logits[i], after.opacity_logits[j]].map(|x| f64::from(forms::opacity(x)));
            assert!((a - b).abs() <= 0.5 / f64::from(quality.opacity_levels) + 1e-6);
            let length: f32 = after.quats[j].iter().map(|x| x * x).sum();
            assert!((length - 1.0).abs() < 1e-5);
        }
    }
}

/// Promise of `colors_that_hardly_vary_cost_little`.
#[test]
fn errors_of_colors_are_those_of_their_steps() {
    let before = cloud(3000, 2);
    for quality in Quality::SETTINGS {
        let quality = Quality { dead_zone: 0.0, position: 0.01, ..quality };
        let after = rounded_in_place(&before, &quality).unwrap();
        // In units of the root mean square of an error within half a step, by a Gaussian's visibility.
        let error = |numbers: std::ops::Range<usize>, gaussians: &[usize], step: f64| {
            let squares = gaussians.iter().flat_map(|i| numbers.clone().map(move |k| 27 * i + k));
            let squares = squares.map(|k| f64::from(before.sh[k] - after.sh[k]).powi(2));
            (squares.sum::<f64>() / (gaussians.len() * numbers.len()) as f64 * 12.0).sqrt() / step
        };
        let order: Vec<usize> = {
            let size = |i: &usize| {
                let mut scales = before.log_scales[*i];
                scales.sort_by(f32::total_cmp);
                0.5 * (scales[1] + scales[2]) + forms::opacity(before.opacity_logits[*i]).ln()
            };
            let mut order: Vec<usize> = (0..3000).collect();
            order.sort_by(|a, b| size(b).total_cmp(&size(a)));
            order
        };
        for (numbers, step) in [(0..3, quality.dc_step), (3..27, quality.sh_step)] {
            let [much, little] = [&order[..300], &order[2700..]].map(|some| error(numbers.clone(), some, step));
            assert!(much < 1.0 && little > 2.0 * much && little < 2.5_f64.exp(), "{much} {little}");
        }
        let equal = Quality { adaptation: 0.0, ..quality };
        let after = rounded_in_place(&before, &equal).unwrap();
        let worst = before.sh.iter().zip(&after.sh).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(f64::from(worst) < 3.0 * quality.dc_step.max(quality.sh_step), "{worst}");
    }
}

/// Promise (scenes): nearly constant colors of a compressed scene cost next to nothing; errors of other colors are
/// bounded by each Gaussian's visible weight.
#[test]
fn colors_that_hardly_vary_cost_little() {
    // Of many Gaussians of one color and any visibility, one coefficient is not 0.
    let mut gaussians = cloud(20_000, 3);
    let one = gaussians.sh[..48].to_vec();
    gaussians.sh = one.repeat(20_000);
    let bytes = encode(&gaussians, &Quality::default()).unwrap();
    let container = Container::read(&bytes).unwrap();
    let of = |name: &[u8; 4]| container.streams.iter().find(|s| s.name == *name).unwrap().bytes.len();
    assert!(of(b"colo") < 400 && of(b"harm") < 800, "{} {}", of(b"colo"), of(b"harm"));
    let after = decode(&bytes).unwrap();
    assert!(after.sh.iter().zip(one.iter().cycle()).all(|(a, b)| (a - b).abs() < 0.01));
}

#[test]
fn coarser_settings_take_fewer_bytes() {
    let gaussians = cloud(2000, 1);
    let bytes: Vec<usize> =
        (0..7).map(|i| encode(&gaussians, &Quality::level(f64::from(i) / 2.0)).unwrap().len()).collect();
    assert!(bytes.is_sorted_by(|a, b| a > b), "{bytes:?}");
}

#[test]
fn pictures_do_not_get_better_with_larger_steps() {
    let gaussians = cloud(800, 1);
    let intrinsics = Intrinsics { fx: 70.0, fy: 70.0, cx: 32.0, cy: 32.0 };
    let pose = Pose::new(Pose::IDENTITY.rotation, [-7.0, -7.0, -2.0].into());
    let camera = Camera { pose, intrinsics, width: 64, height: 64 };
    let draw = |gaussians: &Gaussians| {
        let settings = RasterSettings::default();
        render(&gaussians.to_activated(), &[camera], [1.0; 3], &settings, &mut Workspace::new()).unwrap().remove(0)
    };
    let exact = draw(&gaussians);
    let psnr = |quality: Quality| {
        let drawn = draw(&decode(&encode(&gaussians, &quality).unwrap()).unwrap());
        let squares: f64 = drawn.iter().zip(&exact).map(|(a, b)| f64::from(a - b).powi(2)).sum();
        -10.0 * (squares / exact.len() as f64).log10()
    };
    let quality = Quality::SETTINGS.map(psnr);
    assert!(quality.is_sorted_by(|a, b| *b <= a + 0.05) && quality[3] > 20.0, "{quality:?}");
}

#[test]
fn all_degrees_and_no_or_one_gaussian() {
    for degree in 0..=4 {
        for count in [0, 1, 2, 50] {
            let before = cloud(count, degree);
            let after = decode(&encode(&before, &Quality::default()).unwrap()).unwrap();
            assert!(after.lengths_agree());
            assert_eq!((after.len(), after.degree), (count, degree));
        }
    }
}

#[test]
fn odd_gaussians_are_stored() {
    let mut odd = cloud(40, 1);
    odd.quats[0] = [0.0; 4];
    odd.opacity_logits[1] = f32::INFINITY;
    odd.opacity_logits[2] = f32::NEG_INFINITY;
    odd.log_scales[3] = [f32::MAX, 0.0, f32::MIN];
    odd.sh[5] = f32::MAX;
    odd.means[4] = [1e30, -1e30, 0.0];
    let after = decode(&encode(&odd, &Quality::default()).unwrap()).unwrap();
    assert_eq!(after.len(), 40);
    assert!(after.means.as_flattened().iter().chain(&after.opacity_logits).all(|x| x.is_finite()));
    assert!(after.means.iter().any(|m| m[0] > 0.99e30) && after.means.iter().any(|m| m[1] < -0.99e30));
    assert!(after.opacity_logits.iter().any(|&x| x > 5.0) && after.opacity_logits.iter().any(|&x| x < -5.0));
}

#[test]
fn equal_points_take_one_voxel() {
    let one = cloud(1, 3);
    let same = |count: usize| Gaussians {
        means: one.means.repeat(count),
        log_scales: one.log_scales.repeat(count),
        quats: one.quats.repeat(count),
        opacity_logits: one.opacity_logits.repeat(count),
        sh: one.sh.repeat(count),
        degree: 3,
    };
    let bytes = encode(&same(40_000), &Quality::default()).unwrap();
    // At least one byte for eight under any model; only bits without a model remain.
    assert!((5000..100_000).contains(&bytes.len()), "{}", bytes.len());
    let after = decode(&bytes).unwrap();
    assert!(after.len() == 40_000 && after.means.iter().all(|m| *m == after.means[0]));
    assert_eq!(after.means[0], one.means[0]);
}

#[test]
fn values_that_cannot_be_stored_are_named() {
    type Spoil = fn(&mut Gaussians);
    let spoil: [(Spoil, &str); 6] = [
        (|g| g.means[7][1] = f32::NAN, "Gaussian 7, position"),
        (|g| g.log_scales[7][0] = f32::INFINITY, "Gaussian 7, scale"),
        (|g| g.quats[7][3] = f32::NAN, "Gaussian 7, rotation"),
        (|g| g.opacity_logits[7] = f32::NAN, "Gaussian 7, opacity"),
        (|g| g.sh[12 * 7] = f32::NEG_INFINITY, "Gaussian 7, color"),
        (|g| g.sh.truncate(5), "Gaussians"),
    ];
    for (spoil, name) in spoil {
        let mut gaussians = cloud(9, 1);
        spoil(&mut gaussians);
        let error = encode(&gaussians, &Quality::default()).unwrap_err().to_string();
        assert!(error.starts_with(name), "{error}");
    }
    let quality = Quality { opacity_levels: 0, ..Quality::default() };
    assert!(encode(&cloud(3, 0), &quality).is_err());
}

/// The same container with other sizes or streams, its checksums right.
fn changed(bytes: &[u8], change: impl FnOnce(&mut Container<'_>)) -> Vec<u8> {
    let mut container = Container::read(bytes).unwrap();
    change(&mut container);
    container.write()
}

#[test]
fn streams_that_disagree_are_refused() {
    let bytes = encode(&cloud(100, 1), &Quality::default()).unwrap();
    let refused = |change: fn(&mut Container<'_>)| decode(&changed(&bytes, change)).unwrap_err().to_string();
    refused(|c| c.gaussians = 99);
    refused(|c| c.gaussians = 101);
    assert!(refused(|c| c.streams[1..].iter_mut().for_each(|s| s.symbols = 99)).contains("99"));
    for count in [99, 101] {
        let mut spoiled = changed(&bytes, |_| ());
        spoiled = changed(&spoiled, |c| {
            c.gaussians = count;
            c.streams[1..].iter_mut().for_each(|s| s.symbols = count);
        });
        let error = decode(&spoiled).unwrap_err().to_string();
        assert!(error.starts_with("octree"), "{error}");
    }
    assert!(refused(|c| c.coefficients = 5).contains("1, 4, 9, 16 or 25"));
    assert!(refused(|c| c.coefficients = 9).starts_with("stream"));
    refused(|c| c.streams[1..].iter_mut().for_each(|s| s.symbols = u64::MAX >> 1));
    refused(|c| _ = c.streams.pop());
    refused(|c| c.streams.swap(2, 3));
    refused(|c| c.streams.clear());
    refused(|c| c.streams[0].bytes = [vec![255; 57], vec![3]].concat().into());
    // A file of the version before.
    assert_eq!(refused(|c| c.streams[0].bytes.to_mut().truncate(57)), "version: expected 3, found 1");
    assert_eq!(refused(|c| c.streams[0].bytes.to_mut()[57] = 2), "version: expected 3, found 2");
}

#[test]
fn a_bomb_is_refused_before_it_is_read() {
    // 2^40 Gaussians in a hundred bytes, as a writer would never make it.
    let streams: Vec<Stream> = [b"head", b"posi", b"scal", b"opac", b"rota", b"colo", b"harm"]
        .map(|name| Stream { name: *name, symbols: 1 << 40, bytes: vec![].into() })
        .to_vec();
    let small = Container { gaussians: 800, coefficients: 25, streams }.write();
    let honest = Container::read(&small).unwrap();
    assert!(matches!(decode(&small), Err(CodecError::Invalid { .. })), "{honest:?}");
}

#[test]
fn large_scenes_begin_with_what_shows_most() {
    let gaussians = cloud(40_000, 0);
    let bytes = encode(&gaussians, &Quality::default()).unwrap();
    let all = decode(&bytes).unwrap();
    let start = decode_start(&bytes[..bytes.len() / 9]).unwrap();
    assert_eq!((start.len(), all.len()), (40_000 / 12, 40_000));
    assert_eq!(start.means, all.means[..start.len()]);
    let shows = |g: &Gaussians, i: usize| {
        let mut scales = g.log_scales[i];
        scales.sort_by(f32::total_cmp);
        forms::opacity(g.opacity_logits[i]) * (0.5 * (scales[1] + scales[2])).exp()
    };
    let least = (0..start.len()).map(|i| shows(&start, i)).fold(f32::MAX, f32::min);
    assert!((start.len()..all.len()).all(|i| shows(&all, i) <= least * 1.001));
    assert_eq!(decode_start(&bytes[..40]).map_or(0, |g| g.len()), 0);
    assert_eq!(decode_start(&bytes).unwrap(), all);
}

#[test]
fn same_bytes_at_any_number_of_threads() {
    let gaussians = cloud(40_000, 1);
    let at = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let bytes = encode(&gaussians, &Quality::default()).unwrap();
            let decoded = decode(&bytes).unwrap();
            (bytes, decoded)
        })
    };
    assert!(at(1) == at(3));
}

proptest! {
    #[test]
    fn any_streams_are_borne(at in any::<u64>(), flips in 1..6_u64, count in 1..60_usize) {
        let bytes = encode(&cloud(count, 1), &Quality::default()).unwrap();
        let random = Random::new(at, 0, "codec.flips");
        let spoiled = changed(&bytes, |container| {
            for i in 0..flips {
                let stream = random.below(3 * i, container.streams.len());
                let bytes = container.streams[stream].bytes.to_mut();
                if !bytes.is_empty() {
                    let place = random.below(3 * i + 1, bytes.len());
                    bytes[place] = random.bits(3 * i + 2) as u8;
                }
            }
        });
        if let Ok(gaussians) = decode(&spoiled) {
            prop_assert!(gaussians.lengths_agree() && gaussians.len() == count);
        }
    }
}

/// The covariance of a Gaussian, row by row.
fn covariance(gaussians: &Gaussians, i: usize) -> [f64; 9] {
    let [w, x, y, z] = gaussians.quats[i].map(f64::from);
    let axes = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
    let squares = gaussians.log_scales[i].map(|s| (2.0 * f64::from(s)).exp());
    (axes * DMat3::from_diagonal(DVec3::from(squares)) * axes.transpose()).to_cols_array()
}

#[test]
fn rounding_in_place_keeps_order_and_ellipsoids() {
    let before = cloud(200, 1);
    for quality in Quality::SETTINGS {
        let (placed, sorted) = (rounded_in_place(&before, &quality).unwrap(), rounded(&before, &quality).unwrap());
        let numbers: Vec<usize> = order(&before, &quality).unwrap();
        for (at, &i) in numbers.iter().enumerate() {
            assert_eq!(placed.means[i], sorted.means[at]);
            assert_eq!(placed.opacity_logits[i], sorted.opacity_logits[at]);
            assert_eq!(placed.sh[12 * i..][..12], sorted.sh[12 * at..][..12]);
            let (a, b) = (covariance(&placed, i), covariance(&sorted, at));
            let size = b[0] + b[4] + b[8];
            assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5 * size), "{a:?} {b:?}");
            // Axes where they were: the quaternion is near the one before, and of its length.
            let dot = |a: [f32; 4], b: [f32; 4]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
            let (old, new) = (before.quats[i], placed.quats[i]);
            assert!((dot(new, new) / dot(old, old) - 1.0).abs() < 1e-4 && dot(old, new) > 0.9 * dot(old, old));
        }
    }
}
