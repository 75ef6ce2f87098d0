//! A step of a fit and its parts, at 512 x 512 pixels and 2246 Gaussians (compression ratio 50).

use criterion::{Criterion, Throughput};
use std::hint::black_box;
use weaver_image::{CUT, Canvas, Gaussians, Tiled, Window};
use weaver_kernels::random::Stream;

const SIDE: usize = 512;
const COUNT: usize = 2246;

/// Gaussians of an even cover, as a quadtree makes them: standard deviations of half a cell and about it.
fn picture() -> Gaussians<f32> {
    let stream = Stream::new(1, 0, "bench.image");
    let cell = (SIDE as f32) / (COUNT as f32).sqrt();
    let mut out = Gaussians::default();
    for i in 0..COUNT as u64 {
        let u = |j| stream.uniform::<f32>(8 * i + j);
        let scale = [0, 1].map(|j| cell * (0.35 + 0.3 * u(j)));
        out.push([2, 3].map(|j| SIDE as f32 * u(j)), scale, 3.0 * u(4), [5, 6, 7].map(u));
    }
    out
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    let picture = picture();
    let window = Window::whole(SIDE, SIDE);
    let mut canvas = Canvas::new();
    canvas.place(&picture, window, CUT).expect("Gaussians that can be drawn");
    let mut image = vec![0.0; 3 * SIDE * SIDE];
    canvas.draw(&picture.colors, &mut image).expect("room for the image");
    let target = Tiled::new(&image, SIDE, SIDE).expect("a picture");
    let mut gradient = Gaussians::zeros(COUNT);
    let mut group = criterion.benchmark_group("512 x 512, 2246 Gaussians");
    group.throughput(Throughput::Elements((SIDE * SIDE) as u64));
    group.bench_function("place", |b| b.iter(|| black_box(canvas.place(&picture, window, CUT))));
    group.bench_function("draw", |b| b.iter(|| black_box(canvas.draw(&picture.colors, &mut image))));
    group.bench_function("backward", |b| b.iter(|| black_box(canvas.backward(&picture, &image, &mut gradient))));
    group.bench_function("draw, squared error, backward", |b| {
        b.iter(|| black_box(canvas.squared_error(&picture, &target, &mut gradient)));
    });
    group.bench_function("place and draw a region of 64 x 64", |b| {
        let mut canvas = Canvas::new();
        let region = Window { x: 100, y: 200, width: 64, height: 64 };
        b.iter(|| {
            canvas.place(&picture, region, CUT).and_then(|()| canvas.draw(&picture.colors, &mut image[..3 * 64 * 64]))
        });
    });
    group.finish();
    criterion.final_summary();
}
