//! Photos as a lens without distortion would have taken them.

use rayon::prelude::*;
use weaver_geometry::Undistortion;
use weaver_geometry::glam::DVec2;
use weaver_io::Bitmap;
use weaver_kernels::simd;

/// The photo as the lens without distortion would have taken it; `photo` may be larger than the cameras' photos.
pub(crate) fn undistorted(lens: &Undistortion, photo: &Bitmap) -> Bitmap {
    let size = DVec2::new(photo.width as f64, photo.height as f64);
    let scale = size / DVec2::new(lens.from.width as f64, lens.from.height as f64);
    let mut pixels = vec![0; photo.pixels.len()];
    pixels.par_chunks_mut(3 * photo.width.max(1)).enumerate().for_each(|(y, row)| {
        let place = |x: usize| lens.distorted(DVec2::new(x as f64 + 0.5, y as f64 + 0.5) / scale) * scale;
        let places: Vec<DVec2> = (0..photo.width).map(place).collect();
        simd::dispatch(
            #[inline(always)]
            || colors(photo, &places, row.as_chunks_mut().0),
        );
    });
    Bitmap { pixels, ..*photo }
}

/// The colors at places, by cubic interpolation between the sixteen nearest pixels: linear interpolation would blur.
#[inline(always)]
fn colors(photo: &Bitmap, places: &[DVec2], to: &mut [[u8; 3]]) {
    for (color, at) in to.iter_mut().zip(places) {
        let corner = (*at - 0.5).floor();
        let part = *at - 0.5 - corner;
        let (across, down) = (cubic(part.x as f32), cubic(part.y as f32));
        let inside = |at: f64, size: usize| at >= 1.0 && at + 2.0 < size as f64;
        let sum = if inside(corner.x, photo.width) && inside(corner.y, photo.height) {
            let first = 3 * ((corner.y as usize - 1) * photo.width + corner.x as usize - 1);
            sum_inside(photo, first, across, down)
        } else {
            sum_at_border(photo, corner, across, down)
        };
        for c in 0..3 {
            // The conversion clamps, and cuts off.
            color[c] = (sum[c] + 0.5) as u8;
        }
    }
}

/// The weighted sum of four pixels in each of four rows, the first of which begins at a place of the pixels' bytes:
/// down the columns first, all twelve bytes of a row at once.
#[inline(always)]
fn sum_inside(photo: &Bitmap, first: usize, across: [f32; 4], down: [f32; 4]) -> [f32; 3] {
    let mut columns = [0.0; 12];
    for (j, down) in down.iter().enumerate() {
        let row: &[u8; 12] = photo.pixels[first + 3 * j * photo.width..].first_chunk().expect("a row inside");
        for (sum, x) in columns.iter_mut().zip(row) {
            *sum += down * f32::from(*x);
        }
    }
    let mut sum = [0.0; 3];
    for i in 0..4 {
        for c in 0..3 {
            sum[c] += across[i] * columns[3 * i + c];
        }
    }
    sum
}

/// The same sum where pixels of the border are repeated.
fn sum_at_border(photo: &Bitmap, corner: DVec2, across: [f32; 4], down: [f32; 4]) -> [f32; 3] {
    let within = |at: f64, size: usize| at.clamp(0.0, (size - 1) as f64) as usize;
    let mut sum = [0.0; 3];
    for (j, down) in down.iter().enumerate() {
        let y = within(corner.y + j as f64 - 1.0, photo.height);
        for (i, across) in across.iter().enumerate() {
            let x = within(corner.x + i as f64 - 1.0, photo.width);
            let weight = across * down;
            let color = &photo.pixels[3 * (y * photo.width + x)..][..3];
            for (sum, c) in sum.iter_mut().zip(color) {
                *sum += weight * f32::from(*c);
            }
        }
    }
    sum
}

/// Weights of four pixels in a row for a place `t` between the second and the third: Keys, a = -0.5.
#[inline(always)]
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

    /// The sum inside of a photo is the one that repeats the border.
    #[test]
    fn inside_is_as_at_the_border() {
        let pixels = (0..3 * 9 * 8).map(|i| (i * 7919 % 256) as u8).collect();
        let photo = Bitmap { width: 9, height: 8, pixels };
        for (x, y) in (1..6).flat_map(|x| (1..5).map(move |y| (x, y))) {
            let (across, down) = (cubic(0.13 * x as f32), cubic(0.19 * y as f32));
            let inside = sum_inside(&photo, 3 * ((y - 1) * 9 + x - 1), across, down);
            let border = sum_at_border(&photo, DVec2::new(x as f64, y as f64), across, down);
            let apart = inside.iter().zip(border).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(apart < 1e-3, "{x} {y}: {inside:?} and {border:?}");
        }
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
