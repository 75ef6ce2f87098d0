//! Gradients against finite differences, in `f64` and without the cut, whose step has none.

use crate::random::{gaussians, noise};
use proptest::prelude::*;
use weaver_image::{Canvas, Gaussians, Tiled, Window};

const CUT: f64 = 12.0;
const SIZE: [usize; 2] = [21, 18];

/// The numbers of Gaussians in one list.
fn numbers(of: &Gaussians<f64>) -> Vec<f64> {
    [&of.centers[..], &of.scales, &of.angles, &of.colors].concat()
}

fn with(of: &Gaussians<f64>, mut at: usize, change: f64) -> Gaussians<f64> {
    let mut out = of.clone();
    for list in [&mut out.centers, &mut out.scales, &mut out.angles, &mut out.colors] {
        if at < list.len() {
            list[at] += change;
            break;
        }
        at -= list.len();
    }
    out
}

/// The largest difference between a gradient and the finite differences of `loss`, over all numbers.
fn differs(picture: &Gaussians<f64>, gradient: &Gaussians<f64>, loss: impl Fn(&Gaussians<f64>) -> f64) -> f64 {
    let step = 1e-5;
    let slope = |i| (loss(&with(picture, i, step)) - loss(&with(picture, i, -step))) / (2.0 * step);
    let gradient = numbers(gradient);
    let scale = 1.0 + gradient.iter().fold(0.0_f64, |most, g| most.max(g.abs()));
    gradient.iter().enumerate().map(|(i, g)| (g - slope(i)).abs() / scale).fold(0.0, f64::max)
}

fn draw(picture: &Gaussians<f64>) -> Vec<f64> {
    let window = Window::whole(SIZE[0], SIZE[1]);
    let mut canvas = Canvas::new();
    canvas.place(picture, window, CUT).unwrap();
    let mut image = vec![0.0; 3 * window.pixels()];
    canvas.draw(&picture.colors, &mut image).unwrap();
    image
}

fn weighted(picture: &Gaussians<f64>, slopes: &[f64]) -> f64 {
    draw(picture).iter().zip(slopes).map(|(x, slope)| x * slope).sum()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 32))]

    #[test]
    fn of_any_loss(seed: u64) {
        let picture = gaussians::<f64>(seed, 4, SIZE, [0.6, 4.0]);
        let window = Window::whole(SIZE[0], SIZE[1]);
        let slopes = noise(seed, 3 * window.pixels());
        let mut canvas = Canvas::new();
        canvas.place(&picture, window, CUT).unwrap();
        let mut gradient = Gaussians::default();
        canvas.backward(&picture, &slopes, &mut gradient).unwrap();
        prop_assert!(differs(&picture, &gradient, |at| weighted(at, &slopes)) < 1e-6);
    }

    #[test]
    fn of_the_squared_error(seed: u64) {
        let picture = gaussians::<f64>(seed, 4, SIZE, [0.6, 4.0]);
        let target = noise::<f64>(seed, 3 * SIZE[0] * SIZE[1]);
        let tiled = Tiled::new(&target, SIZE[0], SIZE[1]).unwrap();
        let loss = |at: &Gaussians<f64>| {
            draw(at).iter().zip(&target).map(|(x, y)| (x - y) * (x - y)).sum::<f64>() / target.len() as f64
        };
        let mut canvas = Canvas::new();
        canvas.place(&picture, Window::whole(SIZE[0], SIZE[1]), CUT).unwrap();
        let mut gradient = Gaussians::default();
        let error = canvas.squared_error(&picture, &tiled, &mut gradient).unwrap();
        prop_assert!((error - loss(&picture)).abs() < 1e-9);
        prop_assert!(differs(&picture, &gradient, loss) < 1e-7);
    }

    #[test]
    fn through_another_scale(seed: u64, factor in 0.3_f64..1.5) {
        let picture = gaussians::<f64>(seed, 3, SIZE, [0.6, 4.0]);
        let window = Window::whole(SIZE[0], SIZE[1]);
        let slopes = noise(seed, 3 * window.pixels());
        let scaled = picture.at_scale(factor);
        let mut canvas = Canvas::new();
        canvas.place(&scaled, window, CUT).unwrap();
        let mut gradient = Gaussians::default();
        canvas.backward(&scaled, &slopes, &mut gradient).unwrap();
        picture.pull_back(factor, &mut gradient);
        prop_assert!(differs(&picture, &gradient, |at| weighted(&at.at_scale(factor), &slopes)) < 1e-6);
    }
}
