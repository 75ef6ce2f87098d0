//! Photos as a lens without distortion would have taken them.

use rayon::prelude::*;
use weaver_geometry::Undistortion;
use weaver_geometry::glam::DVec2;
use weaver_io::Bitmap;

/// The photo as the lens without distortion would have taken it; `photo` may be larger than the cameras' photos.
pub(crate) fn undistorted(lens: &Undistortion, photo: &Bitmap) -> Bitmap {
    let size = DVec2::new(photo.width as f64, photo.height as f64);
    let scale = size / DVec2::new(lens.from.width as f64, lens.from.height as f64);
    let mut pixels = vec![0; photo.pixels.len()];
    pixels.par_chunks_mut(3 * photo.width.max(1)).enumerate().for_each(|(y, row)| {
        for (x, color) in row.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let at = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
            *color = color_at(photo, lens.distorted(at / scale) * scale);
        }
    });
    Bitmap { pixels, ..*photo }
}

/// The color at a place, by cubic interpolation between the sixteen nearest pixels: linear interpolation would blur.
fn color_at(photo: &Bitmap, at: DVec2) -> [u8; 3] {
    let corner = (at - 0.5).floor();
    let part = at - 0.5 - corner;
    let (across, down) = (cubic(part.x as f32), cubic(part.y as f32));
    let within = |at: f64, size: usize| at.clamp(0.0, (size - 1) as f64) as usize;
    let mut sum = [0.0_f32; 3];
    for (j, down) in down.iter().enumerate() {
        let y = within(corner.y + j as f64 - 1.0, photo.height);
        for (i, across) in across.iter().enumerate() {
            let x = within(corner.x + i as f64 - 1.0, photo.width);
            let from = 3 * (y * photo.width + x);
            let weight = across * down;
            sum.iter_mut().zip(&photo.pixels[from..from + 3]).for_each(|(sum, c)| *sum += weight * f32::from(*c));
        }
    }
    // The conversion clamps.
    sum.map(|x| x.round() as u8)
}

/// Weights of four pixels in a row for a place `t` between the second and the third: Keys, a = -0.5.
fn cubic(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [0.5 * (-t + 2.0 * t2 - t3), 0.5 * (2.0 - 5.0 * t2 + 3.0 * t3), 0.5 * (t + 4.0 * t2 - 3.0 * t3), 0.5 * (t3 - t2)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_geometry::{Camera, Distortion, Intrinsics, Pose};

    fn lens(distortion: Distortion) -> Undistortion {
        let intrinsics = Intrinsics { fx: 60.0, fy: 58.0, cx: 39.0, cy: 31.0 };
        Undistortion::new(Camera { pose: Pose::IDENTITY, intrinsics, width: 80, height: 60 }, distortion).unwrap()
    }

    #[test]
    fn straight_lines_become_straight() {
        let lens = lens(Distortion::radial(-0.3));
        // A plane whose left part is dark, seen through the lens: the border is bent, and straight again.
        let mut photo = Bitmap { width: 80, height: 60, pixels: vec![0; 3 * 80 * 60] };
        for (i, color) in photo.pixels.chunks_exact_mut(3).enumerate() {
            let pixel = DVec2::new((i % 80) as f64 + 0.5, (i / 80) as f64 + 0.5);
            let Some(straight) = lens.undistorted(pixel) else { continue };
            color.fill(if lens.to.intrinsics.unproject(straight, 1.0).x > 0.5 { 255 } else { 0 });
        }
        let out = undistorted(&lens, &photo);
        let border = |image: &Bitmap, y: usize| (0..80).find(|x| image.pixels[3 * (y * 80 + x)] > 127).unwrap();
        let spread = |image: &Bitmap| {
            let places: Vec<usize> = (0..60).map(|y| border(image, y)).collect();
            places.iter().max().unwrap() - places.iter().min().unwrap()
        };
        assert!(spread(&photo) >= 2 && spread(&out) <= 1, "{} and {}", spread(&photo), spread(&out));
    }

    #[test]
    fn a_larger_photo_is_undone_like_a_smaller_one() {
        let lens = lens(Distortion::radial(-0.1));
        let smooth = |width: usize, height: usize| {
            let at = |i: usize| ((i % width) as f64 / width as f64, (i / width) as f64 / height as f64);
            let color = |i| {
                let (x, y) = at(i);
                [200.0 * x, 200.0 * y, 100.0 * (x + y)].map(|c| c as u8)
            };
            Bitmap { width, height, pixels: (0..width * height).flat_map(color).collect() }
        };
        let (small, large) = (undistorted(&lens, &smooth(80, 60)), undistorted(&lens, &smooth(160, 120)));
        let shrunk = large.resize(80, 60).pixels;
        let apart = small.pixels.iter().zip(&shrunk).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
        assert!(apart <= 3, "{apart}");
    }
}
