//! Forward and backward passes on the tape, at the sizes of a small model.

use criterion::Criterion;
use std::time::Duration;
use weaver_autograd::gradcheck::Input;
use weaver_autograd::ops::{self, Activation, RopeTable};
use weaver_autograd::{Params, Shape, Tape, Var};

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

fn layers(c: &mut Criterion) {
    let shapes = [[220, 96].into(), [384, 96].into(), [384].into()];
    step(c, "linear_gelu 220 x 96 -> 384", &shapes, |x| ops::linear(x[0], x[1], Some(x[2]), Activation::Gelu));
    step(c, "matmul 220 x 96 x 220", &[[220, 96].into(); 2], |x| x[0].matmul_with(x[1], false, true));
    let tokens = Shape::from([1, 220, 3, 32]);
    step(c, "attention 220 tokens, 3 heads of 32", &[tokens; 3], |x| ops::attention(x[0], x[1], x[2], 0.18));
    let positions: Vec<_> = (0..220).map(|i| [i / 20, i % 20]).collect();
    let table = RopeTable::new(&positions, 32, 100.0);
    step(c, "rope2d 220 tokens, 3 heads of 32", &[tokens], |x| x[0].rope2d(&table));
    let shapes = [[220, 96].into(), [96].into(), [220, 96].into()];
    step(c, "scale_residual 220 x 96", &shapes, |x| ops::scale_residual(x[0], x[1], x[2]));
    let shapes = [[220, 96].into(), [96].into(), [96].into()];
    step(c, "layer_norm 220 x 96", &shapes, |x| x[0].layer_norm(Some((x[1], x[2])), 1e-5));
    let shapes = [[660, 32].into(), [32].into()];
    step(c, "rms_norm 660 x 32", &shapes, |x| x[0].rms_norm(x[1], 1e-5));
    let mut params = Params::new();
    let w = params.add("w", [96, 96], vec![0.01; 96 * 96]);
    step(c, "checkpoint of a linear layer 220 x 96 -> 96", &[[220, 96].into()], |x| {
        ops::checkpoint(&params, x, move |tape, params, x| {
            ops::linear(x[0], tape.param(params, w), None, Activation::None)
        })
    });
}

fn images(c: &mut Criterion) {
    let shapes = [[4, 32, 48, 64].into(), [32, 32, 3, 3].into(), [32].into()];
    step(c, "conv2d 4 images, 32 -> 32 channels, 48 x 64", &shapes, |x| ops::conv2d(x[0], x[1], Some(x[2]), 1, 1));
    let shapes = [[4, 32, 24, 32].into(), [32, 16, 2, 2].into(), [16].into()];
    step(c, "conv_transpose2d 4 images, 32 -> 16 channels, 24 x 32 to 48 x 64", &shapes, |x| {
        ops::conv_transpose2d(x[0], x[1], Some(x[2]), 2)
    });
    let maps = [[1, 32, 24, 32].into()];
    step(c, "bilinear 32 maps, 24 x 32 to 48 x 64", &maps, |x| x[0].bilinear(48, 64, true));
    step(c, "bicubic 32 maps, 24 x 32 to 48 x 64", &maps, |x| x[0].bicubic(48, 64));
    step(c, "bicubic_antialias 32 maps, 24 x 32 to 12 x 16", &maps, |x| x[0].bicubic_antialias(12, 16));
    step(c, "avg_pool_same 7 of 32 maps, 24 x 32", &maps, |x| x[0].avg_pool_same(7));
}

fn rows(c: &mut Criterion) {
    let rows = [Shape::from([220, 96])];
    step(c, "softmax 220 x 96", &rows, |x| x[0].softmax(1));
    step(c, "log_softmax 220 x 96", &rows, |x| x[0].log_softmax(1));
    step(c, "normalize_rows 220 x 96", &rows, |x| x[0].normalize_rows(1e-6));
    let labels: Vec<u32> = (0..220).map(|i| i % 96).collect();
    step(c, "cross_entropy 220 x 96", &rows, |x| ops::cross_entropy(x[0], &labels, 0.1));
    step(c, "gather_rows 220 x 96", &rows, |x| x[0].gather_rows(&labels));
    step(c, "scatter_add_rows 220 x 96 -> 96 x 96", &rows, |x| x[0].scatter_add_rows(&labels, 96));
    step(c, "sum 220 x 96", &rows, |x| x[0].sum());
    step(c, "mean 220 x 96", &rows, |x| x[0].mean());
    step(c, "sum_axis 0 of 220 x 96", &rows, |x| x[0].sum_axis(0));
    step(c, "mean_axis 1 of 220 x 96", &rows, |x| x[0].mean_axis(1));
    step(c, "expand 96 to 220 x 96", &[[1, 96].into()], |x| x[0].expand([220, 96]));
    step(c, "permute 220 x 96", &rows, |x| x[0].permute(&[1, 0]));
    step(c, "reshape 220 x 96", &rows, |x| x[0].reshape([96, 220]));
    step(c, "slice 32 of 96 columns", &rows, |x| x[0].slice(1, 32, 32));
    step(c, "split 96 columns in 3, concat", &rows, |x| ops::concat(&ops::split(x[0], 1, &[32; 3]), 1));
}

/// At the sizes of 24 videos of 200 snippets.
fn sequences(c: &mut Criterion) {
    let shapes = [[24, 200, 128].into(), [128, 128, 3].into(), [128].into()];
    step(c, "conv1d 24 x 200 x 128", &shapes, |x| ops::conv1d(x[0], x[1], x[2], 1));
    let scores = [[24, 200].into()];
    step(c, "top_k_mean 13 of 24 x 200", &scores, |x| ops::top_k_mean(x[0], 13));
    step(c, "mean_at_top_k 13 of 24 x 200 x 128", &shapes[..1], |x| {
        let by = x[0]
            .tape()
            .constant_with([24, 200], |by| by.iter_mut().enumerate().for_each(|(i, y)| *y = (i * 37 % 200) as f32));
        ops::mean_at_top_k(x[0], by, 13)
    });
    step(c, "binary_cross_entropy 24 x 200", &scores, |x| {
        ops::binary_cross_entropy(x[0].sigmoid(), x[0].tape().constant(&[0.5; 24 * 200], [24, 200]))
    });
}

fn pointwise(c: &mut Criterion) {
    type Function = for<'t> fn(Var<'t, f32>) -> Var<'t, f32>;
    let functions: [(&str, Function); 17] = [
        ("relu", |x| x.relu()),
        ("gelu", |x| x.gelu()),
        ("sigmoid", |x| x.sigmoid()),
        ("tanh", |x| x.tanh()),
        ("silu", |x| x.silu()),
        ("softplus", |x| x.softplus()),
        ("exp", |x| x.exp()),
        ("ln of a square", |x| x.square().ln()),
        ("sqrt of a square", |x| x.square().sqrt()),
        ("square", |x| x.square()),
        ("abs", |x| x.abs()),
        ("clamp", |x| x.clamp(-1.0, 1.0)),
        ("neg", |x| -x),
        ("add a constant", |x| x + 1.0),
        ("sub a constant", |x| x - 1.0),
        ("mul by a constant", |x| x * 2.0),
        ("div by a constant", |x| x / 2.0),
    ];
    let shape = Shape::from([220, 96]);
    for (name, f) in functions {
        step(c, &format!("{name} 220 x 96"), &[shape], |x| f(x[0]));
    }
    step(c, "add 220 x 96", &[shape; 2], |x| x[0] + x[1]);
    step(c, "sub 220 x 96", &[shape; 2], |x| x[0] - x[1]);
    step(c, "mul 220 x 96", &[shape; 2], |x| x[0] * x[1]);
    step(c, "div 220 x 96", &[shape; 2], |x| x[0] / x[1]);
    step(c, "huber 220 x 96", &[shape; 2], |x| ops::huber(x[0], x[1], 1.0));
    step(c, "straight_through 220 x 96", &[shape; 2], |x| ops::straight_through(x[0], x[1]));
}

fn main() {
    let mut criterion = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(50))
        .measurement_time(Duration::from_millis(200))
        .configure_from_args();
    layers(&mut criterion);
    images(&mut criterion);
    rows(&mut criterion);
    sequences(&mut criterion);
    pointwise(&mut criterion);
    criterion.final_summary();
}
