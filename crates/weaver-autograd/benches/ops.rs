//! Forward and backward passes on the tape, at the sizes of a small model.

use criterion::Criterion;
use weaver_autograd::gradcheck::Input;
use weaver_autograd::ops::{self, Activation};
use weaver_autograd::{Shape, Tape, Var};

/// Times a step: leaves of these shapes, `f`, and the gradients of the sum of its result.
fn step<F>(c: &mut Criterion, name: &str, shapes: &[Shape], f: F)
where
    F: for<'t> Fn(&[Var<'t, f32>]) -> Var<'t, f32>,
{
    let single = |x: Input| x.data.iter().map(|x| *x as f32).collect::<Vec<_>>();
    let data: Vec<_> = shapes.iter().enumerate().map(|(i, s)| single(Input::normal(i as u64, *s))).collect();
    let mut tape = Tape::<f32>::new();
    c.bench_function(name, |bench| {
        bench.iter(|| {
            let x: Vec<_> = data.iter().zip(shapes).map(|(x, s)| tape.leaf(x, *s)).collect();
            f(&x).sum().backward();
            tape.reset();
        });
    });
}

fn benches(c: &mut Criterion) {
    let shapes = [[220, 96].into(), [384, 96].into(), [384].into()];
    step(c, "linear_gelu 220 x 96 -> 384", &shapes, |x| ops::linear(x[0], x[1], Some(x[2]), Activation::Gelu));
    let tokens = Shape::from([1, 220, 3, 32]);
    step(c, "attention 220 tokens, 3 heads of 32", &[tokens; 3], |x| ops::attention(x[0], x[1], x[2], 0.18));
    let shapes = [[4, 32, 48, 64].into(), [32, 32, 3, 3].into(), [32].into()];
    step(c, "conv2d 4 images, 32 -> 32 channels, 48 x 64", &shapes, |x| ops::conv2d(x[0], x[1], Some(x[2]), 1, 1));
    let shapes = [[220, 96].into(), [96].into(), [96].into()];
    step(c, "layer_norm 220 x 96", &shapes, |x| x[0].layer_norm(Some((x[1], x[2])), 1e-5));
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    benches(&mut criterion);
    criterion.final_summary();
}
