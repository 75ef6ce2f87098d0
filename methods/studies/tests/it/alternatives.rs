//! Gradients of the alternatives to the mixture's router, certificates of the best blends, and their bound on gates.

use crate::routed::{Routed, Trained, shots};
use crate::wall::{self, COUNT, Moment, PIXELS, SIZE};
use proptest::prelude::*;
use weaver_autograd::gradcheck::Input;
use weaver_autograd::{Params, Tape, Var};
use weaver_dynamic::{hard_oracle, photometric};
use weaver_nn::{Builder, Context};
use weaver_splat::{Rasterize, WorkspacePool};
use weaver_studies::alternatives::{MlpRouter, VolumeRouter};
use weaver_studies::oracle::{blend, convex_oracle};

const AT: Moment = Moment { angle: 15.0, time: 0.4 };

/// Checks gradients by the parameters of `draw` against differences of the loss, at some numbers of each parameter.
fn check(mut params: Params<f64>, draw: impl for<'t> Fn(Context<'t, '_, f64>) -> Var<'t, f64>) {
    for id in params.ids().collect::<Vec<_>>() {
        let noise = Input::uniform(id.index() as u64, -0.3, 0.3, params.get(id).shape()).data;
        params.value_mut(id).iter_mut().zip(noise).for_each(|(x, n)| *x += n);
    }
    let target = Input::uniform(9, 0.0, 1.0, [PIXELS, 3]).data;
    let loss = |params: &Params<f64>| {
        let tape = Tape::new();
        photometric(draw(Context::new(&tape, params)), tape.constant(&target, [PIXELS, 3]), SIZE).item()
    };
    let tape = Tape::new();
    photometric(draw(Context::new(&tape, &params)), tape.constant(&target, [PIXELS, 3]), SIZE).backward();
    for id in params.ids() {
        let gradient = tape.param_grad(id).expect("a gradient").to_vec();
        for i in (0..gradient.len()).step_by(gradient.len() / 9 + 1) {
            let shifted = |by: f64| {
                let mut other = params.clone();
                other.value_mut(id)[i] += by;
                loss(&other)
            };
            let difference = (shifted(1e-5) - shifted(-1e-5)) / 2e-5;
            let name = params.get(id).name();
            assert!((difference - gradient[i]).abs() < 1e-8, "{name}[{i}]: {difference} {}", gradient[i]);
        }
    }
}

#[test]
fn gradients_of_the_perceptron_on_pixels() {
    let mut params = Params::new();
    let router = MlpRouter::new(Builder::new(&mut params, 3), 3, 5);
    let (images, workspaces) = (Input::uniform(4, 0.0, 1.0, [3, PIXELS, 3]), WorkspacePool::new());
    check(params, |cx| {
        let images = cx.tape.constant(&images.data, images.shape);
        router.gated(cx, images, &wall::shot(cx.tape, &workspaces, AT)).image
    });
}

#[test]
fn gradients_of_numbers_of_a_merged_scene() {
    let mut params = Params::new();
    let router = VolumeRouter::new(Builder::new(&mut params, 3), 2 * COUNT);
    let workspaces = WorkspacePool::new();
    check(params, |cx| {
        let shot = wall::shot(cx.tape, &workspaces, AT);
        router.image(cx, &wall::experts(cx.tape, wall::left, AT), &shot)
    });
}

/// With one expert opaque and the other transparent, the merged scene is the first expert's picture.
#[test]
fn a_merged_scene_can_be_one_expert() {
    let mut params = Params::<f64>::new();
    let router = VolumeRouter::new(Builder::new(&mut params, 3), 2 * COUNT);
    let id = params.find("logit").unwrap();
    (0..2 * COUNT).for_each(|i| params.value_mut(id)[i] = if i < COUNT { 60.0 } else { -60.0 });
    let (tape, workspaces) = (Tape::new(), WorkspacePool::new());
    let shot = wall::shot(&tape, &workspaces, AT);
    let gaussians = wall::experts(&tape, wall::left, AT);
    let found = router.image(Context::new(&tape, &params), &gaussians, &shot).to_vec();
    let own = gaussians.gathered(&(0..COUNT as u32).collect::<Vec<_>>());
    let op = Rasterize::new(SIZE[1], SIZE[0], shot.settings, &workspaces).without_depth();
    assert_eq!(found, op.apply(&own, &shot.camera, shot.background).image.to_vec());
}

/// A perceptron's input at each pixel is that pixel's: pictures that agree in one row of pixels are gated alike there.
#[test]
fn a_perceptron_on_pixels_sees_each_pixel_alone() {
    let mut params = Params::<f64>::new();
    let router = MlpRouter::new(Builder::new(&mut params, 3), 2, 5);
    let workspaces = WorkspacePool::new();
    let mut images = Input::uniform(4, 0.0, 1.0, [2, PIXELS, 3]).data;
    let gate = |images: &[f64]| {
        let tape = Tape::new();
        let shot = wall::shot(&tape, &workspaces, AT);
        router.gated(Context::new(&tape, &params), tape.constant(images, [2, PIXELS, 3]), &shot).gate.to_vec()
    };
    let before = gate(&images);
    images[3 * 40] += 0.5;
    let after = gate(&images);
    let changed: Vec<usize> = (0..2 * PIXELS).filter(|i| before[*i] != after[*i]).collect();
    assert_eq!(changed, [40, PIXELS + 40]);
    assert!((0..PIXELS).all(|i| (before[i] + before[PIXELS + i] - 1.0).abs() < 1e-14));
}

proptest! {
    /// r, the blend minus the photo, is the shortest vector in the hull of the differences d_k exactly where d_k r >= r
    /// r for all of them.
    #[test]
    fn best_blends_have_their_certificate(
        experts in 1..5usize, seed in any::<u64>(), coarse in any::<bool>(),
    ) {
        let pixels = 6;
        let values = |seed: u64, n: usize| {
            // Coarse numbers make equal experts, colors on a line, and photos inside a hull.
            let round = |x: f64| if coarse { (2.0 * x).round() / 2.0 } else { x };
            Input::uniform(seed, 0.0, 1.0, [n, 3]).data.into_iter().map(round).collect::<Vec<f64>>()
        };
        let (images, photo) = (values(seed, experts * pixels), values(!seed, pixels));
        let shares = convex_oracle(&images, &photo);
        let blended = blend(&images, &shares, pixels);
        let hard = hard_oracle(&images, &photo);
        for pixel in 0..pixels {
            let own: Vec<f64> = (0..experts).map(|k| shares[k * pixels + pixel]).collect();
            prop_assert!(own.iter().all(|share| *share >= 0.0));
            prop_assert!((own.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            let minus = |color: &[f64]| [0, 1, 2].map(|c| color[c] - photo[3 * pixel + c]);
            let dot = |a: [f64; 3], b: [f64; 3]| (0..3).map(|c| a[c] * b[c]).sum::<f64>();
            let left = minus(&blended[3 * pixel..]);
            let errors: Vec<[f64; 3]> = (0..experts).map(|k| minus(&images[3 * (k * pixels + pixel)..])).collect();
            for error in &errors {
                prop_assert!(dot(*error, left) >= dot(left, left) - 1e-7, "{own:?}");
            }
            let best = errors[hard[pixel]];
            prop_assert!(errors.iter().all(|error| dot(best, best) <= dot(*error, *error)));
        }
    }
}

/// Squared errors at each pixel: the best convex blend's is the least, at any gate.
///
/// Promise of `half_of_the_picture_needs_weights_alone`.
#[test]
fn no_gate_passes_the_best_convex_blend() {
    let shots = shots(&[-20.0, 0.0, 20.0], &[0.25, 0.75]);
    for steps in [0, 10, 40] {
        let routed = Routed::trained(wall::left, &shots, steps, Trained::All);
        for at in &shots {
            let [images, gate, photo] = routed.shown(wall::left, *at);
            let gate: Vec<f64> = gate.into_iter().map(f64::from).collect();
            let sum: Vec<f64> = (0..PIXELS).map(|i| gate[i] + gate[PIXELS + i]).collect();
            let gate: Vec<f64> = gate.iter().enumerate().map(|(i, share)| share / sum[i % PIXELS]).collect();
            let errors = |shares: &[f64]| {
                let image = blend(&images, shares, PIXELS);
                let squares: Vec<f64> = image.iter().zip(&photo).map(|(a, b)| (a - f64::from(*b)).powi(2)).collect();
                squares.chunks(3).map(|rgb| rgb.iter().sum()).collect::<Vec<f64>>()
            };
            let hard = hard_oracle(&images, &photo);
            let hard: Vec<f64> = (0..2 * PIXELS).map(|i| f64::from(u8::from(hard[i % PIXELS] == i / PIXELS))).collect();
            let (bound, ours, hard) = (errors(&convex_oracle(&images, &photo)), errors(&gate), errors(&hard));
            for ((bound, ours), hard) in bound.iter().zip(ours).zip(hard) {
                assert!(*bound <= ours + 1e-12 && *bound <= hard + 1e-12, "{bound} {ours} {hard}");
            }
        }
    }
}
