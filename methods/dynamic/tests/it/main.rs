//! Models of motion: gradients, slow references, abilities and limits of each.

mod halves;
mod products;
mod recovery;
mod routed;
mod router;
#[cfg(feature = "command")]
mod runs;
mod wall;

use proptest::prelude::*;
use weaver_autograd::gradcheck::{Input, Options, gradcheck_with};
use weaver_autograd::{Params, Real, Tape};
use weaver_dynamic::{
    Code, CodeConfig, Drift, Expert, Field, FieldConfig, Keys, KeysConfig, Motion, Moved, Poly, Start, plane_sample,
};
use weaver_nn::{AdamW, Builder, Context, Group};

const BOUNDS: [[f64; 3]; 2] = [[-1.0; 3], [1.0; 3]];
const KEYS: KeysConfig = KeysConfig { frames: 12, interval: 4, pad: 1.0, margin: 3.0 };

fn field() -> FieldConfig {
    FieldConfig { bounds: BOUNDS, resolution: [4, 5, 3, 6], levels: 2, channels: 2, width: 4 }
}

fn code() -> CodeConfig {
    CodeConfig { code: 3, table: [6, 4], moments: [3, 5], width: 4, neighbors: 2 }
}

/// Centers `[N, 3]` in the box.
fn positions(n: usize) -> Vec<f64> {
    Input::uniform(n as u64, -0.9, 0.9, [n, 3]).data
}

/// All models of n Gaussians, with names.
fn models<T: Real>(params: &mut Params<T>, n: usize) -> Vec<(&'static str, Box<dyn Motion<T>>)> {
    let (positions, sizes) = (positions(n), vec![0.1; n]);
    let start = Start { positions: &positions, sizes: &sizes, opacity: 0.3 };
    let centers: Vec<f64> = (0..n).map(|i| i as f64 / n as f64).collect();
    let mut root = Builder::new(params, 1);
    vec![
        ("field", Box::new(Field::new(root.scope("field"), &start, field()))),
        ("code", Box::new(Code::new(root.scope("code"), &start, code()))),
        ("keys", Box::new(Keys::new(root.scope("keys"), &start, KEYS))),
        ("drift", Box::new(Drift::new(root.scope("drift"), &start))),
        ("poly", Box::new(Poly::new(root.scope("poly"), &start, &centers))),
    ]
}

fn stir<T: Real>(params: &mut Params<T>, seed: u64) {
    for id in params.ids().collect::<Vec<_>>() {
        let name_long = params.get(id).name().len() as u64;
        let values = params.value_mut(id);
        let noise = Input::uniform(seed ^ name_long, -0.2, 0.2, [values.len()]).data;
        values.iter_mut().zip(noise).for_each(|(x, noise)| *x += T::from_f64(noise));
    }
}

/// The bilinear sample, by its formula.
fn sample_twin(plane: &Input, u: f64, v: f64) -> Vec<f64> {
    let [channels, rows, columns] = [0, 1, 2].map(|axis| plane.shape[axis]);
    let along = |x: f64, n: usize| (x.clamp(-1.0, 1.0) + 1.0) / 2.0 * (n - 1) as f64;
    let (x, y) = (along(u, columns), along(v, rows));
    (0..channels)
        .map(|c| {
            let mut sum = 0.0;
            for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
                // Each cell's tent.
                let weight = (1.0 - (x - column as f64).abs()).max(0.0) * (1.0 - (y - row as f64).abs()).max(0.0);
                sum += weight * plane.data[(c * rows + row) * columns + column];
            }
            sum
        })
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 16))]

    #[test]
    fn samples_equal_their_twin_and_have_its_gradient(
        channels in 1..4usize, rows in 2..6usize, columns in 2..6usize, n in 1..6usize, seed in any::<u64>(),
    ) {
        let inputs = [Input::normal(seed, [channels, rows, columns]), Input::uniform(!seed, -1.3, 1.3, [n, 2])];
        let tape = Tape::<f64>::new();
        let [plane, places] = [0, 1].map(|i| tape.constant(&inputs[i].data, inputs[i].shape));
        let found = plane_sample(plane, places).to_vec();
        for (found, at) in found.chunks(channels).zip(inputs[1].data.chunks(2)) {
            for (a, b) in found.iter().zip(sample_twin(&inputs[0], at[0], at[1])) {
                prop_assert!((a - b).abs() < 1e-12);
            }
        }
        // Differences across the middle of a cell or a border are no derivatives.
        let near = |x: f64, n: usize| {
            let at = (x + 1.0) / 2.0 * (n - 1) as f64;
            (at - at.round()).abs() < 1e-3
        };
        prop_assume!(inputs[1].data.chunks(2).all(|at| !near(at[0], columns) && !near(at[1], rows)));
        gradcheck_with(Options { tolerance: 1e-6, ..Options::default() }, &inputs, |x| vec![plane_sample(x[0], x[1])]);
    }
}

/// Gradients of every parameter of every model, by differences.
///
/// Promise (results): models of motion: every gradient, nothing moves at first, keys are met without corners,
/// neighbors that move against each other need codes.
#[test]
fn gradients_of_all_parameters() {
    let mut params = Params::<f64>::new();
    let models = models(&mut params, 4);
    stir(&mut params, 3);
    for (name, model) in &models {
        let ids: Vec<_> = params.iter().filter(|(_, p)| p.name().starts_with(name)).map(|(id, _)| id).collect();
        let value = |params: &Params<f64>| {
            let tape = Tape::new();
            let cx = Context::new(&tape, params);
            let Moved { means, quats, scales, opacities } = model.at(cx, 0.37);
            let weighted = |x: weaver_autograd::Var<'_, f64>, phase: f64| {
                let weights: Vec<f64> = (0..x.shape().len()).map(|i| (i as f64 + phase).sin()).collect();
                (x * tape.constant(&weights, x.shape())).sum().item()
            };
            let parts = [(means, 0.1), (quats, 0.2), (scales, 0.3), (opacities, 0.4)];
            let sum: f64 = parts.map(|(x, phase)| weighted(x, phase)).iter().sum();
            sum + model.regularizer(cx).map_or(0.0, |r| 100.0 * r.item())
        };
        let tape = Tape::new();
        let cx = Context::new(&tape, &params);
        let Moved { means, quats, scales, opacities } = model.at(cx, 0.37);
        let mut loss = tape.scalar(0.0);
        for (x, phase) in [(means, 0.1), (quats, 0.2), (scales, 0.3), (opacities, 0.4)] {
            let weights: Vec<f64> = (0..x.shape().len()).map(|i| (i as f64 + phase).sin()).collect();
            loss = loss + (x * tape.constant(&weights, x.shape())).sum();
        }
        if let Some(regularizer) = model.regularizer(cx) {
            loss = loss + regularizer * 100.0;
        }
        loss.backward();
        for id in ids {
            let label = params.get(id).name().to_string();
            // These gradients are zero by definition: times through paths, distances of neighbors.
            if label == "poly.center" || label == "code.mean" {
                continue;
            }
            let gradient = tape.param_grad(id).unwrap_or_else(|| panic!("{label} has no gradient")).to_vec();
            for i in (0..gradient.len()).step_by(gradient.len() / 5 + 1) {
                let shifted = |by: f64| {
                    let mut other = params.clone();
                    other.value_mut(id)[i] += by;
                    value(&other)
                };
                let difference = (shifted(1e-5) - shifted(-1e-5)) / 2e-5;
                let scale = 1.0 + difference.abs();
                assert!((difference - gradient[i]).abs() < 2e-6 * scale, "{label}[{i}]: {difference} {}", gradient[i]);
            }
        }
    }
}

/// Promise of `gradients_of_all_parameters`.
#[test]
fn nothing_moves_at_first() {
    let mut params = Params::<f64>::new();
    let n = 5;
    let models = models(&mut params, n);
    for (name, model) in &models {
        for time in [0.0, 0.3, 0.99] {
            let tape = Tape::new();
            let moved = model.at(Context::new(&tape, &params), time);
            let close = |found: Vec<f64>, expected: &mut dyn Iterator<Item = f64>| {
                found.into_iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12)
            };
            assert!(close(moved.means.to_vec(), &mut positions(n).into_iter()), "{name}");
            assert!(close(moved.scales.to_vec(), &mut std::iter::repeat(0.1)), "{name}");
            assert!(close(moved.quats.to_vec(), &mut [1.0, 0.0, 0.0, 0.0].into_iter().cycle()), "{name}");
            if *name != "poly" {
                assert!(close(moved.opacities.to_vec(), &mut std::iter::repeat(0.3)), "{name}");
            }
        }
    }
}

/// At a key the path has the key's value, and no corner.
///
/// Promise of `gradients_of_all_parameters`.
#[test]
fn paths_meet_keys_without_corners() {
    let mut params = Params::<f64>::new();
    let start_positions = positions(3);
    let start = Start { positions: &start_positions, sizes: &[0.1; 3], opacity: 0.3 };
    let keys = Keys::new(Builder::new(&mut params, 1).scope("keys"), &start, KEYS);
    stir(&mut params, 5);
    let stored = params.iter().find(|(_, p)| p.name() == "keys.position").unwrap().1.value().to_vec();
    let at = |frame: f64| {
        let tape = Tape::new();
        keys.at_frame(Context::new(&tape, &params), frame).means.to_vec()
    };
    // Frame 7 with a pad of 1 is key 2, which is stored at index 3.
    let count = stored.len() / 9;
    let here = at(7.0);
    for (i, row) in here.chunks(3).enumerate() {
        assert!(row.iter().zip(&stored[(i * count + 3) * 3..]).all(|(a, b)| (a - b).abs() < 1e-12));
    }
    let h = 1e-4;
    let (before, after) = (at(7.0 - h), at(7.0 + h));
    for ((a, b), c) in before.iter().zip(&here).zip(&after) {
        assert!(((b - a) - (c - b)).abs() < 1e-6, "the slope jumps");
    }
}

/// Quaternions go the shorter way around and meet at keys, with either sign in storage.
#[test]
fn rotations_take_the_shorter_way() {
    let mut params = Params::<f64>::new();
    let start = Start { positions: &[0.0; 3], sizes: &[0.1], opacity: 0.3 };
    let keys = Keys::new(Builder::new(&mut params, 1).scope("keys"), &start, KEYS);
    let id = params.iter().find(|(_, p)| p.name() == "keys.quat").unwrap().0;
    let turn = |angle: f64| [(angle / 2.0).cos(), 0.0, 0.0, (angle / 2.0).sin()];
    for (key, row) in params.value_mut(id).chunks_mut(4).enumerate() {
        let sign = if key % 2 == 0 { 1.0 } else { -1.0 };
        row.copy_from_slice(&turn(0.8 * key as f64).map(|x| sign * x));
    }
    let tape = Tape::new();
    // Frame 5: key 1 and a half, stored between 2 and 3.
    let found = keys.at_frame(Context::new(&tape, &params), 5.0).quats.to_vec();
    let expected = turn(0.8 * 2.5);
    let dot: f64 = found.iter().zip(expected).map(|(a, b)| a * b).sum();
    assert!((dot.abs() - 1.0).abs() < 1e-9, "{found:?} {expected:?}");
}

/// A window is full inside and falls off on both sides.
#[test]
fn a_window_falls_off_on_both_sides() {
    let mut params = Params::<f64>::new();
    let start = Start { positions: &[0.0; 3], sizes: &[0.1], opacity: 0.5 };
    let keys = Keys::new(Builder::new(&mut params, 1).scope("keys"), &start, KEYS);
    let id = |name: &str| params.iter().find(|(_, p)| p.name() == name).unwrap().0;
    let (center, width) = (id("keys.center"), id("keys.width"));
    params.value_mut(center).copy_from_slice(&[1.0, 1.5]);
    params.value_mut(width).copy_from_slice(&[-1.0, 0.5]);
    let at = |frame: f64| {
        let tape = Tape::new();
        keys.at_frame(Context::new(&tape, &params), frame).opacities.item()
    };
    // x = (frame + 1) / 4.
    assert!((at(3.0) - 0.5).abs() < 1e-12 && (at(4.5) - 0.5).abs() < 1e-12);
    let flank = |v: f64| v.exp() + 3.0 / (4.0 * 2.36);
    let expected = |d: f64, v: f64| 0.5 * (-(d / flank(v)).powi(2)).exp();
    assert!((at(0.0) - expected(0.75, -1.0)).abs() < 1e-12);
    assert!((at(11.0) - expected(1.5, 0.5)).abs() < 1e-12);
}

/// Error of a model of two Gaussians in one place that move against each other: root of the mean squared error.
fn against<M: Motion<f32>>(build: impl FnOnce(Builder<'_, f32>, &Start<'_>) -> M) -> f64 {
    let positions = [0.1, 0.2, 0.0, 0.1, 0.2001, 0.0];
    let start = Start { positions: &positions, sizes: &[0.1; 2], opacity: 0.5 };
    let mut params = Params::<f32>::new();
    let model = build(Builder::new(&mut params, 0).scope("m"), &start);
    let group = Group { params: params.ids().collect(), lr_scale: 1.0, weight_decay: 0.0 };
    let mut optimizer = AdamW::new(vec![group], 0.9, 0.99, 1e-12);
    // Raw positions are frozen: the test is about motion.
    let mean = params.iter().find(|(_, p)| p.name() == "m.mean").unwrap().0;
    params.set_frozen(mean, true);
    let (mut tape, mut last) = (Tape::new(), 0.0);
    for step in 0..600 {
        let t = (step * 5 % 12) as f64 / 12.0;
        {
            let means = model.at(Context::new(&tape, &params), t).means;
            let shift = 0.3 * (5.0 * t).sin();
            let wanted = [0.1, 0.2 + shift, 0.0, 0.1, 0.2 - shift, 0.0].map(|x| x as f32);
            let loss = (means - tape.constant(&wanted, [2, 3])).square().mean();
            last = if step < 588 { 0.0 } else { last + f64::from(loss.item()) / 12.0 };
            loss.backward();
        }
        optimizer.step(&mut params, &mut tape, 0.01);
        tape.reset();
    }
    last.sqrt()
}

/// A field of positions cannot distinguish neighbors, codes can.
///
/// Promise of `gradients_of_all_parameters`.
#[test]
fn neighbors_that_move_against_each_other_need_codes() {
    let config = FieldConfig { resolution: [8, 8, 4, 8], channels: 4, width: 16, ..field() };
    let by_field = against(|b, start| Field::new(b, start, config));
    let config = CodeConfig { code: 8, table: [12, 8], moments: [4, 12], width: 16, neighbors: 1 };
    let by_code = against(|b, start| Code::new(b, start, config));
    assert!(by_field > 0.08 && by_code < 0.03, "{by_field} {by_code}");
}

#[test]
fn bits_do_not_depend_on_threads() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut params = Params::<f32>::new();
            let models = models(&mut params, 700);
            stir(&mut params, 3);
            let tape = Tape::new();
            let cx = Context::new(&tape, &params);
            let mut loss = tape.scalar(0.0);
            for (_, model) in &models {
                let moved = model.at(cx, 0.4);
                loss = loss + moved.means.square().sum() + moved.quats.square().sum() + moved.opacities.sum();
            }
            loss.backward();
            let all: Vec<_> = params.ids().map(|id| tape.param_grad(id).as_deref().map(<[f32]>::to_vec)).collect();
            (loss.item(), all)
        })
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn an_expert_has_colors_of_its_own() {
    let mut params = Params::<f32>::new();
    let mut root = Builder::new(&mut params, 0);
    let start = Start { positions: &[0.0; 6], sizes: &[0.1; 2], opacity: 0.3 };
    let motion = Drift::new(root.scope("a"), &start);
    let expert = Expert::new(root.scope("a"), motion, &[1.0, 0.5, 0.0, 0.0, 0.5, 1.0]);
    let tape = Tape::new();
    let shown = expert.at(Context::new(&tape, &params), 0.5);
    assert_eq!(shown.colors.to_vec(), [1.0, 0.5, 0.0, 0.0, 0.5, 1.0]);
    assert!(expert.motion().regularizer(Context::new(&tape, &params)).is_some());
}

#[test]
#[should_panic(expected = "more Gaussians than 2 neighbors")]
fn too_few_gaussians_for_their_neighbors_are_refused() {
    let mut params = Params::<f32>::new();
    let start = Start { positions: &[0.0; 6], sizes: &[0.1; 2], opacity: 0.3 };
    Code::new(Builder::new(&mut params, 0), &start, code());
}

#[test]
#[should_panic(expected = "at least 3 cells")]
fn a_field_too_coarse_is_refused() {
    let mut params = Params::<f32>::new();
    let start = Start { positions: &[0.0; 3], sizes: &[0.1], opacity: 0.3 };
    Field::new(Builder::new(&mut params, 0), &start, FieldConfig { resolution: [2, 4, 4, 4], ..field() });
}
