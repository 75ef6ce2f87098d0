//! Where Gaussians are on the image, and the gradients with respect to these places.

use crate::scene::{Scene, relative};
use crate::twin::reference_gradients;
use proptest::prelude::*;
use weaver_splat::Workspace;

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 8, failure_persistence: None, ..Default::default() })]

    /// Statistics of the slow reference are sums over the views of lengths, and the largest radius.
    #[test]
    fn screen_gradients_are_those_of_the_reference(
        seed: u64, n in 0_usize..40, views in 1_usize..4, size in (1_usize..40, 1_usize..40), degree in prop::option::of(0_usize..=3),
    ) {
        let scene = Scene::random(seed, n, views, size, degree);
        let mut workspace = Workspace::new();
        scene.render_in(&mut workspace);
        prop_assert!(workspace.screen_gradients().is_err());
        let cotangents = scene.cotangents(seed);
        scene.gradients_in(&cotangents, &mut workspace);
        let [.., statistics] = reference_gradients(&scene, &cotangents);
        let (splats, gradients) = (workspace.splats().unwrap(), workspace.screen_gradients().unwrap());
        let length = |[x, y]: [f64; 2]| x.hypot(y);
        let mut sums = vec![0.0; 2 * n];
        for (i, gradient) in gradients.iter().enumerate() {
            sums[2 * (i % n)] += length(gradient.plain);
            sums[2 * (i % n) + 1] += length(gradient.absolute.unwrap());
        }
        let expected: Vec<f64> = statistics.chunks(6).flat_map(|s| [s[0], s[1]]).collect();
        prop_assert!(relative(&sums, &expected, 1e-3) < 1e-9);
        for (v, camera) in scene.cameras().to_cameras().iter().enumerate() {
            for i in 0..n {
                let Some(splat) = splats[v * n + i] else { continue };
                let mean = weaver_geometry::glam::DVec3::from_slice(&scene.means[3 * i..]);
                let at = camera.pose.apply(mean);
                let k = camera.intrinsics;
                let center = [k.fx * at.x / at.z + k.cx, k.fy * at.y / at.z + k.cy];
                prop_assert!(relative(&splat.center, &center, 1.0) < 1e-9 && relative(&[splat.depth], &[at.z], 1.0) < 1e-9);
                let (radius, largest) = (statistics[6 * i + 3], splat.radii[0].max(splat.radii[1]));
                // No view has a longer axis, and an axis of the ellipse is at most as long as both of its shadows.
                prop_assert!(views > 1 || radius == 0.0 || largest <= radius * 1.000001 && radius <= 1.4143 * largest);
            }
        }
    }
}
