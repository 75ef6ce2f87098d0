//! Gradients against central differences, in `f64`: every number of every surfel, and the pose; both branches.

use crate::scene::{camera, draw, poses, shell, sight};
use proptest::prelude::*;
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Pose, so3};
use weaver_kernels::random::Stream;
use weaver_surfel::{RangeCotangents, SurfelCamera, Surfels};

struct Weights {
    range: Vec<f64>,
    opacity: Vec<f64>,
    normal: Vec<f64>,
}

fn loss(surfels: &Surfels<f64>, camera: &SurfelCamera, poses: &[Pose], weights: &Weights) -> f64 {
    let (_, images) = draw(&sight(surfels, camera, poses));
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    dot(&images.range, &weights.range) + dot(&images.opacity, &weights.opacity) + dot(&images.normal, &weights.normal)
}

/// Central differences with two steps; none where they disagree, as at a threshold.
fn slope(mut at: impl FnMut(f64) -> f64) -> Option<f64> {
    let mut central = |h: f64| (at(h) - at(-h)) / (2.0 * h);
    let (a, b) = (central(2e-6), central(1e-6));
    ((a - b).abs() < 1e-5 * (1.0 + a.abs())).then_some(b)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 16))]

    #[test]
    fn agree_with_differences(seed in 0_u64..1000, n in 1_usize..9, width in 5_usize..40, height in 5_usize..30, spherical: bool) {
        let (mut surfels, camera) = (shell::<f64>(seed, n, 0.6), camera(spherical, [width, height]));
        let mut poses = poses(seed, 2);
        let stream = Stream::new(seed, 1, "weights");
        let many = |k: u64, count: usize| (0..count as u64).map(|i| stream.normal(4 * i + k)).collect::<Vec<f64>>();
        let pixels = 2 * camera.pixels();
        let weights = Weights { range: many(0, pixels), opacity: many(1, pixels), normal: many(2, 3 * pixels) };
        let (mut gradients, mut dposes) = (Surfels::default(), [[0.0; 6]; 2]);
        {
            let sight = sight(&surfels, &camera, &poses);
            let (mut workspace, _) = draw(&sight);
            let Weights { range, opacity, normal } = &weights;
            let cotangents = RangeCotangents { range: Some(range), opacity: Some(opacity), normal: Some(normal) };
            workspace.backward(&sight, &cotangents, &mut gradients, Some(&mut dposes));
        }
        let (mut checked, mut skipped) = (0, 0);
        let mut check = |own: f64, slope: Option<f64>, what: String| -> Result<(), TestCaseError> {
            let Some(slope) = slope else {
                skipped += 1;
                return Ok(());
            };
            checked += 1;
            prop_assert!((own - slope).abs() < 1e-5 * (1.0 + slope.abs()), "{what}: {own} {slope}");
            Ok(())
        };
        macro_rules! column {
            ($field:ident) => {
                for i in 0..surfels.$field.len() {
                    let before = surfels.$field[i];
                    let slope = slope(|by| {
                        surfels.$field[i] = before + by;
                        loss(&surfels, &camera, &poses, &weights)
                    });
                    surfels.$field[i] = before;
                    check(gradients.$field[i], slope, format!("{} {i}", stringify!($field)))?;
                }
            };
        }
        column!(centers);
        column!(quats);
        column!(log_scales);
        column!(opacity_logits);
        for view in 0..2 {
            let before = poses[view];
            for (k, own) in dposes[view].into_iter().enumerate() {
                let slope = slope(|by| {
                    let axis = DVec3::AXES[k % 3] * by;
                    poses[view] = match k < 3 {
                        true => Pose::new(before.rotation, before.translation + axis),
                        false => Pose::new(so3::exp(axis), DVec3::ZERO).compose(&before),
                    };
                    loss(&surfels, &camera, &poses, &weights)
                });
                poses[view] = before;
                check(own, slope, format!("pose {view}, number {k}"))?;
            }
        }
        prop_assert!(10 * skipped <= checked + 30, "{skipped} of {checked} at thresholds");
    }
}
