//! Hits, contributions, expected depth.

use crate::scene::{Scene, relative};
use proptest::prelude::*;
use std::sync::Mutex;
use weaver_splat::{Compared, Target, TileSide, Workspace, expected_depth, expected_depth_backward};

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 16, failure_persistence: None, ..Default::default() })]

    /// The hits, summed by hand, are the images; their weights are the contributions.
    #[test]
    fn hits_make_the_image(
        seed: u64,
        n in 0_usize..80,
        size in (1_usize..60, 1_usize..40),
        tile in prop::sample::select(vec![TileSide::Sixteen, TileSide::ThirtyTwo]),
    ) {
        let mut scene = Scene::random(seed, n, 2, size, None);
        scene.settings.tile = tile;
        let mut workspace = Workspace::new();
        let (planes, stats) = scene.render_in(&mut workspace);
        let hits = Mutex::new(Vec::new());
        workspace.for_each_hit(|pixel, n, weight, light| hits.lock().unwrap().push((pixel, n, weight, light))).unwrap();
        let hits = hits.into_inner().unwrap();
        prop_assert_eq!(hits.len() as u64, stats.pairs);
        let mut alpha = vec![0.0; scene.pixels()];
        let mut features = vec![0.0; 2 * scene.pixels()];
        let (mut sums, mut largest) = (vec![0.0_f64; 2 * n], vec![0.0_f64; 2 * n]);
        for &(pixel, n_, weight, light) in &hits {
            // Front to back: the arriving light has passed the splats in front.
            prop_assert!((light - (1.0 - alpha[pixel])).abs() < 1e-12);
            alpha[pixel] += weight;
            (0..2).for_each(|c| features[2 * pixel + c] += weight * scene.features[2 * n_ + c]);
            let id = pixel / (size.0 * size.1) * n + n_;
            sums[id] += weight;
            largest[id] = largest[id].max(weight);
        }
        prop_assert!(relative(&alpha, &planes.alpha, 1.0) < 1e-12);
        prop_assert!(relative(&features, &planes.features, 1.0) < 1e-12);
        let (mut own_sums, mut own_largest) = (vec![f64::NAN; 2 * n], vec![f64::NAN; 2 * n]);
        workspace.contributions(&mut own_sums, &mut own_largest).unwrap();
        prop_assert!(relative(&own_sums, &sums, 1.0) < 1e-12);
        prop_assert_eq!(own_largest, largest);
        // Sums by squared weights, alone and on top of something.
        let values = scene.cotangents(seed).features;
        let mut gathered = vec![0.0; 2 * n];
        for &(pixel, n_, weight, _) in &hits {
            (0..2).for_each(|c| gathered[2 * n_ + c] += weight * weight * values[2 * pixel + c]);
        }
        let mut own = vec![f64::NAN; 2 * n];
        workspace.squared_contributions(&values, 2, Target::write(&mut own)).unwrap();
        prop_assert!(relative(&own, &gathered, 1.0) < 1e-12);
        workspace.squared_contributions(&values, 2, Target::add(&mut own)).unwrap();
        gathered.iter_mut().for_each(|x| *x *= 2.0);
        prop_assert!(relative(&own, &gathered, 1.0) < 1e-12);
        // The gradients after it are those without it.
        let cotangents = scene.cotangents(seed);
        prop_assert_eq!(scene.gradients_in(&cotangents, &mut workspace), scene.gradients(&cotangents));
    }

    /// The rises of the error without each Gaussian are those that the hits, walked by hand, say.
    #[test]
    fn removal_is_what_the_pixels_say(seed: u64, n in 0_usize..60, size in (1_usize..40, 1_usize..40)) {
        let scene = Scene::random(seed, n, 2, size, None);
        let mut workspace = Workspace::new();
        let (planes, _) = scene.render_in(&mut workspace);
        let error = scene.cotangents(seed).image;
        let counts: Vec<f64> = (0..scene.pixels()).map(|pixel| f64::from(u8::from(pixel % 3 > 0))).collect();
        let map = [1.1, 0.2, 0.0, -0.1, 0.9, 0.1, 0.3, 0.0, 0.8];
        let hits = Mutex::new(vec![Vec::new(); scene.pixels()]);
        workspace.for_each_hit(|pixel, n, weight, light| hits.lock().unwrap()[pixel].push((n, weight, light))).unwrap();
        let (mut rises, mut shown) = (vec![0.0_f64; 2 * n], vec![0.0_f64; 2 * n]);
        for (pixel, hits) in hits.into_inner().unwrap().iter().enumerate() {
            let view = pixel / (size.0 * size.1);
            let mut behind: [f64; 3] = std::array::from_fn(|c| scene.background[3 * view + c]);
            for &(i, weight, light) in hits.iter().rev() {
                let own: [f64; 3] = std::array::from_fn(|c| scene.colors[3 * i + c]);
                let change: [f64; 3] = std::array::from_fn(|c| weight * (behind[c] - own[c]));
                let mapped = |c: usize| (0..3).map(|k| map[3 * c + k] * change[k]).sum::<f64>();
                let rise = |c: usize| mapped(c) * (2.0 * error[3 * pixel + c] + mapped(c));
                rises[view * n + i] += counts[pixel] * (0..3).map(rise).sum::<f64>();
                shown[view * n + i] += counts[pixel] * weight;
                let alpha = weight / light;
                behind = std::array::from_fn(|c| behind[c] + alpha * (own[c] - behind[c]));
            }
        }
        let compared = Compared { image: &planes.image, error: &error, counts: &counts, map };
        let (mut own_rises, mut own_shown) = (vec![f64::NAN; 2 * n], vec![f64::NAN; 2 * n]);
        workspace.removal(&compared, &mut own_rises, &mut own_shown).unwrap();
        prop_assert!(relative(&own_rises, &rises, 1.0) < 1e-10);
        prop_assert!(relative(&own_shown, &shown, 1.0) < 1e-10);
    }

    /// The gradients of features alone are those that come with all others, to the bit.
    #[test]
    fn features_alone_have_the_same_gradients(seed: u64, n in 0_usize..80, channels in 1_usize..40) {
        let scene = Scene::random(seed, n, 2, (33, 21), None).with_channels(channels);
        let (cotangents, scene) = (scene.cotangents(seed).to_f32(), scene.to_f32());
        let mut workspace = Workspace::new();
        scene.render_in(&mut workspace);
        let with_others = &scene.gradients_in(&cotangents, &mut workspace)[8];
        let mut alone = vec![f32::NAN; channels * n];
        workspace.feature_gradients(&cotangents.features, channels, Target::write(&mut alone)).unwrap();
        prop_assert_eq!(&alone, with_others);
        workspace.feature_gradients(&cotangents.features, channels, Target::add(&mut alone)).unwrap();
        prop_assert_eq!(&alone, &with_others.iter().map(|x| 2.0 * x).collect::<Vec<_>>());
    }

    #[test]
    fn expected_depth_is_differentiated(seed: u64) {
        let scene = Scene::random(seed, 10, 1, (6, 5), None);
        let planes = scene.render();
        let dout = scene.cotangents(seed).depth;
        let value = |depth: &[f64], alpha: &[f64]| -> f64 {
            let mut out = vec![f64::NAN; depth.len()];
            expected_depth(depth, alpha, &mut out);
            out.iter().zip(&dout).map(|(x, d)| x * d).sum()
        };
        let (mut ddepth, mut dalpha) = (vec![0.0; 30], vec![0.0; 30]);
        expected_depth_backward(&planes.depth, &planes.alpha, &dout, &mut ddepth, &mut dalpha);
        for pixel in 0..30 {
            if planes.alpha[pixel] == 0.0 {
                prop_assert_eq!(dalpha[pixel], 0.0);
                continue;
            }
            let slope = |part: usize| {
                let moved = |by: f64| {
                    let mut images = [planes.depth.clone(), planes.alpha.clone()];
                    images[part][pixel] += by;
                    value(&images[0], &images[1])
                };
                let step = 1e-6 * planes.alpha[pixel];
                (moved(step) - moved(-step)) / (2.0 * step)
            };
            for (part, gradient) in [(0, ddepth[pixel]), (1, dalpha[pixel])] {
                prop_assert!((slope(part) - gradient).abs() < 1e-4 * (1.0 + gradient.abs()), "{part} {gradient}");
            }
        }
    }
}

#[test]
fn nothing_drawn_is_nothing_to_visit() {
    let mut workspace = Workspace::<f64>::new();
    assert!(workspace.for_each_hit(|_, _, _, _| ()).unwrap_err().to_string().contains("nothing was drawn"));
    assert!(workspace.contributions(&mut [], &mut []).is_err());
    assert!(workspace.feature_gradients(&[], 1, Target::write(&mut [])).is_err());
    assert!(workspace.squared_contributions(&[], 1, Target::write(&mut [])).is_err());
}
