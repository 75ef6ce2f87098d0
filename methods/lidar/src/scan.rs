//! Scans: points around a sensor.

use crate::{Error, Result};
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Pose, se3};
use weaver_kernels::nearest_neighbors::nearest_neighbors;

/// Largest angle between directions of the same pixel or of neighbors, radians.
const NEIGHBOR: f64 = 0.1 * std::f64::consts::PI / 180.0;

/// The points of one sweep in the sensor's frame: x forward, y left, z up, meters.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scan {
    /// Points `[P]`.
    pub points: Vec<[f32; 3]>,
    /// Measurement time of each point, as a fraction of the sweep from 0 to 1; empty if unknown.
    pub times: Vec<f32>,
}

impl Scan {
    /// A scan without times.
    pub fn new(points: Vec<[f32; 3]>) -> Self {
        Self { points, times: Vec::new() }
    }

    /// The points with a range in `[near, far]`, the number of dropped points, and the number of nonfinite ones among
    /// these.
    pub fn within(&self, [near, far]: [f64; 2]) -> (Self, [usize; 2]) {
        let mut kept = Self::default();
        let mut not_finite = 0;
        for (i, p) in self.points.iter().enumerate() {
            if !p.iter().all(|x| x.is_finite()) {
                not_finite += 1;
                continue;
            }
            let range = vector(p).length();
            if range >= near && range <= far {
                kept.points.push(*p);
                kept.times.extend(self.times.get(i));
            }
        }
        let dropped = self.points.len() - kept.points.len();
        (kept, [dropped, not_finite])
    }

    /// The points as seen from the sensor's position at the beginning of the sweep, if it moved by `motion` (from the
    /// frame at its end to the frame at its beginning) at constant speed and turn. A scan without times stays as it is.
    ///
    /// ```
    /// use weaver_geometry::{Pose, glam::{DMat3, DVec3}};
    /// let scan = weaver_lidar::Scan { points: vec![[5.0, 0.0, 0.0]], times: vec![0.5] };
    /// let ahead = Pose::new(DMat3::IDENTITY, DVec3::X);
    /// assert_eq!(scan.deskewed(&ahead).points, [[5.5, 0.0, 0.0]]);
    /// ```
    #[must_use]
    pub fn deskewed(&self, motion: &Pose) -> Self {
        if self.times.len() != self.points.len() {
            return self.clone();
        }
        let (velocity, turn) = se3::log(motion);
        let moved = |(p, t): (&[f32; 3], &f32)| {
            let t = f64::from(*t);
            se3::exp(velocity * t, turn * t).apply(vector(p)).to_array().map(|x| x as f32)
        };
        let points = self.points.iter().zip(&self.times).map(moved).collect();
        Self { points, times: self.times.clone() }
    }

    /// The lowest and the highest elevation, radians.
    pub fn elevations(&self) -> [f64; 2] {
        let elevation = |p: &[f32; 3]| {
            let p = vector(p);
            p.z.atan2(p.x.hypot(p.y))
        };
        let bounds = |[low, high]: [f64; 2], e: f64| [low.min(e), high.max(e)];
        self.points.iter().map(elevation).fold([f64::INFINITY, f64::NEG_INFINITY], bounds)
    }

    /// The share of points with another direction within 0.1 degrees, and the share of these whose range differs by
    /// more than 1 m from that neighbor.
    ///
    /// A scan from one place has the latter only at edges: a few percent. A cloud merged from several places has tens
    /// of percent.
    pub fn overlap(&self) -> [f64; 2] {
        let directions: Vec<f64> = self.points.iter().flat_map(|p| vector(p).normalize_or_zero().to_array()).collect();
        let mut neighbors = vec![0; 2 * self.points.len()];
        nearest_neighbors(&directions, 1, &mut neighbors);
        let (mut near, mut differ) = (0, 0);
        for (i, pair) in neighbors.chunks_exact(2).enumerate() {
            let j = pair[1] as usize;
            let direction = |n: usize| DVec3::from_slice(&directions[3 * n..]);
            if i != j && direction(i).distance(direction(j)) < NEIGHBOR {
                near += 1;
                let ranges = [i, j].map(|n| vector(&self.points[n]).length());
                differ += usize::from((ranges[0] - ranges[1]).abs() > 1.0);
            }
        }
        let share = |part: usize, of: usize| part as f64 / of.max(1) as f64;
        [share(near, self.points.len()), share(differ, near)]
    }

    /// Checks that the points were seen from one place, as a range image requires.
    ///
    /// # Errors
    /// [`Error::NotOneScan`] if a tenth of the points have a neighbor within 0.1 degrees and over 30 % of these differ
    /// from it by more than 1 m.
    pub fn check_single(&self, of: &str) -> Result<()> {
        let [near, differ] = self.overlap();
        match near >= 0.1 && differ > 0.3 {
            true => Err(Error::NotOneScan { of: of.into(), percent: 100.0 * differ }),
            false => Ok(()),
        }
    }
}

/// A point in double precision.
pub(crate) fn vector(p: &[f32; 3]) -> DVec3 {
    DVec3::new(p[0].into(), p[1].into(), p[2].into())
}
