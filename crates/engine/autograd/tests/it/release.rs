//! Memory given back while nothing is recorded, and parameters in half precision.

use half::{bf16, f16};
use proptest::prelude::*;
use std::sync::Arc;
use weaver_autograd::ops::{self, Activation};
use weaver_autograd::{HalfValues, List, ParamValues, Params, Tape, Var};

#[test]
fn layers_one_behind_the_other_need_the_memory_of_one() {
    let memory_of = |layers: usize| {
        let tape = Tape::<f32>::new();
        let x = tape.constant(&[1.0; 1000], [1000]);
        tape.without_gradient(|| {
            let y = tape.fold(|| x, 0..layers, |y, i| tape.part(i, || y * 0.5 + x));
            assert!((y.to_vec()[0] - 2.0).abs() < 0.1);
            assert_eq!(x.to_vec(), [1.0; 1000], "what was there before is kept");
        });
        tape.pool().allocated_bytes()
    };
    assert_eq!(memory_of(100), memory_of(5), "a longer chain needs no more memory");
}

/// A part's results, in every form that they may have.
fn forms<'t>(tape: &'t Tape<f64>, form: usize, x: Var<'t, f64>) -> Vec<Var<'t, f64>> {
    let more = |n: f64| (x + 1.0) * n;
    match form {
        0 => vec![tape.part("one", || more(2.0))],
        1 => tape.part("array", || [more(2.0), more(3.0)]).to_vec(),
        2 => {
            let (a, (b, c)) = tape.part("tuples", || (more(2.0), (more(3.0), more(4.0).reshape([1, 2]))));
            vec![a, b, c]
        }
        3 => tape.part("list", || List::from_iter((0..20).map(|n| more(f64::from(n))))).to_vec(),
        4 => tape.part("vector", || vec![Some(more(2.0)), None]).into_iter().flatten().collect(),
        5 => {
            let (buffer, y) = tape.part("buffer", || (tape.pool().filled::<u32>(3, 7), more(5.0)));
            assert_eq!(*buffer, [7; 3]);
            vec![y]
        }
        6 => {
            tape.for_each(0..3, |n| _ = more(f64::from(n)));
            let steps = tape.steps(|| more(2.0)).then(|y| (y, y + 1.0)).then(|(y, z)| (x, y * z, z));
            let (x, product, z) = steps.end();
            vec![x, product, z]
        }
        _ => vec![tape.part_at("elsewhere", || tape.steps(|| x).end()), tape.fold(|| x * 2.0, 0..3, |x, _| x + 1.0)],
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 5))]

    /// Nested parts of every form give the same numbers with and without recording; without it they leave their outputs
    /// in memory and nothing else.
    #[test]
    fn outputs_stay_and_nothing_else(order in prop::collection::vec(0..8usize, 1..6)) {
        let run = |tape: &Tape<f64>| {
            let x = tape.leaf(&[3.0, -1.0], [2]);
            let outputs = tape.part("model", || {
                let mut outputs: Vec<Var<'_, f64>> = Vec::new();
                for form in &order {
                    let input = outputs.last().map_or(x, |last| last.reshape([2]));
                    outputs.extend(forms(tape, *form, input));
                }
                outputs
            });
            let distinct = outputs.iter().filter(|y| !std::ptr::eq(&*y.value(), &*x.value())).count();
            (outputs.iter().map(Var::to_vec).collect::<Vec<_>>(), distinct)
        };
        let (recorded, quiet) = (Tape::new(), Tape::new());
        let ((expected, _), (found, distinct)) = (run(&recorded), quiet.without_gradient(|| run(&quiet)));
        prop_assert_eq!(expected, found);
        // Forms may hand on their input itself, once or more.
        let held = quiet.memory().iter().map(|m| m.bytes).sum::<usize>();
        let one = Tape::<f64>::new();
        one.leaf(&[0.0; 2], [2]);
        let each = one.pool().used_bytes();
        prop_assert!(held <= (1 + distinct) * each, "{} bytes for {} values of {}", held, 1 + distinct, each);
        prop_assert_eq!(held, quiet.pool().used_bytes());
    }
}

/// Steps of one part hold the values that they hand on, and not their first input.
#[test]
fn a_longer_chain_of_steps_needs_no_more_memory() {
    let memory_of = |more: bool| {
        let tape = Tape::<f32>::new();
        let x = tape.constant(&[1.0; 1000], [1000]);
        let y = tape.without_gradient(|| {
            let steps = tape.steps(|| x * 0.5).then(|y| y + x).then(|y| y * 0.5);
            if more { steps.then(|y| y + x).then(|y| y * 0.5).then(|y| y + x).end() } else { steps.end() }
        });
        assert_eq!(y.to_vec()[0], if more { 1.875 } else { 0.75 });
        (tape.pool().peak_bytes(), tape.pool().used_bytes())
    };
    assert_eq!(memory_of(true), memory_of(false));
}

#[test]
fn while_recording_everything_stays() {
    let tape = Tape::<f64>::new();
    let x = tape.leaf(&[3.0], [1]);
    let y = tape.fold(|| x, 0..2, |y, _| tape.steps(|| y * x).then(|y| y + 0.0).end());
    y.backward();
    assert_eq!(x.grad().unwrap(), [27.0]);
}

#[test]
#[should_panic(expected = "in a part of the model that did not return it")]
fn reading_what_was_given_back_is_loud() {
    let tape = Tape::<f32>::new();
    let x = tape.constant(&[1.0], [1]);
    tape.without_gradient(|| {
        let mut y = x;
        tape.part("forgetful", || y = x + 1.0);
        y.to_vec()
    });
}

#[test]
fn a_parameter_of_a_finished_part_can_be_used_again() {
    let mut params = Params::<f32>::new();
    let id = params.add("w", [1], vec![3.0]);
    let tape = Tape::new();
    let x = tape.constant(&[2.0], [1]);
    let y = tape.without_gradient(|| tape.fold(|| x, 0..3, |x, _| tape.part("layer", || x * tape.param(&params, id))));
    assert_eq!(y.item(), 54.0);
}

/// Parameters in half precision give the results of the same numbers in full precision, forward and backward.
#[test]
fn half_precision() {
    let numbers = || (0..6).map(|i| 0.3 * i as f32 - 0.7);
    let (brief, half): (Vec<bf16>, Vec<f16>) =
        (numbers().map(bf16::from_f32).collect(), numbers().map(f16::from_f32).collect());
    let wide = |values: &HalfValues| {
        let mut wide = vec![0.0; 6];
        values.view().widen(&mut wide);
        wide
    };
    for (values, tolerance) in [
        (HalfValues::Bf16(Arc::new(brief.clone())), 0.0),
        (HalfValues::F16(Arc::new(half)), 0.0),
        // x is rounded to 8 bits where the processor multiplies pairs.
        (HalfValues::Bf16Pairs(Arc::new(brief)), 2e-2),
    ] {
        let wide = wide(&values);
        let mut params = Params::<f32>::new();
        let half = params.declare("half", [2, 3]);
        params.set(half, ParamValues::Half(values));
        let full = params.add("full", [2, 3], wide.clone());
        let run = |id| {
            let tape = Tape::new();
            let x = tape.leaf(&[1.01, -2.03, 0.507], [1, 3]);
            let y = ops::linear(x, tape.param(&params, id), None, Activation::Gelu);
            y.backward_with(&[1.0, 2.0]);
            (y.to_vec(), x.grad().unwrap(), tape.param_grad(id).is_some())
        };
        let ((y, dx, trained), (full_y, full_dx, full_trained)) = (run(half), run(full));
        for (a, b) in y.iter().chain(&dx).zip(full_y.iter().chain(&full_dx)) {
            assert!((a - b).abs() <= tolerance, "{a} {b}");
        }
        assert!(!trained && full_trained, "what is in half precision is constant");
        assert_eq!(params.count(), 12);
        assert_eq!(params.value_mut(half), wide);
    }
}

#[test]
#[should_panic(expected = "cannot read input 0, [2] in half precision")]
fn an_op_that_cannot_read_half_precision_says_so() {
    let mut params = Params::<f32>::new();
    let id = params.declare("b", [2]);
    params.set(id, ParamValues::Half(HalfValues::Bf16(Arc::new(vec![bf16::ONE; 2]))));
    let tape = Tape::new();
    let _ = tape.param(&params, id) + tape.constant(&[0.0; 2], [2]);
}

#[test]
#[should_panic(expected = "parameter b has no values yet")]
fn a_declared_parameter_cannot_be_used() {
    let mut params = Params::<f32>::new();
    let id = params.declare("b", [2]);
    Tape::new().param(&params, id);
}

#[test]
fn a_watcher_hears_what_is_done() {
    let heard = Arc::new(std::sync::Mutex::new(Vec::new()));
    let tape = Tape::<f32>::new();
    let sink = heard.clone();
    tape.watch(move |path| sink.lock().unwrap().push(path.to_string()));
    tape.part("model", || (0..2).for_each(|i| tape.part(format_args!("block.{i}"), || ())));
    assert_eq!(*heard.lock().unwrap(), ["model.block.0", "model.block.1", "model"]);
}
