//! Gaussians whose opacities depend on the view, drawn and differentiated.

use proptest::prelude::*;
use std::sync::Arc;
use weaver_geometry::Pose;
use weaver_geometry::glam::DVec3;
use weaver_geometry::trajectory::look_at;
use weaver_inference::{ViewOpacity, ViewOpacityRasterizer};
use weaver_kernels::random::Stream;
use weaver_scene::{CameraSlices, Color, GaussianSlices, Model};
use weaver_splat::{Cotangents, CpuRasterizer, Gradients, Images, RasterSettings, Rasterizer, Target};

const SIZE: [usize; 2] = [18, 24];
const PIXELS: usize = SIZE[0] * SIZE[1];

struct Case {
    rasterizer: ViewOpacityRasterizer<f64>,
    means: Vec<f64>,
    colors: Vec<f64>,
    /// The loss is the sum of these times the image.
    weights: Vec<f64>,
}

impl Case {
    fn new(n: usize, seed: u64) -> Self {
        let stream = Stream::new(seed, 0, "case");
        let draw = |k: u64, i: usize| stream.fork(k).uniform::<f64>(i as u64);
        // The mean logit is 1 or so: opacities stay far from where Gaussians are cut.
        let number = |i: usize| if i.is_multiple_of(9) { 3.5 } else { 1.2 * draw(0, i) as f32 - 0.6 };
        let harmonics = (0..9 * n).map(number).collect();
        Self {
            rasterizer: ViewOpacityRasterizer {
                rasterizer: Arc::new(CpuRasterizer),
                opacity: Some(Arc::new(ViewOpacity { harmonics })),
            },
            means: (0..3 * n).map(|i| 1.6 * draw(1, i) - 0.8).collect(),
            colors: (0..3 * n).map(|i| draw(2, i)).collect(),
            weights: (0..3 * PIXELS).map(|i| draw(3, i) - 0.5).collect(),
        }
    }

    fn n(&self) -> usize {
        self.means.len() / 3
    }

    /// The loss.
    fn loss(&self, viewmats: &[f64], means: &[f64]) -> f64 {
        self.pass(viewmats, means, None)
    }

    /// The loss, and its gradient by view matrix and means.
    fn slopes(&self, viewmats: &[f64], means: &[f64]) -> (f64, Vec<f64>) {
        let mut slopes = [vec![0.0; viewmats.len()], vec![0.0; means.len()]];
        let value = self.pass(viewmats, means, Some(&mut slopes));
        (value, slopes.concat())
    }

    fn pass(&self, viewmats: &[f64], means: &[f64], slopes: Option<&mut [Vec<f64>; 2]>) -> f64 {
        let n = self.n();
        let [scales, quats, ignored] = [vec![0.3; 3 * n], [1.0, 0.1, 0.2, 0.3].repeat(n), vec![0.0; n]];
        let color = Color::Plain(&self.colors);
        let gaussians = GaussianSlices {
            means,
            quats: &quats,
            scales: &scales,
            opacities: &ignored,
            color,
            features: None,
            groups: None,
        };
        let cameras = CameraSlices {
            viewmats,
            intrinsics: &[22.0, 22.0, 12.0, 9.0],
            background: &[0.1, 0.2, 0.3],
            width: SIZE[1],
            height: SIZE[0],
            model: Model::Pinhole,
        };
        let settings = RasterSettings::default();
        let (mut image, mut alpha) = (vec![0.0; 3 * PIXELS], vec![0.0; PIXELS]);
        let mut session = self.rasterizer.session();
        let images = Images { image: &mut image, alpha: &mut alpha, depth: None, features: None };
        session.forward(&gaussians, &cameras, &settings, images).unwrap();
        if let Some([by_viewmat, by_means]) = slopes {
            let gradients = Gradients {
                viewmats: Some(Target::write(by_viewmat)),
                means: Some(Target::write(by_means)),
                ..Gradients::default()
            };
            let cotangents = Cotangents { image: Some(&self.weights), ..Cotangents::default() };
            session.backward(&gaussians, &cameras, &settings, &cotangents, gradients).unwrap();
        }
        image.iter().zip(&self.weights).map(|(a, b)| a * b).sum()
    }
}

fn pose(angle: f64) -> Pose {
    look_at(DVec3::new(3.0 * angle.sin(), -0.7, -3.0 * angle.cos()), DVec3::ZERO, DVec3::NEG_Y)
}

proptest! {
    /// Promise of `opacities_may_depend_on_the_view`.
    #[test]
    fn slopes_by_camera_and_means_go_through_opacities(n in 1..6_usize, seed in any::<u64>(), angle in -1.0..1.0_f64) {
        let case = Case::new(n, seed);
        let rows = pose(angle).rows().concat();
        let (value, slopes) = case.slopes(&rows, &case.means);
        prop_assert!(value.is_finite());
        for (i, slope) in slopes.iter().enumerate() {
            let at = |h: f64| {
                let (mut rows, mut means) = (rows.clone(), case.means.clone());
                *if i < 12 { &mut rows[i] } else { &mut means[i - 12] } += h;
                case.loss(&rows, &means)
            };
            let [above, below] = [1e-5, -1e-5].map(at);
            let difference = (above - below) / 2e-5;
            // Where a Gaussian begins to be cut at the least alpha, the image jumps by a 255th.
            prop_assume!((above + below - 2.0 * value).abs() < 1e-6);
            prop_assert!((difference - slope).abs() < 1e-5 * (1.0 + slope.abs()), "{i}: {difference} {slope}");
        }
    }
}

#[test]
fn a_view_is_drawn_with_the_opacities_that_it_sees() {
    let case = Case::new(5, 1);
    let (rows, opacity) = (pose(0.4).rows().concat(), case.rasterizer.opacity.clone().unwrap());
    let seen = opacity.seen_from(&case.means, pose(0.4).center());
    assert_ne!(seen, opacity.seen_from(&case.means, pose(-0.4).center()));
    let plain = Case {
        rasterizer: ViewOpacityRasterizer { rasterizer: Arc::new(CpuRasterizer), opacity: None },
        ..Case::new(5, 1)
    };
    // Without, they are those that are given: zeros.
    let background: f64 = case.weights.chunks(3).map(|w| 0.1 * w[0] + 0.2 * w[1] + 0.3 * w[2]).sum();
    assert!((plain.loss(&rows, &plain.means) - background).abs() < 1e-9);
    assert!((case.loss(&rows, &case.means) - background).abs() > 1e-3);
}

/// Several views and slopes of inputs that take no part are refused.
#[test]
fn several_views_are_refused() {
    let case = Case::new(2, 3);
    let [scales, quats, mut opacities] = [vec![0.3; 6], [1.0, 0.0, 0.0, 0.0].repeat(2), vec![0.0; 2]];
    let given = opacities.clone();
    let color = Color::Plain(&case.colors);
    let gaussians = GaussianSlices {
        means: &case.means,
        quats: &quats,
        scales: &scales,
        opacities: &given,
        color,
        features: None,
        groups: None,
    };
    let two = pose(0.0).rows().concat().repeat(2);
    let intrinsics = [22.0, 22.0, 12.0, 9.0].repeat(2);
    let cameras = |views: usize| CameraSlices {
        viewmats: &two[..12 * views],
        intrinsics: &intrinsics[..4 * views],
        background: &[0.0; 3],
        width: SIZE[1],
        height: SIZE[0],
        model: Model::Pinhole,
    };
    let mut session = case.rasterizer.session();
    let settings = RasterSettings::default();
    let mut forward = |views: usize| {
        let (mut image, mut alpha) = (vec![0.0; 3 * views * PIXELS], vec![0.0; views * PIXELS]);
        let images = Images { image: &mut image, alpha: &mut alpha, depth: None, features: None };
        session.forward(&gaussians, &cameras(views), &settings, images)
    };
    assert!(forward(2).unwrap_err().to_string().contains("expected one view, found 2"));
    forward(1).unwrap();
    let gradients = Gradients { opacities: Some(Target::write(&mut opacities)), ..Gradients::default() };
    let cotangents = Cotangents { image: Some(&case.weights), ..Cotangents::default() };
    let refused = session.backward(&gaussians, &cameras(1), &settings, &cotangents, gradients).unwrap_err();
    assert!(refused.to_string().contains("expected no gradient by opacities"), "{refused}");
}
