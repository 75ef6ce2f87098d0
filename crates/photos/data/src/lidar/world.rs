//! Worlds of boxes and columns.

use std::f64::consts::TAU;
use weaver_geometry::glam::DVec3;
use weaver_kernels::random::Stream;

/// Sides of a column in its mesh.
const SIDES: usize = 48;

/// A world that a lidar moves through: a room or the ground, with boxes and round columns on it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LidarWorld {
    /// Opposite corners of a room that is seen from the inside; else there is the ground z = 0.
    pub room: Option<[DVec3; 2]>,
    /// Opposite corners, the smaller numbers first.
    pub boxes: Vec<[DVec3; 2]>,
    /// Middles at the foot, radii, heights.
    pub columns: Vec<(DVec3, f64, f64)>,
}

/// Triangles of a surface.
pub type Triangles = (Vec<[f32; 3]>, Vec<[u32; 3]>);

impl LidarWorld {
    /// A room of 20 x 15 x 6 m with three boxes and two columns.
    pub fn room() -> Self {
        let on_floor = |x: f64, y: f64, size: [f64; 3]| {
            let [a, b, c] = size;
            [DVec3::new(x - a / 2.0, y - b / 2.0, 0.0), DVec3::new(x + a / 2.0, y + b / 2.0, c)]
        };
        Self {
            room: Some([DVec3::new(-10.0, -7.5, 0.0), DVec3::new(10.0, 7.5, 6.0)]),
            boxes: vec![
                on_floor(0.3, -0.2, [2.4, 1.6, 2.2]),
                on_floor(8.6, 6.0, [1.6, 1.8, 3.0]),
                on_floor(-8.4, -5.9, [2.2, 1.4, 1.2]),
            ],
            columns: vec![(DVec3::new(3.2, 1.6, 0.0), 0.35, 6.0), (DVec3::new(-3.4, -1.2, 0.0), 0.45, 6.0)],
        }
    }

    /// A street of 120 m along x, with houses, gaps between them, parked cars and poles.
    pub fn street(seed: u64) -> Self {
        let stream = Stream::new(seed, 0, "street");
        let number = |i: u64, low: f64, high: f64| low + (high - low) * stream.uniform::<f64>(i);
        let mut world = Self::default();
        for side in [-1.0, 1.0] {
            let mut x = -20.0;
            while x < 140.0 {
                let i = 10 * (world.boxes.len() as u64);
                let (width, depth, height) = (number(i, 6.0, 14.0), number(i + 1, 6.0, 10.0), number(i + 2, 4.0, 12.0));
                let front = number(i + 3, 6.5, 9.0);
                let sides = [side * front, side * (front + depth)];
                world.boxes.push([
                    DVec3::new(x, sides[0].min(sides[1]), 0.0),
                    DVec3::new(x + width, sides[0].max(sides[1]), height),
                ]);
                let car = x + number(i + 4, 0.0, 5.0);
                let lane = side * number(i + 5, 3.6, 4.2);
                world.boxes.push([
                    DVec3::new(car, lane - 0.9, 0.0),
                    DVec3::new(car + 4.2, lane + 0.9, number(i + 6, 1.4, 1.9)),
                ]);
                world.columns.push((DVec3::new(x + width, side * 5.6, 0.0), 0.12, 7.0));
                x += width + number(i + 7, 0.5, 4.0);
            }
        }
        world
    }

    /// The distance along a direction of length 1 to the nearest surface.
    pub fn range(&self, from: DVec3, direction: DVec3) -> Option<f64> {
        let outer = match self.room {
            Some(corners) => inside(corners, from, direction),
            None if direction.z < 0.0 && from.z > 0.0 => -from.z / direction.z,
            None => f64::INFINITY,
        };
        let boxes = self.boxes.iter().filter_map(|corners| outside(*corners, from, direction));
        let columns = self.columns.iter().filter_map(|column| round(*column, from, direction));
        let nearest = boxes.chain(columns).fold(outer, f64::min);
        nearest.is_finite().then_some(nearest)
    }

    /// All surfaces as triangles, whose normals point to where the sensor may be. The ground reaches 200 m.
    pub fn mesh(&self) -> Triangles {
        let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
        let mut quad = |corners: [DVec3; 4]| {
            let first = vertices.len() as u32;
            vertices.extend(corners.map(|p| p.to_array().map(|x| x as f32)));
            triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        };
        let mut cuboid = |[low, high]: [DVec3; 2], inward: bool| {
            for axis in 0..3 {
                for (side, at) in [(false, low[axis]), (true, high[axis])] {
                    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                    let mut corners = [[low, low], [high, low], [high, high], [low, high]].map(|[a, b]| {
                        let mut p = DVec3::ZERO;
                        (p[axis], p[u], p[v]) = (at, a[u], b[v]);
                        p
                    });
                    if side == inward {
                        corners.reverse();
                    }
                    quad(corners);
                }
            }
        };
        if let Some(room) = self.room {
            cuboid(room, true);
        }
        self.boxes.iter().for_each(|corners| cuboid(*corners, false));
        for (foot, radius, height) in &self.columns {
            let at = |i: usize, z: f64| {
                let (sin, cos) = (TAU * i as f64 / SIDES as f64).sin_cos();
                *foot + DVec3::new(radius * cos, radius * sin, z)
            };
            (0..SIDES).for_each(|i| quad([at(i, 0.0), at(i + 1, 0.0), at(i + 1, *height), at(i, *height)]));
        }
        if self.room.is_none() {
            let at = |x: f64, y: f64| DVec3::new(x, y, 0.0);
            quad([at(-200.0, -200.0), at(200.0, -200.0), at(200.0, 200.0), at(-200.0, 200.0)]);
        }
        (vertices, triangles)
    }
}

/// The distance at which a ray leaves a box that it begins in.
fn inside([low, high]: [DVec3; 2], from: DVec3, d: DVec3) -> f64 {
    let to = |axis: usize| ((if d[axis] > 0.0 { high } else { low })[axis] - from[axis]) / d[axis];
    (0..3).filter(|axis| d[*axis] != 0.0).map(to).fold(f64::INFINITY, f64::min)
}

/// The distance at which a ray enters a box.
fn outside([low, high]: [DVec3; 2], from: DVec3, d: DVec3) -> Option<f64> {
    let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
    for axis in 0..3 {
        if d[axis] == 0.0 {
            if from[axis] < low[axis] || from[axis] > high[axis] {
                return None;
            }
            continue;
        }
        let ends = [low, high].map(|corner| (corner[axis] - from[axis]) / d[axis]);
        enter = enter.max(ends[0].min(ends[1]));
        leave = leave.min(ends[0].max(ends[1]));
    }
    (enter > 0.0 && enter <= leave).then_some(enter)
}

/// The distance at which a ray meets the side of a column.
fn round((foot, radius, height): (DVec3, f64, f64), from: DVec3, d: DVec3) -> Option<f64> {
    let offset = from - foot;
    let (a, b) = (d.x * d.x + d.y * d.y, offset.x * d.x + offset.y * d.y);
    let root = b * b - a * (offset.x * offset.x + offset.y * offset.y - radius * radius);
    if a == 0.0 || root < 0.0 {
        return None;
    }
    let t = (-b - root.sqrt()) / a;
    let z = offset.z + t * d.z;
    (t > 0.0 && (0.0..=height).contains(&z)).then_some(t)
}
