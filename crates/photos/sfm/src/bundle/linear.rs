//! Linearized observations: their cost, and its quadratic model. Eight are processed at a time, one in each lane.

#![expect(clippy::needless_range_loop, reason = "numbers in registers go side by side through several arrays")]

use super::lens::{Lens, NUMBERS};
use super::structure::{Blocks, NONE, Part, Seen};
use super::sums::{BLOCK, Coupling, FOUR, NARROW, Sums, WIDE};
use super::{Bundle, longer};
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Pose};

/// An observation behind its camera costs as much as one that is off by so many scales: much, so that steps keep points
/// in front, but finite, so that adjustments can begin with some behind.
const BEHIND: f64 = 100.0;
/// A point nearer than this counts as behind.
const NEAREST: f64 = 1e-12;
/// Numbers of a row, by place: the lens's follow the camera's.
const DIFFERENCE: usize = WIDE - 1;
/// Observations that are processed side by side.
const LANES: usize = 8;
type Lane = [f64; LANES];

/// A camera and its lens, prepared for projection.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct View {
    /// Columns of the rotation, then the translation.
    pose: [[f64; FOUR]; 4],
    /// Rows of the rotation.
    rows: [[f64; FOUR]; 3],
    optics: [f64; OPTICS],
    /// True if the lens is adjusted.
    wide: bool,
    /// The rotation of a camera that is turned from the first of its rig.
    turn: Option<[[f64; 3]; 3]>,
}

/// Numbers of [`View::optics`]: focal lengths, principal point, distortion; then the factors of derivatives, by the
/// movement of the camera and by each number of the lens: 0 if they are not adjusted.
const OPTICS: usize = 6 + 1 + NUMBERS;
/// The first of these, which the projection needs.
const SEEING: usize = 6;

impl View {
    pub fn new(bundle: &Bundle, blocks: &Blocks, camera: usize, pose: &Pose, lens: &Lens) -> Self {
        let seen: &Camera = &bundle.cameras[camera];
        let k = &seen.intrinsics;
        let center = lens.center(seen);
        let factor = lens.log_focal.exp();
        let moves = f64::from(blocks.of_camera[camera] != NONE);
        let [focal, k1, k2, x, y] = lens.free().map(f64::from);
        let (x, y) = (x * longer(seen), y * longer(seen));
        let row = |i: usize| pose.rotation.row(i).extend(0.0).to_array();
        let column = |i: usize| pose.rotation.col(i).extend(0.0).to_array();
        Self {
            pose: [column(0), column(1), column(2), pose.translation.extend(0.0).to_array()],
            rows: [row(0), row(1), row(2)],
            optics: [k.fx * factor, k.fy * factor, center.x, center.y, lens.k1, lens.k2, moves, focal, k1, k2, x, y],
            wide: blocks.of_lens[bundle.lens_of[camera]] != NONE,
            turn: bundle.turned(camera).map(|turn| turn.transpose().to_cols_array_2d()),
        }
    }

    /// A point in coordinates of the camera.
    #[inline(always)]
    fn apply<const FUSED: bool>(&self, point: &[f64; 3]) -> [f64; FOUR] {
        combined::<FUSED>(&[self.pose[0], self.pose[1], self.pose[2]], point, &self.pose[3])
    }

    /// The same direction in coordinates of the world.
    #[inline(always)]
    fn outward<const FUSED: bool>(&self, direction: &[f64; 3]) -> [f64; FOUR] {
        combined::<FUSED>(&self.rows, direction, &[0.0; FOUR])
    }
}

/// The sum of vectors times numbers, and of another vector.
#[inline(always)]
fn combined<const FUSED: bool>(of: &[[f64; FOUR]; 3], by: &[f64; 3], and: &[f64; FOUR]) -> [f64; FOUR] {
    let mut sum = *and;
    for k in (0..3).rev() {
        for i in 0..FOUR {
            sum[i] = fma::<FUSED>(of[k][i], by[k], sum[i]);
        }
    }
    sum
}

/// a b + c, rounded once where the processor can.
#[inline(always)]
pub(super) fn fma<const FUSED: bool>(a: f64, b: f64, c: f64) -> f64 {
    if FUSED { a.mul_add(b, c) } else { a * b + c }
}

/// Cost of squared differences, in scales: the sum of `ln(1 + x)`, as the logarithms of products, less one so that
/// small ones keep their digits.
#[derive(Default)]
struct Logs {
    sum: f64,
    products: Lane,
}

impl Logs {
    /// Factors from which on a product could be infinite.
    const LARGE: f64 = 1e100;

    #[inline(always)]
    fn add(&mut self, x: &Lane) {
        let mut small = true;
        let mut next = [0.0; LANES];
        for l in 0..LANES {
            next[l] = self.products[l] + x[l] * (1.0 + self.products[l]);
            // False for NaN, too.
            small &= next[l] < Self::LARGE;
        }
        if small {
            self.products = next;
        } else {
            self.add_large(x);
        }
    }

    #[cold]
    fn add_large(&mut self, x: &Lane) {
        for (product, x) in self.products.iter_mut().zip(x) {
            self.sum += product.ln_1p() + x.ln_1p();
            *product = 0.0;
        }
    }

    fn total(&self) -> f64 {
        self.sum + self.products.iter().map(|p| p.ln_1p()).sum::<f64>()
    }
}

/// A batch of observations, and their projections.
struct Batch {
    /// In coordinates of the cameras.
    p: [Lane; 3],
    pixel: [Lane; 2],
    precision: Lane,
    optics: [Lane; OPTICS],
    /// Inverse depth, and the places at depth 1.
    near: Lane,
    at: [Lane; 2],
    r2: Lane,
    bent: Lane,
    /// The projected pixel relative to the principal point, and relative to the observed pixel.
    from_center: [Lane; 2],
    difference: [Lane; 2],
    /// Square of the difference, in scales.
    far: Lane,
    /// Rows of both coordinates of the pixel: derivatives by camera and lens, the difference last; times the root of
    /// the weight.
    rows: [[Lane; WIDE]; 2],
    /// The same by the point, in coordinates of the camera.
    by_point: [[Lane; 3]; 2],
}

impl Batch {
    fn new() -> Self {
        let nothing = [0.0; LANES];
        Self {
            p: [[0.0; LANES], [0.0; LANES], [1.0; LANES]],
            pixel: [nothing; 2],
            precision: nothing,
            optics: [nothing; OPTICS],
            near: nothing,
            at: [nothing; 2],
            r2: nothing,
            bent: nothing,
            from_center: [nothing; 2],
            difference: [nothing; 2],
            far: nothing,
            rows: [[nothing; WIDE]; 2],
            by_point: [[nothing; 3]; 2],
        }
    }

    /// Loads observations, and the first `N` numbers of their optics.
    #[inline(always)]
    fn load<const FUSED: bool, const N: usize>(&mut self, views: &[View], points: &[DVec3], seen: &[Seen]) {
        for (l, o) in seen.iter().enumerate().take(LANES) {
            let view = &views[o.camera as usize];
            let p = view.apply::<FUSED>(&points[o.point as usize].to_array());
            for k in 0..3 {
                self.p[k][l] = p[k];
            }
            self.pixel[0][l] = o.pixel[0];
            self.pixel[1][l] = o.pixel[1];
            self.precision[l] = o.precision;
            for k in 0..N {
                self.optics[k][l] = view.optics[k];
            }
        }
        // The padding has weight 0.
        for l in seen.len()..LANES {
            self.precision[l] = 0.0;
        }
    }

    /// Projects the points. A point behind its camera is far off, and has no precision from here on.
    #[inline(always)]
    fn see<const FUSED: bool>(&mut self, far: f64) {
        let [fx, fy, cx, cy, k1, k2, ..] = &self.optics;
        for l in 0..LANES {
            let before = self.p[2][l] > NEAREST;
            let near = 1.0 / if before { self.p[2][l] } else { 1.0 };
            let (x, y) = (self.p[0][l] * near, self.p[1][l] * near);
            let r2 = fma::<FUSED>(x, x, y * y);
            let bent = fma::<FUSED>(r2, fma::<FUSED>(r2, k2[l], k1[l]), 1.0);
            let (u, v) = (fx[l] * bent * x, fy[l] * bent * y);
            let (du, dv) = (u + (cx[l] - self.pixel[0][l]), v + (cy[l] - self.pixel[1][l]));
            let square = fma::<FUSED>(du, du, dv * dv) * (far * self.precision[l]);
            (self.near[l], self.at[0][l], self.at[1][l], self.r2[l], self.bent[l]) = (near, x, y, r2, bent);
            (self.from_center[0][l], self.from_center[1][l]) = (u, v);
            (self.difference[0][l], self.difference[1][l]) = (du, dv);
            let nothing = self.precision[l] == 0.0;
            self.far[l] = if before || nothing { square } else { BEHIND * BEHIND };
            self.precision[l] = if before { self.precision[l] } else { 0.0 };
        }
    }

    /// The derivatives of a coordinate of the pixels.
    #[inline(always)]
    fn derive<const FUSED: bool>(&mut self, i: usize) {
        let [k1, k2] = [&self.optics[4], &self.optics[5]];
        let [moves, focal, bend, bend_more, shift] =
            [&self.optics[6], &self.optics[7], &self.optics[8], &self.optics[9], &self.optics[10 + i]];
        let row = &mut self.rows[i];
        for l in 0..LANES {
            let weight = (self.precision[l] / (1.0 + self.far[l])).sqrt();
            let along = self.at[i][l];
            let r2 = self.r2[l];
            let f = self.optics[i][l];
            // By the place at depth 1, then by the point.
            let turn = along * 2.0 * fma::<FUSED>(2.0 * r2, k2[l], k1[l]);
            let near = weight * f * self.near[l];
            let plane = [turn * self.at[0][l], turn * self.at[1][l]];
            let straight = [self.bent[l] * f64::from(i == 0), self.bent[l] * f64::from(i == 1)];
            let (x, y) = ((plane[0] + straight[0]) * near, (plane[1] + straight[1]) * near);
            let z = -fma::<FUSED>(x, self.at[0][l], y * self.at[1][l]);
            (self.by_point[i][0][l], self.by_point[i][1][l], self.by_point[i][2][l]) = (x, y, z);
            let (x, y, z) = (x * moves[l], y * moves[l], z * moves[l]);
            let p = [self.p[0][l], self.p[1][l], self.p[2][l]];
            (row[0][l], row[1][l], row[2][l]) = (x, y, z);
            row[3][l] = fma::<FUSED>(p[1], z, -p[2] * y);
            row[4][l] = fma::<FUSED>(p[2], x, -p[0] * z);
            row[5][l] = fma::<FUSED>(p[0], y, -p[1] * x);
            row[6][l] = weight * self.from_center[i][l] * focal[l];
            let bent = weight * f * along * r2;
            row[7][l] = bent * bend[l];
            row[8][l] = bent * r2 * bend_more[l];
            row[9 + i][l] = weight * shift[l];
            row[DIFFERENCE][l] = weight * self.difference[i][l];
        }
    }

    /// The rows of an observation.
    #[inline(always)]
    fn rows<const FUSED: bool, const N: usize>(&self, view: &View, l: usize) -> Rows<N> {
        [self.row::<FUSED, N>(view, l, 0), self.row::<FUSED, N>(view, l, 1)]
    }

    /// The row of a coordinate of an observation, and the derivatives by the point in coordinates of the world.
    #[inline(always)]
    fn row<const FUSED: bool, const N: usize>(&self, view: &View, l: usize, i: usize) -> ([f64; N], [f64; FOUR]) {
        let mut row = [0.0; N];
        for k in 0..N - 1 {
            row[k] = if N == WIDE || k < BLOCK { self.rows[i][k][l] } else { 0.0 };
        }
        row[N - 1] = self.rows[i][DIFFERENCE][l];
        if let Some(turn) = &view.turn {
            by_first(&mut row, turn);
        }
        let by_point = [self.by_point[i][0][l], self.by_point[i][1][l], self.by_point[i][2][l]];
        (row, view.outward::<FUSED>(&by_point))
    }
}

/// Makes the derivatives by the twist of a camera those by the twist of the first camera of its rig: with rotation Q
/// between both, the first one's twist (v, w) moves the camera by (Q v, Q w).
#[inline(always)]
fn by_first(row: &mut [f64], turn: &[[f64; 3]; 3]) {
    for half in row[..BLOCK].chunks_exact_mut(3) {
        let by = [half[0], half[1], half[2]];
        for k in 0..3 {
            half[k] = (0..3).map(|j| by[j] * turn[j][k]).sum();
        }
    }
}

/// All views, and the scale of the loss.
#[derive(Clone, Copy)]
pub(super) struct Sights<'a> {
    pub views: &'a [View],
    pub scale: f64,
}

impl Sights<'_> {
    /// The cost of the observations of points.
    #[inline(always)]
    pub fn cost<const FUSED: bool>(&self, points: &[DVec3], seen: &[Seen]) -> f64 {
        let mut logs = Logs::default();
        let mut batch = Batch::new();
        for seen in seen.chunks(LANES) {
            batch.load::<FUSED, SEEING>(self.views, points, seen);
            batch.see::<FUSED>(self.scale.powi(-2));
            logs.add(&batch.far);
        }
        self.scale * self.scale * logs.total()
    }

    /// The cost of a part and its quadratic model.
    #[inline(always)]
    pub fn linearize<const FUSED: bool>(&self, part: &mut Part) {
        let mut logs = Logs::default();
        let mut batch = Batch::new();
        part.sums.fill(Sums::default());
        part.matrix.fill([0.0; 6]);
        part.right.fill([0.0; 3]);
        let free = !part.matrix.is_empty();
        let mut last = NONE;
        for first in (0..part.seen.len()).step_by(LANES) {
            let count = LANES.min(part.seen.len() - first);
            batch.load::<FUSED, OPTICS>(self.views, &part.points, &part.seen[first..first + count]);
            batch.see::<FUSED>(self.scale.powi(-2));
            logs.add(&batch.far);
            batch.derive::<FUSED>(0);
            batch.derive::<FUSED>(1);
            for l in 0..count {
                let o = part.seen[first + l];
                if free && o.point != last {
                    last = o.point;
                    let entries = part.entries(last as usize);
                    part.coupling[entries].fill(Coupling::default());
                }
                let view = &self.views[o.camera as usize];
                if view.wide {
                    let rows = batch.rows::<FUSED, WIDE>(view, l);
                    outer::<FUSED, WIDE>(&mut part.sums[o.sums as usize], &rows);
                    if free {
                        couple::<FUSED, WIDE>(part, &rows, &o);
                    }
                } else {
                    let rows = batch.rows::<FUSED, NARROW>(view, l);
                    if o.sums != NONE {
                        outer::<FUSED, NARROW>(&mut part.sums[o.sums as usize], &rows);
                    }
                    if free {
                        couple::<FUSED, NARROW>(part, &rows, &o);
                    }
                }
            }
        }
        part.cost = self.scale * self.scale * logs.total();
    }
}

/// The rows of an observation, each with the derivatives by the point.
type Rows<const N: usize> = [([f64; N], [f64; FOUR]); 2];

/// Adds the outer products of the rows of an observation.
#[inline(always)]
fn outer<const FUSED: bool, const N: usize>(sums: &mut Sums, [(u, _), (v, _)]: &Rows<N>) {
    for (four, columns) in sums.0.iter_mut().enumerate().take(N / FOUR) {
        for a in four * FOUR..N {
            for c in 0..FOUR {
                let b = four * FOUR + c;
                columns[a][c] = fma::<FUSED>(v[a], v[b], fma::<FUSED>(u[a], u[b], columns[a][c]));
            }
        }
    }
}

/// Adds the terms of an observation for its point, and for the point with the camera and the lens.
#[inline(always)]
fn couple<const FUSED: bool, const N: usize>(part: &mut Part, [(u, du), (v, dv)]: &Rows<N>, o: &Seen) {
    let mut products = [[0.0; N]; 3];
    let right = &mut part.right[o.point as usize];
    for k in 0..3 {
        for b in 0..N {
            products[k][b] = fma::<FUSED>(du[k], u[b], dv[k] * v[b]);
        }
        right[k] -= products[k][N - 1];
    }
    if o.camera_entry != NONE {
        let coupling = &mut part.coupling[o.camera_entry as usize].0;
        for k in 0..3 {
            for b in 0..BLOCK {
                coupling[k][b] += products[k][b];
            }
        }
    }
    if N == WIDE && o.lens_entry != NONE {
        let coupling = &mut part.coupling[o.lens_entry as usize].0;
        for k in 0..3 {
            for b in 0..NUMBERS {
                coupling[k][b] += products[k][BLOCK + b];
            }
        }
    }
    let matrix = &mut part.matrix[o.point as usize];
    let mut at = 0;
    for k in 0..3 {
        for l in k..3 {
            matrix[at] += fma::<FUSED>(du[k], du[l], dv[k] * dv[l]);
            at += 1;
        }
    }
}
