//! Drawing at another size.

use crate::random::gaussians;
use weaver_image::{CUT, Canvas, Gaussians, Window};

fn drawn(picture: &Gaussians<f32>, side: usize) -> Vec<f32> {
    let mut canvas = Canvas::new();
    canvas.place(picture, Window::whole(side, side), CUT).unwrap();
    let mut image = vec![0.0; 3 * side * side];
    canvas.draw(&picture.colors, &mut image).unwrap();
    image
}

#[test]
fn half_size_is_the_mean_of_four_pixels() {
    let picture = gaussians::<f32>(7, 80, [96, 96], [1.0, 8.0]);
    let (whole, half) = (drawn(&picture, 96), drawn(&picture.at_scale(0.5), 48));
    let mut sum = 0.0;
    for (i, found) in half.iter().enumerate() {
        let (x, y, c) = (i / 3 % 48, i / 3 / 48, i % 3);
        let at = |dx: usize, dy: usize| whole[3 * ((2 * y + dy) * 96 + 2 * x + dx) + c];
        let mean = 0.25 * (at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1));
        sum += (found - mean).powi(2);
    }
    let deviation = (sum / half.len() as f32).sqrt();
    assert!(deviation < 0.005, "{deviation}");
}

#[test]
fn larger_is_the_same_function_at_more_points() {
    let picture = gaussians::<f32>(8, 30, [32, 32], [1.0, 5.0]);
    let (once, thrice) = (drawn(&picture, 32), drawn(&picture.at_scale(3.0), 96));
    // Every third pixel has the middle of an original pixel; only pixels at the cut may fall on either side of it.
    let differ = (0..32 * 32).filter(|p| {
        let other = 3 * ((3 * (p / 32) + 1) * 96 + 3 * (p % 32) + 1);
        (0..3).any(|c| (once[3 * p + c] - thrice[other + c]).abs() > 1e-4)
    });
    assert!(differ.count() < 5);
}
