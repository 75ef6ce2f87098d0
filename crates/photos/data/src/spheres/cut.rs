//! The faces of one panorama.

use super::nadir::Below;
use rayon::prelude::*;
use weaver_geometry::glam::{DMat3, DVec2, DVec3};
use weaver_io::{Bitmap, Panorama};

/// Sides of a cube.
pub(super) const FACES: usize = 6;
pub(super) const NAMES: [&str; FACES] = ["front", "right", "back", "left", "up", "down"];
/// Field of view of a face, degrees: more than 90, so that what lies on an edge is found in one face or the other.
const FOV: f64 = 95.0;
/// Quality of the JPEGs, of 100.
pub(super) const QUALITY: u8 = 95;
/// The least part of a face that the panorama shows.
const LEAST: f64 = 0.02;
/// Pixels of a side by which the shown part is judged.
const JUDGED: usize = 32;

/// A panorama that was cut.
pub(super) struct Cut {
    panorama: Panorama,
    /// Mask in the size of the panorama: white counts.
    mask: Option<Bitmap>,
    /// Pixels of a side of a face.
    pub side: usize,
    pub faces: [Bitmap; FACES],
    /// Surroundings of straight down.
    pub below: Below,
}

/// Focal length of a face over its side.
pub(super) fn focal() -> f64 {
    0.5 / (0.5 * FOV.to_radians()).tan()
}

/// Rotation from the axes of the front face to a face's: x right, y down, z ahead.
pub(super) fn rotation(side: usize) -> DMat3 {
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    let (right, down) = [(x, y), (-z, y), (-x, y), (z, y), (x, z), (x, -z)][side];
    DMat3::from_cols(right, down, right.cross(down)).transpose()
}

impl Cut {
    pub fn new(panorama: Panorama, photo: &Bitmap, mask: Option<Bitmap>) -> Self {
        // As many pixels for an angle as the panorama has in its middle.
        let side = (panorama.width / std::f64::consts::TAU / focal()).round().max(1.0) as usize;
        let mut cut = Self { panorama, mask, side, faces: Default::default(), below: Below::of(&panorama, photo) };
        for number in cut.shown() {
            cut.faces[number] = cut.face(number, |pixel| bicubic(photo, &panorama, pixel));
        }
        cut
    }

    /// The faces that the panorama shows anything of.
    pub fn shown(&self) -> Vec<usize> {
        let part = |face: usize| {
            let places =
                (0..JUDGED * JUDGED).map(|i| [i % JUDGED, i / JUDGED].map(|x| (x as f64 + 0.5) / JUDGED as f64));
            let inside = places.filter(|[x, y]| self.panorama.pixel(direction(face, *x, *y)).is_some()).count();
            inside as f64 / (JUDGED * JUDGED) as f64
        };
        (0..FACES).filter(|face| part(*face) >= LEAST).collect()
    }

    /// True if some of its faces have masks.
    pub fn is_masked(&self) -> bool {
        self.mask.is_some() || !self.panorama.is_whole()
    }

    /// The mask of a face: white where it counts, which it does not within `nadir` degrees of straight down.
    pub fn mask(&self, face: usize, nadir: f64) -> Bitmap {
        let lowest = nadir.to_radians().cos();
        let mut mask = self.face(face, |pixel| match &self.mask {
            Some(mask) => nearest(mask, pixel),
            None => [255; 3],
        });
        let side = self.side;
        mask.pixels.par_chunks_exact_mut(3 * side).enumerate().for_each(|(y, row)| {
            for (x, pixel) in row.chunks_exact_mut(3).enumerate() {
                let at = [x, y].map(|x| (x as f64 + 0.5) / side as f64);
                let hidden = nadir > 0.0 && direction(face, at[0], at[1]).normalize().y >= lowest;
                pixel.fill(if hidden || pixel[0] < 128 { 0 } else { 255 });
            }
        });
        mask
    }

    /// A face with the colors that belong to pixels of the panorama, black where it has none.
    fn face(&self, face: usize, color: impl Fn(DVec2) -> [u8; 3] + Sync) -> Bitmap {
        let side = self.side;
        let mut pixels = vec![0; 3 * side * side];
        pixels.par_chunks_exact_mut(3 * side).enumerate().for_each(|(y, row)| {
            for (x, pixel) in row.chunks_exact_mut(3).enumerate() {
                let [x, y] = [x, y].map(|x| (x as f64 + 0.5) / side as f64);
                let at = self.panorama.pixel(direction(face, x, y));
                pixel.copy_from_slice(&at.map_or([0; 3], &color));
            }
        });
        Bitmap { width: side, height: side, pixels }
    }
}

/// The direction at a place of a face, from 0 to 1, in the axes of the front face.
fn direction(face: usize, x: f64, y: f64) -> DVec3 {
    rotation(face).transpose() * DVec3::new((x - 0.5) / focal(), (y - 0.5) / focal(), 1.0)
}

/// A photo of this size that counts all over.
pub(super) fn white((width, height): (usize, usize)) -> Bitmap {
    Bitmap { width, height, pixels: vec![255; 3 * width * height] }
}

fn nearest(photo: &Bitmap, at: DVec2) -> [u8; 3] {
    let [x, y] = [(at.x as usize).min(photo.width - 1), (at.y as usize).min(photo.height - 1)];
    std::array::from_fn(|c| photo.pixels[3 * (y * photo.width + x) + c])
}

/// The color at a place by Catmull and Rom's cubic splines; a whole turn is joined at its ends.
///
/// Source: Keys, Cubic convolution interpolation for digital image processing, 1981.
fn bicubic(photo: &Bitmap, panorama: &Panorama, at: DVec2) -> [u8; 3] {
    let (x, y) = (at.x - 0.5, at.y - 0.5);
    let (left, top) = (x.floor(), y.floor());
    let (by_x, by_y) = (weights(x - left), weights(y - top));
    let width = photo.width as isize;
    let joined = (panorama.width - photo.width as f64).abs() < 0.5;
    let column = |k: usize| {
        let x = left as isize + k as isize - 1;
        (if joined { x.rem_euclid(width) } else { x.clamp(0, width - 1) }) as usize
    };
    let columns: [usize; 4] = std::array::from_fn(column);
    let mut sum = [0.0_f32; 3];
    for (k, by_y) in by_y.into_iter().enumerate() {
        let row = (top as isize + k as isize - 1).clamp(0, photo.height as isize - 1) as usize * photo.width;
        for (column, by_x) in columns.iter().zip(by_x) {
            let pixel = &photo.pixels[3 * (row + column)..][..3];
            (0..3).for_each(|c| sum[c] += by_y * by_x * f32::from(pixel[c]));
        }
    }
    sum.map(|x| x.round().clamp(0.0, 255.0) as u8)
}

/// Weights of four neighbors, at a place between the inner two.
fn weights(t: f64) -> [f32; 4] {
    let t = t as f32;
    let (t2, t3) = (t * t, t * t * t);
    [0.5 * (2.0 * t2 - t3 - t), 0.5 * (3.0 * t3 - 5.0 * t2 + 2.0), 0.5 * (4.0 * t2 - 3.0 * t3 + t), 0.5 * (t3 - t2)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A smooth color for each direction.
    fn paint(direction: DVec3) -> [u8; 3] {
        direction.normalize().to_array().map(|x| (127.5 + 100.0 * x).round() as u8)
    }

    fn panorama(width: usize) -> (Panorama, Bitmap) {
        let height = width / 2;
        let pixel = |i: usize| {
            let (x, y) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let (longitude, latitude) =
                ((x / width as f64 - 0.5) * std::f64::consts::TAU, (y / height as f64 - 0.5) * std::f64::consts::PI);
            paint(DVec3::new(latitude.cos() * longitude.sin(), latitude.sin(), latitude.cos() * longitude.cos()))
        };
        let pixels = (0..width * height).flat_map(pixel).collect();
        (Panorama::whole((width, height)), Bitmap { width, height, pixels })
    }

    /// Promise (photos): each pixel of a face shows what the panorama shows in its direction.
    #[test]
    fn faces_show_what_the_panorama_shows() {
        let (sphere, photo) = panorama(256);
        let cut = Cut::new(sphere, &photo, None);
        assert_eq!((cut.side, cut.shown().len()), (89, FACES));
        for (number, face) in cut.faces.iter().enumerate() {
            for (i, pixel) in face.pixels.chunks_exact(3).enumerate() {
                let at = [i % 89, i / 89].map(|x| (x as f64 + 0.5) / 89.0);
                let expected = paint(direction(number, at[0], at[1]));
                let off = pixel.iter().zip(expected).map(|(a, b)| a.abs_diff(b)).max();
                assert!(off <= Some(2), "{}, {at:?}: {pixel:?}, not {expected:?}", NAMES[number]);
            }
            let rotation = rotation(number);
            assert!((rotation.determinant() - 1.0).abs() < 1e-12);
        }
        // Ahead of each face.
        let ahead = [0, 1, 2, 3, 4, 5].map(|face| direction(face, 0.5, 0.5));
        assert_eq!(ahead, [DVec3::Z, DVec3::X, DVec3::NEG_Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::Y]);
    }

    #[test]
    fn masks_follow_the_sphere() {
        let (sphere, photo) = panorama(128);
        // The left half does not count.
        let left = |i: usize| if i % 128 < 64 { [0; 3] } else { [255; 3] };
        let mask = Bitmap { width: 128, height: 64, pixels: (0..128 * 64).flat_map(left).collect() };
        let cut = Cut::new(sphere, &photo, Some(mask));
        let part = |face: usize, nadir: f64| {
            let mask = cut.mask(face, nadir);
            mask.pixels.iter().filter(|x| **x == 255).count() as f64 / mask.pixels.len() as f64
        };
        assert!((part(0, 0.0) - 0.5).abs() < 0.03 && part(1, 0.0) == 1.0 && part(3, 0.0) == 0.0);
        assert!(part(5, 30.0) < part(5, 0.0) - 0.1 && part(1, 30.0) == 1.0);
        // A part of the sphere that ends above.
        let part = Panorama { width: 128.0, corner: [0.0, 32.0], size: (128, 32) };
        let lower = Bitmap { width: 128, height: 32, pixels: photo.pixels[3 * 128 * 32..].to_vec() };
        let cut = Cut::new(part, &lower, None);
        assert!(cut.is_masked() && !cut.shown().contains(&4), "nothing above");
        let front = cut.mask(0, 0.0);
        assert!(front.pixels[0] == 0 && front.pixels.last() == Some(&255));
    }
}
