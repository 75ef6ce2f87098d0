//! A hall with a box in it, scanned by rays.

use weaver_geometry::Pose;
use weaver_geometry::glam::DVec3;
use weaver_lidar::Scan;

/// Boxes: the hall from the inside, and obstacles, by center and half sizes.
const OBSTACLES: [[DVec3; 2]; 3] = [
    [DVec3::new(4.0, 2.0, -0.7), DVec3::new(0.6, 0.8, 0.8)],
    [DVec3::new(-3.0, -3.0, 0.0), DVec3::new(0.5, 0.4, 1.5)],
    [DVec3::new(-5.0, 3.0, -1.0), DVec3::new(1.0, 0.7, 0.5)],
];
pub const HALF: DVec3 = DVec3::new(8.0, 5.0, 1.5);

/// The range of a ray.
pub fn range(origin: DVec3, d: DVec3) -> f64 {
    let inside = |axis: usize| (HALF[axis] * d[axis].signum() - origin[axis]) / d[axis];
    let mut nearest = (0..3).filter(|axis| d[*axis] != 0.0).map(inside).fold(f64::INFINITY, f64::min);
    for [center, half] in OBSTACLES {
        let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
        for axis in 0..3 {
            let ends = [-1.0, 1.0].map(|side| (center[axis] + side * half[axis] - origin[axis]) / d[axis]);
            enter = enter.max(ends[0].min(ends[1]));
            leave = leave.min(ends[0].max(ends[1]));
        }
        if enter > 0.0 && enter <= leave {
            nearest = nearest.min(enter);
        }
    }
    nearest
}

/// `rows` x `columns` rays, up and down 0.5 radians.
pub fn scan(pose: &Pose, rows: usize, columns: usize) -> Scan {
    Scan::new(sweep(|_| *pose, rows, columns).points)
}

/// A scan of a moving sensor, from time 0 to 1.
pub fn sweep(pose: impl Fn(f64) -> Pose, rows: usize, columns: usize) -> Scan {
    let time = |i: usize| ((i % columns) as f64 + 0.3) / columns as f64;
    let point = |i: usize| {
        let (pose, az) = (pose(time(i)), time(i) * std::f64::consts::TAU);
        let el = ((i / columns) as f64 + 0.5) / rows as f64 - 0.5;
        let d = DVec3::new(az.cos() * el.cos(), az.sin() * el.cos(), el.sin());
        (d * range(pose.translation, pose.rotation * d)).to_array().map(|x| x as f32)
    };
    let all = 0..rows * columns;
    Scan { points: all.clone().map(point).collect(), times: all.map(|i| time(i) as f32).collect() }
}
