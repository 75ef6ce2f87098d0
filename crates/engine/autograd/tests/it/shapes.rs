//! Wrong shapes are refused with the op's name, the model path, and every shape found.

use std::panic::{AssertUnwindSafe, catch_unwind};
use weaver_autograd::ops::{self, Activation, RopeTable};
use weaver_autograd::{
    Backward, Op, Pool, Shape, ShapeError, Shapes, Tape, Var, View, ViewMut, apply_pointwise, pointwise,
};

pointwise!(Product, 2, |a, b| a * b);

/// Takes a result that never comes.
fn done<X>(_: X) {}

type Case = (&'static str, &'static [&'static [usize]], fn(&[Var<'_, f64>]));

/// The op's name, shapes that do not fit it, and the call.
const CASES: &[Case] = &[
    ("linear", &[&[2, 3], &[5, 4]], |x| done(ops::linear(x[0], x[1], None, Activation::None))),
    ("linear", &[&[2, 3], &[5, 3], &[4]], |x| done(ops::linear(x[0], x[1], Some(x[2]), Activation::Gelu))),
    ("matmul", &[&[2, 3], &[4, 5]], |x| done(x[0].matmul(x[1]))),
    ("matmul", &[&[2, 3, 4], &[3, 4, 5]], |x| done(x[0].matmul(x[1]))),
    ("matmul", &[&[3], &[3, 5]], |x| done(x[0].matmul(x[1]))),
    ("attention", &[&[1, 4, 2, 8], &[1, 5, 2, 8], &[1, 6, 2, 8]], |x| done(ops::attention(x[0], x[1], x[2], 1.0))),
    ("attention", &[&[1, 4, 2, 8], &[1, 5, 3, 8], &[1, 5, 3, 8]], |x| done(ops::attention(x[0], x[1], x[2], 1.0))),
    ("conv2d", &[&[1, 3, 8, 8], &[4, 2, 3, 3]], |x| done(ops::conv2d(x[0], x[1], None, 1, 1))),
    ("conv2d", &[&[3, 8, 8], &[4, 3, 3, 3]], |x| done(ops::conv2d(x[0], x[1], None, 1, 1))),
    ("conv2d", &[&[1, 3, 8, 8], &[4, 3, 3, 3], &[3]], |x| done(ops::conv2d(x[0], x[1], Some(x[2]), 1, 1))),
    ("conv_transpose2d", &[&[1, 3, 4, 4], &[2, 3, 2, 2]], |x| done(ops::conv_transpose2d(x[0], x[1], None, 2))),
    ("layer_norm", &[&[2, 6], &[5], &[5]], |x| done(x[0].layer_norm(Some((x[1], x[2])), 1e-5))),
    ("rms_norm", &[&[2, 6], &[5]], |x| done(x[0].rms_norm(x[1], 1e-5))),
    ("scale_residual", &[&[2, 6], &[6], &[2, 5]], |x| done(ops::scale_residual(x[0], x[1], x[2]))),
    ("concat", &[&[2, 3], &[2, 4]], |x| done(ops::concat(&[x[0], x[1]], 0))),
    ("slice", &[&[2, 3]], |x| done(x[0].slice(1, 2, 2))),
    ("split", &[&[2, 5]], |x| done(ops::split(x[0], 1, &[2, 2]))),
    ("permute", &[&[2, 3]], |x| done(x[0].permute(&[0, 0]))),
    ("expand", &[&[2, 3]], |x| done(x[0].expand([2, 4]))),
    ("reshape", &[&[2, 3]], |x| done(x[0].reshape([7]))),
    ("item", &[&[2, 3]], |x| done(x[0].item())),
    ("gather_rows", &[&[2, 3]], |x| done(x[0].gather_rows(&[0, 2]))),
    ("scatter_add_rows", &[&[2, 3]], |x| done(x[0].scatter_add_rows(&[0, 1, 0], 2))),
    ("scatter_add_rows", &[&[2, 3]], |x| done(x[0].scatter_add_rows(&[0, 5], 2))),
    ("cross_entropy", &[&[2, 3]], |x| done(ops::cross_entropy(x[0], &[0, 1, 2], 0.0))),
    ("cross_entropy", &[&[2, 3]], |x| done(ops::cross_entropy(x[0], &[0, 3], 0.0))),
    ("softmax", &[&[2, 3]], |x| done(x[0].softmax(2))),
    ("log_softmax", &[&[2, 3]], |x| done(x[0].log_softmax(2))),
    ("sum_axis", &[&[2, 3]], |x| done(x[0].sum_axis(2))),
    ("bilinear", &[&[3, 8, 8]], |x| done(x[0].bilinear(4, 4, false))),
    ("rope2d", &[&[1, 3, 2, 8]], |x| done(x[0].rope2d(&RopeTable::new(&[[0, 0]; 4], 8, 100.0)))),
    ("straight_through", &[&[2, 3], &[3, 2]], |x| done(ops::straight_through(x[0], x[1]))),
    ("Product", &[&[2, 3], &[3, 2]], |x| done(apply_pointwise(Product, [x[0], x[1]]))),
    ("backward", &[&[2, 3]], |x| x[0].backward()),
    ("backward_with", &[&[2, 3]], |x| x[0].backward_with(&[1.0; 5])),
];

#[test]
fn messages_name_op_path_and_shapes() {
    for (op, shapes, call) in CASES {
        let tape = Tape::<f64>::new();
        let vars: Vec<_> = shapes.iter().map(|s| tape.leaf(&vec![0.5; s.iter().product()], *s)).collect();
        let layer = || tape.part_at("encoder.block.3", || tape.part("attn", || call(&vars)));
        let model = || tape.part("decoder", layer);
        let panic = catch_unwind(AssertUnwindSafe(model)).expect_err("shapes that do not fit are refused");
        let message = panic.downcast::<String>().expect("a formatted message");
        let start = format!("encoder.block.3.attn: {op}: expected ");
        assert!(message.starts_with(&start), "{message:?} does not start with {start:?}");
        let (_, found) = message.split_once("found ").expect("what was found");
        let first = if *op == "backward_with" { "[5]".into() } else { format!("{:?}", shapes[0]) };
        assert!(found.starts_with(&first), "{message:?} does not say that it found {first}");
        for shape in &shapes[1..] {
            assert!(found.contains(&format!("{shape:?}")), "{message:?} does not name {shape:?}");
        }
    }
}

#[test]
fn paths_end_with_their_parts() {
    let tape = Tape::<f64>::new();
    let expect_path = |path: &str| {
        let message = tape.try_apply(Never, &[]).expect_err("never fits").to_string();
        assert_eq!(message, format!("{path}never: expected nothing, found "));
    };
    tape.part("a", || {
        tape.part_at("x.y", || tape.part("z", || expect_path("x.y.z: ")));
        tape.part_at("", || tape.part("d", || expect_path("a.d: ")));
    });
    expect_path("");
    let badly = || tape.part("a", || assert_eq!(1, 2, "a part that ends badly"));
    catch_unwind(AssertUnwindSafe(badly)).expect_err("it panics");
    expect_path("");
}

/// An op that fits nothing.
#[derive(Debug)]
struct Never;

impl Op<f64> for Never {
    fn name(&self) -> &'static str {
        "never"
    }
    fn shapes(&self, _: &[Shape]) -> Result<Shapes, ShapeError> {
        Err(ShapeError::expected("nothing"))
    }
    fn forward(&mut self, _: &[View<'_, f64>], _: &mut [ViewMut<'_, f64>], _: &Pool) {}
    fn backward(&self, _at: Backward<'_, '_, f64>) {}
}
