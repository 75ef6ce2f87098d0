//! The rasterizer as a linear map.

use crate::random::{Splats, cameras, error, lifted, matrix, noise, permuted, product, squares, transposed};
use proptest::prelude::*;
use std::sync::Mutex;
use weaver_kernels::random::Stream;
use weaver_lift::{Descent, LiftOptions, Maps, Operator, Raster, Solver, Stop, guide, lift};
use weaver_scene::{CameraSlices, Model};
use weaver_splat::{Images, RasterSettings, Workspace, rasterize};

const SOLVERS: [Solver; 5] = [
    Solver::RowSum,
    Solver::Squared,
    Solver::Exact { descent: Descent::Iteration, stop: Stop { passes: 4, tolerance: 1e-6 } },
    Solver::Exact { descent: Descent::ConjugateGradients, stop: Stop { passes: 4, tolerance: 1e-6 } },
    Solver::Damped { mu: 0.1, stop: Stop { passes: 4, tolerance: 1e-6 } },
];

/// Features for the views of some cameras.
fn maps(cameras: &[weaver_geometry::Camera], channels: usize) -> Vec<Vec<f64>> {
    cameras.iter().enumerate().map(|(v, c)| noise(v as u64, c.width * c.height * channels)).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 20, failure_persistence: None, ..Default::default() })]

    #[test]
    fn adjoint_and_forward_fit_together(seed: u64, count in 1_usize..40, channels in 1_usize..6) {
        let (splats, cameras) = (Splats::<f64>::random(seed, count), cameras(2));
        let mut raster = Raster::new(splats.as_slices(), &cameras, RasterSettings::default());
        let x: Vec<f64> = noise(seed, count * channels);
        for view in 0..2 {
            let y: Vec<f64> = noise(seed ^ 9, raster.rays(view) * channels);
            let mut back = vec![0.0; x.len()];
            // Before anything is drawn, too.
            raster.adjoint(view, &y, channels, &mut back).unwrap();
            let mut drawn = vec![0.0; y.len()];
            raster.forward(view, &x, channels, &mut drawn).unwrap();
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let (left, right) = (dot(&drawn, &y), dot(&x, &back));
            prop_assert!((left - right).abs() < 1e-10 * (1.0 + left.abs()), "{left} {right}");
            let mut again = back.clone();
            raster.adjoint(view, &y, channels, &mut again).unwrap();
            prop_assert!(error(&again, &back.iter().map(|x| 2.0 * x).collect::<Vec<_>>()) < 1e-14);
        }
    }

    /// D and sums of squares equal the sums of `contributions`, and of the hits.
    #[test]
    fn weights_are_those_of_the_hits(seed: u64, count in 1_usize..40) {
        let (splats, cameras) = (Splats::<f64>::random(seed, count), cameras(2));
        let mut raster = Raster::new(splats.as_slices(), &cameras, RasterSettings::default());
        for (view, camera) in cameras.iter().enumerate() {
            let rays = raster.rays(view);
            let (mut sums, mut squared) = (vec![0.0; count], vec![0.0; count]);
            raster.adjoint(view, &vec![1.0; rays], 1, &mut sums).unwrap();
            raster.adjoint_squared(view, &vec![1.0; rays], 1, &mut squared).unwrap();
            let rotation = camera.pose.rotation.transpose().to_cols_array_2d();
            let shift = camera.pose.translation.to_array();
            let viewmat: Vec<f64> = (0..3).flat_map(|i| rotation[i].into_iter().chain([shift[i]])).collect();
            let k = camera.intrinsics;
            let slices = CameraSlices {
                viewmats: &viewmat, intrinsics: &[k.fx, k.fy, k.cx, k.cy], background: &[0.0; 3],
                width: camera.width, height: camera.height,
                model: Model::Pinhole,
            };
            let (mut workspace, mut alpha) = (Workspace::new(), vec![0.0; rays]);
            let images = Images { image: &mut [], alpha: &mut alpha, depth: None, features: None };
            rasterize(&splats.as_slices(), &slices, &RasterSettings::default(), &mut workspace, images).unwrap();
            let (mut contributions, mut largest) = (vec![0.0; count], vec![0.0; count]);
            workspace.contributions(&mut contributions, &mut largest).unwrap();
            prop_assert!(error(&sums, &contributions) < 1e-12);
            let of_hits = Mutex::new((vec![0.0; count], vec![0.0; count], vec![0.0; rays]));
            workspace.for_each_hit(|pixel, j, weight, _| {
                let mut sums = of_hits.lock().unwrap();
                sums.0[j] += weight;
                sums.1[j] += weight * weight;
                sums.2[pixel] += weight;
            }).unwrap();
            let (of_hits, of_squares, rows) = of_hits.into_inner().unwrap();
            prop_assert!(error(&sums, &of_hits) < 1e-12 && error(&squared, &of_squares) < 1e-12);
            prop_assert!(error(&rows, &alpha) < 1e-12);
        }
    }

    /// The rasterizer's row sums equal the matrix's.
    #[test]
    fn row_sums_are_those_of_the_matrix(seed: u64, count in 1_usize..30) {
        let (splats, cameras) = (Splats::<f64>::random(seed, count), cameras(2));
        let mut raster = Raster::new(splats.as_slices(), &cameras, RasterSettings::default());
        let views = maps(&cameras, 2);
        let a = matrix(&mut raster);
        let expected = |power: i32| {
            let a: Vec<f64> = a.iter().map(|x| x.powi(power)).collect();
            let mut sums = product(&transposed(&a, count), &views.concat(), a.len() / count, 2);
            for (j, row) in sums.chunks_exact_mut(2).enumerate() {
                let total: f64 = a.iter().skip(j).step_by(count).sum();
                row.iter_mut().for_each(|x| *x = if total > 0.0 { *x / total } else { 0.0 });
            }
            sums
        };
        prop_assume!(squares(&a) > 0.0);
        for (power, solver) in [(1, Solver::RowSum), (2, Solver::Squared)] {
            let found = lifted(&mut raster, &views, 2, LiftOptions::with(solver)).features;
            prop_assert!(error(&found, &expected(power)) < 1e-10);
        }
    }

    #[test]
    fn order_of_the_gaussians_is_that_of_their_features(seed: u64, count in 2_usize..40) {
        let (splats, cameras) = (Splats::<f64>::random(seed, count), cameras(2));
        let order = Stream::new(seed, 0, "order").permutation(count);
        let shuffled = splats.permuted(&order);
        let views = maps(&cameras, 3);
        for solver in SOLVERS {
            let of = |splats: &Splats<f64>| {
                let mut raster = Raster::new(splats.as_slices(), &cameras, RasterSettings::default());
                lifted(&mut raster, &views, 3, LiftOptions::with(solver)).features
            };
            // Sums over all Gaussians come in another order.
            prop_assert!(error(&of(&shuffled), &permuted(&of(&splats), 3, &order)) < 1e-10, "{solver:?}");
        }
    }
}

/// The same bits at any number of threads and of channels.
#[test]
fn same_bits_at_any_threads_and_channels() {
    let (splats, cameras) = (Splats::<f32>::random(3, 200), cameras(3));
    let views: Vec<Vec<f32>> = maps(&cameras, 5).iter().map(|v| v.iter().map(|x| *x as f32).collect()).collect();
    for solver in SOLVERS {
        let run = |threads, block| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut raster = Raster::new(splats.as_slices(), &cameras, RasterSettings::default());
                lifted(&mut raster, &views, 5, LiftOptions { block, loss: true, ..LiftOptions::with(solver) })
            })
        };
        let one = run(1, 5);
        assert_eq!(one, run(2, 5), "{solver:?}");
        assert_eq!(one, run(4, 5), "{solver:?}");
        // The loss is summed by blocks.
        assert_eq!(one.features, run(2, 2).features, "{solver:?}");
    }
}

/// Planted and drawn features come back, if every Gaussian is seen by itself somewhere.
#[test]
fn planted_features_are_found() {
    let (splats, cameras) = (Splats::<f64>::random(8, 12), cameras(4));
    let mut raster = Raster::new(splats.as_slices(), &cameras, RasterSettings::default());
    let planted: Vec<f64> = noise(1, 12 * 3);
    let views: Vec<Vec<f64>> = (0..4)
        .map(|view| {
            let mut drawn = vec![0.0; 3 * raster.rays(view)];
            raster.forward(view, &planted, 3, &mut drawn).unwrap();
            drawn
        })
        .collect();
    let stop = Stop { passes: 500, tolerance: 1e-12 };
    let solver = Solver::Exact { descent: Descent::ConjugateGradients, stop };
    let exact = lifted(&mut raster, &views, 3, LiftOptions { loss: true, ..LiftOptions::with(solver) });
    let row_sum = lifted(&mut raster, &views, 3, LiftOptions::with(Solver::RowSum)).features;
    let of_seen = |x: &[f64]| -> Vec<f64> {
        x.chunks_exact(3).zip(&exact.seen).filter(|(_, d)| **d > 0.1).flat_map(|(row, _)| row.to_vec()).collect()
    };
    assert!(of_seen(&planted).len() >= 15, "{:?}", exact.seen);
    assert!(exact.loss.unwrap() < 1e-12, "{:?}", exact.loss);
    assert!(error(&of_seen(&exact.features), &of_seen(&planted)) < 1e-6, "{:?}", exact.passes);
    assert!(error(&of_seen(&row_sum), &of_seen(&planted)) > 1e-2);
}

/// Pixels of little alpha are masked for solvers that draw; the others are multiplied by their alpha.
#[test]
fn photos_are_composited_over_zeros() {
    let (splats, cameras) = (Splats::<f64>::random(4, 40), cameras(1));
    let mut raster = Raster::new(splats.as_slices(), &cameras, RasterSettings::default());
    let rays = raster.rays(0);
    let mut alpha = vec![0.0; rays];
    raster.forward(0, &[1.0; 40], 1, &mut alpha).unwrap();
    let view: Vec<f64> = noise(2, rays);
    let by_hand: Vec<f64> = view.iter().zip(&alpha).map(|(b, r)| if *r < 0.5 { 0.0 } else { b * r }).collect();
    let mut sums = vec![0.0; 40];
    raster.adjoint(0, &by_hand, 1, &mut sums).unwrap();
    let kept: Vec<f64> = alpha.iter().map(|r| if *r < 0.5 { 0.0 } else { 1.0 }).collect();
    let mut seen = vec![0.0; 40];
    raster.adjoint(0, &kept, 1, &mut seen).unwrap();
    let expected: Vec<f64> = sums.iter().zip(&seen).map(|(x, d)| if *d > 0.0 { x / d } else { 0.0 }).collect();
    let mut maps = Maps { views: vec![view], channels: 1 };
    let found = lift(&mut raster, &mut maps, &LiftOptions::with(Solver::exact(1)), &mut || ()).unwrap();
    assert!(error(&found.features, &expected) < 1e-12);
    let dropped = kept.iter().filter(|x| **x == 0.0).count();
    assert!(dropped > 20 && dropped < rays - 20);
    assert_eq!(found.coverage.dropped, dropped);
    // Solvers that do not draw take every pixel unchanged.
    let all = lift(&mut raster, &mut maps, &LiftOptions::with(Solver::RowSum), &mut || ()).unwrap();
    assert_eq!(all.coverage.dropped, 0);
}

#[test]
fn guidance_is_exact_and_none_at_one() {
    let mut opacities: Vec<f32> = (0..=50).map(|i| i as f32 / 50.0).collect();
    let before = opacities.clone();
    guide(&mut opacities, 1.0).unwrap();
    assert_eq!(opacities, before);
    guide(&mut opacities, 1.2).unwrap();
    for (after, before) in opacities.iter().zip(&before) {
        let o = f64::from(*before);
        let logit = (o / (1.0 - o)).ln().clamp(-13.8, 13.8);
        let expected = 1.0 / (1.0 + (-1.2 * logit).exp());
        assert!((f64::from(*after) - expected).abs() < 1e-7);
    }
    for lambda in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(guide(&mut opacities, lambda).unwrap_err().to_string().contains("lambda: expected a positive number"));
    }
    // Two equal Gaussians on a ray: the share off the diagonal falls for opacities above one half, and rises below.
    for (theta, shares, sums) in [(0.5, [0.398, 0.334], [0.857, 0.928]), (-0.5, [0.473, 0.488], [0.613, 0.466])] {
        for (lambda, (share, sum)) in [1.0, 2.0].into_iter().zip(shares.into_iter().zip(sums)) {
            let mut o = [1.0 / (1.0 + f64::exp(-theta))];
            guide(&mut o, lambda).unwrap();
            let row = [o[0], o[0] * (1.0 - o[0])];
            let total: f64 = row.iter().sum();
            assert!((total - sum).abs() < 6e-4 && (1.0 - squares(&row) / (total * total) - share).abs() < 6e-4);
        }
    }
}
