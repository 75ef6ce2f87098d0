//! A photo at the size that depth is found at.

use weaver_geometry::Camera;
use weaver_scene::Photo;

/// The most pixels, so that sixteen bits are an index that needs no check.
pub(crate) const PIXELS: usize = 1 << 16;
/// The longest side.
pub(crate) const LONGEST: usize = 256;

/// A photo shrunk by a whole factor.
#[derive(Debug)]
pub(crate) struct Picture {
    /// Its camera.
    pub camera: Camera,
    /// sRGB, rounded.
    pub colors: Vec<[u8; 3]>,
    /// Luma.
    pub gray: Vec<u8>,
    /// The luma of each pixel and of the pixels right of it, below it and below right of it, from the lowest byte on:
    /// all that one bilinear sample needs, in one load. Of the last column and row the neighbors are repeated.
    pub quads: Box<[u32; PIXELS]>,
    /// Mask of the pixels that count.
    pub counts: Vec<bool>,
}

impl Picture {
    /// The photo, shrunk by the smallest whole factor that brings its longer side to `long_side` or below. Rows and
    /// columns that are left over at the right and the bottom are cut off, so that pixels stay where they were. A pixel
    /// counts if none of its parts is masked.
    pub fn of(photo: &Photo, long_side: usize) -> Self {
        let full = &photo.camera;
        let factor = full.width.max(full.height).div_ceil(long_side.clamp(1, LONGEST));
        let (width, height) = ((full.width / factor).max(1), (full.height / factor).max(1));
        let factor_of = |side: usize, full: usize| factor.min(full / side).max(1);
        let (fx, fy) = (factor_of(width, full.width), factor_of(height, full.height));
        let intrinsics = full.intrinsics.resized(1.0 / fx as f64, 1.0 / fy as f64);
        let camera = Camera { intrinsics, width, height, ..*full };
        let mut colors = Vec::with_capacity(width * height);
        let mut counts = Vec::with_capacity(width * height);
        let area = (fx * fy) as u32;
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            let (mut sum, mut all) = ([0_u32; 3], true);
            for row in y * fy..(y + 1) * fy {
                let first = row * full.width + x * fx;
                for pixel in photo.rgb[3 * first..3 * (first + fx)].chunks_exact(3) {
                    (0..3).for_each(|c| sum[c] += u32::from(pixel[c]));
                }
                all &= photo.mask.as_ref().is_none_or(|mask| !mask[first..first + fx].contains(&false));
            }
            colors.push(sum.map(|s| ((s + area / 2) / area) as u8));
            counts.push(all);
        }
        let luma =
            |c: &[u8; 3]| (0.299 * f32::from(c[0]) + 0.587 * f32::from(c[1]) + 0.114 * f32::from(c[2])).round() as u8;
        let gray: Vec<u8> = colors.iter().map(luma).collect();
        let quad = |(y, x): (usize, usize)| {
            let (right, below) = ((x + 1).min(width - 1), (y + 1).min(height - 1));
            let at = |y: usize, x: usize| gray[y * width + x];
            u32::from_le_bytes([at(y, x), at(y, right), at(below, x), at(below, right)])
        };
        let mut quads: Box<[u32; PIXELS]> = vec![0; PIXELS].try_into().expect("as many");
        let places = (0..height).flat_map(|y| (0..width).map(move |x| (y, x)));
        quads.iter_mut().zip(places).for_each(|(to, place)| *to = quad(place));
        Self { camera, colors, gray, quads, counts }
    }
}
