//! A step of a fit, the optimizer's part of it alone, and a round of density control.

use criterion::{BatchSize, Criterion};
use weaver_fit::strategy::Split;
use weaver_fit::{Fit, FitSettings, Moment, Photo, Population, Strategy};
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_kernels::optim::AdamW;
use weaver_kernels::random::Stream;
use weaver_scene::Gaussians;
use weaver_splat::GaussianStatistics;

const GAUSSIANS: usize = 40_000;
const SIZE: [usize; 2] = [384, 256];

/// Gaussians of a few pixels in front of a camera, with harmonics of degree 3.
fn scene(camera: &Camera) -> Gaussians {
    let stream = |purpose| Stream::new(1, 0, "fit.bench").fork(purpose);
    let (place, scale, turn, opacity, color) = (stream(0), stream(1), stream(2), stream(3), stream(4));
    let Intrinsics { fx, fy, .. } = camera.intrinsics;
    let [width, height] = SIZE.map(|side| side as f64);
    let mean = |n: u64| {
        let z = 1.5 + 6.5 * place.uniform::<f64>(3 * n);
        let [x, y]: [f64; 2] = std::array::from_fn(|i| 1.1 * place.uniform::<f64>(3 * n + 1 + i as u64) - 0.55);
        [x * width / fx * z, y * height / fy * z, z].map(|x| x as f32)
    };
    let all = 0..GAUSSIANS as u64;
    Gaussians {
        means: all.clone().map(mean).collect(),
        log_scales: all
            .clone()
            .map(|n| std::array::from_fn(|i| 0.6 * scale.normal::<f32>(3 * n + i as u64) - 3.7))
            .collect(),
        quats: all.clone().map(|n| std::array::from_fn(|i| turn.normal(4 * n + i as u64))).collect(),
        opacity_logits: all.map(|n| 1.5 * opacity.normal::<f32>(n)).collect(),
        sh: (0..48 * GAUSSIANS as u64).map(|i| 0.2 * color.normal::<f32>(i)).collect(),
        degree: 3,
    }
}

fn fit(criterion: &mut Criterion) {
    let [width, height] = SIZE;
    let intrinsics = Intrinsics { fx: 300.0, fy: 300.0, cx: 192.0, cy: 128.0 };
    let camera = Camera { pose: Pose::IDENTITY, intrinsics, width, height };
    let rgb = (0..3 * width * height).map(|i| if i / 60 % 2 == 0 { 200 } else { 60 }).collect();
    let photo = Photo { name: "stripes".into(), camera, rgb, mask: None, lens: None };
    let mut settings = FitSettings {
        steps: 1 << 20,
        gaussians: GAUSSIANS,
        coarse_until: 0.0,
        sh_interval: 0.0,
        ..FitSettings::default()
    };
    settings.density.until = 0.0;
    settings.rates.power = 0.0;
    let initial = scene(&camera);
    let mut fit = Fit::new(vec![photo], &initial, settings.clone()).expect("a fit");
    criterion.bench_function("step of 40,000 Gaussians, 384 x 256", |bencher| {
        bencher.iter(|| fit.step().expect("a step").loss);
    });
}

/// Adam on all numbers of the Gaussians, as a step runs it.
fn optimizer(criterion: &mut Criterion) {
    let adam = AdamW { rate: 1e-3_f32, beta1: 0.9, beta2: 0.999, eps: 1e-15, weight_decay: 0.0, gradient_scale: 1.0 };
    let columns: Vec<f32> = (0..48).map(|i| if i < 3 { 1.0 } else { 0.05 }).collect();
    let mut fields = [3, 3, 4, 1, 48].map(|width| {
        let noise = Stream::new(1, 0, "fit.bench").fork(5);
        let gradient: Vec<f32> = (0..(width * GAUSSIANS) as u64).map(|i| noise.normal(i)).collect();
        let zeros = vec![0.0; gradient.len()];
        (zeros.clone(), gradient, zeros.clone(), zeros)
    });
    let mut step = 0;
    criterion.bench_function("optimizer step of 40,000 Gaussians", |bencher| {
        bencher.iter(|| {
            step += 1;
            let [others @ .., (p, g, m, v)] = &mut fields;
            others.iter_mut().for_each(|(p, g, m, v)| adam.step(step, p, g, m, v));
            adam.step_columns(step, p, g, m, v, &columns);
        });
    });
}

fn density(criterion: &mut Criterion) {
    let [width, height] = SIZE;
    let intrinsics = Intrinsics { fx: 300.0, fy: 300.0, cx: 192.0, cy: 128.0 };
    let population = Population::new(&scene(&Camera { pose: Pose::IDENTITY, intrinsics, width, height }));
    let noise = Stream::new(1, 0, "fit.bench").fork(6);
    let statistics: Vec<GaussianStatistics<f32>> = (0..GAUSSIANS as u64)
        .map(|n| GaussianStatistics { absgrad: noise.uniform(n), views: 1, ..GaussianStatistics::default() })
        .collect();
    let settings = FitSettings::default().density;
    let moment = Moment {
        step: 5,
        since: 5,
        steps: settings.rounds,
        budget: GAUSSIANS + GAUSSIANS / 10,
        mean_rate: 1e-3,
        extent: 1.0,
        stream: Stream::new(1, 0, "fit.density"),
    };
    criterion.bench_function("round of density control of 40,000 Gaussians", |bencher| {
        bencher.iter_batched_ref(
            || (population.clone(), Split::new(settings.clone())),
            |(population, strategy)| assert!(strategy.adapt(&moment, population, &statistics)),
            BatchSize::LargeInput,
        );
    });
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    fit(&mut criterion);
    optimizer(&mut criterion);
    density(&mut criterion);
    criterion.final_summary();
}
