//! Memory given back while nothing is recorded, and parameters in half precision.

use half::{bf16, f16};
use std::sync::Arc;
use weaver_autograd::ops::{self, Activation};
use weaver_autograd::{HalfValues, ParamValues, Params, Tape};

#[test]
fn what_is_not_kept_is_used_again() {
    let memory_of = |steps: usize| {
        let tape = Tape::<f32>::new();
        let x = tape.constant(&[1.0; 1000], [1000]);
        tape.without_gradient(|| {
            let mark = tape.mark();
            let mut y = x;
            for _ in 0..steps {
                y = y * 0.5 + x;
                tape.keep_only(mark, &[y]);
            }
            assert!((y.to_vec()[0] - 2.0).abs() < 0.1);
        });
        tape.pool().allocated_bytes()
    };
    assert_eq!(memory_of(100), memory_of(5), "a longer chain needs no more memory");
}

#[test]
fn while_recording_everything_stays() {
    let tape = Tape::<f64>::new();
    let x = tape.leaf(&[3.0], [1]);
    let mark = tape.mark();
    let y = tape.result_of(|| (x * x) * x);
    tape.keep_only(mark, &[y]);
    y.backward();
    assert_eq!(x.grad().unwrap(), [27.0]);
}

#[test]
#[should_panic(expected = "it must be kept")]
fn reading_what_was_given_back_is_loud() {
    let tape = Tape::<f32>::new();
    let x = tape.constant(&[1.0], [1]);
    tape.without_gradient(|| {
        let mark = tape.mark();
        let y = x + 1.0;
        tape.keep_only(mark, &[]);
        y.to_vec()
    });
}

/// Parameters in half precision give what the same numbers give in full precision, forward and backward.
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
    {
        let _model = tape.scope("model");
        (0..2).for_each(|i| drop(tape.scope(format_args!("block.{i}"))));
    }
    assert_eq!(*heard.lock().unwrap(), ["model.block.0", "model.block.1", "model"]);
}
