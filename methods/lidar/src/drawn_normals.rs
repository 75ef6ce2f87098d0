//! Normals of a drawn surface from its ranges, and the gradient back to them.

use weaver_geometry::glam::DVec3;
use weaver_surfel::SurfelCamera;

/// Unit vectors of the pixels of a camera, cached.
#[derive(Clone, Debug)]
pub(crate) struct Rays {
    rays: Vec<DVec3>,
    width: usize,
    height: usize,
}

impl Rays {
    pub fn new(camera: &SurfelCamera) -> Self {
        let (width, height) = (camera.width, camera.height);
        let rays = (0..camera.pixels()).map(|i| camera.pixel_ray(i % width, i / width)).collect();
        Self { rays, width, height }
    }

    /// Right, left, below and above a pixel; none at the upper and the lower border. Columns wrap around.
    fn around(&self, pixel: usize) -> Option<[usize; 4]> {
        let (row, column) = (pixel / self.width, pixel % self.width);
        (row > 0 && row + 1 < self.height).then(|| {
            let start = row * self.width;
            let right = start + (column + 1) % self.width;
            let left = start + (column + self.width - 1) % self.width;
            [right, left, pixel + self.width, pixel - self.width]
        })
    }

    /// The normal (P_right - P_left) x (P_below - P_above) of length 1 toward the camera; `None` if one of these has no
    /// range.
    pub fn normal(&self, ranges: &[f32], pixel: usize) -> Option<DVec3> {
        self.cross(ranges, pixel).map(|(_, _, cross, sign)| cross.normalize() * sign)
    }

    fn cross(&self, ranges: &[f32], pixel: usize) -> Option<([usize; 4], [DVec3; 2], DVec3, f64)> {
        let around = self.around(pixel)?;
        if around.iter().any(|i| ranges[*i] <= 0.0) {
            return None;
        }
        let [right, left, below, above] = around.map(|i| self.rays[i] * f64::from(ranges[i]));
        let sides = [right - left, below - above];
        let cross = sides[0].cross(sides[1]);
        if cross.length_squared() < 1e-24 {
            return None;
        }
        let sign = if cross.dot(self.rays[pixel]) > 0.0 { -1.0 } else { 1.0 };
        Some((around, sides, cross, sign))
    }

    /// Adds the gradient with respect to the ranges, given the gradient with respect to the normal of a pixel.
    pub fn normal_backward(&self, ranges: &[f32], pixel: usize, dnormal: DVec3, to: &mut [f32]) {
        let Some((around, sides, cross, sign)) = self.cross(ranges, pixel) else { return };
        let length = cross.length();
        let unit = cross / length;
        let dcross = (dnormal - unit * unit.dot(dnormal)) * (sign / length);
        let dsides = [sides[1].cross(dcross), dcross.cross(sides[0])];
        for (i, place) in around.into_iter().enumerate() {
            let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
            to[place] += (sign * dsides[i / 2].dot(self.rays[place])) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_kernels::random::Stream;

    #[test]
    fn gradients_agree_with_differences() {
        let camera = SurfelCamera::spherical([12, 5], [-0.4, 0.4]);
        let rays = Rays::new(&camera);
        let stream = Stream::new(1, 0, "ranges");
        let ranges: Vec<f32> = (0..60).map(|i| 4.0 + 0.3 * stream.normal::<f32>(i)).collect();
        let weight = DVec3::new(0.3, -1.1, 0.7);
        for pixel in [12, 17, 30, 47] {
            let mut gradient = vec![0.0; 60];
            rays.normal_backward(&ranges, pixel, weight, &mut gradient);
            for i in 0..60 {
                let at = |by: f32| {
                    let mut moved = ranges.clone();
                    moved[i] += by;
                    rays.normal(&moved, pixel).unwrap().dot(weight)
                };
                let slope = (at(0.01) - at(-0.01)) / 0.02;
                assert!((slope - f64::from(gradient[i])).abs() < 2e-3, "{pixel} {i}: {slope} {}", gradient[i]);
            }
        }
        assert_eq!(rays.normal(&ranges, 3), None);
    }
}
