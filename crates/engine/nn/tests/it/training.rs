//! Optimizer, clipping, averages, and their stored state.

use std::collections::BTreeMap;
use weaver_autograd::{ParamId, Params, Tape};
use weaver_nn::{
    AdamW, Ema, Group, Optimizer, PublishedSchedule, StateError, WarmupCosine, clip_global_norm, missing_gradients,
};

/// Two parameters and the gradient of sum(a^2) + 3 sum(b) on a tape.
fn setup() -> (Params<f64>, [ParamId; 2]) {
    let mut params = Params::new();
    let ids = [params.add("a", [2], vec![1.0, -2.0]), params.add("b", [1], vec![0.5])];
    (params, ids)
}

fn gradients(tape: &Tape<f64>, params: &Params<f64>, [a, b]: [ParamId; 2]) {
    let (a, b) = (tape.param(params, a), tape.param(params, b));
    (a.square().sum() + b.sum() * 3.0).backward();
}

fn optimizer(ids: [ParamId; 2]) -> AdamW<f64> {
    let group = |id, lr_scale, weight_decay| Group { params: vec![id], lr_scale, weight_decay };
    AdamW::new(vec![group(ids[0], 1.0, 0.1), group(ids[1], 0.5, 0.0)], 0.9, 0.95, 1e-8)
}

#[test]
fn adamw_agrees_with_its_formula() {
    let (mut params, ids) = setup();
    let mut optimizer = optimizer(ids);
    let mut tape = Tape::new();
    // Value, first and second moment of a[0] and of b[0].
    let mut twin = [[1.0, 0.0, 0.0], [0.5, 0.0, 0.0]];
    for t in 1..=5 {
        gradients(&tape, &params, ids);
        optimizer.step(&mut params, &mut tape, 0.01);
        tape.reset();
        for ([p, m, v], (scale, decay, slope)) in twin.iter_mut().zip([(1.0, 0.1, 2.0), (0.5, 0.0, 0.0)]) {
            let g = if slope > 0.0 { slope * *p } else { 3.0 };
            *m = 0.9 * *m + 0.1 * g;
            *v = 0.95 * *v + 0.05 * g * g;
            let (rate, mean) = (0.01 * scale, *m / (1.0 - 0.9_f64.powi(t)));
            *p = *p * (1.0 - rate * decay) - rate * mean / ((*v / (1.0 - 0.95_f64.powi(t))).sqrt() + 1e-8);
        }
        assert!((params.get(ids[0]).value()[0] - twin[0][0]).abs() < 1e-12);
        assert!((params.get(ids[1]).value()[0] - twin[1][0]).abs() < 1e-12);
    }
}

#[test]
fn a_resumed_run_takes_the_same_steps() {
    let (mut params, ids) = setup();
    let mut tape = Tape::new();
    let mut step = |params: &mut Params<f64>, optimizer: &mut AdamW<f64>| {
        gradients(&tape, params, ids);
        optimizer.step(params, &mut tape, 0.1);
        tape.reset();
    };
    let mut first = optimizer(ids);
    step(&mut params, &mut first);
    let stored: BTreeMap<_, _> = first.state(&params).map(|(n, s, m)| (n.to_string(), (s, m.clone()))).collect();
    let mut resumed_params = params.clone();
    let mut resumed = optimizer(ids);
    resumed.set_state(&resumed_params, stored.clone()).unwrap();
    step(&mut params, &mut first);
    step(&mut resumed_params, &mut resumed);
    assert!(ids.iter().all(|id| params.get(*id).value() == resumed_params.get(*id).value()));

    let mut wrong = stored.clone();
    wrong.get_mut("a").unwrap().1.first.push(0.0);
    let error = resumed.set_state(&params, wrong).unwrap_err();
    assert_eq!(error, StateError::Size { name: "a".into(), expected: 2, found: 3 });
    let mut unknown = stored;
    let moments = unknown.remove("a").unwrap();
    unknown.insert("c".into(), moments);
    assert_eq!(resumed.set_state(&params, unknown).unwrap_err(), StateError::Unknown { name: "c".into() });
}

#[test]
fn clipping_scales_to_the_norm_and_reports_what_was() {
    let (params, ids) = setup();
    let mut tape = Tape::new();
    gradients(&tape, &params, ids);
    let norm = clip_global_norm(&params, &mut tape, 1.0);
    assert!((norm - 29.0_f64.sqrt()).abs() < 1e-12);
    assert!((clip_global_norm(&params, &mut tape, 2.0) - 1.0).abs() < 1e-6);
    tape.reset();
    let a = tape.param(&params, ids[0]);
    (a * f64::NAN).sum().backward();
    assert!(clip_global_norm(&params, &mut tape, 1.0).is_nan());
}

#[test]
fn missing_gradients_are_named() {
    let (mut params, ids) = setup();
    params.add("unused", [1], vec![0.0]);
    let frozen = params.add("frozen", [1], vec![0.0]);
    params.set_frozen(frozen, true);
    let tape = Tape::new();
    gradients(&tape, &params, ids);
    assert_eq!(missing_gradients(&params, &tape), ["unused"]);
}

#[test]
fn ema_follows_its_formula_and_swaps() {
    let (mut params, [a, b]) = setup();
    let mut ema = Ema::new(&params, 0.2);
    let mut expected = 1.0;
    for k in 0..4 {
        params.value_mut(a)[0] = f64::from(k);
        ema.update(&params);
        let decay = 0.2_f64.min(f64::from(k + 1) / f64::from(k + 10));
        expected = decay * expected + (1.0 - decay) * f64::from(k);
    }
    ema.swap(&mut params);
    assert!((params.get(a).value()[0] - expected).abs() < 1e-15);
    assert_eq!(params.get(b).value(), [0.5]);
    ema.swap(&mut params);
    assert_eq!(params.get(a).value()[0], 3.0);

    let stored: BTreeMap<_, _> = ema.state(&params).map(|(n, a)| (n.to_string(), a.to_vec())).collect();
    let mut resumed = Ema::new(&params, 0.2);
    resumed.set_state(&params, ema.steps(), stored).unwrap();
    ema.update(&params);
    resumed.update(&params);
    assert!(ema.state(&params).eq(resumed.state(&params)));
}

#[test]
fn schedules() {
    let tiny = WarmupCosine { warmup: 4, total: 12, floor: 0.05 };
    assert_eq!((tiny.factor(0), tiny.factor(3), tiny.factor(4)), (0.25, 1.0, 1.0));
    assert!((tiny.factor(8) - 0.525).abs() < 1e-12 && (tiny.factor(12) - 0.05).abs() < 1e-12);
    assert_eq!(WarmupCosine { warmup: 0, total: 0, floor: 0.5 }.factor(0), 1.0);
    let published = PublishedSchedule { warmup: 1000, period: 30000, final_rate: 2e-5 };
    assert!((published.rate(0, 2e-4) - 2e-7).abs() < 1e-18);
    assert_eq!(published.rate(1000, 2e-4), 2e-4);
    // A base rate equal to the final one stays.
    assert!((published.rate(20000, 2e-5) - 2e-5).abs() < 1e-18);
    assert!((published.rate(31000, 2e-4) - 2e-5).abs() < 1e-18);
}
