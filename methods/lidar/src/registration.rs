//! Registration of points to a tree of patches, and of ranges to a range image.

use crate::normal_equations::{NormalEquations, Residual, moved};
use crate::{PatchTree, RangeReference};
use weaver_geometry::Pose;
use weaver_geometry::glam::{DMat3, DVec3};

/// The result of a registration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Registered {
    /// The motion from the query's frame to the reference's.
    pub pose: Pose,
    /// The normal equations of the last step.
    pub equations: NormalEquations,
    /// Share of the query in the last step.
    pub fitness: f64,
}

/// Reason of a failed registration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Lost {
    /// Too few matches to determine a motion.
    #[error("fewer than 20 matches")]
    FewMatches,
    /// Too small a share of the scan fits, in percent.
    #[error("only {0} % of it fits")]
    LittleFits(u32),
    /// The scan has no range image.
    #[error("the scan cannot be used")]
    NoScan,
    /// An undetermined direction.
    #[error("the scene does not determine the motion")]
    Singular,
}

/// Least number of matches.
const LEAST: usize = 20;

/// Rules for matching points with patches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeometricSettings {
    /// Steps.
    pub steps: usize,
    /// Largest distance of a match: the first in meters, the second for each meter of range.
    pub gate: [f64; 2],
    /// Factor of the gate in the first step; falls to 1 in half of the steps.
    pub widened: f64,
}

impl Default for GeometricSettings {
    fn default() -> Self {
        Self { steps: 10, gate: [0.2, 0.02], widened: 1.0 }
    }
}

/// Registers points to a tree by distances from its planes (point to plane), from the motion `start`.
///
/// e = n.(Xq - m) for the patch m, n of the cell that holds Xq, matched within 0.2 m + 0.02 |q|; weights min(1,
/// sqrt(0.8) / |e|) (1 - thickness / 0.2)^2.
///
/// # Errors
/// [`Lost`] if matches do not determine the motion.
pub fn register(
    query: &[DVec3],
    tree: &PatchTree,
    start: &Pose,
    settings: &GeometricSettings,
) -> Result<Registered, Lost> {
    let kernel = 0.8_f64.sqrt();
    let residual = |x: &Pose, wider: f64, q: DVec3| {
        let p = x.apply(q);
        let patch = tree.patch(p)?;
        let offset = p - patch.point;
        if offset.length() > wider * (settings.gate[0] + settings.gate[1] * q.length()) {
            return None;
        }
        let error = patch.normal.dot(offset);
        let planar = (1.0 - patch.thickness / 0.2).max(0.0);
        let weight = planar * planar * (kernel / error.abs()).min(1.0);
        let n = x.rotation.transpose() * patch.normal;
        Some(Residual { error, gradient: [n, q.cross(n)], weight })
    };
    let half = (settings.steps / 2).max(1);
    descend(start, settings.steps, query.len(), |x, step| {
        let wider = 1.0 + (settings.widened - 1.0) * (1.0 - step as f64 / half as f64).max(0.0);
        NormalEquations::sum(query.len(), |i| residual(x, wider, query[i]))
    })
}

/// Registers points to a range image by their ranges, from the motion `start`; `query` are the points of a range
/// image's pixels.
///
/// e = sqrt(5) (|Xq| - r(u, v)) for the nearest point in each pixel, bilinear in the reference; left out are e^2 > 0.8
/// and pixels at which the reference changes by half a meter or more to the next, with their neighbors.
///
/// # Errors
/// [`Lost`] if ranges do not determine the motion.
pub fn register_ranges(
    query: &[DVec3],
    reference: &RangeReference,
    start: &Pose,
    steps: usize,
) -> Result<Registered, Lost> {
    let camera = &reference.camera;
    let root = 5.0_f64.sqrt();
    descend(start, steps, query.len(), |x, _| {
        let nearest = reference.nearest(query, x);
        NormalEquations::sum(query.len(), |i| {
            let q = query[i];
            let p = x.apply(q);
            let at = camera.project(p);
            if nearest[reference.pixel(at)?] != i as u32 {
                return None;
            }
            let (range, slope) = reference.sample(at)?;
            let distance = p.length();
            let error = root * (distance - range);
            if error * error > 0.8 {
                return None;
            }
            let [du, dv] = camera.project_gradients(p);
            let by_point = root * (p / distance - du * slope.x - dv * slope.y);
            let n = x.rotation.transpose() * by_point;
            Some(Residual { error, gradient: [n, q.cross(n)], weight: 1.0 })
        })
    })
}

/// Gauss-Newton steps.
fn descend(
    start: &Pose,
    steps: usize,
    of: usize,
    equations: impl Fn(&Pose, usize) -> NormalEquations,
) -> Result<Registered, Lost> {
    let mut pose = *start;
    let mut last = NormalEquations::default();
    for step in 0..steps {
        last = equations(&pose, step);
        if last.count < LEAST {
            return Err(Lost::FewMatches);
        }
        let step = last.solve().ok_or(Lost::Singular)?;
        pose = moved(&pose, step);
        if !pose.translation.is_finite() || pose.rotation == DMat3::ZERO {
            return Err(Lost::Singular);
        }
    }
    Ok(Registered { pose, equations: last, fitness: last.count as f64 / of.max(1) as f64 })
}
