//! The same bits at any number of threads.

use weaver_autograd::gradcheck::Input;
use weaver_autograd::ops::{self, Activation, RopeTable};
use weaver_autograd::{Shape, Tape};

/// Values and gradients of a graph whose tensors are cut into several chunks each.
fn step() -> Vec<Vec<u32>> {
    let shapes: [Shape; 6] =
        [[2, 3, 48, 64].into(), [32, 3, 3, 3].into(), [32].into(), [96, 32].into(), [96].into(), [3072].into()];
    let tape = Tape::<f32>::new();
    let leaf = |(i, shape): (usize, &Shape)| {
        let data: Vec<f32> = Input::normal(i as u64, *shape).data.iter().map(|x| 0.3 * *x as f32).collect();
        tape.leaf(&data, *shape)
    };
    let x: Vec<_> = shapes.iter().enumerate().map(leaf).collect();
    let maps = ops::conv2d(x[0], x[1], Some(x[2]), 1, 1).silu().bilinear(24, 32, false).avg_pool_same(3);
    let tokens = maps.permute(&[0, 2, 3, 1]).reshape([2, 768, 32]);
    let qkv = ops::linear(tokens.layer_norm(None, 1e-5), x[3], Some(x[4]), Activation::Gelu);
    let positions: Vec<_> = (0..768).map(|i| [i / 32, i % 32]).collect();
    let table = RopeTable::new(&positions, 16, 100.0);
    let [q, k, v] = [0, 1, 2].map(|i| ops::split(qkv, 2, &[32; 3])[i].reshape([2, 768, 2, 16]).rope2d(&table));
    let y = ops::attention(q, k, v, 0.25).reshape([1536, 32]);
    let indices: Vec<u32> = (0..3072_u32).map(|i| i * 7919 % 1536).collect();
    let rows = y.gather_rows(&indices) * x[5].reshape([3072, 1]).expand([3072, 32]);
    let sums = rows.scatter_add_rows(&indices, 1536).softmax(1);
    (ops::concat(&[sums, rows], 0).square().mean() + maps.mean_axis(1).sum() * 1e-3).backward();
    let bits = |x: &[f32]| x.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    let gradients = x.iter().map(|x| bits(&x.grad().expect("a gradient")));
    gradients.chain([bits(&sums.value())]).collect()
}

#[test]
fn same_bits_at_any_thread_count() {
    let run =
        |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool").install(step);
    let first = run(1);
    assert!(first.iter().all(|x| x.iter().any(|x| *x != 0)));
    assert!(run(2) == first && run(3) == first);
}
