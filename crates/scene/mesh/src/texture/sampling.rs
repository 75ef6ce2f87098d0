//! Colors of photos between their pixels.

use super::sight::Sight;
use weaver_geometry::glam::{DVec2, DVec3};

/// The most samples along a side of a texel.
const MOST: f64 = 4.0;
/// Pixels of a side of the square that a mean color is of, at least.
const MEAN: f64 = 3.0;

impl Sight<'_> {
    /// The color of a texel with these sides: the mean of samples about a pixel apart, at most 4 x 4.
    pub fn color(&self, point: DVec3, spans: [DVec3; 2]) -> DVec3 {
        let center = self.pixel(point);
        let counts = spans.map(|span| (self.pixel(point + span) - center).length().round().clamp(1.0, MOST));
        let mut sum = DVec3::ZERO;
        for i in 0..(counts[0] * counts[1]) as usize {
            let part = |at: usize, of: f64| (at as f64 + 0.5) / of - 0.5;
            let (across, down) = (i % counts[0] as usize, i / counts[0] as usize);
            let offset = spans[0] * part(across, counts[0]) + spans[1] * part(down, counts[1]);
            sum += self.between(self.pixel(point + offset));
        }
        sum / (counts[0] * counts[1])
    }

    /// The mean color around a point, of a pixel of the depth image and at least of 3 x 3 pixels.
    pub fn mean(&self, point: DVec3) -> DVec3 {
        let (center, side) = (self.pixel(point), self.shrink().max(MEAN));
        let samples = (0..9).map(|i| center + (DVec2::new((i % 3) as f64, (i / 3) as f64) - 1.0) * (side / 3.0));
        samples.map(|at| self.between(at)).sum::<DVec3>() / 9.0
    }

    /// The color at a place, linear between the four pixels around it.
    fn between(&self, at: DVec2) -> DVec3 {
        let (width, height) = (self.photo.camera.width, self.photo.camera.height);
        let corner = (at - 0.5).clamp(DVec2::ZERO, DVec2::new((width - 1) as f64, (height - 1) as f64));
        let (x, y) = (corner.x as usize, corner.y as usize);
        let part = corner - corner.floor();
        let pixel = |x: usize, y: usize| {
            let first = 3 * (y.min(height - 1) * width + x.min(width - 1));
            DVec3::new(
                f64::from(self.photo.rgb[first]),
                f64::from(self.photo.rgb[first + 1]),
                f64::from(self.photo.rgb[first + 2]),
            )
        };
        let row = |y: usize| pixel(x, y).lerp(pixel(x + 1, y), part.x);
        row(y).lerp(row(y + 1), part.y)
    }
}
