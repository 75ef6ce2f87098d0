//! Changes that must not affect an image, or a gradient.

use crate::scene::{NAMES, Planes, Scene, relative};
use proptest::prelude::*;
use std::sync::Mutex;
use weaver_kernels::{Real, random::Stream};
use weaver_splat::{Compared, Cotangents, Gradients, RasterStats, Target, TileSide, Workspace, rasterize_backward};

/// `values` with its rows of `len` in another order.
fn permuted(values: &[f64], len: usize, order: &[usize]) -> Vec<f64> {
    order.iter().flat_map(|&n| values[n * len..(n + 1) * len].iter().copied()).collect()
}

fn quaternion_product(a: [f64; 4], b: &[f64]) -> [f64; 4] {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

/// Results of forward and backward.
type Outcome<T> = (Planes<T>, RasterStats, [Vec<T>; 10]);

fn outcome<T: Real>(scene: &Scene<T>, cotangents: &Planes<T>) -> Outcome<T> {
    let mut workspace = Workspace::new();
    let (planes, stats) = scene.render_in(&mut workspace);
    (planes, stats, scene.gradients_in(cotangents, &mut workspace))
}

/// Pixel, Gaussian, weight, transmittance.
type Hit<T> = (usize, usize, T, T);

/// The hits of all pixels, pixel by pixel, in the order of drawing.
fn hits<T: Real>(workspace: &Workspace<T>) -> Vec<Hit<T>> {
    let hits = Mutex::new(Vec::new());
    workspace.for_each_hit(|pixel, n, weight, light| hits.lock().unwrap().push((pixel, n, weight, light))).unwrap();
    let mut hits = hits.into_inner().unwrap();
    hits.sort_by_key(|hit| hit.0);
    hits
}

/// All outputs of a scene: images, counts, gradients, hits, sums and maxima of contributions, sums by squared
/// weights, and rises of the error without each.
fn everything(scene: &Scene<f32>, cotangents: &Planes<f32>) -> (Outcome<f32>, Vec<Hit<f32>>, [Vec<f32>; 5]) {
    let outcome = outcome(scene, cotangents);
    let mut workspace = Workspace::new();
    scene.render_in(&mut workspace);
    let hits = hits(&workspace);
    let len = scene.views() * scene.opacities.len();
    let mut contributions = [len, len, 2 * scene.opacities.len(), len, len].map(|len| vec![f32::NAN; len]);
    let [sums, largest, squared, rises, shown] = &mut contributions;
    workspace.contributions(sums, largest).unwrap();
    let values: Vec<f32> = (0..2 * scene.pixels()).map(|i| (0.37 * i as f32).sin()).collect();
    workspace.squared_contributions(&values, 2, Target::write(squared)).unwrap();
    let (planes, _) = scene.render_in(&mut workspace);
    let counts = vec![1.0; scene.pixels()];
    let map = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let compared = Compared { image: &planes.image, error: &cotangents.image, counts: &counts, map };
    workspace.removal(&compared, rises, shown).unwrap();
    (outcome, hits, contributions)
}

fn on_threads<R: Send>(threads: usize, run: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(run)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 20, failure_persistence: None, ..Default::default() })]

    #[test]
    fn order_of_the_gaussians(seed: u64, n in 1_usize..50) {
        let scene = Scene::random(seed, n, 1, (20, 14), Some(1));
        let order = Stream::new(seed, 0, "order").permutation(n);
        let mut shuffled = scene.clone();
        shuffled.means = permuted(&scene.means, 3, &order);
        shuffled.quats = permuted(&scene.quats, 4, &order);
        shuffled.scales = permuted(&scene.scales, 3, &order);
        shuffled.opacities = permuted(&scene.opacities, 1, &order);
        shuffled.colors = permuted(&scene.colors, 12, &order);
        shuffled.features = permuted(&scene.features, 2, &order);
        prop_assert_eq!(scene.render(), shuffled.render());
        let cotangents = scene.cotangents(seed);
        let (a, b) = (scene.gradients(&cotangents), shuffled.gradients(&cotangents));
        for (part, len) in [(0, 3), (1, 4), (2, 3), (3, 1), (4, 12), (8, 2), (9, 6)] {
            prop_assert_eq!(&permuted(&a[part], len, &order), &b[part], "{}", NAMES[part]);
        }
    }

    /// Equal depths keep the order of the indices, however many there are.
    #[test]
    fn order_of_equals(seed: u64, few in 1_usize..40, many: bool) {
        let n = if many { 60 * few } else { few };
        let mut scene = Scene::random(seed, n, 1, (20, 14), None);
        scene.viewmats = vec![1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        // Depths that differ only in `f64`, descending.
        (0..n).for_each(|i| scene.means[3 * i + 2] = 2.0 - 1e-12 * i as f64);
        scene.opacities.iter_mut().for_each(|o| *o *= 0.1);
        let mut workspace = Workspace::new();
        scene.render_in(&mut workspace);
        let mut last = vec![None; scene.pixels()];
        for (pixel, n, ..) in hits(&workspace) {
            prop_assert!(last[pixel] < Some(n), "{n} after {:?}", last[pixel]);
            last[pixel] = Some(n);
        }
    }

    #[test]
    fn number_of_threads(
        seed: u64,
        n in 1_usize..400,
        views in 1_usize..4,
        degree in prop::option::of(0_usize..=2),
        channels in prop::sample::select(vec![0_usize, 2, 5]),
    ) {
        let scene = Scene::random(seed, n, views, (50, 37), degree).with_channels(channels);
        let cotangents = scene.cotangents(seed).to_f32();
        let single = scene.to_f32();
        let one = on_threads(1, || everything(&single, &cotangents));
        prop_assert!(one == on_threads(2, || everything(&single, &cotangents)));
        prop_assert!(one == on_threads(5, || everything(&single, &cotangents)));
    }

    #[test]
    fn side_of_the_tiles(
        seed: u64,
        n in 1_usize..120,
        size in (1_usize..90, 1_usize..50),
        degree in prop::option::of(0_usize..=3),
        thin: bool,
        antialiased: bool,
    ) {
        let mut scene = Scene::random(seed, n, 2, size, degree);
        if thin {
            // Long needles: the hardest to bound.
            scene.scales.chunks_mut(3).for_each(|s| { s[0] *= 1e-3; s[1] *= 1e-3; s[2] *= 20.0; });
        }
        scene.settings.antialiased = antialiased;
        let mut single = scene.to_f32();
        let cotangents = scene.cotangents(seed);
        let single_cotangents = cotangents.to_f32();
        let (planes, stats, gradients) = outcome(&scene, &cotangents);
        let (single_planes, single_stats, single_gradients) = outcome(&single, &single_cotangents);
        for tile in [TileSide::ThirtyTwo, TileSide::SixtyFour] {
            scene.settings.tile = tile;
            single.settings.tile = tile;
            let (own, own_stats, own_gradients) = outcome(&scene, &cotangents);
            prop_assert_eq!(&own, &planes);
            prop_assert_eq!(own_stats.pairs, stats.pairs);
            let (own, own_stats, own_single_gradients) = outcome(&single, &single_cotangents);
            prop_assert_eq!(&own, &single_planes);
            prop_assert_eq!(own_stats.pairs, single_stats.pairs);
            for part in 0..10 {
                prop_assert!(relative(&own_gradients[part], &gradients[part], 1e-3) < 1e-13, "{}", NAMES[part]);
                let expected: Vec<f64> = single_gradients[part].iter().map(|x| f64::from(*x)).collect();
                let error = relative(&own_single_gradients[part], &expected, 1e-3);
                prop_assert!(error < 1e-6, "{} {:e}", NAMES[part], error);
            }
        }
    }

    #[test]
    fn views_together_or_one_by_one(seed: u64, n in 0_usize..50, views in 2_usize..5) {
        let scene = Scene::random(seed, n, views, (18, 13), Some(2));
        let cotangents = scene.cotangents(seed);
        let planes = scene.render();
        let gradients = scene.gradients(&cotangents);
        let pixels = 18 * 13;
        let mut sums: Vec<Vec<f64>> = (0..5).map(|part| vec![0.0; gradients[part].len()]).collect();
        for v in 0..views {
            let mut single = scene.clone();
            single.viewmats = scene.viewmats[12 * v..][..12].to_vec();
            single.intrinsics = scene.intrinsics[4 * v..][..4].to_vec();
            single.background = scene.background[3 * v..][..3].to_vec();
            let part = |planes: &Planes<f64>| Planes {
                image: planes.image[3 * v * pixels..][..3 * pixels].to_vec(),
                alpha: planes.alpha[v * pixels..][..pixels].to_vec(),
                depth: planes.depth[v * pixels..][..pixels].to_vec(),
                features: planes.features[2 * v * pixels..][..2 * pixels].to_vec(),
            };
            prop_assert_eq!(single.render(), part(&planes));
            let own = single.gradients(&part(&cotangents));
            for (part, sum) in sums.iter_mut().enumerate() {
                sum.iter_mut().zip(&own[part]).for_each(|(sum, x)| *sum += x);
            }
            prop_assert_eq!(&own[5], &gradients[5][12 * v..][..12]);
            prop_assert_eq!(&own[6], &gradients[6][4 * v..][..4]);
            prop_assert_eq!(&own[7], &gradients[7][3 * v..][..3]);
        }
        for (part, sum) in sums.iter().enumerate() {
            prop_assert!(relative(&gradients[part], sum, 1e-3) < 1e-12, "{}", NAMES[part]);
        }
    }

    /// World and camera moved together: x -> R x + b, A -> A R^T, t -> t - A R^T b. Gradients move along.
    #[test]
    fn rigid_motion(seed: u64, n in 1_usize..40, antialiased: bool) {
        let mut scene = Scene::random(seed, n, 2, (18, 13), None);
        scene.settings.antialiased = antialiased;
        let stream = Stream::new(seed, 0, "motion");
        let q: [f64; 4] = std::array::from_fn(|i| stream.normal(i as u64));
        let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
        let q = q.map(|x| x / length);
        let shift: [f64; 3] = std::array::from_fn(|i| stream.normal(4 + i as u64));
        let conjugate = [q[0], -q[1], -q[2], -q[3]];
        let rotate = |v: &[f64]| {
            let r = quaternion_product(quaternion_product(q, &[0.0, v[0], v[1], v[2]]), &conjugate);
            [r[1], r[2], r[3]]
        };
        let mut moved = scene.clone();
        for (to, from) in moved.means.chunks_mut(3).zip(scene.means.chunks(3)) {
            let r = rotate(from);
            (0..3).for_each(|i| to[i] = r[i] + shift[i]);
        }
        for (to, from) in moved.quats.chunks_mut(4).zip(scene.quats.chunks(4)) {
            to.copy_from_slice(&quaternion_product(q, from));
        }
        for (to, from) in moved.viewmats.chunks_mut(4).zip(scene.viewmats.chunks(4)) {
            let r = rotate(&from[..3]);
            to[..3].copy_from_slice(&r);
            to[3] = from[3] - (r[0] * shift[0] + r[1] * shift[1] + r[2] * shift[2]);
        }
        prop_assert!(relative(&moved.render().flat(), &scene.render().flat(), 1e-3) < 1e-10);
        let cotangents = scene.cotangents(seed);
        let mut expected = scene.gradients(&cotangents);
        expected[0] = expected[0].chunks(3).flat_map(rotate).collect();
        expected[1] = expected[1].chunks(4).flat_map(|d| quaternion_product(q, d)).collect();
        // p = A m + t stays the same, so that dA' = dA R^T + dt b^T.
        for row in expected[5].chunks_mut(4) {
            let r = rotate(&row[..3]);
            (0..3).for_each(|j| row[j] = r[j] + row[3] * shift[j]);
        }
        for (part, gradient) in moved.gradients(&cotangents).iter().enumerate() {
            let error = relative(gradient, &expected[part], 1e-3);
            prop_assert!(error < 1e-9, "{} {:e}", NAMES[part], error);
        }
    }

    /// The same without a rotation, but with colors that depend on the direction.
    #[test]
    fn translation(seed: u64, n in 1_usize..40, degree in 0_usize..=4) {
        let scene = Scene::random(seed, n, 2, (18, 13), Some(degree));
        let stream = Stream::new(seed, 0, "motion");
        let shift: [f64; 3] = std::array::from_fn(|i| stream.normal(i as u64));
        let mut moved = scene.clone();
        moved.means.chunks_mut(3).for_each(|m| (0..3).for_each(|i| m[i] += shift[i]));
        moved.viewmats.chunks_mut(4).for_each(|row| row[3] -= (0..3).map(|j| row[j] * shift[j]).sum::<f64>());
        prop_assert!(relative(&moved.render().flat(), &scene.render().flat(), 1e-3) < 1e-10);
        let cotangents = scene.cotangents(seed);
        let mut expected = scene.gradients(&cotangents);
        expected[5].chunks_mut(4).for_each(|row| (0..3).for_each(|j| row[j] += row[3] * shift[j]));
        for (part, gradient) in moved.gradients(&cotangents).iter().enumerate() {
            let error = relative(gradient, &expected[part], 1e-3);
            prop_assert!(error < 1e-9, "{} {:e}", NAMES[part], error);
        }
    }

    /// A workspace that has seen other scenes draws and differentiates as a new one does.
    #[test]
    fn one_workspace_for_all(
        scenes in prop::collection::vec(
            (
                any::<u64>(),
                prop::sample::select(vec![0_usize, 1, 15, 600]),
                0_usize..3,
                (1_usize..50, 1_usize..40),
                prop::option::of(0_usize..=4),
                prop::sample::select(vec![0_usize, 1, 5]),
                any::<bool>(),
                prop::sample::select(vec![TileSide::Sixteen, TileSide::ThirtyTwo, TileSide::SixtyFour]),
            ),
            2..5,
        ),
    ) {
        let mut workspace = Workspace::new();
        for (seed, n, views, size, degree, channels, colorless, tile) in scenes {
            let mut scene = Scene::random(seed, n, views, size, degree).with_channels(channels);
            if colorless {
                scene = scene.without_colors();
            }
            scene.settings.tile = tile;
            let cotangents = scene.cotangents(seed);
            let (planes, stats, gradients) = outcome(&scene, &cotangents);
            prop_assert_eq!(scene.render_in(&mut workspace), (planes, stats));
            prop_assert_eq!(scene.gradients_in(&cotangents, &mut workspace), gradients);
        }
    }
}

/// Enough Gaussians for the radix sort and the lists to be made in parts.
#[test]
fn number_of_threads_in_a_large_scene() {
    let mut scene = Scene::random(1, 40_000, 1, (70, 50), Some(1));
    scene.scales.iter_mut().for_each(|s| *s *= 0.1);
    let cotangents = scene.cotangents(1).to_f32();
    let single = scene.to_f32();
    let one = on_threads(1, || everything(&single, &cotangents));
    for threads in [2, 3, 8] {
        assert!(one == on_threads(threads, || everything(&single, &cotangents)), "{threads} threads");
    }
}

/// Matrices may have their fourth row; gradients can be added.
#[test]
fn layouts() {
    let scene = Scene::random(1, 40, 2, (33, 21), Some(1));
    let mut workspace = Workspace::new();
    let (planes, stats) = scene.render_in(&mut workspace);
    assert!(stats.splats > 0 && stats.entries >= stats.splats && stats.rejected == 0);

    let mut square = scene.clone();
    square.viewmats = scene.viewmats.chunks(12).flat_map(|m| m.iter().copied().chain([7.0, 7.0, 7.0, 7.0])).collect();
    assert_eq!(planes, square.render());
    let cotangents = scene.cotangents(1);
    let (flat, tall) = (scene.gradients(&cotangents), square.gradients(&cotangents));
    for (flat, tall) in flat[5].chunks(12).zip(tall[5].chunks(16)) {
        assert_eq!((flat, [0.0; 4].as_slice()), (&tall[..12], &tall[12..]));
    }

    let mut means = vec![1.0; scene.means.len()];
    let gradients = Gradients { means: Some(Target::add(&mut means)), ..Gradients::default() };
    let only_alpha = Cotangents { alpha: Some(&cotangents.alpha), ..Cotangents::default() };
    rasterize_backward(&scene.gaussians(), &scene.cameras(), &scene.settings, &mut workspace, &only_alpha, gradients)
        .unwrap();
    let zeros = |values: &[f64]| vec![0.0; values.len()];
    let padded = Planes {
        image: zeros(&cotangents.image),
        alpha: cotangents.alpha.clone(),
        depth: zeros(&cotangents.depth),
        features: zeros(&cotangents.features),
    };
    let expected: Vec<f64> = scene.gradients(&padded)[0].iter().map(|x| 1.0 + x).collect();
    assert!(relative(&means, &expected, 0.0) < 1e-14);
}
