//! The direction up, by a drone's gimbal, a flat ground, or the horizons of photos.

use super::FEW;
use crate::EstimatedPhotos;
use weaver_geometry::Pose;
use weaver_geometry::glam::DVec3;
use weaver_kernels::dense::symmetric_eigen;
use weaver_kernels::order::median_mean;
use weaver_kernels::random::Stream;

/// Ratio of the second to the smallest spread of horizontal axes from which they determine a plane.
const TURNED: f64 = 8.0;
/// Part of the axes that the second spread has at least, for the same.
const SPREAD: f64 = 0.02;
/// Length of the mean of photos' own up from which it tells which side is up.
const UPRIGHT: f64 = 0.2;
/// Rounds of robust averages.
const ROUNDS: usize = 20;
/// Slope, radians, at which a photo that is held at an angle has half its weight.
const SLANT: f64 = 0.05;
/// Least expected error of a vertical, and of one by photos that look in one direction; radians.
const LEAST: f64 = 0.01;
const UNTURNED: f64 = 0.3;
/// Planes that are tried.
const DRAWS: u64 = 2000;
/// Distance of points from the plane that they are on, over the median distance of cameras from points.
const FLAT: f64 = 0.01;
/// Part of the points that a ground has, and the part that is below it, at most.
const GROUND: [f64; 2] = [0.2, 0.1];
/// Cosines of the angle between the ground's vertical and that of the cameras: where horizons determine it, and where
/// cameras look in one direction.
const NEAR: [f64; 2] = [0.966, 0.7];

/// The source of a vertical.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Vertical {
    Gimbal,
    Ground,
    Cameras,
}

impl Vertical {
    pub fn name(self) -> &'static str {
        match self {
            Self::Gimbal => "gimbal",
            Self::Ground => "ground",
            Self::Cameras => "cameras",
        }
    }
}

/// The direction up in the world of the estimate.
#[derive(Clone, Copy, Debug)]
pub(super) struct Up {
    pub direction: DVec3,
    pub source: Vertical,
    /// Expected error, radians.
    pub deviation: f64,
    /// True if the horizontal axes of photos point in several directions.
    turned: bool,
}

impl Up {
    /// Finds it by gimbals, which have the directions by photos, or by horizons; `None` if nothing determines it.
    pub fn of(found: &EstimatedPhotos, gimbal: &[DVec3]) -> Option<Self> {
        if let Some(direction) = average(gimbal) {
            return Some(Self { direction, source: Vertical::Gimbal, deviation: LEAST, turned: true });
        }
        let poses: Vec<Pose> = found.poses().iter().map(|(_, pose)| *pose).collect();
        let (direction, turned) = of_cameras(&poses)?;
        let slopes = poses.iter().map(|pose| pose.rotation.row(0).dot(direction).powi(2)).sum::<f64>();
        let deviation = slopes.sqrt() / poses.len() as f64;
        let deviation = if turned { deviation.max(LEAST) } else { UNTURNED };
        Some(Self { direction, source: Vertical::Cameras, deviation, turned })
    }

    /// The vertical of the ground, if the scene has one that horizons agree with: floors and tables are more level than
    /// photos, land is not.
    pub fn by_ground(self, found: &EstimatedPhotos) -> Self {
        if self.source == Vertical::Gimbal {
            return self;
        }
        let poses: Vec<Pose> = found.poses().iter().map(|(_, pose)| *pose).collect();
        let ground = ground(&poses, &found.firm_points(), self.direction, self.turned);
        ground.map_or(self, |direction| Self { direction, source: Vertical::Ground, ..self })
    }
}

/// The robust mean of directions.
fn average(directions: &[DVec3]) -> Option<DVec3> {
    let mut mean = directions.iter().sum::<DVec3>().try_normalize()?;
    for _ in 0..ROUNDS {
        let weight = |d: &DVec3| 1.0 / (1.0 + (d.distance(mean) / SLANT).powi(2));
        mean = directions.iter().map(|d| *d * weight(d)).sum::<DVec3>().try_normalize()?;
    }
    Some(mean)
}

/// Up by the horizontal axes of photos, which people and drones hold level; true if the axes point in several
/// directions, so that they determine a plane.
fn of_cameras(poses: &[Pose]) -> Option<(DVec3, bool)> {
    let n = poses.len() as f64;
    let right: Vec<DVec3> = poses.iter().map(|pose| pose.rotation.row(0)).collect();
    let mean_up = -poses.iter().map(|pose| pose.rotation.row(1)).sum::<DVec3>() / n;
    let mean_ahead = poses.iter().map(|pose| pose.rotation.row(2)).sum::<DVec3>() / n;
    let (values, normal) = smallest(&right, &vec![1.0; right.len()]);
    if values[1] > TURNED * values[0] && values[1] > SPREAD * n {
        let mut up = normal;
        for _ in 0..ROUNDS {
            let weights: Vec<f64> = right.iter().map(|x| 1.0 / (1.0 + (x.dot(up) / SLANT).powi(2))).collect();
            up = smallest(&right, &weights).1;
        }
        // Photos that look straight down have no up of their own: it is where they do not look.
        let sign = if mean_up.dot(up).abs() > UPRIGHT { mean_up.dot(up) } else { -mean_ahead.dot(up) };
        return Some((if sign < 0.0 { -up } else { up }, true));
    }
    let along = right.iter().sum::<DVec3>().normalize_or_zero();
    let up = mean_up - along * mean_up.dot(along);
    (up.length() > UPRIGHT).then(|| (up.normalize(), false))
}

/// The two smaller sums of squares along principal axes of some directions, ascending, and the axis of the smallest.
fn smallest(directions: &[DVec3], weights: &[f64]) -> ([f64; 2], DVec3) {
    let mut matrix = [0.0; 9];
    for (d, weight) in directions.iter().zip(weights) {
        let d = d.to_array();
        (0..9).for_each(|i| matrix[i] += weight * d[i / 3] * d[i % 3]);
    }
    let mut vectors = [0.0; 9];
    symmetric_eigen(&mut matrix, &mut vectors, 12, |m| m[1] == 0.0 && m[2] == 0.0 && m[5] == 0.0);
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| matrix[4 * a].total_cmp(&matrix[4 * b]));
    let axis = DVec3::from_slice(&vectors[3 * order[0]..][..3]);
    ([matrix[4 * order[0]], matrix[4 * order[1]]], axis.normalize_or_zero())
}

/// The vertical of a plane that many points are on, few below, and all cameras above.
fn ground(poses: &[Pose], points: &[DVec3], up: DVec3, turned: bool) -> Option<DVec3> {
    if points.len() < FEW {
        return None;
    }
    let centers: Vec<DVec3> = poses.iter().map(Pose::center).collect();
    let middle = centers.iter().sum::<DVec3>() / centers.len() as f64;
    let depth = median_mean(&mut points.iter().map(|p| p.distance(middle)).collect::<Vec<_>>())?;
    let flat = FLAT * depth;
    let near = if turned { NEAR[0] } else { NEAR[1] };
    let rng = Stream::new(0, 0, "ground");
    let plane = |draw: u64| {
        let rng = rng.fork(draw);
        let [a, b, c] = [0, 1, 2].map(|i| points[rng.below(i, points.len())]);
        let normal = (b - a).cross(c - a).try_normalize()?;
        let normal = if normal.dot(up) < 0.0 { -normal } else { normal };
        (normal.dot(up) > near && centers.iter().all(|center| (*center - a).dot(normal) > 0.0)).then_some((a, normal))
    };
    let heights = |(a, normal): &(DVec3, DVec3)| points.iter().map(|p| (*p - *a).dot(*normal)).collect::<Vec<f64>>();
    let count = |plane: &(DVec3, DVec3)| {
        let heights = heights(plane);
        let below = heights.iter().filter(|h| **h < -3.0 * flat).count();
        let on = heights.iter().filter(|h| h.abs() < flat).count();
        let n = points.len() as f64;
        (on as f64 > GROUND[0] * n && (below as f64) < GROUND[1] * n).then_some(on)
    };
    let planes = (0..DRAWS).filter_map(plane).filter_map(|plane| Some((count(&plane)?, plane)));
    // Of equal ones the first.
    let (_, mut best) = planes.reduce(|best, next| if next.0 > best.0 { next } else { best })?;
    for _ in 0..5 {
        let on: Vec<DVec3> =
            points.iter().zip(heights(&best)).filter(|(_, height)| height.abs() < flat).map(|(p, _)| *p).collect();
        let middle = on.iter().sum::<DVec3>() / on.len().max(1) as f64;
        let around: Vec<DVec3> = on.iter().map(|p| *p - middle).collect();
        let normal = smallest(&around, &vec![1.0; around.len()]).1;
        best = (middle, if normal.dot(up) < 0.0 { -normal } else { normal });
    }
    (best.1.dot(up) > near).then_some(best.1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_geometry::trajectory::look_at;

    /// Around a table, with y down: cameras are turned by two degrees about their axes, as people hold them.
    #[test]
    fn horizons_and_a_table_tell_up() {
        let rng = Stream::new(1, 0, "test");
        let poses: Vec<Pose> = (0..24)
            .map(|i| {
                let a = f64::from(i) * 0.26;
                let pose = look_at(DVec3::new(2.0 * a.cos(), -1.0, 2.0 * a.sin()), DVec3::ZERO, DVec3::NEG_Y);
                let roll = weaver_geometry::glam::DMat3::from_rotation_z(0.035 * rng.normal::<f64>(i as u64));
                Pose::new(roll * pose.rotation, roll * pose.translation)
            })
            .collect();
        let (up, turned) = of_cameras(&poses).unwrap();
        assert!(turned && up.angle_between(DVec3::NEG_Y).to_degrees() < 1.5, "{up}");
        let point = |i: u64| {
            let height = if i.is_multiple_of(2) { 0.0 } else { -0.5 * rng.uniform::<f64>(3 * i + 2) };
            DVec3::new(
                rng.uniform::<f64>(3 * i) - 0.5,
                height + 0.002 * rng.normal::<f64>(i),
                rng.uniform::<f64>(3 * i + 1) - 0.5,
            )
        };
        let points: Vec<DVec3> = (0..2000).map(point).collect();
        let up = ground(&poses, &points, up, turned).unwrap();
        assert!(up.angle_between(DVec3::NEG_Y).to_degrees() < 0.2, "{up}");
    }

    /// A drone that looks straight down and flies to and fro.
    #[test]
    fn photos_from_above_have_up_behind_them() {
        let poses: Vec<Pose> = (0..12)
            .map(|i| {
                let ahead = if i % 2 == 0 { DVec3::X } else { DVec3::NEG_X };
                let side = if i % 3 == 0 { DVec3::Z } else { ahead };
                look_at(DVec3::new(f64::from(i), -50.0, 0.0), DVec3::new(f64::from(i), 0.0, 0.0), side)
            })
            .collect();
        let (up, turned) = of_cameras(&poses).unwrap();
        assert!(turned && up.distance(DVec3::NEG_Y) < 1e-6, "{up}");
    }
}
