//! Rectified Adam: against PyTorch's numbers, parameters without gradients and stored states.

use std::collections::BTreeMap;
use weaver_autograd::{ParamId, Params, Tape};
use weaver_nn::{Optimizer, RAdam};

/// Three numbers, and one with a rate of its own.
fn setup() -> (Params<f64>, [ParamId; 2]) {
    let mut params = Params::new();
    let ids = [params.add("a", [3], vec![1.0, -2.0, 0.5]), params.add("b", [1], vec![0.7])];
    (params, ids)
}

/// The gradient of sum_i c_i (a_i - 1/4)^2 / 2 + b^2, c = 1, 3, 0.1.
fn quadratic(tape: &Tape<f64>, params: &Params<f64>, [a, b]: [ParamId; 2]) {
    let (a, b) = (tape.param(params, a), tape.param(params, b));
    let weights = tape.constant(&[0.5, 1.5, 0.05], [3]);
    (((a + -0.25).square() * weights).sum() + b.square().sum()).backward();
}

fn step(optimizer: &mut RAdam<f64>, params: &mut Params<f64>, ids: [ParamId; 2]) {
    let mut tape = Tape::new();
    quadratic(&tape, params, ids);
    optimizer.step(params, &mut tape, |id| if id == ids[0] { 0.1 } else { 0.02 });
}

/// `torch.optim.RAdam` 2.15, f64: after steps 1 and 5, the last that goes along the mean, and 6 and 12, which are
/// rectified.
#[test]
fn steps_are_those_of_pytorch() {
    let published = [
        (1, [0.925, -1.325, 0.4975, 0.672]),
        (5, [0.6642731463264235, 0.3925338560137991, 0.4876354266233105, 0.565999084089329]),
        (6, [0.6618299305784061, 0.39413286174637163, 0.48506163085318565, 0.565490607455258]),
        (12, [0.6365838507586852, 0.4028743839774062, 0.45778285367475596, 0.5601008562539012]),
    ];
    // A large eps shows where it is added.
    let other = [
        (1, [0.925, -1.325, 0.4975, 0.672]),
        (5, [0.6675185368697198, 0.3216773431631632, 0.48764725328398006, 0.5665136124040342]),
        (6, [0.6511851037711388, 0.33160145531094865, 0.47755506881474885, 0.5630039975108004]),
        (12, [0.48907756894278065, 0.37121715379045217, 0.36918939892084, 0.5257134720867854]),
    ];
    for (betas, eps, expected) in [([0.9, 0.999], 1e-8, published), ([0.8, 0.95], 1e-2, other)] {
        let (mut params, ids) = setup();
        let mut optimizer = RAdam::new(ids.to_vec(), betas[0], betas[1], eps);
        let mut expected = expected.into_iter();
        let mut next = expected.next();
        for t in 1..=12 {
            step(&mut optimizer, &mut params, ids);
            let Some((at, values)) = next else { break };
            if at == t {
                let found = ids.iter().flat_map(|id| params.get(*id).value());
                for (found, value) in found.zip(values) {
                    assert!((found - value).abs() < 1e-13, "step {t}: expected {value}, found {found}");
                }
                next = expected.next();
            }
        }
        assert!(next.is_none(), "all steps were compared");
    }
}

#[test]
fn what_has_no_gradient_stays_and_counts_no_step() {
    let (mut params, [a, b]) = setup();
    let mut optimizer = RAdam::new(vec![a, b], 0.9, 0.999, 1e-8);
    for _ in 0..3 {
        let mut tape = Tape::new();
        tape.param(&params, a).sum().backward();
        optimizer.step(&mut params, &mut tape, |_| 0.1);
    }
    assert_eq!(params.get(b).value(), [0.7]);
    let steps: Vec<_> = optimizer.state(&params).map(|(name, steps, _)| (name.to_string(), steps)).collect();
    assert_eq!(steps, [("a".to_string(), 3)]);
}

#[test]
fn a_resumed_run_takes_the_same_steps() {
    let (mut params, ids) = setup();
    let mut first = RAdam::new(ids.to_vec(), 0.9, 0.999, 1e-8);
    (0..7).for_each(|_| step(&mut first, &mut params, ids));
    let stored: BTreeMap<_, _> = first.state(&params).map(|(n, s, m)| (n.to_string(), (s, m.clone()))).collect();
    let mut resumed_params = params.clone();
    let mut resumed = RAdam::new(ids.to_vec(), 0.9, 0.999, 1e-8);
    resumed.set_state(&resumed_params, stored).unwrap();
    step(&mut first, &mut params, ids);
    step(&mut resumed, &mut resumed_params, ids);
    assert!(ids.iter().all(|id| params.get(*id).value() == resumed_params.get(*id).value()));
}
