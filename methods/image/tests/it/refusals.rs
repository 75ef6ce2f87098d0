//! Bad input: an error with the expected and the found value.

use weaver_image::{CUT, Canvas, Gaussians, Tiled, Window};

fn one() -> Gaussians<f32> {
    let mut one = Gaussians::default();
    one.push([1.0, 2.0], [1.0, 1.0], 0.0, [1.0; 3]);
    one
}

fn refusal(picture: &Gaussians<f32>, window: Window, cut: f64) -> String {
    Canvas::new().place(picture, window, cut).unwrap_err().to_string()
}

#[test]
fn gaussians_that_are_none() {
    let window = Window::whole(4, 4);
    let mut short = one();
    short.colors.pop();
    assert_eq!(refusal(&short, window, CUT), "colors of Gaussians: expected 3 numbers, found 2");
    let mut flat = one();
    flat.scales[1] = 0.0;
    assert_eq!(refusal(&flat, window, CUT), "scale of a Gaussian: expected a positive number of pixels, found 0");
    let mut lost = one();
    lost.centers[0] = f32::NAN;
    assert_eq!(refusal(&lost, window, CUT), "number of a Gaussian: expected a finite center, found NaN");
}

#[test]
fn windows_that_cannot_be_drawn() {
    for (width, height) in [(0, 4), (1 << 20, 1 << 20), (usize::MAX, 2)] {
        let refusal = refusal(&one(), Window::whole(width, height), CUT);
        assert!(refusal.starts_with("pixels of a drawing: expected 1 to 268435456, found"), "{refusal}");
    }
    let far = Window { x: usize::MAX, y: 0, width: 1, height: 1 };
    assert!(refusal(&one(), far, CUT).starts_with("pixels of a drawing"));
    assert!(refusal(&one(), Window::whole(4, 4), f64::NAN).starts_with("cut: expected above 0"));
    assert_eq!(Tiled::new(&[0.0_f32; 11], 2, 2).unwrap_err().to_string(), "picture: expected 12 numbers, found 11");
}

#[test]
fn images_of_another_size() {
    let mut canvas = Canvas::new();
    canvas.place(&one(), Window::whole(4, 4), CUT).unwrap();
    let refusal = canvas.draw(&[1.0; 3], &mut [0.0; 40]).unwrap_err().to_string();
    assert_eq!(refusal, "image: expected 48 numbers, found 40");
    let refusal = canvas.draw(&[1.0; 2], &mut [0.0; 48]).unwrap_err().to_string();
    assert_eq!(refusal, "colors of Gaussians: expected 3 numbers, found 2");
}
