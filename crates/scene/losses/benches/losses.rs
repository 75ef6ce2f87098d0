//! Time of the image losses on the renders of one training step.

use criterion::Criterion;
use weaver_autograd::Tape;
use weaver_autograd::gradcheck::Input;
use weaver_losses::{Perceptual, Photometric, Relief, depth_loss, error_regression, laplacian_log_depth};
use weaver_losses::{mse, normal_loss, ssim};

fn losses(criterion: &mut Criterion) {
    let image =
        |seed| Input::uniform(seed, 0.0, 1.0, [6, 3, 48, 64]).data.iter().map(|x| *x as f32).collect::<Vec<_>>();
    let (render, target) = (image(1), image(2));
    let mut tape = Tape::<f32>::new();
    criterion.bench_function("mse of 6 x 64 x 48, forward and backward", |bencher| {
        bencher.iter(|| {
            let (a, b) = (tape.leaf(&render, [6, 3, 48, 64]), tape.constant(&target, [6, 3, 48, 64]));
            mse(a, b).backward();
            tape.reset();
        });
    });
    criterion.bench_function("ssim of 6 x 64 x 48, forward and backward", |bencher| {
        bencher.iter(|| {
            let (a, b) = (tape.leaf(&render, [6, 3, 48, 64]), tape.constant(&target, [6, 3, 48, 64]));
            ssim(a, b).mean().backward();
            tape.reset();
        });
    });
    criterion.bench_function("Laplacian of depth of 4 x 64 x 48, forward and backward", |bencher| {
        bencher.iter(|| {
            let pixels = 4 * 48 * 64;
            let [l, u] = [&render, &target].map(|x| tape.leaf(&x[..pixels], [4, 48, 64]));
            laplacian_log_depth(l, u, tape.constant(&target[..pixels], [4, 48, 64])).backward();
            tape.reset();
        });
    });
    criterion.bench_function("error regression of 4 x 64 x 48, forward and backward", |bencher| {
        bencher.iter(|| {
            let pixels = 4 * 48 * 64;
            let score = tape.leaf(&render[..pixels], [4, 48, 64]);
            error_regression(score, tape.constant(&target[..pixels], [4, 48, 64]), None).backward();
            tape.reset();
        });
    });
}

/// By features of VGG-19, with weights that stand for the published ones.
fn perceptual(criterion: &mut Criterion) {
    let tensors =
        [[0, 64, 3], [2, 64, 64], [5, 128, 64], [7, 128, 128], [10, 256, 128], [12, 256, 256], [14, 256, 256]]
            .into_iter()
            .chain([[16, 256, 256], [19, 512, 256], [21, 512, 512], [23, 512, 512], [25, 512, 512], [28, 512, 512]])
            .chain([[30, 512, 512]])
            .flat_map(|[index, outputs, inputs]| {
                let tensor = |what: &str, shape: Vec<usize>| {
                    let numbers = vec![1e-3; shape.iter().product()];
                    (format!("features.{index}.{what}"), (shape, numbers))
                };
                [tensor("weight", vec![outputs, inputs, 3, 3]), tensor("bias", vec![outputs])]
            });
    let network = Perceptual::from_tensors(&tensors.collect(), "drawn").expect("the shapes of VGG-19");
    let image =
        |seed| Input::uniform(seed, 0.0, 1.0, [2, 3, 48, 64]).data.iter().map(|x| *x as f32).collect::<Vec<_>>();
    let (render, target) = (image(1), image(2));
    let mut tape = Tape::<f32>::new();
    criterion.bench_function("perceptual loss of 2 x 64 x 48, forward and backward", |bencher| {
        bencher.iter(|| {
            let (a, b) = (tape.leaf(&render, [2, 3, 48, 64]), tape.constant(&target, [2, 3, 48, 64]));
            network.loss(a, b).backward();
            tape.reset();
        });
    });
}

/// The fused loss beside the same of ops on the tape.
fn surfaces(criterion: &mut Criterion) {
    let (width, height) = (800, 600);
    let pixels = width * height;
    let between = |seed, low, high, count| -> Vec<f32> {
        Input::uniform(seed, low, high, [count]).data.iter().map(|x| *x as f32).collect()
    };
    let (depth, known, alpha) = (between(1, 1.9, 2.0, pixels), between(2, 1.5, 2.5, pixels), vec![1.0; pixels]);
    let normals = between(3, -1.0, 1.0, 3 * pixels);
    let (mut of_depth, mut of_normals) = (vec![0.0; pixels], vec![0.0; 3 * pixels]);
    criterion.bench_function(&format!("loss of depth of {width} x {height} and its gradient"), |bencher| {
        bencher.iter(|| depth_loss(&depth, &known, 0.02, &mut of_depth));
    });
    let intrinsics = [700.0, 700.0, 400.0, 300.0];
    let relief = Relief { depth: &depth, alpha: &alpha, normals: &normals, size: [height, width], intrinsics };
    criterion.bench_function(&format!("loss of normals of {width} x {height} and its gradients"), |bencher| {
        bencher.iter(|| normal_loss(&relief, &mut of_depth, &mut of_normals));
    });
}

fn photometric(criterion: &mut Criterion) {
    for size @ [height, width] in [[256, 384], [720, 1280]] {
        let image = |seed| {
            Input::uniform(seed, 0.0, 1.0, [height, width, 3]).data.iter().map(|x| *x as f32).collect::<Vec<_>>()
        };
        let (render, target) = (image(1), image(2));
        let mut gradient = vec![0.0; render.len()];
        let mut loss = Photometric::new();
        criterion.bench_function(&format!("photometric loss of {width} x {height} and its gradient"), |bencher| {
            bencher.iter(|| loss.value_and_gradient(&render, &target, size, 0.2, &mut gradient));
        });
        let (mut tape, shape) = (Tape::<f32>::new(), [1, 3, height, width]);
        criterion.bench_function(&format!("photometric loss of {width} x {height} by ops on the tape"), |bencher| {
            bencher.iter(|| {
                let (a, b) = (tape.leaf(&render, shape), tape.constant(&target, shape));
                ((a - b).abs().mean() * 0.8 + (ssim(a, b).mean() * -1.0 + 1.0) * 0.2).backward();
                tape.reset();
            });
        });
    }
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    losses(&mut criterion);
    photometric(&mut criterion);
    surfaces(&mut criterion);
    perceptual(&mut criterion);
    criterion.final_summary();
}
