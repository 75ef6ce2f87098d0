//! Ten thousand Gaussians of each model at one time, forward and backward.
// The macros of criterion define functions without documentation.
#![allow(missing_docs)]

use criterion::{Criterion, criterion_group, criterion_main};
use weaver_autograd::{Params, Tape};
use weaver_dynamic::{Code, CodeConfig, Field, FieldConfig, Keys, KeysConfig, Motion, Poly, Start};
use weaver_nn::{Builder, Context};

const COUNT: usize = 10_000;

fn bench(c: &mut Criterion) {
    let positions: Vec<f64> = (0..3 * COUNT).map(|i| (i as f64 * 0.731).sin()).collect();
    let start = Start { positions: &positions, sizes: &[0.05; COUNT], opacity: 0.1 };
    let mut params = Params::<f32>::new();
    let mut root = Builder::new(&mut params, 0);
    let bounds = [[-1.0; 3], [1.0; 3]];
    let field = FieldConfig { bounds, resolution: [16, 16, 8, 16], levels: 2, channels: 8, width: 32 };
    let code = CodeConfig { code: 8, table: [16, 16], moments: [4, 16], width: 32, neighbors: 20 };
    let keys = KeysConfig { frames: 32, interval: 4, pad: 0.0, margin: 3.0 };
    let models: [(&str, Box<dyn Motion<f32>>); 4] = [
        ("field", Box::new(Field::new(root.scope("field"), &start, field))),
        ("code", Box::new(Code::new(root.scope("code"), &start, code))),
        ("keys", Box::new(Keys::new(root.scope("keys"), &start, keys))),
        ("poly", Box::new(Poly::new(root.scope("poly"), &start, &[0.5; COUNT]))),
    ];
    let mut tape = Tape::new();
    let mut group = c.benchmark_group("dynamic");
    for (name, model) in models {
        group.bench_function(name, |b| {
            b.iter(|| {
                tape.reset();
                let moved = model.at(Context::new(&tape, &params), 0.3);
                (moved.means.sum() + moved.quats.sum() + moved.scales.sum() + moved.opacities.sum()).backward();
            });
        });
    }
}

criterion_group!(benches, bench);
criterion_main!(benches);
