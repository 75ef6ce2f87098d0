//! Levenberg's and Marquardt's steps.

use super::dense::Dense;
use super::lens::Lens;
use super::linear::{Sights, View};
use super::profile::Profile;
use super::reduced::Reduced;
use super::sparse::Sparse;
use super::structure::{Blocks, NONE, Part};
use super::sums::{BLOCK, PADDED};
use super::system::{Row, System, expectations};
use super::{Bundle, Solved};
use std::ops::RangeInclusive;
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Pose, se3};
use weaver_kernels::parallel;
use weaver_kernels::simd::{self, Level};

/// Damping of the first step over the diagonal, the least and the largest.
const DAMPING: [f64; 3] = [1e-5, 1e-10, 1e9];
/// Relative fall of the cost at which the descent has converged, if the damping is at most `HARDLY`: a strongly damped
/// step is short wherever it is.
const CONVERGED: f64 = 1e-7;
const HARDLY: f64 = 1e-2;
/// Predicted relative fall that is lost in rounding: a step that fails then ends the descent.
const ROUNDING: f64 = 1e-11;
/// Root of the mean cost of an observation, in scales, that counts as 0.
const EXACT: f64 = 1e-11;

/// Solver of the reduced equations, and its limits.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    /// Blocks up to which the matrix is dense, if enough of it is stored.
    pub dense: usize,
    /// Products of blocks up to which the factor of a sparse matrix is found.
    pub profile: usize,
    /// Residual of conjugate gradients, and most iterations.
    pub tolerance: f64,
    pub iterations: usize,
    /// Cameras and lenses are settled below this squared movement, in standard deviations by the observations, in a
    /// step that is hardly damped.
    pub settled: f64,
}

impl Limits {
    pub const USUAL: Self = Self { dense: 200, profile: 40_000_000, tolerance: 1e-8, iterations: 1000, settled: 1e-4 };
    pub const NEAR: Self = Self { settled: 0.01, ..Self::USUAL };
    pub const ROUGH: Self = Self { settled: 0.1, ..Self::USUAL };
    /// The stored part of the matrix from which on a dense solver pays off; and blocks up to which it always does.
    const FULL: f64 = 0.1;
    const FEW: usize = 16;
    /// Numbers of blocks for which products of blocks decide between a profile and a dense matrix, and the factor by
    /// which each is faster in a dense one.
    const COUNTED: RangeInclusive<usize> = 201..=700;
    const FASTER: usize = 3;
}

#[derive(Debug)]
pub(super) enum Solver {
    Dense(Dense),
    Profile(Profile),
    Sparse(Box<Sparse>),
}

impl Solver {
    pub fn new(reduced: &Reduced, limits: &Limits) -> Self {
        let n = reduced.rows;
        // Only the lower half is stored.
        let full = 2.0 * reduced.stored() as f64 >= Limits::FULL * (n * n) as f64;
        if n <= limits.dense && (full || n <= Limits::FEW) {
            Self::Dense(Dense::new(BLOCK * n))
        } else if let Some(profile) = Profile::new(reduced, limits.profile) {
            if Limits::COUNTED.contains(&n) && Limits::FASTER * profile.products() >= n.pow(3) / 6 {
                Self::Dense(Dense::new(BLOCK * n))
            } else {
                Self::Profile(profile)
            }
        } else {
            Self::Sparse(Box::new(Sparse::new(reduced, limits.tolerance, limits.iterations)))
        }
    }

    fn solve(&mut self, reduced: &Reduced, step: &mut [Row]) -> bool {
        match self {
            Self::Dense(dense) => dense.solve(reduced, step),
            Self::Profile(profile) => profile.solve(reduced, step),
            Self::Sparse(sparse) => sparse.solve(reduced, step),
        }
    }
}

/// Poses and lenses; points are in parts.
#[derive(Clone, Debug)]
pub(super) struct State {
    pub poses: Vec<Pose>,
    pub lenses: Vec<Lens>,
    pub views: Vec<View>,
}

/// An adjustment, with all the memory that its steps need.
#[derive(Debug)]
pub(super) struct Descent<'a> {
    bundle: &'a Bundle,
    scale: f64,
    settled: f64,
    pub blocks: Blocks,
    pub parts: Vec<Part>,
    pub state: State,
    tried: State,
    pub system: System,
    pub reduced: Reduced,
    pub solver: Solver,
    pub step: Vec<Row>,
}

impl<'a> Descent<'a> {
    pub fn new(bundle: &'a Bundle, scale: f64, limits: &Limits) -> Self {
        let blocks = Blocks::new(bundle);
        let parts = Part::all(bundle, &blocks);
        let system = System::new(bundle, &blocks);
        let reduced = Reduced::new(&blocks, &system, &parts);
        let solver = Solver::new(&reduced, limits);
        let poses: Vec<Pose> = bundle.cameras.iter().map(|c| c.pose).collect();
        let view = |i: usize| View::new(bundle, &blocks, i, &poses[i], &bundle.lenses[bundle.lens_of[i]]);
        let views = (0..poses.len()).map(view).collect();
        let state = State { poses, lenses: bundle.lenses.clone(), views };
        let tried = state.clone();
        let step = vec![[0.0; PADDED]; blocks.count];
        let settled = limits.settled;
        Self { bundle, scale, settled, blocks, parts, state, tried, system, reduced, solver, step }
    }

    /// Takes at most so many steps.
    pub fn run(&mut self, most_steps: usize) -> Solved {
        let mut cost = self.linearize();
        let [mut damping, least, largest] = DAMPING;
        let mut more = 2.0;
        let mut steps = 0;
        let nothing = EXACT * EXACT * self.scale * self.scale * self.bundle.observations.len() as f64;
        // Exact observations leave nothing to lower, and no relative fall to measure.
        let mut converged = cost <= nothing;
        for _ in 0..most_steps {
            // With the largest damping a step is as good as none: no step lowers the cost.
            if converged || damping >= largest || !cost.is_finite() {
                break;
            }
            let fall = if self.solve(damping) { self.attempt(damping) } else { None };
            let Some((next, predicted)) = fall.filter(|(next, _)| *next < cost) else {
                converged = fall.is_some_and(|(_, predicted)| predicted <= ROUNDING * cost);
                // Nielsen's update of a step that failed: the damping grows faster and faster.
                damping *= more;
                more *= 2.0;
                continue;
            };
            steps += 1;
            let fall = cost - next;
            let still = fall <= CONVERGED * cost || self.movement() <= self.settled;
            converged = (still && damping <= HARDLY) || next <= nothing;
            // Nielsen's update: the better the prediction was, the less damping.
            let gain = 2.0 * fall / predicted - 1.0;
            damping = (damping * (1.0 - gain.powi(3)).clamp(1.0 / 3.0, 2.0)).max(least);
            more = 2.0;
            cost = next;
            self.accept();
            // After the last step the equations are not needed any more.
            if !converged {
                self.linearize();
            }
        }
        Solved { cost, steps, converged }
    }

    /// Linearizes at the current state; returns the cost.
    pub fn linearize(&mut self) -> f64 {
        let sights = Sights { views: &self.state.views, scale: self.scale };
        parallel::for_chunks(&mut self.parts, 1, |_, parts| {
            for part in parts {
                if simd::level() == Level::Portable {
                    sights.linearize::<false>(part);
                } else {
                    simd::dispatch(
                        #[inline(always)]
                        || sights.linearize::<true>(part),
                    );
                }
            }
        });
        let State { poses, lenses, .. } = &self.state;
        // Parts are added in their order, so that the bits do not depend on threads.
        self.system.sum(self.bundle, &self.blocks, &self.parts, poses, lenses);
        self.parts.iter().map(|part| part.cost).sum::<f64>() + expectations(self.bundle, &self.blocks, poses, lenses)
    }

    /// Fills the reduced equations.
    pub fn reduce(&mut self, damping: f64) {
        parallel::for_chunks(&mut self.parts, 1, |_, parts| parts.iter_mut().for_each(|part| part.invert(damping)));
        self.reduced.fill(&self.system, &self.parts, damping);
    }

    /// The step of cameras and lenses; `false` if there is none.
    pub fn solve(&mut self, damping: f64) -> bool {
        self.reduce(damping);
        self.solver.solve(&self.reduced, &mut self.step)
    }

    /// The squared movement of cameras and lenses with the step, in standard deviations: `x^T S x` with the reduced
    /// matrix `S`, and `S x` is the reduced right side for a step `x` that is hardly damped.
    fn movement(&self) -> f64 {
        let along =
            |(row, x): (usize, &Row)| x.iter().zip(self.reduced.right(row)).map(|(x, right)| x * right).sum::<f64>();
        self.step.iter().enumerate().map(along).sum()
    }

    /// The cost after the step, and the fall of the cost that was predicted; `None` if the step is not finite.
    fn attempt(&mut self, damping: f64) -> Option<(f64, f64)> {
        let Self { bundle, blocks, state, tried, step, .. } = self;
        // A nearly singular matrix can be solved and still overflow.
        if !step.as_flattened().iter().all(|x| x.is_finite()) {
            return None;
        }
        for (i, block) in blocks.of_lens.iter().enumerate().filter(|(_, block)| **block != NONE) {
            tried.lenses[i] = state.lenses[i].moved(&step[*block as usize]);
        }
        for i in 0..state.poses.len() {
            let (camera, lens) = (blocks.of_camera[i], bundle.lens_of[i]);
            if camera != NONE {
                let [a, b, c, d, e, f, ..] = step[camera as usize];
                let (mut v, mut w) = (DVec3::new(a, b, c), DVec3::new(d, e, f));
                if let Some(turn) = bundle.turned(i) {
                    (v, w) = (turn * v, turn * w);
                }
                tried.poses[i] = se3::exp(v, w).compose(&state.poses[i]);
            }
            if camera != NONE || blocks.of_lens[lens] != NONE {
                tried.views[i] = View::new(bundle, blocks, i, &tried.poses[i], &tried.lenses[lens]);
            }
        }
        let step = &*step;
        let fixed_points = bundle.fixed_points;
        let sights = Sights { views: &tried.views, scale: self.scale };
        parallel::for_chunks(&mut self.parts, 1, |_, parts| {
            for part in parts {
                if simd::level() == Level::Portable {
                    sights.attempt::<false>(part, step, damping, fixed_points);
                } else {
                    simd::dispatch(
                        #[inline(always)]
                        || sights.attempt::<true>(part, step, damping, fixed_points),
                    );
                }
            }
        });
        let expected = expectations(bundle, blocks, &tried.poses, &tried.lenses);
        let cost = self.parts.iter().map(|part| part.cost).sum::<f64>() + expected;
        let mut predicted: f64 = self.parts.iter().map(|part| part.predicted).sum();
        for (block, step) in step.iter().enumerate() {
            let (right, diagonal) = (&self.system.right[block], &self.system.diagonal[block]);
            let each = step.iter().zip(right).zip(diagonal);
            predicted += each.map(|((x, right), diagonal)| x * (right + damping * diagonal * x)).sum::<f64>();
        }
        Some((cost, predicted))
    }

    /// Takes the step that was tried.
    fn accept(&mut self) {
        std::mem::swap(&mut self.state, &mut self.tried);
        if !self.bundle.fixed_points {
            self.parts.iter_mut().for_each(|part| std::mem::swap(&mut part.points, &mut part.tried));
        }
    }
}

impl Sights<'_> {
    /// Moves the points of a part along with a step of cameras and lenses, and sets the cost.
    #[inline(always)]
    fn attempt<const FUSED: bool>(&self, part: &mut Part, step: &[Row], damping: f64, fixed_points: bool) {
        part.predicted = 0.0;
        if fixed_points {
            part.cost = self.cost::<FUSED>(&part.points, &part.seen);
            return;
        }
        for point in 0..part.points.len() {
            part.tried[point] = part.points[point] + part.movement(point, step, damping);
        }
        part.cost = self.cost::<FUSED>(&part.tried, &part.seen);
    }
}

impl Part {
    /// Movement of a point with a step of cameras and lenses. Adds the predicted fall of the cost.
    #[inline(always)]
    pub fn movement(&mut self, point: usize, step: &[Row], damping: f64) -> DVec3 {
        let right = self.right[point];
        let mut sums = [[0.0; PADDED]; 3];
        for entry in self.entries(point) {
            let step = &step[self.block[entry] as usize];
            let coupling = &self.coupling[entry].0;
            for k in 0..3 {
                for b in 0..PADDED {
                    sums[k][b] += coupling[k][b] * step[b];
                }
            }
        }
        let mut rest = right;
        for k in 0..3 {
            rest[k] -= sums[k].iter().sum::<f64>();
        }
        let [xx, xy, xz, yy, yz, zz] = self.inverse[point];
        let [x, y, z] = rest;
        let by = [xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z];
        let matrix = &self.matrix[point];
        for (k, diagonal) in [matrix[0], matrix[3], matrix[5]].into_iter().enumerate() {
            self.predicted += by[k] * (right[k] + damping * diagonal * by[k]);
        }
        DVec3::from_array(by)
    }
}
