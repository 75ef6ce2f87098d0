//! Groups of Gaussians, each with a picture of its own.

use crate::op::{inputs, named};
use crate::scene::{Planes, Scene};
use proptest::prelude::*;
use std::sync::{Arc, Mutex};
use weaver_autograd::gradcheck::{Options, gradcheck_with};
use weaver_kernels::Real;
use weaver_scene::Groups;
use weaver_splat::{Images, RasterSettings, Rasterize, Workspace, WorkspacePool, rasterize};

/// The scene of one group, and the rows of its Gaussians.
fn alone<T: Real>(scene: &Scene<T>, group: u32) -> (Scene<T>, Vec<usize>) {
    let (of, _) = scene.groups.as_ref().unwrap();
    let rows: Vec<usize> = (0..of.len()).filter(|n| of[*n] == group).collect();
    let part = |values: &[T]| {
        let width = values.len() / of.len().max(1);
        rows.iter().flat_map(|n| values[n * width..][..width].to_vec()).collect()
    };
    let alone = Scene {
        means: part(&scene.means),
        quats: part(&scene.quats),
        scales: part(&scene.scales),
        opacities: part(&scene.opacities),
        colors: part(&scene.colors),
        features: part(&scene.features),
        groups: None,
        ..scene.clone()
    };
    (alone, rows)
}

/// The pictures of one group among the pictures of all views.
fn pictures_of<T: Real>(scene: &Scene<T>, planes: &Planes<T>, group: usize) -> Planes<T> {
    let count = scene.groups.as_ref().unwrap().1;
    let pixels = scene.region().pixels();
    let part = |values: &[T], channels: usize| {
        let size = (pixels * channels).max(1);
        values.chunks(size).enumerate().filter(|(i, _)| i % count == group).flat_map(|(_, x)| x.to_vec()).collect()
    };
    Planes {
        image: part(&planes.image, scene.image_channels()),
        alpha: part(&planes.alpha, 1),
        depth: part(&planes.depth, 1),
        features: part(&planes.features, scene.channels),
    }
}

fn hits<T: Real>(scene: &Scene<T>) -> Vec<(usize, usize, T, T)> {
    let mut workspace = Workspace::new();
    scene.render_in(&mut workspace);
    let hits = Mutex::new(Vec::new());
    workspace.for_each_hit(|pixel, n, weight, light| hits.lock().unwrap().push((pixel, n, weight, light))).unwrap();
    let mut hits = hits.into_inner().unwrap();
    hits.sort_by_key(|hit| hit.0);
    hits
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 8, failure_persistence: None, ..Default::default() })]

    /// One pass over all groups gives the bits of a pass over each: pictures, gradients of Gaussians, hits.
    ///
    /// Promise (results): Gaussians in groups: one pass has the bits of a pass for each, pictures, gradients and
    /// hits; groups that do not fit are refused.
    #[test]
    fn one_pass_is_a_pass_for_each(
        seed: u64,
        n in 1_usize..600,
        views in 1_usize..3,
        count in 1_usize..5,
        size in (1_usize..40, 1_usize..40),
        channels in prop::sample::select(vec![0_usize, 3, 17]),
        colorless: bool,
    ) {
        let mut scene = Scene::random(seed, n, views, size, None).with_channels(channels).in_groups(count);
        if colorless {
            scene = scene.without_colors();
        }
        let scene = scene.to_f32();
        let cotangents = {
            let (mut other, pixels) = (scene.clone(), scene.pixels());
            other.groups = None;
            let all = |channels: usize| (0..pixels * channels).map(|i| (0.61 * i as f32 + seed as f32 * 1e-9).sin()).collect();
            Planes { image: all(other.image_channels()), alpha: all(1), depth: all(1), features: all(channels) }
        };
        let (drawn, gradients, met) = (scene.render(), scene.gradients(&cotangents), hits(&scene));
        let pixels = scene.region().pixels();
        for group in 0..count {
            let (alone, rows) = alone(&scene, group as u32);
            prop_assert_eq!(&alone.render(), &pictures_of(&scene, &drawn, group));
            let expected = alone.gradients(&pictures_of(&scene, &cotangents, group));
            // Gradients of Gaussians, features and statistics among them; cameras' gradients are sums over all groups.
            for part in [0, 1, 2, 3, 4, 8, 9] {
                let width = gradients[part].len() / n;
                let own: Vec<f32> = rows.iter().flat_map(|row| gradients[part][row * width..][..width].to_vec()).collect();
                prop_assert_eq!(&own, &expected[part]);
            }
            let own: Vec<_> = met
                .iter()
                .filter(|hit| hit.0 / pixels % count == group)
                .map(|hit| {
                    let (view, row) = (hit.0 / pixels / count, rows.iter().position(|row| *row == hit.1).unwrap());
                    (view * pixels + hit.0 % pixels, row, hit.2, hit.3)
                })
                .collect();
            prop_assert_eq!(own, hits(&alone));
        }
    }

    /// One light for all groups, by which each may hide the others: colors that only a group has, drawn as features,
    /// sum to the picture of all.
    #[test]
    fn groups_of_one_light_sum_to_one_picture(seed: u64, n in 1_usize..200, count in 1_usize..5) {
        let mut scene = Scene::random(seed, n, 2, (20, 15), None).with_channels(3 * count);
        scene.background.fill(0.0);
        scene.features = (0..n * 3 * count)
            .map(|i| if i / 3 % count == i / (3 * count) % count { scene.colors[i / (3 * count) * 3 + i % 3] } else { 0.0 })
            .collect();
        let drawn = scene.render();
        for (parts, whole) in drawn.features.chunks(3 * count).zip(drawn.image.chunks(3)) {
            for (channel, whole) in whole.iter().enumerate() {
                let sum: f64 = parts.iter().skip(channel).step_by(3).sum();
                prop_assert!((sum - whole).abs() < 1e-12);
            }
        }
    }

    /// Promise of `one_pass_is_a_pass_for_each`.
    #[test]
    fn groups_pass_gradcheck(seed: u64, n in 1_usize..5, views in 1_usize..3, count in 1_usize..4) {
        let scene = Scene::smooth(seed, n, views, (4, 3), None).in_groups(count);
        let groups: Arc<[u32]> = scene.groups.as_ref().unwrap().0.as_slice().into();
        let workspaces = WorkspacePool::new();
        let options = Options { duplicates: false, seed, ..Options::default() };
        gradcheck_with(options, &inputs(&scene), |x| {
            let (gaussians, cameras, background) = named(x);
            let op = Rasterize::new(4, 3, scene.settings, &workspaces).in_groups(groups.clone(), count);
            let (drawn, features) = op.apply_with_features(&gaussians, &cameras, background, x[8]);
            vec![drawn.image, drawn.alpha, drawn.depth, features]
        });
    }
}

/// Promise of `one_pass_is_a_pass_for_each`.
#[test]
fn groups_that_do_not_fit_are_refused() {
    let scene = Scene::random(1, 3, 1, (4, 4), None);
    let refusal = |of: &[u32], count: usize| {
        let groups = Some(Groups { of, count });
        let gaussians = weaver_scene::GaussianSlices { groups, features: None, ..scene.gaussians() };
        let (mut image, mut alpha) = (vec![0.0; 48 * count], vec![0.0; 16 * count]);
        let images = Images { image: &mut image, alpha: &mut alpha, depth: None, features: None };
        let settings = RasterSettings::default();
        rasterize(&gaussians, &scene.cameras(), &settings, &mut Workspace::new(), images).unwrap_err().to_string()
    };
    assert!(refusal(&[0, 1], 2).contains("groups has 2 numbers, expected 3"));
    assert!(refusal(&[0, 2, 1], 2).contains("Gaussian 1 is in group 2, the last of 2 is 1"));
    assert!(refusal(&[0, 0, 0], 0).contains("0 groups"));
}
