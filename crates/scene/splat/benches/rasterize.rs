//! Synthetic scenes: the stages one by one, forward, forward with backward, and optional outputs of a drawing.

#![allow(missing_docs)] // criterion_group! makes an undocumented function

use criterion::{Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use std::sync::Arc;
use std::time::Duration;
use weaver_autograd::Tape;
use weaver_geometry::Intrinsics;
use weaver_geometry::lens::{self, Lens};
use weaver_kernels::random::Stream;
use weaver_scene::{CameraSlices, Color, GaussianSlices, Model};
use weaver_splat::{
    BlendWeights, Cotangents, GaussianStatistics, Gradients, Images, RasterSettings, Region, Target, Timings,
    Workspace, rasterize, rasterize_backward,
};

/// Gaussians of about a pixel and a half in a frustum; plain arrays, reused by every iteration.
struct Load {
    means: Vec<f32>,
    quats: Vec<f32>,
    scales: Vec<f32>,
    opacities: Vec<f32>,
    colors: Vec<f32>,
    degree: usize,
    viewmats: Vec<f32>,
    intrinsics: Vec<f32>,
    size: (usize, usize),
    model: Model,
    planes: [Vec<f32>; 3],
    cotangents: [Vec<f32>; 3],
    gradients: [Vec<f32>; 8],
    statistics: Option<Vec<GaussianStatistics<f32>>>,
    settings: RasterSettings,
    workspace: Workspace<f32>,
}

impl Load {
    fn new(n: usize, views: usize, size: (usize, usize), degree: usize) -> Self {
        let stream = Stream::new(1, 0, "splat.bench");
        let normal = |purpose: u64, i: usize| stream.fork(purpose).normal::<f32>(i as u64);
        let uniform = |purpose: u64, i: usize| stream.fork(purpose).uniform::<f32>(i as u64);
        let focal = size.0 as f32 * 0.8;
        let terms = 3 * (degree + 1) * (degree + 1);
        let (mut means, mut scales) = (Vec::new(), Vec::new());
        for i in 0..n {
            let z = 1.5 + 6.5 * uniform(0, i);
            means.extend([1.2 * (uniform(1, i) - 0.5) * z, 0.9 * (uniform(2, i) - 0.5) * z, z]);
            (0..3).for_each(|axis| scales.push(1.5 * z / focal * (0.6 * normal(3, 3 * i + axis)).exp()));
        }
        let mut viewmats = Vec::new();
        for v in 0..views {
            viewmats.extend([1.0, 0.0, 0.0, 0.05 * v as f32, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        }
        let pixels = views * size.0 * size.1;
        let draw = |purpose: u64, len: usize| (0..len).map(|i| normal(purpose, i)).collect::<Vec<f32>>();
        let opacities = draw(5, n).iter().map(|x| 1.0 / (1.0 + (-1.5 * x).exp())).collect();
        Self {
            means,
            quats: draw(4, 4 * n),
            scales,
            opacities,
            colors: draw(6, terms * n),
            degree,
            intrinsics: [focal, focal, size.0 as f32 / 2.0, size.1 as f32 / 2.0].repeat(views),
            size,
            model: Model::Pinhole,
            planes: [3, 1, 1].map(|channels| vec![0.0; channels * pixels]),
            cotangents: [(7, 3), (8, 1), (9, 1)].map(|(purpose, channels)| draw(purpose, channels * pixels)),
            gradients: [3 * n, 4 * n, 3 * n, n, terms * n, viewmats.len(), 4 * views, 3].map(|len| vec![0.0; len]),
            viewmats,
            statistics: None,
            settings: RasterSettings::default(),
            workspace: Workspace::new(),
        }
    }

    fn run(&mut self, backward: bool) {
        let gaussians = GaussianSlices {
            means: &self.means,
            quats: &self.quats,
            scales: &self.scales,
            opacities: &self.opacities,
            color: Color::Sh { coefficients: &self.colors, degree: self.degree },
            features: None,
            groups: None,
        };
        let cameras = CameraSlices {
            viewmats: &self.viewmats,
            intrinsics: &self.intrinsics,
            background: &[0.0; 3],
            width: self.size.0,
            height: self.size.1,
            model: self.model,
        };
        let settings = self.settings;
        let pixels = settings.region.map_or(self.planes[1].len(), |region| self.intrinsics.len() / 4 * region.pixels());
        let [image, alpha, depth] = self.planes.each_mut().map(|plane| &mut plane[..]);
        let (image, alpha, depth) = (&mut image[..3 * pixels], &mut alpha[..pixels], &mut depth[..pixels]);
        let images = Images { image, alpha, depth: Some(depth), features: None };
        let stats =
            rasterize(&gaussians, &cameras, &settings, &mut self.workspace, images).expect("the scene fits together");
        black_box(stats);
        if backward {
            let [image, alpha, depth] = self.cotangents.each_ref().map(|plane| &plane[..]);
            let (image, alpha, depth) = (&image[..3 * pixels], &alpha[..pixels], &depth[..pixels]);
            let cotangents = Cotangents { image: Some(image), alpha: Some(alpha), depth: Some(depth), features: None };
            let [means, quats, scales, opacities, colors, viewmats, intrinsics, background] =
                self.gradients.each_mut().map(|values| Some(Target::write(&mut values[..])));
            let gradients = Gradients {
                means,
                quats,
                scales,
                opacities,
                colors,
                viewmats,
                intrinsics: intrinsics.filter(|_| self.model == Model::Pinhole),
                background,
                statistics: self.statistics.as_deref_mut(),
                ..Gradients::default()
            };
            rasterize_backward(&gaussians, &cameras, &settings, &mut self.workspace, &cotangents, gradients)
                .expect("forward came first");
        }
    }
}

fn benches(c: &mut Criterion) {
    let cases = [
        ("10k Gaussians, 320x240, degree 3", Load::new(10_000, 1, (320, 240), 3)),
        ("4915 Gaussians, 6 views of 64x48, degree 1", Load::new(4915, 6, (64, 48), 1)),
    ];
    for (name, mut load) in cases {
        let mut group = c.benchmark_group(name);
        group.sample_size(10).warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(1));
        for (i, stage) in ["project", "sort and bin", "blend", "backward"].into_iter().enumerate() {
            group.bench_function(stage, |b| {
                b.iter_custom(|times| {
                    let once = |_| {
                        load.run(stage == "backward");
                        let Timings { project, bin, blend, backward } = load.workspace.timings();
                        [project, bin, blend, backward][i]
                    };
                    (0..times).map(once).sum()
                });
            });
        }
        group.bench_function("forward", |b| b.iter(|| load.run(false)));
        group.bench_function("forward and backward", |b| b.iter(|| load.run(true)));
        load.statistics = Some(vec![GaussianStatistics::default(); load.opacities.len()]);
        group.bench_function("forward and backward with statistics", |b| b.iter(|| load.run(true)));
        load.statistics = None;
        let straight = load.intrinsics.clone();
        for (name, lens) in [("a fisheye", Lens::EQUIDISTANT), ("a sphere", Lens::Equirectangular)] {
            load.model = Model::Lens(lens);
            // About as many pixels for each Gaussian as the pinhole has.
            let Intrinsics { fx, fy, cx, cy } = match lens {
                Lens::Equirectangular => lens::equirectangular(load.size.0, load.size.1),
                _ => lens::fisheye(1.6, load.size.0, load.size.1),
            };
            load.intrinsics = [fx, fy, cx, cy].map(|x| x as f32).repeat(straight.len() / 4);
            group.bench_function(format!("forward through {name}"), |b| b.iter(|| load.run(false)));
            group.bench_function(format!("forward and backward through {name}"), |b| b.iter(|| load.run(true)));
        }
        (load.model, load.intrinsics) = (Model::Pinhole, straight);
        let (width, height) = (load.size.0 / 2, load.size.1 / 2);
        load.settings.region = Some(Region { x: width / 2, y: height / 2, width, height });
        group.bench_function("forward and backward of a quarter", |b| b.iter(|| load.run(true)));
        load.settings.region = None;
        load.run(false);
        group.bench_function("for_each_hit", |b| {
            b.iter(|| {
                let workspace = &load.workspace;
                workspace.for_each_hit(|pixel, n, weight, light| {
                    black_box((pixel, n, weight, light));
                })
            });
        });
        let [mut sums, mut largest] = [(); 2].map(|()| vec![0.0; load.intrinsics.len() / 4 * load.opacities.len()]);
        group.bench_function("contributions", |b| b.iter(|| load.workspace.contributions(&mut sums, &mut largest)));
        let mut squared = vec![0.0; load.opacities.len()];
        let ones = vec![1.0; load.intrinsics.len() / 4 * load.size.0 * load.size.1];
        group.bench_function("squared contributions", |b| {
            b.iter(|| load.workspace.squared_contributions(&ones, 1, Target::write(&mut squared)));
        });
        let weights = Arc::new(BlendWeights::of(&load.workspace).expect("something was drawn"));
        group.bench_function("keeping weights", |b| b.iter(|| BlendWeights::of(&load.workspace)));
        let (mut tape, features) = (Tape::new(), &load.colors[..3 * load.opacities.len()]);
        group.bench_function("three features by kept weights, forward and backward", |b| {
            b.iter(|| {
                weights.blend(tape.leaf(features, [features.len() / 3, 3])).sum().backward();
                tape.reset();
            });
        });
        group.finish();
    }
}

criterion_group!(all, benches);
criterion_main!(all);
