//! Sweeps of a spinning lidar through worlds of boxes, with exact poses and surfaces.
//!
//! Everything is a function of a seed, the sweep's number and the point's: the same bits at any number of threads.

mod world;

pub use world::LidarWorld;

use std::f64::consts::{FRAC_PI_8, TAU};
use weaver_geometry::Pose;
use weaver_geometry::glam::{DQuat, DVec3};
use weaver_kernels::random::Stream;

/// A sensor that turns once in a sweep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpinningSensor {
    /// Beams above one another.
    pub rows: usize,
    /// Directions of a sweep.
    pub columns: usize,
    /// The lowest and the highest beam, radians.
    pub elevations: [f64; 2],
    /// Least and largest range, meters.
    pub range: [f64; 2],
    /// Standard deviation of ranges, meters.
    pub noise: f64,
    /// Standard deviation of a beam's direction about the one that is reported, radians: at edges, beams return now one
    /// surface, now the other.
    pub divergence: f64,
}

impl Default for SpinningSensor {
    /// 32 x 512, 22.5 degrees up and down, 1 cm, 1.5 mrad.
    fn default() -> Self {
        Self {
            rows: 32,
            columns: 512,
            elevations: [-FRAC_PI_8, FRAC_PI_8],
            range: [0.3, 80.0],
            noise: 0.01,
            divergence: 0.0015,
        }
    }
}

/// A sweep, and where it was taken.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sweep {
    /// Points in the frame that the sensor had when each was measured, `[P]`, meters.
    pub points: Vec<[f32; 3]>,
    /// When each was measured, from 0 to 1, `[P]`.
    pub times: Vec<f32>,
}

impl SpinningSensor {
    /// A sweep through a world while the sensor goes along `motion`, which maps times from 0 to 1 to poses (sensor to
    /// world). It turns to the right, from behind. A sensor at rest has the same pose at all times.
    ///
    /// ```
    /// use weaver_data::lidar::{LidarWorld, SpinningSensor};
    /// use weaver_geometry::{Pose, glam::{DMat3, DVec3}};
    /// let pose = Pose::new(DMat3::IDENTITY, DVec3::new(6.0, 0.0, 1.5));
    /// let sweep = SpinningSensor::default().sweep(&LidarWorld::room(), |_| pose, 0, 0);
    /// assert_eq!(sweep.points.len(), 32 * 512);
    /// ```
    pub fn sweep(&self, world: &LidarWorld, motion: impl Fn(f64) -> Pose, seed: u64, number: u64) -> Sweep {
        let stream = Stream::new(seed, number, "sweep");
        let [low, high] = self.elevations;
        let mut sweep = Sweep::default();
        for column in 0..self.columns {
            let time = (column as f64 + 0.5) / self.columns as f64;
            let pose = motion(time);
            let azimuth = TAU * (0.5 - time);
            for row in 0..self.rows {
                let elevation = high - (high - low) * (row as f64 + 0.5) / self.rows as f64;
                let direction =
                    DVec3::new(azimuth.cos() * elevation.cos(), azimuth.sin() * elevation.cos(), elevation.sin());
                let normal = |k: u64| stream.normal::<f64>(4 * (column * self.rows + row) as u64 + k);
                let beam = direction + self.divergence * DVec3::new(normal(0), normal(1), normal(2));
                let Some(range) = world.range(pose.translation, pose.rotation * beam.normalize()) else { continue };
                let range = range + self.noise * normal(3);
                if range >= self.range[0] && range <= self.range[1] {
                    sweep.points.push((direction * range).to_array().map(|x| x as f32));
                    sweep.times.push(time as f32);
                }
            }
        }
        sweep
    }
}

/// Poses of a closed loop around the middle of the room of [`LidarWorld::room`], `count` of them, looking ahead, 1.5 m
/// above the floor.
pub fn room_loop(count: usize) -> Vec<Pose> {
    (0..count).map(|i| ellipse(i as f64 / count as f64, [6.5, 4.5], 1.5)).collect()
}

/// Poses along the street of [`LidarWorld::street`], `step` meters apart, swaying a little, 1.8 m above the ground.
pub fn street_drive(count: usize, step: f64) -> Vec<Pose> {
    let pose = |i: usize| {
        let x = step * i as f64;
        let slope = 0.1 * (0.12 * x).cos();
        Pose::new(weaver_geometry::so3::exp(DVec3::Z * slope.atan()), DVec3::new(x, 0.1 / 0.12 * (0.12 * x).sin(), 1.8))
    };
    (0..count).map(pose).collect()
}

fn ellipse(turn: f64, [a, b]: [f64; 2], height: f64) -> Pose {
    let (sin, cos) = (TAU * turn).sin_cos();
    let heading = (b * cos).atan2(-a * sin);
    Pose::new(weaver_geometry::so3::exp(DVec3::Z * heading), DVec3::new(a * cos, b * sin, height))
}

/// A pose between two, by a straight line and a turn of constant speed.
pub fn between(a: &Pose, b: &Pose, t: f64) -> Pose {
    let quat = |p: &Pose| DQuat::from_mat3(&p.rotation);
    let q = quat(a).slerp(quat(b), t).normalize();
    Pose::from_wxyz([q.w, q.x, q.y, q.z], a.translation.lerp(b.translation, t))
}
