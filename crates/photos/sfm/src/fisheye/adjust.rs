//! Adjustment of fisheye cameras, their lens and points, in pixels of the fisheye.

use super::lens::{FisheyeLens, NUMBERS};
use crate::bundle::{Observation, TWIST};
use crate::evidence::EXACT;
use weaver_geometry::glam::{DMat3, DVec2, DVec3};
use weaver_geometry::{Pose, se3};
use weaver_kernels::dense::{cholesky, cholesky_solve};
use weaver_kernels::order::median_high;

/// Scales of the robust loss, in deviations, one adjustment after the other; observations off by more than `FARTHEST`
/// times a scale are then left out.
const SCALES: [f64; 3] = [8.0, 2.0, 1.0];
const FARTHEST: f64 = 3.0;
/// Steps of an adjustment, the relative fall of the cost that ends it, and the damping of its first step.
const STEPS: usize = 20;
const CONVERGED: f64 = 1e-5;
const DAMPING: f64 = 1e-5;
/// The most damping: beyond, no step lowers the cost.
const LARGEST: f64 = 1e9;
/// Expected sizes of the numbers of a lens beside its first guess: they hold those that photos do not determine.
const EXPECTED: [f64; NUMBERS] = [0.5, 0.02, 0.02, 0.2, 0.1, 0.05, 0.02];
/// A point that a camera cannot see costs as much as one that is off by so many scales.
const UNSEEN: f64 = 100.0;
/// Photos and observations that determine a lens, at least.
const FEWEST: [usize; 2] = [3, 100];

/// A point seen in a fisheye photo.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sight {
    pub photo: usize,
    pub point: usize,
    pub pixel: DVec2,
    pub deviation: f64,
}

/// Fisheye cameras of one lens, and the points that they see; sights ascend by point.
#[derive(Clone, Debug)]
pub(super) struct Adjustment {
    pub lens: FisheyeLens,
    /// `None` for photos without a place.
    pub poses: Vec<Option<Pose>>,
    pub points: Vec<DVec3>,
    pub sights: Vec<Sight>,
}

/// The normal equations, points eliminated: the lens, then the cameras.
struct Equations {
    matrix: Vec<f64>,
    right: Vec<f64>,
    points: Vec<Eliminated>,
}

/// A point that is eliminated: the inverse of its damped matrix, its right side, and its couplings with places among
/// the unknowns.
type Eliminated = (DMat3, DVec3, Vec<(usize, DVec3)>);

impl Adjustment {
    /// Adjusts all; `false`, and nothing is changed, if there are too few photos or observations.
    pub fn run(&mut self) -> bool {
        let placed = self.poses.iter().flatten().count();
        if placed < FEWEST[0] || self.sights.len() < FEWEST[1] {
            return false;
        }
        let first = self.lens;
        for scale in SCALES {
            self.descend(scale, &first);
            self.prune(FARTHEST * scale);
        }
        true
    }

    /// The residual of each sight, pixels; infinite where the camera cannot see the point.
    fn errors(&self) -> Vec<f64> {
        let error = |sight: &Sight| {
            let at = self.poses[sight.photo].and_then(|pose| self.lens.project(pose.apply(self.points[sight.point])));
            at.map_or(f64::INFINITY, |at| at.distance(sight.pixel))
        };
        self.sights.iter().map(error).collect()
    }

    pub fn median_error(&self) -> f64 {
        median_high(&mut self.errors()).unwrap_or(f64::NAN)
    }

    /// The exactly fitting part of the observations.
    pub fn support(&self) -> f64 {
        let fit = |(error, sight): (f64, &Sight)| (1.0 - (error / (EXACT * sight.deviation)).powi(2)).max(0.0);
        self.errors().into_iter().zip(&self.sights).map(fit).sum()
    }

    /// The standard deviation of the logarithm of the focal length, as far as the noise of observations makes it; not a
    /// number if nothing determines it.
    pub fn focal_deviation(&self) -> f64 {
        let errors = self.errors();
        let each = errors.iter().zip(&self.sights).filter(|(error, _)| error.is_finite());
        let squares: f64 = each.map(|(error, sight)| (error / sight.deviation).powi(2)).sum();
        let unknowns = NUMBERS + TWIST * self.poses.iter().flatten().count() + 3 * self.points.len();
        let left = 2.0 * self.sights.len() as f64 - unknowns as f64;
        // The scale of the world is held by next to nothing, and has no part in a focal length.
        let Some(Equations { mut matrix, right, .. }) = self.equations(f64::INFINITY, &self.lens, 1e-9) else {
            return f64::NAN;
        };
        let n = right.len();
        let mut column: Vec<f64> = (0..n).map(|i| f64::from(i == 0)).collect();
        if left <= 0.0 || !cholesky(&mut matrix, n, n) {
            return f64::NAN;
        }
        cholesky_solve(&matrix, &mut column);
        (column[0] * squares / left).sqrt()
    }

    /// Leaves out sights with larger residuals than this, in deviations, and points that fewer than two photos see.
    fn prune(&mut self, farthest: f64) {
        let errors = self.errors();
        let mut errors = errors.iter();
        self.sights.retain(|sight| errors.next().is_some_and(|error| *error <= farthest * sight.deviation));
        let kept: Vec<Vec<Sight>> =
            self.sights.chunk_by(|a, b| a.point == b.point).filter(|seen| seen.len() > 1).map(<[_]>::to_vec).collect();
        self.points = kept.iter().map(|seen| self.points[seen[0].point]).collect();
        let numbered = kept.into_iter().enumerate();
        self.sights = numbered.flat_map(|(point, seen)| seen.into_iter().map(move |s| Sight { point, ..s })).collect();
    }

    /// The observations of the points.
    pub fn observations(&self) -> Vec<Observation> {
        let of = |s: &Sight| Observation { camera: s.photo, point: s.point, pixel: s.pixel, deviation: s.deviation };
        self.sights.iter().map(of).collect()
    }

    /// Steps of Levenberg and Marquardt.
    fn descend(&mut self, scale: f64, first: &FisheyeLens) {
        let mut cost = self.cost(scale, first);
        let mut damping = DAMPING;
        for _ in 0..STEPS {
            let equations = self.equations(scale, first, damping);
            let next = equations.and_then(|equations| self.stepped(equations));
            let next = next.map(|next| (next.cost(scale, first), next)).filter(|(lower, _)| *lower < cost);
            let Some((lower, next)) = next else {
                damping *= 10.0;
                if damping > LARGEST {
                    break;
                }
                continue;
            };
            let fall = cost - lower;
            (*self, cost, damping) = (next, lower, (0.2 * damping).max(1e-12));
            if fall <= CONVERGED * cost {
                break;
            }
        }
    }

    /// Differences of the lens from its first guess, over the expected ones.
    fn priors(&self, first: &FisheyeLens) -> [f64; NUMBERS] {
        let shift = (self.lens.center - first.center) / self.lens.longer;
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| self.lens.k[i]);
        let off = [(self.lens.focal / first.focal).ln(), shift.x, shift.y, a, b, c, d];
        std::array::from_fn(|i| off[i] / EXPECTED[i])
    }

    fn cost(&self, scale: f64, first: &FisheyeLens) -> f64 {
        let each = |(error, sight): (f64, &Sight)| {
            let far = if error.is_finite() { error / (scale * sight.deviation) } else { UNSEEN };
            scale * scale * (far * far).ln_1p()
        };
        let seen: f64 = self.errors().into_iter().zip(&self.sights).map(each).sum();
        seen + self.priors(first).iter().map(|x| x * x).sum::<f64>()
    }

    /// The place of each photo's camera among the unknowns; the first with a place stays.
    fn places(&self) -> (Vec<Option<usize>>, usize) {
        let mut next = NUMBERS;
        let mut fixed = true;
        let place = |pose: &Option<Pose>| {
            pose.as_ref()?;
            if std::mem::take(&mut fixed) {
                return None;
            }
            next += TWIST;
            Some(next - TWIST)
        };
        let places = self.poses.iter().map(place).collect();
        (places, next)
    }

    /// The damped equations of lens and cameras; `None` if they are not finite.
    fn equations(&self, scale: f64, first: &FisheyeLens, damping: f64) -> Option<Equations> {
        let (places, n) = self.places();
        let mut matrix = vec![0.0; n * n];
        let mut right = vec![0.0; n];
        let mut points = Vec::with_capacity(self.points.len());
        for seen in self.sights.chunk_by(|a, b| a.point == b.point) {
            let point = self.points[seen[0].point];
            let (mut own, mut own_right) = (DMat3::ZERO, DVec3::ZERO);
            let mut coupling: Vec<(usize, DVec3)> = (0..NUMBERS).map(|i| (i, DVec3::ZERO)).collect();
            for sight in seen {
                let Some(pose) = self.poses[sight.photo] else { continue };
                let p = pose.apply(point);
                let Some((at, rows)) = self.lens.linearized(p) else { continue };
                let off = at - sight.pixel;
                let precision = 1.0 / (sight.deviation * sight.deviation);
                let weight = precision / (1.0 + off.length_squared() * precision / (scale * scale));
                let camera = coupling.len();
                if let Some(place) = places[sight.photo] {
                    coupling.extend((place..place + TWIST).map(|i| (i, DVec3::ZERO)));
                }
                let back = pose.rotation.transpose();
                for (i, (by_point, by_lens)) in rows.iter().enumerate() {
                    let by_camera = DVec3::from_array(*by_point);
                    let by_world = back * by_camera;
                    own += outer(by_world, by_world * weight);
                    own_right -= by_world * (weight * off[i]);
                    let twist = [by_camera, p.cross(by_camera)];
                    let mut row = [(0, 0.0); NUMBERS + TWIST];
                    (0..NUMBERS).for_each(|k| row[k] = (k, by_lens[k]));
                    let moves = coupling.len() - camera;
                    (0..moves).for_each(|k| row[NUMBERS + k] = (camera + k, twist[k / 3][k % 3]));
                    let row = &row[..NUMBERS + moves];
                    for (a, value) in row {
                        coupling[*a].1 += by_world * (weight * value);
                        let at_a = coupling[*a].0;
                        right[at_a] -= weight * off[i] * value;
                        row.iter().for_each(|(b, other)| matrix[n * at_a + coupling[*b].0] += weight * value * other);
                    }
                }
            }
            let damped = own + DMat3::from_diagonal(DVec3::new(own.x_axis.x, own.y_axis.y, own.z_axis.z) * damping);
            let inverse = damped.inverse();
            // A point without depth stays where it is.
            let inverse = if inverse.is_finite() { inverse } else { DMat3::ZERO };
            points.push((inverse, own_right, coupling));
        }
        for (k, off) in self.priors(first).into_iter().enumerate() {
            matrix[n * k + k] += 1.0 / (EXPECTED[k] * EXPECTED[k]);
            right[k] -= off / EXPECTED[k];
        }
        (0..n).for_each(|k| matrix[n * k + k] = matrix[n * k + k] * (1.0 + damping) + f64::MIN_POSITIVE);
        for (inverse, own_right, coupling) in &points {
            for (a, by) in coupling {
                let solved = *inverse * *by;
                right[*a] -= solved.dot(*own_right);
                coupling.iter().for_each(|(b, other)| matrix[n * a + b] -= solved.dot(*other));
            }
        }
        let finite = matrix.iter().chain(&right).all(|x| x.is_finite());
        finite.then_some(Equations { matrix, right, points })
    }

    /// The state after the step of the equations; `None` if there is none.
    fn stepped(&self, equations: Equations) -> Option<Self> {
        let Equations { mut matrix, right: mut step, points } = equations;
        let n = step.len();
        if !cholesky(&mut matrix, n, n) {
            return None;
        }
        cholesky_solve(&matrix, &mut step);
        if !step.iter().all(|x| x.is_finite()) {
            return None;
        }
        let mut next = self.clone();
        next.lens = self.lens.moved(&step[..NUMBERS]);
        for (pose, place) in next.poses.iter_mut().zip(self.places().0) {
            if let (Some(pose), Some(place)) = (pose, place) {
                let [v, w] = [0, 3].map(|k| DVec3::from_slice(&step[place + k..]));
                *pose = se3::exp(v, w).compose(pose);
            }
        }
        let seen = self.sights.chunk_by(|a, b| a.point == b.point);
        for (seen, (inverse, right, coupling)) in seen.zip(points) {
            let moved = coupling.iter().fold(right, |rest, (place, by)| rest - *by * step[*place]);
            next.points[seen[0].point] += inverse * moved;
        }
        Some(next)
    }
}

fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_kernels::random::Stream;

    /// Cameras that look at points all around and behind them, with noise in pixels.
    fn drawn(noise: f64) -> Adjustment {
        let stream = Stream::new(5, 0, "test.fisheye");
        let draw =
            |k: usize| DVec3::new(stream.normal(k as u64), stream.normal(k as u64 + 1), stream.normal(k as u64 + 2));
        let k = [0.03, -0.01, 0.004, -0.001];
        let lens = FisheyeLens { k, center: DVec2::new(326.0, 236.0), ..FisheyeLens::new([480, 640], 190.0) };
        let pose = |i: usize| Pose::new(weaver_geometry::so3::exp(draw(10 * i) * 0.3), draw(10 * i + 3) * 0.8);
        let mut all =
            Adjustment { lens, poses: (0..6).map(|i| Some(pose(i))).collect(), points: vec![], sights: vec![] };
        for point in 0..400 {
            let position = draw(1000 + 40 * point).normalize() * (2.0 + draw(1003 + 40 * point).x.abs());
            for photo in 0..6 {
                let p = all.poses[photo].unwrap().apply(position);
                let angle = p.truncate().length().atan2(p.z);
                if let Some(at) = lens.project(p).filter(|_| angle < 1.7) {
                    let pixel = at + noise * draw(1006 + 40 * point + 3 * photo).truncate();
                    all.sights.push(Sight { photo, point, pixel, deviation: 1.0 });
                }
            }
            all.points.push(position);
        }
        all.prune(f64::INFINITY);
        all
    }

    /// The right side is minus half the gradient of the cost, which differences of the cost show.
    #[test]
    fn the_right_side_is_the_slope_of_the_cost() {
        let all = drawn(0.7);
        let first = FisheyeLens::new([480, 640], 180.0);
        let equations = all.equations(3.0, &first, 0.0).unwrap();
        // Of the equations before points are eliminated.
        let mut right = equations.right.clone();
        for (inverse, own, coupling) in &equations.points {
            coupling.iter().for_each(|(place, by)| right[*place] += (*inverse * *by).dot(*own));
        }
        let places = all.places().0;
        let moved = |at: usize, by: f64| {
            let mut other = all.clone();
            let unit: Vec<f64> = (0..right.len()).map(|i| if i == at { by } else { 0.0 }).collect();
            other.lens = all.lens.moved(&unit[..NUMBERS]);
            for (pose, place) in other.poses.iter_mut().zip(&places) {
                if let (Some(pose), Some(place)) = (pose, place) {
                    let [v, w] = [0, 3].map(|k| DVec3::from_slice(&unit[place + k..]));
                    *pose = se3::exp(v, w).compose(pose);
                }
            }
            other.cost(3.0, &first)
        };
        for (at, right) in right.iter().enumerate() {
            // k4 moves the border by tens of thousands of pixels for each unit.
            let h = if at < NUMBERS { 1e-6 } else { 1e-4 };
            let slope =
                (8.0 * (moved(at, h) - moved(at, -h)) - (moved(at, 2.0 * h) - moved(at, -2.0 * h))) / (12.0 * h);
            let error = (slope + 2.0 * right).abs();
            assert!(error < 1e-5 * slope.abs().max(100.0), "{at}: {slope} and {}", -2.0 * right);
        }
        for (point, (_, right, _)) in equations.points.iter().enumerate().step_by(37) {
            let cost = |axis: usize, by: f64| {
                let mut other = all.clone();
                other.points[point][axis] += by;
                other.cost(3.0, &first)
            };
            for axis in 0..3 {
                let slope = (cost(axis, 1e-5) - cost(axis, -1e-5)) / 2e-5;
                assert!((slope + 2.0 * right[axis]).abs() < 1e-4 * slope.abs().max(10.0), "{point}, {axis}");
            }
        }
    }

    /// From an equidistant lens with another focal length, and cameras and points that are off.
    #[test]
    fn a_lens_that_nobody_knows_is_found() {
        let truth = drawn(0.3);
        let mut all = truth.clone();
        all.lens = FisheyeLens { k: [0.0; 4], center: DVec2::new(320.0, 240.0), focal: 176.0, ..truth.lens };
        let draw = Stream::new(6, 0, "test.off");
        for (i, pose) in all.poses.iter_mut().flatten().enumerate().skip(1) {
            let by = |k: usize| DVec3::from_array([0, 1, 2].map(|a| draw.normal::<f64>((6 * i + 3 * k + a) as u64)));
            *pose = se3::exp(0.02 * by(0), 0.02 * by(1)).compose(pose);
        }
        all.points.iter_mut().for_each(|point| *point *= 1.03);
        assert!(all.run());
        assert!((all.lens.focal / truth.lens.focal - 1.0).abs() < 2e-3, "{:?}", all.lens);
        assert!(all.lens.center.distance(truth.lens.center) < 0.3, "{:?}", all.lens);
        for degrees in [20.0_f64, 50.0, 80.0, 95.0] {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let off = |lens: &FisheyeLens| lens.project(DVec3::new(sin, 0.0, cos)).unwrap() - lens.center;
            assert!(off(&all.lens).distance(off(&truth.lens)) < 0.3, "{degrees}: {:?}", all.lens);
        }
        for (a, b) in all.poses.iter().flatten().zip(truth.poses.iter().flatten()) {
            assert!(a.relative_to(&all.poses[0].unwrap()).angle_to(&b.relative_to(&truth.poses[0].unwrap())) < 2e-3);
        }
        let deviation = all.focal_deviation();
        assert!(deviation > 1e-5 && deviation < 3e-3, "{deviation}");
        assert!((all.lens.focal / truth.lens.focal).ln().abs() < 4.0 * deviation, "{deviation}");
        assert!(all.sights.len() as f64 > 0.97 * truth.sights.len() as f64 && all.median_error() < 0.5);
    }
}
