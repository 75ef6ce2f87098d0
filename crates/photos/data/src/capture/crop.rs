//! The largest centered part of a photo that has the network's aspect ratio.

use weaver_geometry::Intrinsics;
use weaver_io::{Bitmap, PhotoFile};

/// A part of a photo, in pixels with fractions, and the size it is brought to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crop {
    left: f64,
    top: f64,
    right: f64,
    bottom: f64,
    width: usize,
    height: usize,
}

impl Crop {
    /// The largest centered part of a `from_width` x `from_height` photo with the shape of `width` x `height`.
    pub fn centered(from_width: usize, from_height: usize, width: usize, height: usize) -> Self {
        let (w, h) = (from_width as f64, from_height as f64);
        let part_width = w.min(h * width as f64 / height as f64);
        // Rounding must not push the part over the border.
        let part_height = h.min(part_width * height as f64 / width as f64);
        let (left, top) = ((w - part_width) / 2.0, (h - part_height) / 2.0);
        let (right, bottom) = ((left + part_width).min(w), (top + part_height).min(h));
        Self { left, top, right, bottom, width, height }
    }

    /// The part of a photo, shrunk or enlarged.
    ///
    /// # Errors
    /// When the photo cannot be read.
    pub fn read(&self, photo: &PhotoFile) -> Result<Bitmap, weaver_io::Error> {
        photo.resize(self.width, self.height, [self.left, self.top, self.right, self.bottom])
    }

    /// The same part so many times as large.
    pub(crate) fn enlarged(&self, times: usize) -> Self {
        Self { width: self.width * times, height: self.height * times, ..*self }
    }

    /// Width of the part over the width of the result.
    pub(crate) fn shrink(&self) -> f64 {
        (self.right - self.left) / self.width as f64
    }

    /// The photo's intrinsics carried over to the part.
    pub fn intrinsics(&self, photo: &Intrinsics) -> Intrinsics {
        let sx = self.width as f64 / (self.right - self.left);
        let sy = self.height as f64 / (self.bottom - self.top);
        photo.cropped(self.left, self.top).resized(sx, sy)
    }
}

#[cfg(test)]
mod tests {
    use super::Crop;
    use weaver_geometry::Intrinsics;

    /// A wide photo loses its sides and a tall one its top and bottom.
    #[test]
    fn photos_are_cropped_about_the_middle() {
        let wide = Crop::centered(384, 256, 64, 48);
        let part = [wide.left, wide.top, wide.right, wide.bottom];
        let third = 256.0 * 64.0 / 48.0;
        assert_eq!(part, [(384.0 - third) / 2.0, 0.0, (384.0 - third) / 2.0 + third, 256.0]);
        let tall = Crop::centered(216, 384, 64, 48);
        assert_eq!([tall.left, tall.top, tall.right, tall.bottom], [0.0, 111.0, 216.0, 273.0]);
    }

    #[test]
    fn intrinsics_follow_the_crop_then_the_scale() {
        let photo = Intrinsics { fx: 286.0, fy: 287.0, cx: 108.0, cy: 192.0 };
        let k = Crop::centered(216, 384, 64, 48).intrinsics(&photo);
        let s = 64.0 / 216.0;
        assert_eq!((k.fx, k.fy, k.cx, k.cy), (286.0 * s, 287.0 * s, 32.0, 24.0));
    }

    #[test]
    fn no_size_pushes_the_part_over_the_border() {
        for w in 1..60 {
            for h in 1..60 {
                for (width, height) in [(64, 48), (70, 42), (3, 7)] {
                    let c = Crop::centered(w, h, width, height);
                    assert!(c.left >= 0.0 && c.left < c.right && c.right <= w as f64);
                    assert!(c.top >= 0.0 && c.top < c.bottom && c.bottom <= h as f64);
                }
            }
        }
    }
}
