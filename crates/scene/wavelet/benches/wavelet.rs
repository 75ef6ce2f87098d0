//! Time of the wavelet ops on the photos of one training step.

use criterion::Criterion;
use weaver_autograd::Tape;
use weaver_autograd::gradcheck::Input;
use weaver_wavelet::{Wavelet, analysis, detail_energy, luma};

fn wavelet(criterion: &mut Criterion) {
    let images: Vec<f32> = Input::uniform(1, 0.0, 1.0, [4, 3, 48, 64]).data.iter().map(|x| *x as f32).collect();
    let mut tape = Tape::<f32>::new();
    criterion.bench_function("db2 energy of 4 x 64 x 48, forward and backward", |bencher| {
        bencher.iter(|| {
            let x = tape.leaf(&images, [4, 3, 48, 64]);
            detail_energy(analysis(luma(x), Wavelet::Db2)).sum().backward();
            tape.reset();
        });
    });
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    wavelet(&mut criterion);
    criterion.final_summary();
}
