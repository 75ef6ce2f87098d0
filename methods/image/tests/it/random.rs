//! Random Gaussians, and numbers to compare.

use weaver_image::{CUT, Canvas, Gaussians, Picture, Window, reference};
use weaver_kernels::Real;
use weaver_kernels::random::Stream;

/// Gaussians around a picture, some of them outside, with scales between the two bounds.
pub fn gaussians<T: Real>(seed: u64, count: usize, size: [usize; 2], scales: [f64; 2]) -> Gaussians<T> {
    let stream = Stream::new(seed, 0, "test.gaussians");
    let uniform = |i: usize, low: f64, high: f64| low + (high - low) * stream.uniform::<f64>(i as u64);
    let mut out = Gaussians::default();
    for i in 0..count {
        let at = |j: usize, low, high| T::from_f64(uniform(8 * i + j, low, high));
        let center = [at(0, -4.0, size[0] as f64 + 4.0), at(1, -4.0, size[1] as f64 + 4.0)];
        let scale = [at(2, scales[0], scales[1]), at(3, scales[0], scales[1])];
        out.push(center, scale, at(4, -4.0, 4.0), [at(5, -1.0, 1.0), at(6, -1.0, 1.0), at(7, 0.0, 1.0)]);
    }
    out
}

/// Numbers of a normal distribution.
pub fn noise<T: Real>(seed: u64, count: usize) -> Vec<T> {
    let stream = Stream::new(seed, 0, "test.noise");
    (0..count).map(|i| stream.normal(i as u64)).collect()
}

/// The largest difference.
pub fn apart<T: Real>(a: &[T], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a.to_f64() - b).abs()).fold(0.0, f64::max)
}

/// `sum a b`.
pub fn dot<T: Real>(a: &[T], b: &[T]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.to_f64() * b.to_f64()).sum()
}

/// Runs on this number of threads.
pub fn on_threads<R: Send>(threads: usize, body: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(body)
}

/// A picture of soft spots on a slope, with some noise.
pub fn picture(seed: u64, width: usize, height: usize) -> Picture {
    let spots = gaussians::<f64>(seed, 12, [width, height], [1.0, 8.0]);
    let noise = noise::<f32>(!seed, 3 * width * height);
    let drawn = reference::draw(&spots, &Window::whole(width, height), 6.0);
    let colors = drawn.iter().zip(noise).enumerate();
    let color = |(i, (x, noise)): (usize, (&f64, f32))| {
        let slope = (i / 3 % width) as f32 / width as f32;
        (0.3 + 0.3 * slope + 0.4 * *x as f32 + 0.01 * noise).clamp(0.0, 1.0)
    };
    Picture::new(width, height, colors.map(color).collect()).unwrap()
}

/// Mean squared error of a drawing, not clamped.
pub fn error(picture: &Picture, gaussians: &Gaussians<f32>) -> f64 {
    let mut canvas = Canvas::new();
    canvas.place(gaussians, Window::whole(picture.width(), picture.height()), CUT).unwrap();
    let mut image = vec![0.0; picture.colors().len()];
    canvas.draw(&gaussians.colors, &mut image).unwrap();
    let squares = image.iter().zip(picture.colors()).map(|(a, b)| f64::from((a - b) * (a - b)));
    squares.sum::<f64>() / image.len() as f64
}
