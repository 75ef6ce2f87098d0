//! Photos as a lens without distortion would have taken them.

use rayon::prelude::*;
use weaver_geometry::Camera;
use weaver_geometry::glam::DVec2;
use weaver_io::Image;

/// Largest factor that a lens may be longer or shorter by without its distortion.
const LARGEST: f64 = 4.0;
/// Halvings of the interval of such factors.
const HALVINGS: usize = 40;
/// Places of each side of a photo that must come from within it.
const PLACES: usize = 16;
/// Steps by which a place in a photo is found again without distortion.
const STEPS: usize = 20;

/// How pixels of a lens with radial distortion lie in one without: a point at distance r from the axis, over its depth, is seen
/// at `f r (1 + k1 r^2)` in the first and at `g r` in the second. g is the smallest focal length without blank corners.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Undistortion {
    /// The camera with distortion.
    from: Camera,
    k1: f64,
    /// The camera without.
    pub to: Camera,
}

impl Undistortion {
    /// The distortion of a camera, undone.
    pub fn new(from: Camera, k1: f64) -> Self {
        let with = |zoom: f64| {
            let mut to = from;
            (to.intrinsics.fx, to.intrinsics.fy) = (zoom * from.intrinsics.fx, zoom * from.intrinsics.fy);
            Self { from, k1, to }
        };
        let (mut short, mut long) = (1.0 / LARGEST, LARGEST);
        for _ in 0..HALVINGS {
            let middle = (short * long).sqrt();
            *(if with(middle).is_full() { &mut long } else { &mut short }) = middle;
        }
        with(long)
    }

    /// Whether all of the second photo's border comes from within the first.
    fn is_full(&self) -> bool {
        let size = DVec2::new(self.from.width as f64, self.from.height as f64);
        let along = (0..=PLACES).map(|i| i as f64 / PLACES as f64);
        let border =
            along.flat_map(|t| [DVec2::new(t, 0.0), DVec2::new(t, 1.0), DVec2::new(0.0, t), DVec2::new(1.0, t)]);
        border.map(|at| self.distorted(at * size)).all(|p| p.cmpge(DVec2::ZERO).all() && p.cmple(size).all())
    }

    /// Where the lens with distortion sees what the other one sees at a pixel.
    pub fn distorted(&self, pixel: DVec2) -> DVec2 {
        let at = self.to.intrinsics.unproject(pixel, 1.0).truncate();
        let bent = at * (1.0 + self.k1 * at.length_squared());
        self.from.intrinsics.project(bent.extend(1.0))
    }

    /// Where the lens without distortion sees what the other one sees at a pixel.
    pub fn undistorted(&self, pixel: DVec2) -> DVec2 {
        let bent = self.from.intrinsics.unproject(pixel, 1.0).truncate();
        let straight = (0..STEPS).fold(bent, |at, _| bent / (1.0 + self.k1 * at.length_squared()));
        self.to.intrinsics.project(straight.extend(1.0))
    }

    /// The photo as the lens without distortion would have taken it; `image` may be larger than the cameras' photos.
    pub fn apply(&self, image: &Image) -> Image {
        let size = DVec2::new(image.width as f64, image.height as f64);
        let scale = size / DVec2::new(self.from.width as f64, self.from.height as f64);
        let mut pixels = vec![0.0; image.pixels.len()];
        pixels.par_chunks_mut(3 * image.width).enumerate().for_each(|(y, row)| {
            for (x, color) in row.as_chunks_mut::<3>().0.iter_mut().enumerate() {
                let at = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                *color = image_at(image, self.distorted(at / scale) * scale);
            }
        });
        Image { pixels, ..*image }
    }
}

/// The color at a place, between the four nearest pixels.
fn image_at(image: &Image, at: DVec2) -> [f32; 3] {
    let last = DVec2::new((image.width - 1) as f64, (image.height - 1) as f64);
    let at = (at - 0.5).clamp(DVec2::ZERO, last);
    let corner = at.floor().min((last - 1.0).max(DVec2::ZERO));
    let [x, y] = [corner.x as usize, corner.y as usize];
    let (tx, ty) = ((at.x - corner.x) as f32, (at.y - corner.y) as f32);
    let pixel = |x: usize, y: usize, c: usize| {
        image.pixels[3 * (y.min(image.height - 1) * image.width + x.min(image.width - 1)) + c]
    };
    std::array::from_fn(|c| {
        let row = |y: usize| pixel(x, y, c) * (1.0 - tx) + pixel(x + 1, y, c) * tx;
        row(y) * (1.0 - ty) + row(y + 1) * ty
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_geometry::{Intrinsics, Pose};

    fn camera() -> Camera {
        let intrinsics = Intrinsics { fx: 60.0, fy: 58.0, cx: 39.0, cy: 31.0 };
        Camera { pose: Pose::IDENTITY, intrinsics, width: 80, height: 60 }
    }

    #[test]
    fn pixels_go_there_and_back_and_no_corner_is_blank() {
        for k1 in [-0.15, -0.02, 0.0, 0.03, 0.2] {
            let lens = Undistortion::new(camera(), k1);
            assert!(lens.is_full(), "{k1}");
            for at in [DVec2::new(1.0, 2.0), DVec2::new(40.0, 30.0), DVec2::new(77.0, 50.0)] {
                let back = lens.undistorted(lens.distorted(at));
                assert!(back.distance(at) < 1e-3, "{k1}: {at} came back as {back}");
            }
        }
    }

    #[test]
    fn straight_lines_become_straight() {
        let k1 = -0.3;
        let lens = Undistortion::new(camera(), k1);
        // What the lens sees of a plane whose left part is dark: the border is bent, and straight again.
        let bright = |at: DVec2| f32::from(at.x > 0.5);
        let mut photo = Image::filled(80, 60, [0.0; 3]);
        for (i, color) in photo.pixels.chunks_exact_mut(3).enumerate() {
            let pixel = DVec2::new((i % 80) as f64 + 0.5, (i / 80) as f64 + 0.5);
            let straight = lens.to.intrinsics.unproject(lens.undistorted(pixel), 1.0).truncate();
            color.fill(bright(straight));
        }
        let out = lens.apply(&photo);
        let border = |image: &Image, y: usize| (0..80).find(|x| image.pixels[3 * (y * 80 + x)] > 0.5).unwrap();
        let spread = |image: &Image| {
            let places: Vec<usize> = (0..60).map(|y| border(image, y)).collect();
            places.iter().max().unwrap() - places.iter().min().unwrap()
        };
        assert!(spread(&photo) >= 2 && spread(&out) <= 1, "{} and {}", spread(&photo), spread(&out));
    }
}
