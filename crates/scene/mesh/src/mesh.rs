//! Triangles.

use weaver_geometry::glam::DVec3;
use weaver_kernels::random::Stream;

/// A surface of triangles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Vertices `[N]`, meters.
    pub vertices: Vec<[f32; 3]>,
    /// Indices of corners, counterclockwise from outside, `[M]`.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// The corners of a triangle.
    pub fn corners(&self, triangle: [u32; 3]) -> [DVec3; 3] {
        triangle.map(|i| DVec3::from_array(self.vertices[i as usize].map(f64::from)))
    }

    /// The area, square meters.
    pub fn area(&self) -> f64 {
        self.triangles.iter().map(|t| area(self.corners(*t))).sum()
    }

    /// Points on the surface, `per_area` of them on a square meter on average, the same ones for the same seed.
    /// Triangles with a corner that is not finite have none.
    pub fn sample(&self, per_area: f64, seed: u64) -> Vec<[f32; 3]> {
        let stream = Stream::new(seed, 0, "mesh");
        let mut points = Vec::new();
        let mut due = 0.0;
        let mut drawn = 0;
        for triangle in &self.triangles {
            let [a, b, c] = self.corners(*triangle);
            let own = per_area * area([a, b, c]);
            due += if own.is_finite() { own } else { 0.0 };
            while due >= 1.0 {
                due -= 1.0;
                let (u, v) = (stream.uniform::<f64>(2 * drawn).sqrt(), stream.uniform::<f64>(2 * drawn + 1));
                drawn += 1;
                let p = a * (1.0 - u) + b * (u * (1.0 - v)) + c * (u * v);
                points.push(p.to_array().map(|x| x as f32));
            }
        }
        points
    }
}

fn area([a, b, c]: [DVec3; 3]) -> f64 {
    0.5 * (b - a).cross(c - a).length()
}
