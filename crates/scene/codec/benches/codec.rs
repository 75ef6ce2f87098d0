//! Symbols, numbers and scenes, coded and decoded.

use criterion::{Criterion, Throughput};
use std::hint::black_box;
use weaver_codec::lite::{Quality, decode, encode};
use weaver_codec::{AdaptiveModel, Codebook, Coder, MixedModel, Raht, RangeDecoder, RangeEncoder};
use weaver_kernels::random::Stream;
use weaver_scene::Gaussians;

const NUMBERS: usize = 100_000;
const GAUSSIANS: usize = 20_000;
/// Copies of the cloud, side by side, that are a million.
const TILES: usize = 50;

/// Numbers of a normal distribution three wide, in four contexts that say nothing.
fn numbers() -> Vec<i32> {
    let stream = Stream::new(1, 0, "bench.codec");
    (0..NUMBERS as u64).map(|i| (3.0 * stream.normal::<f64>(i)).round() as i32).collect()
}

fn adaptive(coder: &mut impl Coder, numbers: &[i32]) {
    let mut model = AdaptiveModel::new(64);
    numbers.iter().for_each(|number| _ = black_box(model.code(coder, (number + 32) as usize)));
}

fn mixed(coder: &mut impl Coder, numbers: &[i32]) {
    let mut model = MixedModel::new([1, 4, 4]);
    let contexts = |i: usize| [0, i % 4, i / 4 % 4];
    numbers.iter().enumerate().for_each(|(i, number)| _ = black_box(model.code(coder, contexts(i), *number)));
}

fn cloud() -> Gaussians {
    let stream = Stream::new(2, 0, "bench.cloud");
    let normal = |i: usize, k: u64| stream.fork(k).normal::<f32>(i as u64);
    Gaussians {
        means: (0..GAUSSIANS).map(|i| [normal(i, 0), normal(i, 1), 0.1 * normal(i, 2)]).collect(),
        log_scales: (0..GAUSSIANS).map(|i| [-5.0 + normal(i, 3), -5.0 + normal(i, 4), -7.0]).collect(),
        quats: (0..GAUSSIANS).map(|i| [5, 6, 7, 8].map(|k| normal(i, k))).collect(),
        opacity_logits: (0..GAUSSIANS).map(|i| 2.0 * normal(i, 9)).collect(),
        sh: (0..GAUSSIANS * 12).map(|i| 0.2 * normal(i, 10)).collect(),
        degree: 1,
    }
}

type Write = fn(&mut RangeEncoder, &[i32]);
type Read = fn(&mut RangeDecoder, &[i32]);

fn coders(criterion: &mut Criterion) {
    let numbers = numbers();
    let mut group = criterion.benchmark_group("100,000 numbers");
    group.throughput(Throughput::Elements(NUMBERS as u64));
    let models: [(&str, Write, Read); 2] = [
        ("adaptive", |c, n| adaptive(c, n), |c, n| adaptive(c, n)),
        ("mixed, 3 contexts", |c, n| mixed(c, n), |c, n| mixed(c, n)),
    ];
    for (name, write, read) in models {
        let encoded = || {
            let mut encoder = RangeEncoder::default();
            write(&mut encoder, &numbers);
            encoder.finish()
        };
        let bytes = encoded();
        group.bench_function(format!("{name}, encode"), |b| b.iter(encoded));
        group.bench_function(format!("{name}, decode"), |b| b.iter(|| read(&mut RangeDecoder::new(&bytes), &numbers)));
    }
    group.finish();
}

fn scenes(criterion: &mut Criterion) {
    let (gaussians, quality) = (cloud(), Quality::default());
    let bytes = encode(&gaussians, &quality).unwrap_or_default();
    let mut group = criterion.benchmark_group("20,000 Gaussians of degree 1, parameters");
    group.sample_size(10);
    group.throughput(Throughput::Elements((GAUSSIANS * 23) as u64));
    group.bench_function("encode", |b| b.iter(|| black_box(encode(&gaussians, &quality))));
    group.bench_function("decode", |b| b.iter(|| black_box(decode(&bytes))));
    group.finish();
}

/// A large scene of degree 1: the cloud many times, side by side.
fn million(criterion: &mut Criterion) {
    let (tile, quality) = (cloud(), Quality::default());
    let moved = |i: usize| {
        let means = tile.means.iter().map(|[x, y, z]| [x + 8.0 * i as f32, *y, *z]).collect();
        Gaussians { means, ..tile.clone() }
    };
    let gaussians = Gaussians::joined(&(0..TILES).map(moved).collect::<Vec<_>>());
    let bytes = encode(&gaussians, &quality).unwrap_or_default();
    let mut group = criterion.benchmark_group("a million Gaussians of degree 1, parameters");
    group.sample_size(10);
    group.throughput(Throughput::Elements((TILES * GAUSSIANS * 23) as u64));
    group.bench_function("encode", |b| b.iter(|| black_box(encode(&gaussians, &quality))));
    group.bench_function("decode", |b| b.iter(|| black_box(decode(&bytes))));
    group.finish();
}

/// The transform, and codes of a codebook.
fn transforms(criterion: &mut Criterion) {
    let stream = Stream::new(3, 0, "bench.raht");
    let mut codes: Vec<u64> = (0..NUMBERS as u64).map(|i| stream.bits(i) >> 34).collect();
    codes.sort_unstable();
    let Ok(raht) = Raht::new(&codes, &vec![1.0; NUMBERS]) else { return };
    let mut values: Vec<f64> = (0..3 * NUMBERS as u64).map(|i| stream.normal(i)).collect();
    let mut group = criterion.benchmark_group("100,000 voxels");
    group.sample_size(20);
    group.throughput(Throughput::Elements(NUMBERS as u64));
    group.bench_function("RAHT, its tree", |b| b.iter(|| black_box(Raht::new(&codes, &vec![1.0; NUMBERS]))));
    group.bench_function("RAHT, three channels there and back", |b| {
        b.iter(|| {
            raht.forward(&mut values, 3);
            raht.inverse(&mut values, 3);
        })
    });
    let (rows, importance) = (&values[..45 * 2000], vec![1.0; 2000]);
    group.bench_function("256 codes of 2,000 rows of 45, a round", |b| {
        b.iter(|| black_box(Codebook::fit(rows, 45, &importance, 256, 1)))
    });
    group.finish();
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    coders(&mut criterion);
    scenes(&mut criterion);
    million(&mut criterion);
    transforms(&mut criterion);
    criterion.final_summary();
}
