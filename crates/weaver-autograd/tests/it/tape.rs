//! The engine's own promises.

use weaver_autograd::gradcheck::{Input, gradcheck};
use weaver_autograd::{Grad, Op, Params, Pool, Shape, ShapeError, Shapes, Tape, View, ViewMut, pointwise};

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
    fn backward(
        &self,
        _: &[View<'_, f64>],
        _: &[View<'_, f64>],
        douts: &[View<'_, f64>],
        dins: &mut [Option<Grad<'_, f64>>],
        _: &Pool,
    ) {
        if let (Some(dx), false) = (&mut dins[0], self.broken) {
            dx.add(&douts[0]);
        }
    }
}

#[test]
#[should_panic(expected = "model.block: `identity` did not write the gradient of input 0")]
fn a_forgotten_gradient_is_loud() {
    let tape = Tape::new();
    let _model = tape.scope("model");
    let _block = tape.scope("block");
    let [y, _] = tape.apply(Identity { broken: true }, &[tape.leaf(&[1.0], [1])]);
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
    let _scope = tape.scope("encoder.block");
    let x = tape.constant(&[1.0; 6], [2, 3]);
    let error = tape.try_apply(Identity { broken: false }, &[x]).unwrap_err();
    assert_eq!(error.to_string(), "encoder.block: identity: expected x [N], found [2, 3]");
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
