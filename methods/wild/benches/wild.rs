//! Colors of all pixels of four photos of 64 x 48 under two looks, forward and backward, and the embedding of two
//! photos.
// The macros of criterion define functions without documentation.
#![allow(missing_docs)]

use criterion::{Criterion, criterion_group, criterion_main};
use weaver_autograd::{Params, Tape};
use weaver_nn::{Builder, Context, WeightInit};
use weaver_wild::{AppearanceEncoder, AppearanceEncoderConfig, LookDecoder, LookDecoderConfig};

fn bench(c: &mut Criterion) {
    let mut params = Params::<f32>::new();
    let config = LookDecoderConfig { features: 24, embedding: 16, hidden: 32, sh_degree: 1, recolor: true };
    let decoder = LookDecoder::new(Builder::new(&mut params, 0).scope("looks"), config);
    let config = AppearanceEncoderConfig {
        width: 96,
        heads: 3,
        blocks: 1,
        mlp_ratio: 4,
        layer_scale: 1.0,
        hidden: vec![64],
        embedding: 16,
        init: WeightInit::FanIn,
    };
    let encoder = AppearanceEncoder::new(Builder::new(&mut params, 0).scope("appearance"), &config);
    let mut tape = Tape::new();
    let mut group = c.benchmark_group("appearance");
    group.bench_function("decoder, 4 views of 64 x 48, 2 looks", |b| {
        b.iter(|| {
            tape.reset();
            let maps = tape.leaf(&vec![0.1; 4 * 24 * 3072], [4, 24, 48, 64]);
            let looks = tape.leaf(&[0.2; 32], [2, 16]);
            let plain = tape.constant(&vec![0.3; 4 * 3 * 3072], [4, 3, 48, 64]);
            decoder.forward(Context::new(&tape, &params), maps, looks, plain).sum().backward();
        });
    });
    group.bench_function("encoder, 2 photos of 8 x 6 patches", |b| {
        b.iter(|| {
            tape.reset();
            let tokens = tape.leaf(&vec![0.1; 2 * 48 * 96], [2, 48, 96]);
            encoder.forward(Context::new(&tape, &params), tokens, [6, 8]).sum().backward();
        });
    });
}

criterion_group!(benches, bench);
criterion_main!(benches);
