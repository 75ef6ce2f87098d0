//! The normal equations, with the points eliminated.

use super::{Bundle, LENS, Observation, TWIST, longer};
use std::ops::Range;
use weaver_geometry::glam::{DMat3, DVec2, DVec3};
use weaver_geometry::se3;
use weaver_kernels::parallel;

/// Numbers that an observation depends on beside its point: those of its camera and of its lens.
const NUMBERS: usize = TWIST + LENS;
/// Parts that points are eliminated in side by side: always as many, so that sums are always the same.
const PARTS: usize = 8;
/// Points of a task.
const GRAIN: usize = 64;
/// An observation behind its camera costs as much as one that is off by so many scales.
const BEHIND: f64 = 100.0;

type Row = [f64; NUMBERS];

/// What an observation says: its part of the matrix and right side, and its coupling with the point.
#[derive(Clone, Copy, Debug)]
struct Term {
    matrix: [Row; NUMBERS],
    right: Row,
    coupling: [DVec3; NUMBERS],
}

/// What all observations of a point say.
#[derive(Clone, Debug)]
struct Of {
    cost: f64,
    matrix: DMat3,
    right: DVec3,
    /// By observation; `None` behind the camera.
    terms: Vec<Option<Term>>,
}

/// The equations at a state.
pub(super) struct System {
    pub cost: f64,
    size: usize,
    /// Of cameras and lenses alone.
    matrix: Vec<f64>,
    right: Vec<f64>,
    of_points: Vec<Of>,
    /// Where the numbers of each observation stand, by point.
    places: Vec<Vec<[usize; NUMBERS]>>,
    fixed_points: bool,
}

impl System {
    pub fn new(bundle: &Bundle, scale: f64) -> Self {
        let size = TWIST * bundle.cameras.len() + LENS * bundle.lenses.len();
        let mut groups: Vec<&[Observation]> = vec![&[]; bundle.points.len()];
        bundle.observations.chunk_by(|a, b| a.point == b.point).for_each(|group| groups[group[0].point] = group);
        // Not the default, which of a matrix is the identity.
        let nothing = Of { cost: 0.0, matrix: DMat3::ZERO, right: DVec3::ZERO, terms: Vec::new() };
        let mut of_points = vec![nothing; groups.len()];
        parallel::for_chunks(&mut of_points, GRAIN, |chunk, of_points| {
            for (i, of) in of_points.iter_mut().enumerate() {
                groups[chunk * GRAIN + i].iter().for_each(|o| of.add(bundle, o, scale));
            }
        });
        let place = |o: &Observation| {
            let lens = TWIST * bundle.cameras.len() + LENS * bundle.lens_of[o.camera];
            std::array::from_fn(|n| if n < TWIST { TWIST * o.camera + n } else { lens + n - TWIST })
        };
        let places = groups.iter().map(|group| group.iter().map(place).collect()).collect();
        let mut system = Self {
            cost: 0.0,
            size,
            matrix: vec![0.0; size * size],
            right: vec![0.0; size],
            of_points,
            places,
            fixed_points: bundle.fixed_points,
        };
        system.sum(bundle);
        system
    }

    /// Adds up what concerns cameras and lenses alone.
    fn sum(&mut self, bundle: &Bundle) {
        let size = self.size;
        for (of, places) in self.of_points.iter().zip(&self.places) {
            self.cost += of.cost;
            for (term, places) in of.terms.iter().zip(places) {
                let Some(term) = term else { continue };
                for (a, row) in places.iter().zip(&term.matrix) {
                    places.iter().zip(row).for_each(|(b, x)| self.matrix[a * size + b] += x);
                }
                places.iter().zip(&term.right).for_each(|(a, x)| self.right[*a] += x);
            }
        }
        for (i, (camera, (pose, weights))) in bundle.cameras.iter().zip(&bundle.expected).enumerate() {
            if bundle.fixed[i] {
                continue;
            }
            let (v, w) = se3::log(&camera.pose.relative_to(pose));
            for (k, (x, weight)) in v.to_array().into_iter().chain(w.to_array()).zip(weights).enumerate() {
                let at = TWIST * i + k;
                self.cost += weight * x * x;
                self.right[at] -= weight * x;
                self.matrix[at * size + at] += weight;
            }
        }
        for (i, lens) in bundle.lenses.iter().enumerate() {
            let first = TWIST * bundle.cameras.len() + LENS * i;
            let priors = [
                (lens.free_focal, lens.weight, 0, lens.log_focal - lens.expected),
                (lens.free_shift, lens.shift_weight, 2, lens.shift.x),
                (lens.free_shift, lens.shift_weight, 3, lens.shift.y),
            ];
            for (_, weight, number, off) in priors.into_iter().filter(|prior| prior.0) {
                let at = first + number;
                self.cost += weight * off * off;
                self.right[at] -= weight * off;
                self.matrix[at * size + at] += weight;
            }
        }
        // What nothing depends on stays: its equation is x = 0.
        for at in 0..size {
            let diagonal = &mut self.matrix[at * size + at];
            *diagonal = if *diagonal > 0.0 { *diagonal } else { 1.0 };
        }
    }

    /// The step of cameras and lenses.
    pub fn solve(&self, damping: f64) -> Option<Vec<f64>> {
        let size = self.size;
        let (mut matrix, mut right) = (self.matrix.clone(), self.right.clone());
        for i in 0..size {
            matrix[i * size + i] += damping * matrix[i * size + i] + f64::MIN_POSITIVE;
        }
        if !self.fixed_points {
            let part = self.of_points.len().div_ceil(PARTS).max(1);
            let mut sums: Vec<(Vec<f64>, Vec<f64>)> = vec![Default::default(); self.of_points.len().div_ceil(part)];
            parallel::for_chunks(&mut sums, 1, |chunk, sums| {
                let range = chunk * part..((chunk + 1) * part).min(self.of_points.len());
                sums[0] = self.eliminated(range, damping);
            });
            for (by_matrix, by_right) in sums {
                matrix.iter_mut().zip(by_matrix).for_each(|(m, x)| *m -= x);
                right.iter_mut().zip(by_right).for_each(|(r, x)| *r -= x);
            }
        }
        cholesky_solve(matrix, right)
    }

    /// What the points in a range take off the matrix, of which only the lower half is filled, and off the right side.
    fn eliminated(&self, range: Range<usize>, damping: f64) -> (Vec<f64>, Vec<f64>) {
        let size = self.size;
        let (mut matrix, mut right) = (vec![0.0; size * size], vec![0.0; size]);
        for (of, places) in self.of_points[range.clone()].iter().zip(&self.places[range]) {
            let Some(inverse) = of.inverse(damping) else { continue };
            let moved = inverse * of.right;
            let couplings =
                || of.terms.iter().zip(places).filter_map(|(term, places)| Some((&term.as_ref()?.coupling, places)));
            for (coupling, rows) in couplings() {
                for (a, x) in rows.iter().zip(coupling).filter(|(_, x)| **x != DVec3::ZERO) {
                    right[*a] += x.dot(moved);
                    let solved = inverse * *x;
                    let row = &mut matrix[a * size..][..a + 1];
                    for (coupling, columns) in couplings().filter(|(_, columns)| columns[0] <= *a) {
                        for (b, y) in columns.iter().zip(coupling).filter(|(b, _)| *b <= a) {
                            row[*b] += solved.dot(*y);
                        }
                    }
                }
            }
        }
        (matrix, right)
    }

    /// Moves points by what goes with a step of cameras and lenses.
    pub fn move_points(&self, points: &mut [DVec3], step: &[f64], damping: f64) {
        if self.fixed_points {
            return;
        }
        for ((point, of), places) in points.iter_mut().zip(&self.of_points).zip(&self.places) {
            let Some(inverse) = of.inverse(damping) else { continue };
            let mut right = of.right;
            for (term, places) in of.terms.iter().zip(places) {
                let Some(term) = term else { continue };
                places.iter().zip(&term.coupling).for_each(|(a, x)| right -= *x * step[*a]);
            }
            *point += inverse * right;
        }
    }
}

impl Of {
    fn add(&mut self, bundle: &Bundle, o: &Observation, scale: f64) {
        let square = (scale * o.deviation).powi(2);
        let precision = o.deviation.powi(-2);
        let camera = &bundle.cameras[o.camera];
        let lens = &bundle.lenses[bundle.lens_of[o.camera]];
        let p = camera.pose.apply(bundle.points[o.point]);
        if p.z <= 1e-12 {
            self.cost += scale * scale * (BEHIND * BEHIND).ln_1p();
            self.terms.push(None);
            return;
        }
        let seen = lens.project(camera, p);
        let difference = seen - o.pixel;
        let far = difference.length_squared() / square;
        self.cost += scale * scale * far.ln_1p();
        let weight = precision / (1.0 + far);
        let (focal, k) = (lens.log_focal.exp(), &camera.intrinsics);
        let at = DVec2::new(p.x, p.y) / p.z;
        let r2 = at.length_squared();
        let bent = 1.0 + lens.k1 * r2;
        let to_world = camera.pose.rotation.transpose();
        let moves = f64::from(!bundle.fixed[o.camera]);
        let [focuses, bends, shifts] = [lens.free_focal, lens.free_k1, lens.free_shift].map(f64::from);
        let center = lens.center(camera);
        let row = |f: f64, axis: DVec2, along: f64, from_center: f64| {
            // d (f (1 + k1 r^2) along) by the place on the plane at depth 1, then by the point.
            let by_plane = (axis * bent + at * (2.0 * lens.k1 * along)) * (f * focal);
            let by_point = DVec3::new(by_plane.x, by_plane.y, -by_plane.dot(at)) / p.z;
            let turn = p.cross(by_point);
            let (shift, turn) = (by_point * moves, turn * moves);
            let bend = bends * f * focal * along * r2;
            let DVec2 { x, y } = axis * (shifts * longer(camera));
            let numbers = [shift.x, shift.y, shift.z, turn.x, turn.y, turn.z, focuses * from_center, bend, x, y];
            (numbers, to_world * by_point)
        };
        let rows = [row(k.fx, DVec2::X, at.x, seen.x - center.x), row(k.fy, DVec2::Y, at.y, seen.y - center.y)];
        let mut term =
            Term { matrix: [[0.0; NUMBERS]; NUMBERS], right: [0.0; NUMBERS], coupling: [DVec3::ZERO; NUMBERS] };
        for ((numbers, by_point), difference) in rows.iter().zip(difference.to_array()) {
            for a in 0..NUMBERS {
                let x = weight * numbers[a];
                (0..NUMBERS).for_each(|b| term.matrix[a][b] += x * numbers[b]);
                term.right[a] -= x * difference;
                term.coupling[a] += *by_point * x;
            }
            let scaled = *by_point * weight;
            self.matrix += DMat3::from_cols(scaled * by_point.x, scaled * by_point.y, scaled * by_point.z);
            self.right -= scaled * difference;
        }
        self.terms.push(Some(term));
    }

    /// The inverse of the damped matrix; `None` for a point that nothing holds.
    fn inverse(&self, damping: f64) -> Option<DMat3> {
        let m = &self.matrix;
        let diagonal = DVec3::new(m.x_axis.x, m.y_axis.y, m.z_axis.z);
        let inverse = (*m + DMat3::from_diagonal(diagonal * damping)).inverse();
        inverse.is_finite().then_some(inverse)
    }
}

/// Solves a positive definite system whose lower half is given; `None` if it is not.
fn cholesky_solve(mut matrix: Vec<f64>, mut x: Vec<f64>) -> Option<Vec<f64>> {
    let n = x.len();
    for i in 0..n {
        for j in 0..=i {
            let rest = matrix[i * n + j] - dot(&matrix[i * n..][..j], &matrix[j * n..][..j]);
            matrix[i * n + j] = match (i > j, rest > 0.0) {
                (true, _) => rest / matrix[j * n + j],
                (false, true) => rest.sqrt(),
                (false, false) => return None,
            };
        }
    }
    for i in 0..n {
        x[i] = (x[i] - dot(&matrix[i * n..][..i], &x[..i])) / matrix[i * n + i];
    }
    for i in (0..n).rev() {
        x[i] /= matrix[i * n + i];
        let (above, row) = (x[i], &matrix[i * n..][..i]);
        x[..i].iter_mut().zip(row).for_each(|(x, m)| *x -= m * above);
    }
    Some(x)
}

/// With sums side by side, which the processor adds at once.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    const LANES: usize = 8;
    let mut sums = [0.0; LANES];
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    for (a, b) in a.iter().zip(b) {
        (0..LANES).for_each(|i| sums[i] += a[i] * b[i]);
    }
    sums.iter().sum::<f64>() + a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::super::Lens;
    use super::*;
    use weaver_geometry::{Camera, Intrinsics, Pose, so3};
    use weaver_kernels::random::Stream;

    fn bundle(seed: u64) -> Bundle {
        let stream = Stream::new(seed, 0, "test.equations");
        let draw = |k: u64| DVec3::new(stream.normal(k), stream.normal(k + 1), stream.normal(k + 2));
        let intrinsics = Intrinsics { fx: 30.0, fy: 28.0, cx: 16.0, cy: 12.0 };
        let camera = |i: u64| {
            let pose = Pose::new(so3::exp(draw(10 * i) * 0.2), draw(10 * i + 3) * 0.3 + DVec3::Z * 5.0);
            Camera { pose, intrinsics, width: 32, height: 24 }
        };
        let observation = |i: usize| {
            let at = draw(1000 + 3 * i as u64);
            let pixel = DVec2::new(16.0 + 4.0 * at.x, 12.0 + 4.0 * at.y);
            Observation { camera: i % 3, point: i / 3, pixel, deviation: 1.0 + 0.3 * at.z.abs() }
        };
        let cameras: Vec<Camera> = (0..3).map(camera).collect();
        Bundle {
            expected: cameras
                .iter()
                .map(|c| (Pose::new(so3::exp(DVec3::X * 0.1) * c.pose.rotation, c.pose.translation), [0.7; 6]))
                .collect(),
            cameras,
            lenses: vec![
                Lens {
                    log_focal: 0.1,
                    k1: -0.2,
                    shift: DVec2::new(0.02, -0.01),
                    expected: 0.3,
                    weight: 3.0,
                    shift_weight: 2.0,
                    free_focal: true,
                    free_k1: true,
                    free_shift: true,
                };
                2
            ],
            lens_of: vec![0, 1, 0],
            fixed: vec![false; 3],
            points: (0..5).map(|i| draw(500 + 3 * i)).collect(),
            fixed_points: false,
            observations: (0..15).map(observation).collect(),
        }
    }

    /// The right side is minus half the gradient of the cost.
    #[test]
    fn the_right_side_is_the_slope_of_the_cost() {
        for seed in 0..20 {
            let bundle = bundle(seed);
            let system = System::new(&bundle, 3.0);
            let numbers = system.size + 3 * bundle.points.len();
            for at in 0..numbers {
                let h = 1e-6;
                let cost = |by: f64| {
                    let mut other = bundle.clone();
                    if at >= system.size {
                        other.points[(at - system.size) / 3][(at - system.size) % 3] += by;
                    } else if at >= TWIST * 3 {
                        let lens = &mut other.lenses[(at - TWIST * 3) / LENS];
                        let DVec2 { x, y } = &mut lens.shift;
                        *[&mut lens.log_focal, &mut lens.k1, x, y][(at - TWIST * 3) % LENS] += by;
                    } else {
                        let mut twist = [0.0; TWIST];
                        twist[at % TWIST] = by;
                        let [a, b, c, d, e, f] = twist;
                        let pose = &mut other.cameras[at / TWIST].pose;
                        *pose = se3::exp(DVec3::new(a, b, c), DVec3::new(d, e, f)).compose(pose);
                    }
                    System::new(&other, 3.0).cost
                };
                let slope = (cost(h) - cost(-h)) / (2.0 * h);
                let right = match at.checked_sub(system.size) {
                    None => system.right[at],
                    Some(n) => system.of_points[n / 3].right[n % 3],
                };
                // What expects cameras has a Jacobian that is the identity only nearby.
                let tolerance = if at < TWIST * 3 { 0.02 } else { 1e-4 };
                let error = (slope + 2.0 * right).abs();
                assert!(error < tolerance * slope.abs().max(1.0), "{seed}, {at}: {slope} and {}", -2.0 * right);
            }
        }
    }
}
