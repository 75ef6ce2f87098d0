//! The seams: any rasterizer behind the operation on the tape, any region of an image, statistics on the tape.

use crate::op::{inputs, named};
use crate::scene::{NAMES, Planes, Scene, flatten, relative};
use proptest::prelude::*;
use std::sync::Arc;
use weaver_autograd::gradcheck::{Options, gradcheck_with};
use weaver_autograd::{Tape, Var};
use weaver_scene::{CameraSlices, GaussianSlices};
use weaver_splat::{
    Cotangents, Gradients, Images, RasterError, RasterSettings, RasterStats, Rasterize, Rasterizer, Region, Session,
    SharedStatistics, Target, TileSide, WorkspacePool, reference,
};

/// The slow reference as a rasterizer.
#[derive(Debug)]
struct Slow;

/// True if anything was drawn.
#[derive(Debug, Default)]
struct SlowSession(bool);

impl Rasterizer<f64> for Slow {
    fn session(&self) -> Box<dyn Session<f64>> {
        Box::new(SlowSession::default())
    }
}

impl Session<f64> for SlowSession {
    fn forward(
        &mut self,
        gaussians: &GaussianSlices<'_, f64>,
        cameras: &CameraSlices<'_, f64>,
        settings: &RasterSettings,
        images: Images<'_, f64>,
    ) -> Result<RasterStats, RasterError> {
        self.0 = true;
        let drawn = reference::rasterize(gaussians, cameras, settings)?;
        images.image.copy_from_slice(&drawn.image);
        images.alpha.copy_from_slice(&drawn.alpha);
        images.depth.into_iter().for_each(|depth| depth.copy_from_slice(&drawn.depth));
        images.features.into_iter().for_each(|features| features.copy_from_slice(&drawn.features));
        Ok(RasterStats::default())
    }

    fn backward(
        &mut self,
        gaussians: &GaussianSlices<'_, f64>,
        cameras: &CameraSlices<'_, f64>,
        settings: &RasterSettings,
        cotangents: &Cotangents<'_, f64>,
        gradients: Gradients<'_, f64>,
    ) -> Result<(), RasterError> {
        if !self.0 {
            return Err(RasterError::Arguments("nothing was drawn".into()));
        }
        let d = reference::rasterize_backward(gaussians, cameras, settings, cotangents)?;
        let put = |target: Option<Target<'_, f64>>, from: &[f64]| {
            let Some(Target { values, add }) = target else { return };
            values.iter_mut().zip(from).for_each(|(to, x)| *to = if add { *to + x } else { *x });
        };
        put(gradients.means, &d.means);
        put(gradients.quats, &d.quats);
        put(gradients.scales, &d.scales);
        put(gradients.opacities, &d.opacities);
        put(gradients.colors, &d.colors);
        put(gradients.features, &d.features);
        put(gradients.viewmats, &d.viewmats);
        put(gradients.intrinsics, &d.intrinsics);
        put(gradients.background, &d.background);
        if let Some(statistics) = gradients.statistics {
            statistics.copy_from_slice(&d.statistics);
        }
        Ok(())
    }
}

/// The sum of an image with weights.
fn weighted<'t>(tape: &'t Tape<f64>, image: Var<'t, f64>, weights: &[f64]) -> Var<'t, f64> {
    (image * tape.constant(weights, image.shape())).sum()
}

/// Images, gradients of a weighted sum of them, and statistics, of a rasterizer on the tape.
fn on_the_tape(
    scene: &Scene<f64>,
    cotangents: &Planes<f64>,
    workspaces: &WorkspacePool<f64>,
) -> (Planes<f64>, Vec<Vec<f64>>) {
    let (tape, statistics) = (Tape::<f64>::new(), SharedStatistics::new());
    let x: Vec<_> = inputs(scene).iter().map(|input| tape.leaf(&input.data, input.shape)).collect();
    let (gaussians, cameras, background) = named(&x);
    let op = Rasterize::new(scene.width, scene.height, scene.settings, workspaces).with_statistics(&statistics);
    let (drawn, features) = op.apply_with_features(&gaussians, &cameras, background, x[8]);
    let loss = weighted(&tape, drawn.image, &cotangents.image)
        + weighted(&tape, drawn.alpha, &cotangents.alpha)
        + weighted(&tape, drawn.depth, &cotangents.depth)
        + weighted(&tape, features, &cotangents.features);
    loss.backward();
    let planes = Planes {
        image: drawn.image.to_vec(),
        alpha: drawn.alpha.to_vec(),
        depth: drawn.depth.to_vec(),
        features: features.to_vec(),
    };
    let mut gradients: Vec<_> = x.iter().map(|leaf| leaf.grad().unwrap().to_vec()).collect();
    gradients.push(flatten(&statistics.take()));
    assert!(statistics.take().is_empty());
    (planes, gradients)
}

/// A region somewhere in an image of this size, from two corners.
fn region((width, height): (usize, usize), corners: [(prop::sample::Index, prop::sample::Index); 2]) -> Region {
    let [(a, b), (c, d)] = corners.map(|(x, y)| (x.index(width), y.index(height)));
    Region { x: a.min(c), y: b.min(d), width: a.abs_diff(c) + 1, height: b.abs_diff(d) + 1 }
}

/// The pixels of all views that lie in a region, in its order.
fn pixels_of(scene: &Scene<f64>, region: &Region) -> Vec<usize> {
    let rows = (0..scene.views()).flat_map(|v| (region.y..region.y + region.height).map(move |y| v * scene.height + y));
    rows.flat_map(|row| (region.x..region.x + region.width).map(move |x| row * scene.width + x)).collect()
}

/// Runs `body(values, numbers per pixel)` on every image.
fn each_image<T>(planes: &Planes<T>, scene: &Scene<f64>, body: impl Fn(&[T], usize) -> Vec<T>) -> Planes<T> {
    Planes {
        image: body(&planes.image, scene.image_channels()),
        alpha: body(&planes.alpha, 1),
        depth: body(&planes.depth, 1),
        features: body(&planes.features, scene.channels),
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 10, failure_persistence: None, ..Default::default() })]

    /// A region has the bits of that part of the whole image, and the very gradients of the whole image with cotangents
    /// of zero outside.
    #[test]
    fn a_region_is_a_crop(
        seed: u64,
        n in 0_usize..80,
        views in 1_usize..3,
        size in (1_usize..90, 1_usize..60),
        corners: [(prop::sample::Index, prop::sample::Index); 2],
        tile in prop::sample::select(vec![TileSide::Sixteen, TileSide::ThirtyTwo, TileSide::SixtyFour]),
        degree in prop::option::of(0_usize..=2),
        channels in prop::sample::select(vec![0_usize, 2, 5]),
    ) {
        let mut whole = Scene::random(seed, n, views, size, degree).with_channels(channels);
        whole.settings.tile = tile;
        let region = region(size, corners);
        let mut part = whole.clone();
        part.settings.region = Some(region);
        let pixels = pixels_of(&whole, &region);
        let cotangents = part.cotangents(seed);
        let padded = each_image(&cotangents, &whole, |values, channels| {
            let mut out = vec![0.0; whole.pixels() * channels];
            for (&pixel, from) in pixels.iter().zip(values.chunks(channels.max(1))) {
                out[pixel * channels..][..channels].copy_from_slice(from);
            }
            out
        });
        let crop = |values: &[f64], channels: usize| -> Vec<f64> {
            pixels.iter().flat_map(|pixel| values[pixel * channels..][..channels].iter().copied()).collect()
        };
        prop_assert_eq!(&part.render(), &each_image(&whole.render(), &whole, crop));
        let (own, all) = (part.gradients(&cotangents), whole.gradients(&padded));
        for i in 0..9 {
            prop_assert_eq!(&own[i], &all[i], "{}", NAMES[i]);
        }
        let (single, whole, cotangents, padded) = (part.to_f32(), whole.to_f32(), cotangents.to_f32(), padded.to_f32());
        let (own, all) = (single.gradients(&cotangents), whole.gradients(&padded));
        for i in 0..9 {
            prop_assert_eq!(&own[i], &all[i], "{}", NAMES[i]);
        }
        let image: Vec<f32> = pixels.iter().flat_map(|pixel| whole.render().image[3 * pixel..][..3].to_vec()).collect();
        prop_assert_eq!(single.render().image, image);
    }

    /// Two rasterizers behind one operation: the same images, gradients and statistics.
    #[test]
    fn any_rasterizer_fits_the_tape(
        seed: u64,
        n in 1_usize..40,
        views in 1_usize..3,
        size in (1_usize..30, 1_usize..24),
        corners: [(prop::sample::Index, prop::sample::Index); 2],
        degree in prop::option::of(0_usize..=2),
        cropped: bool,
    ) {
        let mut scene = Scene::random(seed, n, views, size, degree);
        scene.settings.region = cropped.then(|| region(size, corners));
        let cotangents = scene.cotangents(seed);
        let (planes, gradients) = on_the_tape(&scene, &cotangents, &WorkspacePool::new());
        prop_assert_eq!(&planes, &scene.render());
        let (slow, expected) = on_the_tape(&scene, &cotangents, &WorkspacePool::of(Arc::new(Slow)));
        prop_assert!(relative(&planes.flat(), &slow.flat(), 1e-3) < 1e-11);
        for ((name, own), expected) in TAPE_NAMES.iter().zip(&gradients).zip(&expected) {
            let error = relative(own, expected, 1e-3);
            prop_assert!(error < 1e-9, "{name}: {error}");
        }
    }

    /// A region passes the gradient check on the tape.
    #[test]
    fn a_region_passes_gradcheck(
        seed: u64,
        n in 0_usize..5,
        size in (1_usize..6, 1_usize..6),
        corners: [(prop::sample::Index, prop::sample::Index); 2],
    ) {
        let mut scene = Scene::smooth(seed, n, 1, size, Some(1));
        scene.settings.region = Some(region(size, corners));
        let workspaces = WorkspacePool::new();
        let options = Options { duplicates: false, seed, ..Options::default() };
        gradcheck_with(options, &inputs(&scene)[..8], |x| {
            let (gaussians, cameras, background) = named(x);
            let drawn = Rasterize::new(size.0, size.1, scene.settings, &workspaces).apply(&gaussians, &cameras, background);
            vec![drawn.image, drawn.alpha, drawn.depth]
        });
    }
}

/// Names of the inputs of the operation, then of the statistics.
const TAPE_NAMES: [&str; 10] = [
    "means",
    "quats",
    "scales",
    "opacities",
    "colors",
    "viewmats",
    "intrinsics",
    "background",
    "features",
    "statistics",
];

/// Statistics add up over passes and operations until they are taken.
#[test]
fn statistics_add_up() {
    let scene = Scene::random(5, 20, 2, (20, 15), None);
    let (workspaces, statistics) = (WorkspacePool::new(), SharedStatistics::new());
    let pass = |times: usize| {
        let tape = Tape::<f64>::new();
        let x: Vec<_> = inputs(&scene).iter().map(|input| tape.leaf(&input.data, input.shape)).collect();
        let (gaussians, cameras, background) = named(&x);
        let draw = || Rasterize::new(20, 15, scene.settings, &workspaces).with_statistics(&statistics);
        let images = (0..times).map(|_| draw().apply(&gaussians, &cameras, background).image.square().sum());
        images.reduce(|sum, image| sum + image).unwrap().backward();
    };
    pass(1);
    let once = statistics.take();
    assert!(once.iter().any(|s| s.views == 2 && s.absgrad >= s.screen_gradient && s.screen_gradient > 0.0));
    assert!(once.iter().all(|s| s.largest_weight <= s.contribution && (s.views == 0) == (s.radius == 0.0)));
    pass(1);
    pass(2);
    for (all, once) in statistics.take().iter().zip(&once) {
        assert_eq!((all.views, all.radius, all.largest_weight), (3 * once.views, once.radius, once.largest_weight));
        for (sum, one) in [(all.absgrad, once.absgrad), (all.contribution, once.contribution)] {
            assert!((sum - 3.0 * one).abs() <= 1e-12 * sum);
        }
    }
}

#[test]
fn regions_beyond_the_image_are_refused() {
    let mut scene = Scene::random(1, 4, 1, (5, 5), None);
    for (x, y, width, height) in [(0, 0, 0, 1), (0, 0, 1, 0), (3, 0, 3, 1), (0, 5, 1, 1), (usize::MAX, 0, 2, 1)] {
        scene.settings.region = Some(Region { x, y, width, height });
        let error = reference::rasterize(&scene.gaussians(), &scene.cameras(), &scene.settings).unwrap_err();
        assert!(error.to_string().contains("region"), "{error}");
        let tape = Tape::<f64>::new();
        let x: Vec<_> = inputs(&scene)[..8].iter().map(|input| tape.leaf(&input.data, input.shape)).collect();
        let op = Rasterize::new(5, 5, scene.settings, &WorkspacePool::new());
        assert!(tape.try_apply(op, &x).unwrap_err().to_string().contains("region"));
    }
}
