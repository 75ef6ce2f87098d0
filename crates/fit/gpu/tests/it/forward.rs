//! Images on the device against the CPU's.

use crate::device::{NARROW, decided, masked, narrow, rasterizer, render, rounded};
use crate::scene::{Planes, Scene};
use proptest::prelude::*;
use weaver_gpu::GpuRasterizer;
use weaver_kernels::Real;
use weaver_splat::{RasterSettings, Region, Workspace};

/// The largest difference of two images.
fn farthest<T: Real, U: Real>(a: &[T], b: &[U]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter()
        .zip(b)
        .map(|(a, b)| (a.to_f64() - b.to_f64()).abs())
        .fold(0.0, |most, x| if x > most || x.is_nan() { x } else { most })
}

/// Compares images where rounding decides nothing.
fn compare(ours: &Planes<f32>, theirs: &Planes<f64>, decided: &[bool]) -> Result<(), TestCaseError> {
    let (ours, theirs) = (masked(ours, decided), masked(theirs, decided));
    let nearest = theirs.depth.iter().fold(1.0_f64, |most, z| most.max(*z));
    for (name, error) in [
        ("image", farthest(&ours.image, &theirs.image)),
        ("alpha", farthest(&ours.alpha, &theirs.alpha)),
        ("depth", farthest(&ours.depth, &theirs.depth) / nearest),
    ] {
        prop_assert!(error <= 1e-4, "{name}: {error:e}");
    }
    Ok(())
}

fn check(rasterizer: &GpuRasterizer, scene: &Scene<f64>) -> Result<(), TestCaseError> {
    let exact = rounded(scene);
    let single = exact.to_f32();
    let (own, stats) = render(rasterizer, &mut weaver_gpu::GpuWorkspace::default(), &single);
    let (_, expected) = single.render_in(&mut Workspace::new());
    prop_assert_eq!(
        (stats.splats, stats.entries, stats.rejected),
        (expected.splats, expected.entries, expected.rejected)
    );
    let decided = decided(&exact);
    let undecided = decided.iter().filter(|decided| !**decided).count();
    prop_assert!(undecided as f64 <= 0.02 * decided.len() as f64 + 4.0, "{undecided} of {}", decided.len());
    compare(&own, &exact.render(), &decided)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 32, failure_persistence: None, ..Default::default() })]

    #[test]
    fn images_are_those_of_the_cpu(
        seed: u64,
        n in 0_usize..300,
        views in 1_usize..4,
        size in (1_usize..90, 1_usize..60),
        degree in prop::option::of(0_usize..=4),
        antialiased: bool,
        colorless: bool,
        thin: bool,
        alpha_max in prop::sample::select(vec![0.99, 0.999]),
        radius_clip in prop::option::of(0.0_f64..8.0),
        region in prop::option::of(any::<[prop::sample::Index; 2]>()),
    ) {
        let Some(rasterizer) = rasterizer() else { return Ok(()) };
        let mut scene = Scene::random(seed, n, views, size, degree).with_channels(0);
        if colorless {
            scene = scene.without_colors();
        }
        scene.settings = RasterSettings { antialiased, alpha_max, radius_clip, ..RasterSettings::default() };
        if let Some([x, y]) = region {
            let (x, y) = (x.index(size.0), y.index(size.1));
            scene.settings.region = Some(Region { x, y, width: size.0 - x, height: size.1 - y });
        }
        if thin {
            scene.scales.iter_mut().step_by(3).for_each(|s| *s *= 1e-3);
        }
        check(&rasterizer, &scene)?;
    }
}

#[test]
fn large_drawings_go_in_bands() {
    let Some(narrow) = narrow() else { return };
    let mut scene = Scene::random(3, 600, 2, (120, 90), Some(2)).with_channels(0);
    scene.settings.region = Some(Region { x: 5, y: 9, width: 110, height: 80 });
    check(&narrow, &scene).unwrap();
    let entries = scene.to_f32().render_in(&mut Workspace::new()).1.entries;
    assert!(entries > 4 * NARROW as usize / 48, "{entries} entries fit without bands");
}

/// Many tiles, many passes of the sort, an image whose sides are no multiples of a tile's.
#[test]
fn many_gaussians() {
    let Some(rasterizer) = rasterizer() else { return };
    let mut scene = Scene::random(4, 5000, 1, (301, 203), Some(1)).with_channels(0);
    scene.scales.iter_mut().for_each(|scale| *scale *= 0.1);
    check(&rasterizer, &scene).unwrap();
    let decided = decided(&rounded(&scene));
    let share = decided.iter().filter(|decided| **decided).count() as f64 / decided.len() as f64;
    assert!(share >= 0.995, "{share}");
}

/// Equal depths stay in the order of their indices.
#[test]
fn ties_go_by_index() {
    let Some(rasterizer) = rasterizer() else { return };
    let mut scene = Scene::random(5, 400, 1, (40, 30), None).with_channels(0);
    scene.viewmats = vec![1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    scene.means.iter_mut().skip(2).step_by(3).for_each(|z| *z = z.round().abs().max(1.0));
    check(&rasterizer, &scene).unwrap();
}

#[test]
fn nothing_is_drawn_as_background() {
    let Some(rasterizer) = rasterizer() else { return };
    let behind = {
        let mut scene = Scene::random(6, 20, 2, (17, 1), Some(3)).with_channels(0);
        scene.means.iter_mut().skip(2).step_by(3).for_each(|z| *z = -1.0 - z.abs());
        scene
    };
    for scene in [Scene::random(6, 0, 1, (1, 1), None).with_channels(0), behind] {
        let single = scene.to_f32();
        let (own, stats) = render(&rasterizer, &mut weaver_gpu::GpuWorkspace::default(), &single);
        assert_eq!(own, single.render());
        assert_eq!((stats.splats, stats.entries, stats.rejected), (0, 0, 0));
    }
}
