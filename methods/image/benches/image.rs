//! A step of a fit and its parts at 512 x 512 pixels, a megapixel and a region from a file; compression ratio 50.
//!
//! `RAYON_NUM_THREADS=1 cargo bench -p weaver-image`, and with 2.

use criterion::{BenchmarkGroup, Criterion, Throughput, measurement::WallTime};
use std::hint::black_box;
use weaver_image::{CUT, Canvas, Fitted, Gaussians, Tiled, Window, decode, decode_region, encode};
use weaver_kernels::random::Stream;

/// Gaussians of an even cover, as from a quadtree: standard deviations of about half a cell.
fn picture(side: usize, count: usize) -> Gaussians<f32> {
    let stream = Stream::new(1, 0, "bench.image");
    let cell = (side as f32) / (count as f32).sqrt();
    let mut out = Gaussians::default();
    for i in 0..count as u64 {
        let u = |j| stream.uniform::<f32>(8 * i + j);
        let scale = [0, 1].map(|j| cell * (0.35 + 0.3 * u(j)));
        out.push([2, 3].map(|j| side as f32 * u(j)), scale, 3.0 * u(4), [5, 6, 7].map(u));
    }
    out
}

fn step(group: &mut BenchmarkGroup<'_, WallTime>) {
    const SIDE: usize = 512;
    let picture = picture(SIDE, 2246);
    let window = Window::whole(SIDE, SIDE);
    let mut canvas = Canvas::new();
    canvas.place(&picture, window, CUT).expect("Gaussians that can be drawn");
    let mut image = vec![0.0; 3 * window.pixels()];
    canvas.draw(&picture.colors, &mut image).expect("room for the image");
    let target = Tiled::new(&image, SIDE, SIDE).expect("a picture");
    let mut gradient = Gaussians::default();
    group.throughput(Throughput::Elements(window.pixels() as u64));
    group.bench_function("place", |b| b.iter(|| black_box(canvas.place(&picture, window, CUT))));
    group.bench_function("draw", |b| b.iter(|| black_box(canvas.draw(&picture.colors, &mut image))));
    group.bench_function("backward", |b| b.iter(|| black_box(canvas.backward(&picture, &image, &mut gradient))));
    group.bench_function("draw, squared error, backward", |b| {
        b.iter(|| black_box(canvas.squared_error(&picture, &target, &mut gradient)));
    });
}

fn file(group: &mut BenchmarkGroup<'_, WallTime>) {
    const SIDE: usize = 1024;
    let fitted = Fitted { gaussians: picture(SIDE, 8987), cut: CUT, reset: 0 };
    let bytes = encode(&fitted, SIDE, SIDE).expect("Gaussians that can be coded");
    group.throughput(Throughput::Elements((SIDE * SIDE) as u64));
    group.bench_function("decode a megapixel", |b| b.iter(|| black_box(decode(&bytes))));
    group.bench_function("decode and draw a megapixel", |b| {
        b.iter(|| decode(&bytes).and_then(|coded| coded.fitted.draw(SIDE, SIDE)));
    });
    let window = Window { x: 400, y: 500, width: 64, height: 64 };
    group.throughput(Throughput::Elements(window.pixels() as u64));
    group.bench_function("draw a region of 64 x 64", |b| b.iter(|| black_box(fitted.draw_window(window))));
    group.bench_function("decode and draw a region of 64 x 64", |b| {
        let mut read = |range: std::ops::Range<u64>| Ok(bytes[range.start as usize..range.end as usize].to_vec());
        b.iter(|| {
            let part = decode_region(bytes.len() as u64, &mut read, window);
            part.and_then(|part| part.fitted.draw_window(window))
        });
    });
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    let mut group = criterion.benchmark_group(format!("{} threads", rayon::current_num_threads()));
    step(&mut group);
    file(&mut group);
    group.finish();
    criterion.final_summary();
}
