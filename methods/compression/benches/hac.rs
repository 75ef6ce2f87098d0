//! Parts of a step of HAC-lite beside drawing: the hash grid, the bits of numbers, signs.

use criterion::Criterion;
use std::sync::Arc;
use weaver_autograd::Tape;
use weaver_compression::{HashGrid, HashLevel, binary_through, gaussian_bits};
use weaver_kernels::random::Stream;

/// Anchors of 20,000 Gaussians, and numbers of each.
const ANCHORS: usize = 4000;
const NUMBERS: usize = 53;

fn grids(criterion: &mut Criterion) {
    let stream = Stream::new(1, 0, "bench.hash");
    let positions: Vec<[f64; 3]> =
        (0..ANCHORS as u64).map(|i| [0, 1, 2].map(|axis| stream.uniform(3 * i + axis))).collect();
    let levels: Vec<HashLevel> =
        [18, 31, 52, 89, 151, 257].map(|resolution| HashLevel { axes: vec![0, 1, 2], resolution, rows: 1024 }).into();
    let grid = Arc::new(HashGrid::new(&levels, &positions));
    let table: Vec<f32> = (0..4 * grid.rows() as u64).map(|i| stream.normal(i)).collect();
    let mut tape = Tape::<f32>::new();
    criterion.bench_function("hash grid of 6 levels, 4,000 positions, signs of 4 numbers, there and back", |b| {
        b.iter(|| {
            let table = tape.leaf(&table, [grid.rows(), 4]);
            grid.look_up(binary_through(table)).sum().backward();
            tape.reset();
        });
    });
}

fn rates(criterion: &mut Criterion) {
    let (stream, count) = (Stream::new(2, 0, "bench.rates"), ANCHORS * NUMBERS);
    let numbers: Vec<f32> = (0..count as u64).map(|i| stream.normal(i)).collect();
    let positive: Vec<f32> = numbers.iter().map(|x| x.abs() + 0.1).collect();
    let mut tape = Tape::<f32>::new();
    criterion.bench_function("gaussian bits of 212,000 numbers, there and back", |b| {
        b.iter(|| {
            let [x, mean] = [1.0, 0.5].map(|_| tape.leaf(&numbers, [count]));
            let [deviation, step] = [1.0, 0.5].map(|_| tape.leaf(&positive, [count]));
            gaussian_bits(x, mean, deviation, step).sum().backward();
            tape.reset();
        });
    });
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    grids(&mut criterion);
    rates(&mut criterion);
    criterion.final_summary();
}
