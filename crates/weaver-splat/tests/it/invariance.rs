//! What must not change an image, or a gradient.

use crate::scene::{NAMES, Planes, Scene, relative};
use proptest::prelude::*;
use weaver_kernels::random::Stream;
use weaver_splat::{Cotangents, Gradients, Target, TileSide, Workspace, rasterize_backward};

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

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn order_of_the_gaussians(seed: u64, n in 1_usize..50) {
        let scene = Scene::random(seed, n, 1, (20, 14), Some(1));
        let order = Stream::new(seed, 0, "order").permutation(n);
        let mut shuffled = scene.clone();
        shuffled.means = permuted(&scene.means, 3, &order);
        shuffled.quats = permuted(&scene.quats, 4, &order);
        shuffled.scales = permuted(&scene.scales, 3, &order);
        shuffled.opacities = permuted(&scene.opacities, 1, &order);
        shuffled.colours = permuted(&scene.colours, 12, &order);
        shuffled.features = permuted(&scene.features, 2, &order);
        prop_assert_eq!(scene.render(), shuffled.render());
        let cotangents = scene.cotangents(seed);
        let (a, b) = (scene.gradients(&cotangents), shuffled.gradients(&cotangents));
        for (part, len) in [(0, 3), (1, 4), (2, 3), (3, 1), (4, 12), (8, 2), (9, 2)] {
            prop_assert_eq!(&permuted(&a[part], len, &order), &b[part], "{}", NAMES[part]);
        }
    }

    #[test]
    fn number_of_threads(seed: u64, n in 1_usize..400, views in 1_usize..4, degree in prop::option::of(0_usize..=2)) {
        let scene = Scene::random(seed, n, views, (50, 37), degree);
        let single = scene.to_f32();
        let cotangents = scene.cotangents(seed);
        let cotangents = cotangents.to_f32();
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| (single.render(), single.gradients(&cotangents)))
        };
        let one = run(1);
        prop_assert!(one == run(2));
        prop_assert!(one == run(5));
    }

    #[test]
    fn side_of_the_tiles(seed: u64, n in 1_usize..120, thin: bool) {
        let mut scene = Scene::random(seed, n, 2, (70, 41), None);
        if thin {
            // Long needles: the hardest to bound.
            scene.scales.chunks_mut(3).for_each(|s| { s[0] *= 1e-3; s[1] *= 1e-3; s[2] *= 20.0; });
        }
        let mut single = scene.to_f32();
        let (double_planes, single_planes) = (scene.render(), single.render());
        for tile in [TileSide::ThirtyTwo, TileSide::SixtyFour] {
            scene.settings.tile = tile;
            single.settings.tile = tile;
            prop_assert_eq!(&double_planes, &scene.render());
            prop_assert_eq!(&single_planes, &single.render());
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

    /// World and camera moved together: x -> R x + b, A -> A R^T, t -> t - A R^T b.
    #[test]
    fn rigid_motion(seed: u64, n in 1_usize..40) {
        let scene = Scene::random(seed, n, 2, (18, 13), None);
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
    }
}

/// A workspace that has seen other scenes draws the same; matrices may have their fourth row; gradients can be added.
#[test]
fn leftovers_and_layouts() {
    let scene = Scene::random(1, 40, 2, (33, 21), Some(1));
    let mut workspace = Workspace::new();
    Scene::random(2, 90, 3, (50, 50), None).render_in(&mut workspace);
    let (planes, stats) = scene.render_in(&mut workspace);
    assert_eq!(planes, scene.render());
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
