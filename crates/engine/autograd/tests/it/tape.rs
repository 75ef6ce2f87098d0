//! The engine's own promises.

use weaver_autograd::gradcheck::{Input, gradcheck};
use weaver_autograd::{
    Backward, Op, Params, Phase, Pool, Shape, ShapeError, Shapes, Tape, Var, View, ViewMut, ops, pointwise,
};

pointwise!(Silu, 1, |x| x / (1 + (-x).exp()));
pointwise!(Blend { weight: f64 }, 2, |a, b| a * weight + b * (1.0 - weight) + a * b);

#[test]
fn pointwise_derivatives() {
    gradcheck(&[Input::normal(1, [3, 4])], |x| vec![x[0].map(Silu)]);
    gradcheck(&[Input::normal(1, [5]), Input::normal(2, [5])], |x| {
        vec![weaver_autograd::apply_pointwise(Blend { weight: 0.3 }, [x[0], x[1]])]
    });
    gradcheck(&[Input::normal(1, [5]), Input::normal(2, [1])], |x| vec![x[0] * x[1], x[0] / (x[1] * x[1] + 1.0)]);
    gradcheck(&[Input::normal(1, [0, 3])], |x| vec![x[0].map(Silu)]);
}

/// y = x, whose backward forgets to write when `broken`.
#[derive(Debug)]
struct Identity {
    broken: bool,
}

impl Op<f64> for Identity {
    fn name(&self) -> &'static str {
        "identity"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        weaver_autograd::ensure_shape!(ins[0].rank() == 1, "x [N]");
        Ok(Shapes::one(ins[0]).and(ins[0]))
    }
    fn auxiliary_outputs(&self) -> usize {
        1
    }
    fn forward(&mut self, ins: &[View<'_, f64>], outs: &mut [ViewMut<'_, f64>], _: &Pool) {
        outs[0].copy_from_slice(&ins[0]);
        outs[1].copy_from_slice(&ins[0]);
    }
    fn backward(&self, at: Backward<'_, '_, f64>) {
        let Backward { douts, dins, .. } = at;
        if let (Some(dx), false) = (&mut dins[0], self.broken) {
            dx.add(&douts[0]);
        }
    }
}

#[test]
#[should_panic(expected = "model.block: `identity` did not write the gradient of input 0")]
fn a_forgotten_gradient_is_loud() {
    let tape = Tape::new();
    let identity = || tape.apply::<_, 2>(Identity { broken: true }, &[tape.leaf(&[1.0], [1])]);
    let [y, _] = tape.part("model", || tape.part("block", identity));
    y.backward();
}

#[test]
#[should_panic(expected = "auxiliary output of `identity`")]
fn a_gradient_into_an_auxiliary_output_is_loud() {
    let tape = Tape::new();
    let [_, aux] = tape.apply(Identity { broken: false }, &[tape.leaf(&[1.0], [1])]);
    (aux * aux).sum().backward();
}

#[test]
fn shape_errors_name_op_path_and_shapes() {
    let tape = Tape::<f64>::new();
    let x = tape.constant(&[1.0; 6], [2, 3]);
    tape.part("encoder.block", || {
        let error = tape.try_apply(Identity { broken: false }, &[x]).unwrap_err();
        assert_eq!(error.to_string(), "encoder.block: identity: expected x [N], found [2, 3]");
    });
}

#[test]
fn detach_reshape_and_retained_gradients() {
    let tape = Tape::<f64>::new();
    let x = tape.leaf(&[1.0, 2.0], [2]);
    let y = (x * 3.0).retain_grad();
    let z = (y.reshape([1, 2]) * y.detach().reshape([1, 2])).sum();
    z.backward();
    assert_eq!(y.grad().unwrap(), [3.0, 6.0]);
    assert_eq!(x.grad().unwrap(), [9.0, 18.0]);
    assert!(tape.without_gradient(|| !(x * 2.0).is_tracked()));
}

#[test]
fn a_given_gradient_is_kept_or_added_to_where_asked() {
    let tape = Tape::<f64>::new();
    let x = tape.leaf(&[1.0, 2.0], [2]);
    let y = (x * 3.0).reshape([1, 2]);
    y.backward_with(&[1.0, 10.0]);
    assert!(y.grad().is_none());
    y.backward_with(&[1.0, 1.0]);
    assert_eq!(x.grad().unwrap(), [6.0, 33.0]);
    x.backward_with(&[1.0, 1.0]);
    assert_eq!(x.grad().unwrap(), [7.0, 34.0]);
    let kept = (x * 2.0).retain_grad();
    kept.backward_with(&[0.5, 0.5]);
    assert_eq!((kept.grad().unwrap(), x.grad().unwrap()), (vec![0.5, 0.5], vec![8.0, 35.0]));
}

#[test]
fn what_is_retained_is_not_walked_again() {
    let tape = Tape::<f64>::new();
    let x = tape.leaf(&[1.0], [1]);
    let y = (x * 3.0).retain_grad();
    let z = y.sum();
    z.backward();
    z.backward();
    assert_eq!((y.grad().unwrap(), x.grad().unwrap()), (vec![2.0], vec![6.0]));
    (x * 2.0).sum().backward();
    assert_eq!((y.grad().unwrap(), x.grad().unwrap()), (vec![2.0], vec![8.0]));
    y.backward_with(&[1.0]);
    assert_eq!((y.grad().unwrap(), x.grad().unwrap()), (vec![3.0], vec![11.0]));
}

#[test]
fn parameters_are_shared_and_frozen() {
    let mut params = Params::<f64>::new();
    let w = params.add("w", [2], vec![1.0, 2.0]);
    let b = params.add("b", [2], vec![0.5, 0.5]);
    params.set_frozen(b, true);
    let mut tape = Tape::new();
    let loss = (tape.param(&params, w) * tape.param(&params, w) + tape.param(&params, b)).sum();
    loss.backward();
    assert_eq!(&*tape.param_grad(w).unwrap(), &[2.0, 4.0]);
    assert!(tape.param_grad(b).is_none());
    tape.reset();
    params.value_mut(w)[0] = 5.0;
    assert_eq!(tape.param(&params, w).to_vec(), [5.0, 2.0]);
}

#[test]
fn a_repeated_step_takes_no_new_memory() {
    let mut tape = Tape::<f64>::new();
    let mut step = || {
        let x = tape.leaf(&[0.5; 100], [100]);
        (x.map(Silu) * x).sum().backward();
        tape.reset();
        tape.pool().allocated_bytes()
    };
    let first = step();
    assert_eq!((step(), step()), (first, first));
}

/// Two products with one weight, a non-linearity, and the input used outside as well.
#[test]
fn recomputed_gradients_are_the_same_to_the_bit() {
    let mut params = Params::<f32>::new();
    let single = |seed, n| Input::normal(seed, [n]).data.iter().map(|x| *x as f32).collect::<Vec<_>>();
    let w = params.add("w", [5, 5], single(1, 25));
    let b = params.add("b", [5], single(2, 5));
    let unused = params.add("unused", [1], vec![0.0]);
    params.set_frozen(b, true);
    fn layer<'a>(
        tape: &'a Tape<f32>,
        params: &'a Params<f32>,
        x: Var<'a, f32>,
        [w, b]: [weaver_autograd::ParamId; 2],
    ) -> Var<'a, f32> {
        let (w, b) = (tape.param(params, w), tape.param(params, b));
        let hidden = ops::linear(x, w, Some(b), ops::Activation::Gelu);
        ops::linear(hidden, w, Some(b), ops::Activation::None) * x.tanh() + x
    }
    let run = |recompute: bool| {
        let tape = Tape::<f32>::new();
        let x = tape.leaf(&single(3, 20), [4, 5]);
        let inner = |x| match recompute {
            true => ops::checkpoint(&params, &[x], move |tape, params, x| layer(tape, params, x[0], [w, b])),
            false => layer(&tape, &params, x, [w, b]),
        };
        let y = inner(inner(x * 0.5) + x) * x + tape.param(&params, w).sum();
        y.square().sum().backward();
        assert!(tape.param_grad(b).is_none() && tape.param_grad(unused).is_none());
        let dw = tape.param_grad(w).expect("a gradient").to_vec();
        (y.to_vec(), x.grad().expect("a gradient"), dw)
    };
    assert_eq!(run(true), run(false));
}

#[test]
fn a_function_without_elements_has_gradients_of_zero() {
    let tape = Tape::<f64>::new();
    let (x, w) = (tape.leaf(&[], [0, 3]), tape.leaf(&[1.0; 6], [2, 3]));
    ops::linear(x, w, None, ops::Activation::Gelu).sum().backward();
    assert_eq!(w.grad().unwrap(), [0.0; 6]);
}

#[test]
fn profiling_counts_ops_and_parts() {
    let mut tape = Tape::<f64>::new();
    assert!(tape.op_times().is_empty());
    tape.set_profiling(true);
    let x = tape.leaf(&[1.0, 2.0], [2]);
    tape.timed("part", || (x.map(Silu) * x).sum()).backward();
    tape.reset();
    let names: Vec<_> = tape.op_times().iter().map(|t| (t.name, t.calls)).collect();
    assert_eq!(names, [("Silu", 1), ("MulOp", 1), ("sum", 1), ("part", 1)]);
    assert!(tape.op_times().iter().all(|t| t.name == "part" || t.backward.as_nanos() > 0));
}

#[test]
fn a_trace_has_every_op_in_order() {
    let tape = Tape::<f64>::new();
    tape.set_tracing(true);
    let x = tape.leaf(&[1.0, 2.0], [2]);
    let y = tape.part("head", || tape.timed("part", || x.map(Silu) * x));
    y.sum().backward();
    let trace = tape.trace();
    let events: Vec<_> = trace.iter().map(|e| (e.name, e.path.as_str(), e.phase)).collect();
    let expected = [
        ("Silu", "head", Phase::Forward),
        ("MulOp", "head", Phase::Forward),
        ("part", "head", Phase::Part),
        ("sum", "", Phase::Forward),
        ("sum", "", Phase::Backward),
        ("MulOp", "head", Phase::Backward),
        ("Silu", "head", Phase::Backward),
    ];
    assert_eq!(events, expected);
    let ops = || trace.iter().filter(|e| e.phase != Phase::Part);
    assert!(ops().zip(ops().skip(1)).all(|(a, b)| a.start + a.duration <= b.start), "one op after the other");
    let (silu, part) = (&trace[0], &trace[2]);
    assert!(part.start <= silu.start && silu.start + silu.duration <= part.start + part.duration);
    tape.set_tracing(false);
    assert!(tape.trace().is_empty());
}

/// In the forward and in the backward pass, the ops of a checkpoint show inside it.
#[test]
fn a_trace_shows_what_is_inside_a_checkpoint() {
    let tape = Tape::<f64>::new();
    tape.set_tracing(true);
    let x = tape.leaf(&[1.0, 2.0], [2]);
    let y =
        tape.part("head", || ops::checkpoint(&Params::new(), &[x], |tape, _, x| tape.part("block", || x[0].map(Silu))));
    y.sum().backward();
    let trace = tape.trace();
    let events: Vec<_> = trace.iter().map(|e| (e.name, e.path.as_str(), e.phase)).collect();
    let expected = [
        ("Silu", "head.block", Phase::Forward),
        ("checkpointed", "head", Phase::Part),
        ("checkpoint", "head", Phase::Forward),
        ("sum", "", Phase::Forward),
        ("sum", "", Phase::Backward),
        ("Silu", "head.block", Phase::Recompute),
        ("Silu", "head.block", Phase::Backward),
        ("checkpoint", "head", Phase::Backward),
    ];
    assert_eq!(events, expected);
    let inside = |inner: usize, outer: usize| {
        let (inner, outer) = (&trace[inner], &trace[outer]);
        outer.start <= inner.start && inner.start + inner.duration <= outer.start + outer.duration
    };
    assert!(inside(0, 1) && inside(5, 7) && inside(6, 7) && !inside(0, 7));
}

#[test]
fn memory_is_reported_by_op() {
    let mut tape = Tape::<f32>::new();
    let (x, w) = (tape.leaf(&[0.1; 4096], [64, 64]), tape.leaf(&[0.1; 4096], [64, 64]));
    let y = ops::linear(x, w, None, ops::Activation::Gelu); // saves the sums before the GELU
    let loss = tape.without_gradient(|| y * 2.0).sum() + y.sum();
    let found: Vec<_> = tape.memory().iter().map(|m| (m.name, m.count, m.bytes)).collect();
    let room = |elements: usize| 4 * elements + 64; // a cache line to begin at one
    let small = room(16); // the least that is allocated
    let of = |name: &str| found.iter().find(|m| m.0 == name).copied().unwrap_or_default();
    assert_eq!(of("linear"), ("linear", 1, 2 * room(4096)), "{found:?}");
    // Two leaves, the product that is not recorded, and its sum.
    assert_eq!(of("leaves and constants"), ("leaves and constants", 4, 3 * room(4096) + small), "{found:?}");
    assert_eq!((of("sum"), of("AddOp")), (("sum", 1, small), ("AddOp", 1, small)), "{found:?}");
    assert_eq!(found.iter().map(|m| m.2).sum::<usize>(), tape.pool().used_bytes());
    let before = tape.pool().used_bytes();
    loss.backward();
    assert!(tape.pool().peak_bytes() > before && tape.pool().peak_bytes() <= tape.pool().allocated_bytes());
    tape.reset();
    assert_eq!((tape.pool().used_bytes(), tape.memory().len()), (0, 0));
}
