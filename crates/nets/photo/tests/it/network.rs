//! The network: how it begins, its gradients, its sizes.

use crate::Drawn;
use proptest::prelude::*;
use weaver_autograd::{Params, Tape, Var};
use weaver_kernels::random::Stream;
use weaver_model::ParametrizationConfig;
use weaver_nn::Context;
use weaver_photo::{Comparison, PhotoConfig, PhotoNetwork, Prior};
use weaver_router::AllocationKind;

fn micro() -> PhotoConfig {
    PhotoConfig::preset("micro").unwrap()
}

fn prior(drawn: &Drawn) -> Prior {
    let comparison = Comparison::simulated(drawn.photos(), &drawn.cameras, &drawn.depth, Stream::new(1, 0, "test"));
    Prior::new(drawn.photos(), &drawn.cameras, &comparison)
}

fn photos<'t>(tape: &'t Tape<f64>, drawn: &Drawn) -> Var<'t, f64> {
    let wide: Vec<f64> = drawn.planes.iter().map(|x| f64::from(*x)).collect();
    tape.constant(&wide, [drawn.cameras.len(), 3, drawn.size[0], drawn.size[1]])
}

/// Moves all parameters by random numbers, so that no layer is zero.
fn stirred(params: &mut Params<f64>) {
    for id in params.ids() {
        let stream = Stream::new(3, 0, params.get(id).name());
        (0..).zip(params.value_mut(id)).for_each(|(i, x)| *x += 0.05 * stream.normal::<f64>(i));
    }
}

/// Numbers that stand for a loss of everything that the network predicts.
fn loss<'t>(cx: Context<'t, '_, f64>, network: &PhotoNetwork, prior: &Prior, drawn: &Drawn) -> Var<'t, f64> {
    let colors = photos(cx.tape, drawn);
    let dense = network.dense(cx, prior, colors);
    let allocation = AllocationKind::Dithered.allocation(0.3, 4).unwrap();
    let stream = Stream::new(0, 0, "");
    let made = network.gaussians(cx, (&dense, prior), colors, None, &*allocation, stream);
    let g = made.gaussians;
    let parts = [dense.log_depth, dense.log_spread, dense.logits, g.means, g.scales, g.quats, g.opacities, g.colors];
    parts.into_iter().map(|x| x.square().mean() + x.sin_mean()).reduce(|a, b| a + b).unwrap()
}

trait SinMean<'t> {
    fn sin_mean(self) -> Var<'t, f64>;
}

impl<'t> SinMean<'t> for Var<'t, f64> {
    /// A mean with uneven weights.
    fn sin_mean(self) -> Var<'t, f64> {
        let weights: Vec<f64> = (0..self.shape().len()).map(|i| (i as f64).sin()).collect();
        (self * self.tape().constant(&weights, self.shape())).mean()
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 64))]

    /// Gradients of everything that is predicted by all parameters, along random directions, against differences.
    #[test]
    fn gradients_of_all_parameters(h in 17..34usize, w in 17..34usize, seed in 0..1000u64) {
        let drawn = Drawn::new(seed, [h, w], 3);
        let prior = prior(&drawn);
        let mut params = Params::new();
        // Patches would hold the shape of the surface constant, which differences do not.
        let mut config = micro();
        config.gaussians.parametrization = ParametrizationConfig::Footprint { offset_reach: 2.0, scale: 0.7 };
        let network = PhotoNetwork::new(config, &mut params, seed);
        stirred(&mut params);
        let tape = Tape::new();
        loss(Context::new(&tape, &params), &network, &prior, &drawn).backward();
        let direction = |name: &str, i: usize| Stream::new(seed, 1, name).normal::<f64>(i as u64);
        let mut slope = 0.0;
        for (id, param) in params.iter() {
            let gradient = tape.param_grad(id);
            prop_assert!(gradient.is_some(), "{} has no gradient", param.name());
            slope += gradient.unwrap().iter().enumerate().map(|(i, g)| g * direction(param.name(), i)).sum::<f64>();
        }
        let at = |step: f64| {
            let mut moved = params.clone();
            for id in moved.ids() {
                let name = moved.get(id).name().to_string();
                (0..).zip(moved.value_mut(id)).for_each(|(i, x)| *x += step * direction(&name, i));
            }
            let tape = Tape::new();
            loss(Context::new(&tape, &moved), &network, &prior, &drawn).item()
        };
        let step = 1e-6;
        let found = (at(step) - at(-step)) / (2.0 * step);
        prop_assert!((found - slope).abs() <= 2e-3 * slope.abs().max(0.1), "differences {found}, gradient {slope}");
    }
}

/// Untrained, the network is the photos' colors on the depth of comparison.
///
/// Promise (results): training of the photo network begins with the photos' colors on the depth of comparison.
#[test]
fn it_begins_with_photos_on_compared_depth() {
    let drawn = Drawn::new(7, [30, 45], 3);
    let prior = prior(&drawn);
    let mut params = Params::<f64>::new();
    let network = PhotoNetwork::new(micro(), &mut params, 9);
    let tape = Tape::new();
    let (cx, colors) = (Context::new(&tape, &params), photos(&tape, &drawn));
    let dense = network.dense(cx, &prior, colors);
    let off = |(a, b): (&f64, &f32)| (a - f64::from(*b)).abs();
    assert!(dense.log_depth.to_vec().iter().zip(&prior.log_depth).map(off).all(|off| off < 1e-6));
    let each = AllocationKind::Fixed(1).allocation::<f64>(0.0, 4).unwrap();
    let made = network.gaussians(cx, (&dense, &prior), colors, None, &*each, Stream::new(0, 0, ""));
    let sh = made.gaussians.colors.to_vec();
    assert!(made.pixel.len() > 1000);
    for (i, pixel) in made.pixel.iter().enumerate() {
        let (view, at) = (*pixel as usize / drawn.pixels(), *pixel as usize % drawn.pixels());
        for c in 0..3 {
            let photo = f64::from(drawn.planes[(3 * view + c) * drawn.pixels() + at]);
            assert!((sh[3 * i + c] * weaver_geometry::sh::DC + 0.5 - photo).abs() < 1e-9);
        }
    }
}

/// Sides that no patch divides: the padding makes no Gaussians and no depth.
#[test]
fn padding_makes_no_gaussians() {
    for size in [[17, 31], [16, 48], [5, 70]] {
        let drawn = Drawn::new(3, size, 2);
        let prior = prior(&drawn);
        let mut params = Params::<f64>::new();
        let network = PhotoNetwork::new(micro(), &mut params, 9);
        stirred(&mut params);
        let tape = Tape::new();
        let (cx, colors) = (Context::new(&tape, &params), photos(&tape, &drawn));
        let dense = network.dense(cx, &prior, colors);
        assert_eq!(dense.log_depth.shape().dims(), [2, size[0], size[1]]);
        let each = AllocationKind::Fixed(2).allocation::<f64>(0.0, 4).unwrap();
        let made = network.gaussians(cx, (&dense, &prior), colors, None, &*each, Stream::new(0, 0, ""));
        assert_eq!(made.pixel.len(), 2 * made.kept.iter().filter(|kept| **kept).count());
    }
}

/// The network of every size has the same parameters, few enough to come with a program.
#[test]
fn one_network_for_all_sizes() {
    let counts = PhotoConfig::PRESETS[..3].iter().map(|name| {
        let mut params = Params::<f32>::new();
        PhotoNetwork::declare(PhotoConfig::preset(name).unwrap(), &mut params);
        params.iter().map(|(_, param)| (param.name().to_string(), param.shape())).collect::<Vec<_>>()
    });
    let all: Vec<_> = counts.collect();
    assert!(all[0] == all[1] && all[1] == all[2]);
    let numbers: usize = all[0].iter().map(|(_, shape)| shape.len()).sum();
    assert!((1_000_000..3_000_000).contains(&numbers), "{numbers} parameters");
}

#[test]
fn wrong_settings_are_named() {
    for (change, said) in [
        ((|c: &mut PhotoConfig| c.channels[4] = 20) as fn(&mut PhotoConfig), "model.channels"),
        (|c| c.head = 4, "model.head"),
        (|c| c.features = 2, "model.features: expected 3 to"),
        (|c| c.gaussians.temperature = 0.0, "model.gaussians.temperature"),
        (|c| c.width = 0, "model.width"),
    ] {
        let mut config = micro();
        change(&mut config);
        let message = config.check().unwrap_err();
        assert!(message.contains(said), "{message}");
    }
}
