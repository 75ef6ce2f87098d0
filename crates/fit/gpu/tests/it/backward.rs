//! Gradients on the device against the CPU's.

use crate::device::{decided, gradients, masked, narrow, rasterizer, render, rounded};
use crate::scene::{NAMES, Scene, relative};
use proptest::prelude::*;
use weaver_gpu::{GpuRasterizer, GpuWorkspace};
use weaver_kernels::Real;
use weaver_splat::{Cotangents, Gradients, RasterSettings, Target};

/// All gradients within 1e-4 of their norm, with cotangents where rounding decides nothing.
fn check(rasterizer: &GpuRasterizer, scene: &Scene<f64>, seed: u64) -> Result<(), TestCaseError> {
    let exact = rounded(scene);
    let single = exact.to_f32();
    let cotangents = masked(&exact.cotangents(seed), &decided(&exact));
    let mut workspace = GpuWorkspace::default();
    render(rasterizer, &mut workspace, &single);
    let own = gradients(rasterizer, &mut workspace, &single, &cotangents.to_f32());
    // The CPU at the same precision shows the effect of rounding alone.
    let on_cpu = single.gradients(&cotangents.to_f32());
    let expected = exact.gradients(&cotangents);
    for (i, name) in NAMES.iter().enumerate().filter(|(_, name)| **name != "features") {
        let (error, of_rounding) = (relative(&own[i], &expected[i], 1e-3), relative(&on_cpu[i], &expected[i], 1e-3));
        prop_assert!(error <= 1e-4_f64.max(2.0 * of_rounding), "{name}: {error:e}, on the CPU {of_rounding:e}");
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 32, failure_persistence: None, ..Default::default() })]

    #[test]
    fn gradients_are_those_of_the_cpu(
        seed: u64,
        n in 0_usize..200,
        views in prop::sample::select(vec![1_usize, 3]),
        size in (1_usize..60, 1_usize..50),
        degree in prop::option::of(0_usize..=4),
        antialiased: bool,
        colorless: bool,
        far_out: bool,
    ) {
        let Some(rasterizer) = rasterizer() else { return Ok(()) };
        let mut scene = Scene::random(seed, n, views, size, degree).with_channels(0);
        if colorless {
            scene = scene.without_colors();
        }
        // Beyond the limits of the slope, where they are functions of the intrinsics.
        if far_out {
            scene.means.chunks_mut(3).for_each(|mean| mean[0] *= 2.0);
            scene.scales.iter_mut().for_each(|scale| *scale *= 3.0);
        }
        scene.settings = RasterSettings { antialiased, ..RasterSettings::default() };
        check(&rasterizer, &scene, seed)?;
    }
}

#[test]
fn gradients_of_bands_add_up() {
    let Some(narrow) = narrow() else { return };
    let scene = Scene::random(8, 600, 2, (110, 80), Some(2)).with_channels(0);
    check(&narrow, &scene, 8).unwrap();
}

/// Gradients are added on request, and cotangents may be left out.
#[test]
fn targets_are_added_to() {
    let Some(rasterizer) = rasterizer() else { return };
    let scene = Scene::random(9, 60, 1, (30, 20), None).with_channels(0).to_f32();
    let mut workspace = GpuWorkspace::default();
    render(&rasterizer, &mut workspace, &scene);
    let alpha = vec![1.0; scene.pixels()];
    let cotangents = Cotangents { alpha: Some(&alpha), ..Cotangents::default() };
    let n = scene.opacities.len();
    let mut once = vec![0.0_f32; n];
    let mut twice = vec![1.0_f32; n];
    let (gaussians, cameras) = (scene.gaussians(), scene.cameras());
    let mut backward = |target: Target<'_, f32>| {
        let targets = Gradients { opacities: Some(target), ..Gradients::default() };
        rasterizer.backward(&gaussians, &cameras, &scene.settings, &mut workspace, &cotangents, targets).unwrap();
    };
    backward(Target::write(&mut once));
    backward(Target::add(&mut twice));
    backward(Target::add(&mut twice));
    assert!(once.iter().any(|g| *g > 0.0));
    once.iter().zip(&twice).for_each(|(once, twice)| assert_eq!(*twice, 1.0 + once + once));
    assert!(once.iter().all(|g| g.to_f64().is_finite()));
}
