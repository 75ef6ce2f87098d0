//! Drawing: against the plain loop, in regions, by threads, and as a linear map.

use crate::random::{apart, dot, gaussians, noise, on_threads};
use proptest::prelude::*;
use weaver_image::{CUT, Canvas, Gaussians, Values, Window, reference};
use weaver_kernels::Real;
use weaver_lift::Operator;

fn drawn<T: Real>(picture: &Gaussians<T>, window: Window, cut: f64) -> Vec<T> {
    let mut canvas = Canvas::new();
    canvas.place(picture, window, cut).unwrap();
    let mut image = vec![T::ONE; 3 * window.pixels()];
    canvas.draw(&picture.colors, &mut image).unwrap();
    image
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 8))]

    #[test]
    fn tiles_are_the_plain_loop(seed: u64, width in 1_usize..50, height in 1_usize..50, x in 0_usize..9) {
        let picture = gaussians::<f64>(seed, 20, [60, 50], [0.3, 12.0]);
        let window = Window { x, y: 2 * x, width, height };
        let expected = reference::draw(&picture, &window, CUT);
        prop_assert!(apart(&drawn(&picture, window, CUT), &expected) < 1e-6);
    }

    #[test]
    fn single_precision_is_near(seed: u64) {
        // A far cut: at three deviations, rounding could move a pixel across a step of e^-4.5.
        let picture = gaussians::<f32>(seed, 20, [40, 40], [0.5, 6.0]);
        let window = Window::whole(40, 40);
        prop_assert!(apart(&drawn(&picture, window, 9.0), &reference::draw(&picture, &window, 9.0)) < 1e-5);
    }

    #[test]
    fn a_region_has_the_bits_of_the_whole(seed: u64, x in 0_usize..40, y in 0_usize..40, side in 1_usize..30) {
        let picture = gaussians::<f32>(seed, 60, [70, 70], [0.3, 15.0]);
        let whole = drawn(&picture, Window::whole(70, 70), CUT);
        let part = drawn(&picture, Window { x, y, width: side, height: side }, CUT);
        for (row, line) in part.chunks_exact(3 * side).enumerate() {
            prop_assert_eq!(line, &whole[3 * ((y + row) * 70 + x)..][..3 * side]);
        }
    }

    #[test]
    fn the_transpose_is_one(seed: u64, channels in 1_usize..6) {
        let picture = gaussians::<f64>(seed, 15, [37, 21], [0.3, 9.0]);
        let mut values = Values::new(&picture, Window::whole(37, 21), CUT).unwrap();
        let (x, y) = (noise::<f64>(seed, 15 * channels), noise::<f64>(!seed, 37 * 21 * channels));
        let (mut ax, mut ay) = (vec![0.0; y.len()], vec![0.0; x.len()]);
        values.forward(0, &x, channels, &mut ax).unwrap();
        values.adjoint(0, &y, channels, &mut ay).unwrap();
        prop_assert!((dot(&ax, &y) - dot(&x, &ay)).abs() < 1e-9 * dot(&y, &y));
    }
}

#[test]
fn squares_of_values_are_squares() {
    let picture = gaussians::<f64>(3, 6, [19, 18], [0.4, 5.0]);
    let window = Window::whole(19, 18);
    let mut values = Values::new(&picture, window, CUT).unwrap();
    let y = noise::<f64>(4, window.pixels());
    let mut found = vec![0.0; 6];
    values.adjoint_squared(0, &y, 1, &mut found).unwrap();
    for (i, found) in found.iter().enumerate() {
        let mut one = vec![0.0; 6];
        one[i] = 1.0;
        let mut column = vec![0.0; y.len()];
        values.forward(0, &one, 1, &mut column).unwrap();
        let expected: f64 = column.iter().zip(&y).map(|(a, y)| a * a * y).sum();
        assert!((found - expected).abs() < 1e-9, "{found} {expected}");
    }
}

#[test]
fn threads_do_not_matter() {
    let picture = gaussians::<f32>(5, 300, [90, 130], [0.3, 10.0]);
    let window = Window::whole(90, 130);
    let slopes = noise::<f32>(6, 3 * window.pixels());
    let run = |threads| {
        on_threads(threads, || {
            let mut canvas = Canvas::new();
            canvas.place(&picture, window, CUT).unwrap();
            let mut image = vec![0.0; slopes.len()];
            canvas.draw(&picture.colors, &mut image).unwrap();
            let mut gradient = Gaussians::zeros(0);
            canvas.backward(&picture, &slopes, &mut gradient).unwrap();
            (image, gradient)
        })
    };
    assert_eq!(run(1), run(2));
    assert_eq!(run(1), run(5));
}

#[test]
fn nothing_draws_black() {
    assert_eq!(drawn(&Gaussians::<f32>::default(), Window::whole(3, 5), CUT), [0.0; 45]);
    let mut far = Gaussians::default();
    far.push([-1e9, 1e9], [1.0, 2.0], 0.0, [1.0_f32; 3]);
    assert_eq!(drawn(&far, Window::whole(3, 5), CUT), [0.0; 45]);
}
