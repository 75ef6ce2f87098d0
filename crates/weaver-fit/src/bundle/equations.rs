//! The normal equations of bundle adjustment, with the depths eliminated.

use super::points::{PATCH, Point};
use super::prior::Prior;
use super::{Cameras, Picture, TWIST};
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_geometry::{Intrinsics, Pose};
use weaver_kernels::parallel;

/// Difference of gray, root mean square, beyond which a patch counts for less and less.
const SMALL: f64 = 0.02;
/// Cost of a view that no longer sees its point: that of a large difference.
const MISSED: f64 = 2.0 * SMALL * SMALL;
/// Weight of the squared change of the logarithm of a depth: points that no parallax holds stay.
const STIFFNESS: f64 = 1e-2;
/// Points of a task.
const GRAIN: usize = 64;

/// What one view of a point says: cost, matrix and right side of its numbers, which are the twists of the anchor and of the
/// view, the logarithm of the focal length, the logarithm of the depth.
#[derive(Clone, Copy, Debug)]
struct Term {
    cost: f64,
    matrix: [[f64; NUMBERS]; NUMBERS],
    right: [f64; NUMBERS],
}

const FOCAL: usize = 2 * TWIST;
const DEPTH: usize = FOCAL + 1;
const NUMBERS: usize = DEPTH + 1;

/// What a point leaves for its depth: curvature, right side, and the coupling with numbers of cameras.
#[derive(Clone, Debug, Default)]
struct Eliminated {
    curvature: f64,
    right: f64,
    coupling: Vec<(usize, f64)>,
}

/// The equations at a state.
pub(super) struct System {
    pub cost: f64,
    size: usize,
    matrix: Vec<f64>,
    right: Vec<f64>,
    eliminated: Vec<Eliminated>,
}

impl System {
    pub fn new(pictures: &[Picture<'_>], prior: &Prior, points: &[Point], cameras: &Cameras, focal: bool) -> Self {
        let size = TWIST * cameras.poses.len() + usize::from(focal);
        let mut terms: Vec<Vec<Option<Term>>> = vec![Vec::new(); points.len()];
        parallel::for_chunks(&mut terms, GRAIN, |chunk, terms| {
            for (terms, point) in terms.iter_mut().zip(&points[chunk * GRAIN..]) {
                terms.extend(point.views.iter().map(|view| term(pictures, cameras, point, *view)));
            }
        });
        let mut system =
            Self { cost: 0.0, size, matrix: vec![0.0; size * size], right: vec![0.0; size], eliminated: Vec::new() };
        for (point, terms) in points.iter().zip(&terms) {
            system.add(point, terms, focal);
        }
        for (camera, pose) in cameras.poses.iter().enumerate() {
            for (i, (x, weight)) in prior.twist(camera, pose).iter().zip(prior.weights[camera]).enumerate() {
                let at = TWIST * camera + i;
                system.cost += weight * x * x;
                system.right[at] -= weight * x;
                system.matrix[at * size + at] += weight;
            }
        }
        system
    }

    fn add(&mut self, point: &Point, terms: &[Option<Term>], focal: bool) {
        let mut depth = Eliminated { curvature: STIFFNESS, ..Eliminated::default() };
        let mut coupling: Vec<(usize, f64)> = (0..TWIST).map(|i| (TWIST * point.anchor + i, 0.0)).collect();
        let mut by_focal = 0.0;
        for (view, term) in point.views.iter().zip(terms) {
            let Some(term) = term else {
                self.cost += MISSED;
                continue;
            };
            self.cost += term.cost;
            let place = |n: usize| match n {
                0..TWIST => TWIST * point.anchor + n,
                TWIST..FOCAL => TWIST * view + n - TWIST,
                _ => self.size - 1,
            };
            let used = if focal { DEPTH } else { FOCAL };
            for a in 0..used {
                self.right[place(a)] += term.right[a];
                for b in 0..used {
                    self.matrix[place(a) * self.size + place(b)] += term.matrix[a][b];
                }
            }
            (0..TWIST).for_each(|i| coupling[i].1 += term.matrix[i][DEPTH]);
            coupling.extend((TWIST..FOCAL).map(|i| (TWIST * view + i - TWIST, term.matrix[i][DEPTH])));
            by_focal += term.matrix[FOCAL][DEPTH];
            depth.curvature += term.matrix[DEPTH][DEPTH];
            depth.right += term.right[DEPTH];
        }
        if focal {
            coupling.push((self.size - 1, by_focal));
        }
        for (a, x) in &coupling {
            self.right[*a] -= x * depth.right / depth.curvature;
            let row = &mut self.matrix[a * self.size..][..self.size];
            coupling.iter().for_each(|(b, y)| row[*b] -= x * y / depth.curvature);
        }
        depth.coupling = coupling;
        self.eliminated.push(depth);
    }

    /// The step of cameras and of the focal length.
    pub fn solve(&self, damping: f64) -> Option<(Vec<[f64; TWIST]>, f64)> {
        let mut matrix = self.matrix.clone();
        for i in 0..self.size {
            let diagonal = &mut matrix[i * self.size + i];
            *diagonal += damping * *diagonal + f64::MIN_POSITIVE;
        }
        let step = cholesky_solve(matrix, &self.right)?;
        let (twists, rest) = step.as_chunks::<TWIST>();
        Some((twists.to_vec(), rest.first().copied().unwrap_or(0.0)))
    }

    /// The points, at the depths that go with a step.
    pub fn deeper(&self, points: &[Point], twists: &[[f64; TWIST]], by_focal: f64) -> Vec<Point> {
        let number = |n: usize| twists.as_flattened().get(n).copied().unwrap_or(by_focal);
        let deeper = |(point, depth): (&Point, &Eliminated)| {
            let along: f64 = depth.coupling.iter().map(|(n, x)| x * number(*n)).sum();
            let step = ((depth.right - along) / depth.curvature).clamp(-0.1, 0.1);
            Point { depth: point.depth * step.exp(), ..point.clone() }
        };
        points.iter().zip(&self.eliminated).map(deeper).collect()
    }
}

/// What a view says of a point: `c^2 log(1 + mean d^2 / c^2)` over the differences d of the patch.
fn term(pictures: &[Picture<'_>], cameras: &Cameras, point: &Point, view: usize) -> Option<Term> {
    let scaled = |k: Intrinsics| Intrinsics { fx: k.fx * cameras.focal.exp(), fy: k.fy * cameras.focal.exp(), ..k };
    let (from, to) = (&pictures[point.anchor], &pictures[view]);
    let (k, l) = (scaled(from.camera.intrinsics), scaled(to.camera.intrinsics));
    let across: Pose = cameras.poses[view].relative_to(&cameras.poses[point.anchor]);
    let (mut slopes, mut right, mut square) = ([0.0; 3], DVec2::ZERO, 0.0);
    for offset in PATCH {
        let pixel = point.pixel + DVec2::from(offset);
        let p = across.apply(k.unproject(pixel, point.depth));
        if p.z <= 0.0 {
            return None;
        }
        let (here, there) = (from.at(pixel)?, to.at(l.project(p))?);
        let difference = there.x - here.x;
        let slope = DVec2::new(there.y, there.z);
        right -= difference * slope;
        let parts = [slope.x * slope.x, slope.x * slope.y, slope.y * slope.y];
        (0..3).for_each(|i| slopes[i] += parts[i]);
        square += difference * difference;
    }
    let over = 1.0 / PATCH.len() as f64;
    let weight = over / (1.0 + over * square / (SMALL * SMALL));
    let cost = SMALL * SMALL * (over * square / (SMALL * SMALL)).ln_1p();
    let (slopes, right) = (slopes.map(|s| weight * s), weight * right);
    let local = k.unproject(point.pixel, point.depth);
    let seen = across.apply(local);
    let place = l.project(seen);
    let row = |to_pixel: DVec3, from_center: f64| {
        let back = across.rotation.transpose() * to_pixel;
        let (turn, turned) = (seen.cross(to_pixel), local.cross(back));
        let by_focal = from_center - back.x * local.x - back.y * local.y;
        [
            [-back.x, -back.y, -back.z, -turned.x, -turned.y, -turned.z],
            [to_pixel.x, to_pixel.y, to_pixel.z, turn.x, turn.y, turn.z],
            [by_focal, back.dot(local), 0.0, 0.0, 0.0, 0.0],
        ]
    };
    let u = row(DVec3::new(l.fx, 0.0, -l.fx * seen.x / seen.z) / seen.z, place.x - l.cx);
    let v = row(DVec3::new(0.0, l.fy, -l.fy * seen.y / seen.z) / seen.z, place.y - l.cy);
    let (u, v) = (&u.as_flattened()[..NUMBERS], &v.as_flattened()[..NUMBERS]);
    let matrix = std::array::from_fn(|a| {
        let (du, dv) = (slopes[0] * u[a] + slopes[1] * v[a], slopes[1] * u[a] + slopes[2] * v[a]);
        std::array::from_fn(|b| du * u[b] + dv * v[b])
    });
    Some(Term { cost, matrix, right: std::array::from_fn(|a| u[a] * right.x + v[a] * right.y) })
}

/// Solves a positive definite system; `None` if it is not.
fn cholesky_solve(mut matrix: Vec<f64>, right: &[f64]) -> Option<Vec<f64>> {
    let n = right.len();
    for i in 0..n {
        for j in 0..=i {
            let (row, other) = (&matrix[i * n..][..j], &matrix[j * n..][..j]);
            let dot: f64 = row.iter().zip(other).map(|(a, b)| a * b).sum();
            let rest = matrix[i * n + j] - dot;
            matrix[i * n + j] = if i > j {
                rest / matrix[j * n + j]
            } else if rest > 0.0 {
                rest.sqrt()
            } else {
                return None;
            };
        }
    }
    let mut x = right.to_vec();
    for i in 0..n {
        let dot: f64 = matrix[i * n..][..i].iter().zip(&x).map(|(a, b)| a * b).sum();
        x[i] = (x[i] - dot) / matrix[i * n + i];
    }
    for i in (0..n).rev() {
        let dot: f64 = (i + 1..n).map(|k| matrix[k * n + i] * x[k]).sum();
        x[i] = (x[i] - dot) / matrix[i * n + i];
    }
    Some(x)
}
