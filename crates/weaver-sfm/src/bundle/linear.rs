//! What observations say: their cost, and its quadratic model.

use super::lens::{Lens, NUMBERS};
use super::structure::{Blocks, NONE, Part};
use super::{Bundle, longer};
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Pose};

/// Numbers of a block, and as many as fill a vector.
pub(super) const BLOCK: usize = 6;
pub(super) const PADDED: usize = 8;
/// An observation behind its camera costs as much as one that is off by so many scales.
const BEHIND: f64 = 100.0;
/// Nearer than this, a point is behind.
const NEAREST: f64 = 1e-12;
/// Numbers of a row of an observation: those of its camera, of its lens if that is adjusted, and the difference; in fours.
const WIDE: usize = 12;
const NARROW: usize = 8;
/// Numbers that the compiler keeps in a register.
const FOUR: usize = 4;

/// What a block has in common with a point, one row for each coordinate of the point.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(64))]
pub(super) struct Coupling(pub [[f64; PADDED]; 3]);

/// Sum of the outer products of the rows of a camera, in columns of four; of the columns above the diagonal only those beside it.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(64))]
pub(super) struct Sums([[[f64; FOUR]; WIDE]; WIDE / FOUR]);

impl Sums {
    pub fn add(&mut self, other: &Self) {
        let both = self.0.as_flattened_mut().as_flattened_mut().iter_mut().zip(other.0.as_flattened().as_flattened());
        both.for_each(|(x, y)| *x += y);
    }

    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// The element of a row and a column of the symmetric matrix.
    pub fn at(&self, row: usize, column: usize) -> f64 {
        let (row, column) = (row.max(column), row.min(column));
        self.0[column / FOUR][row][column % FOUR]
    }
}

/// A camera and its lens, ready to see.
#[derive(Clone, Copy, Debug)]
pub(super) struct View {
    rotation: [[f64; 3]; 3],
    translation: [f64; 3],
    focal: [f64; 2],
    center: [f64; 2],
    k: [f64; 2],
    /// 1 if the camera moves, 0 if not.
    moves: f64,
    /// What derivatives by the numbers of the lens are multiplied by: 0 for those that are not adjusted.
    lens: [f64; NUMBERS],
    /// The number of its sums, or [`NONE`].
    pub sums: u32,
    /// Whether the lens is adjusted.
    pub wide: bool,
}

impl View {
    pub fn new(bundle: &Bundle, blocks: &Blocks, camera: usize, pose: &Pose, lens: &Lens) -> Self {
        let seen: &Camera = &bundle.cameras[camera];
        let k = &seen.intrinsics;
        let factor = lens.log_focal.exp();
        let mut free = lens.free().map(f64::from);
        free[3] *= longer(seen);
        free[4] *= longer(seen);
        Self {
            rotation: [0, 1, 2].map(|i| pose.rotation.row(i).to_array()),
            translation: pose.translation.to_array(),
            focal: [k.fx * factor, k.fy * factor],
            center: lens.center(seen).to_array(),
            k: [lens.k1, lens.k2],
            moves: f64::from(blocks.of_camera[camera] != NONE),
            lens: free,
            sums: blocks.sums[camera],
            wide: blocks.of_lens[bundle.lens_of[camera]] != NONE,
        }
    }

    /// The point in coordinates of the camera.
    #[inline(always)]
    fn apply<const FUSED: bool>(&self, point: &[f64; 3]) -> [f64; 3] {
        let [x, y, z] = *point;
        let mut p = [0.0; 3];
        for i in 0..3 {
            let r = &self.rotation[i];
            p[i] = fma::<FUSED>(r[0], x, fma::<FUSED>(r[1], y, fma::<FUSED>(r[2], z, self.translation[i])));
        }
        p
    }
}

/// a b + c, rounded once where the processor can.
#[inline(always)]
pub(super) fn fma<const FUSED: bool>(a: f64, b: f64, c: f64) -> f64 {
    if FUSED { a.mul_add(b, c) } else { a * b + c }
}

/// What squared differences, in scales, cost: the sum of `ln(1 + x)`, as the logarithm of products, less one so that small
/// ones keep their digits.
#[derive(Default)]
struct Logs {
    sum: f64,
    product: f64,
}

impl Logs {
    /// Factors from which on a product could be infinite.
    const LARGE: f64 = 1e100;

    #[inline(always)]
    fn add(&mut self, x: f64) {
        // Also true for what is not a number.
        if !(x < Self::LARGE) {
            self.sum += x.ln_1p();
            return;
        }
        self.product += x * (1.0 + self.product);
        if self.product > Self::LARGE {
            self.sum += self.product.ln_1p();
            self.product = 0.0;
        }
    }

    fn total(&self) -> f64 {
        self.sum + self.product.ln_1p()
    }
}

/// How an observation is seen.
struct Sight {
    /// In coordinates of the camera.
    p: [f64; 3],
    /// One over the depth, and the place at depth 1.
    near: f64,
    at: [f64; 2],
    r2: f64,
    bent: f64,
    /// Where it is seen less the principal point, and less where it was seen.
    from_center: [f64; 2],
    difference: [f64; 2],
}

impl Sight {
    /// `None` behind the camera.
    #[inline(always)]
    fn new<const FUSED: bool>(view: &View, point: &[f64; 3], pixel: &[f64; 2]) -> Option<Self> {
        let p = view.apply::<FUSED>(point);
        if p[2] <= NEAREST {
            return None;
        }
        let near = 1.0 / p[2];
        let at = [p[0] * near, p[1] * near];
        let r2 = fma::<FUSED>(at[0], at[0], at[1] * at[1]);
        let bent = fma::<FUSED>(r2, fma::<FUSED>(r2, view.k[1], view.k[0]), 1.0);
        let mut from_center = [0.0; 2];
        let mut difference = [0.0; 2];
        for i in 0..2 {
            from_center[i] = view.focal[i] * bent * at[i];
            difference[i] = from_center[i] + (view.center[i] - pixel[i]);
        }
        Some(Self { p, near, at, r2, bent, from_center, difference })
    }

    /// The square of the difference.
    #[inline(always)]
    fn square(&self) -> f64 {
        self.difference[0] * self.difference[0] + self.difference[1] * self.difference[1]
    }

    /// The derivatives of a coordinate of the pixel, by camera, lens and point, with the difference last.
    #[inline(always)]
    fn row<const FUSED: bool, const N: usize>(&self, view: &View, i: usize) -> ([f64; N], [f64; 3]) {
        let along = self.at[i];
        let f = view.focal[i];
        // By the place at depth 1, then by the point.
        let bend = along * 2.0 * fma::<FUSED>(2.0 * self.r2, view.k[1], view.k[0]);
        let mut plane = [bend * self.at[0], bend * self.at[1]];
        plane[i] += self.bent;
        let [x, y] = [plane[0] * f * self.near, plane[1] * f * self.near];
        let z = -(x * self.at[0] + y * self.at[1]);
        let p = &self.p;
        let mut row = [0.0; N];
        row[0] = x * view.moves;
        row[1] = y * view.moves;
        row[2] = z * view.moves;
        row[3] = (p[1] * z - p[2] * y) * view.moves;
        row[4] = (p[2] * x - p[0] * z) * view.moves;
        row[5] = (p[0] * y - p[1] * x) * view.moves;
        if N == WIDE {
            let straight = f * along;
            row[6] = self.from_center[i] * view.lens[0];
            row[7] = straight * self.r2 * view.lens[1];
            row[8] = straight * self.r2 * self.r2 * view.lens[2];
            row[9 + i] = view.lens[3 + i];
        }
        row[N - 1] = self.difference[i];
        let r = &view.rotation;
        let mut by_point = [0.0; 3];
        for k in 0..3 {
            by_point[k] = fma::<FUSED>(r[0][k], x, fma::<FUSED>(r[1][k], y, r[2][k] * z));
        }
        (row, by_point)
    }
}

/// Where all was seen from, and the scale of the loss.
#[derive(Clone, Copy)]
pub(super) struct Sights<'a> {
    pub views: &'a [View],
    pub scale: f64,
}

impl Sights<'_> {
    /// The cost of the observations of a part, with its points where they are or where they are tried.
    #[inline(always)]
    pub fn cost<const FUSED: bool>(&self, part: &mut Part, points: impl Fn(&mut Part, usize) -> DVec3) {
        let mut logs = Logs::default();
        let far = self.scale.powi(-2);
        for point in 0..part.points.len() {
            let at = points(part, point).to_array();
            for o in &part.seen[part.sights(point)] {
                let sight = Sight::new::<FUSED>(&self.views[o.camera as usize], &at, &o.pixel);
                logs.add(sight.map_or(BEHIND * BEHIND, |s| s.square() * (far * o.precision)));
            }
        }
        part.cost = self.scale * self.scale * logs.total();
    }

    /// The cost and its quadratic model.
    #[inline(always)]
    pub fn linearize<const FUSED: bool>(&self, part: &mut Part) {
        let mut logs = Logs::default();
        let far = self.scale.powi(-2);
        part.sums.iter_mut().for_each(Sums::clear);
        let free = !part.matrix.is_empty();
        for point in 0..part.points.len() {
            let at = part.points[point].to_array();
            let entries = part.entries(point);
            part.coupling[entries].fill(Coupling::default());
            let mut of_point = OfPoint::default();
            for o in part.sights(point) {
                let o = &part.seen[o];
                let view = &self.views[o.camera as usize];
                let Some(sight) = Sight::new::<FUSED>(view, &at, &o.pixel) else {
                    logs.add(BEHIND * BEHIND);
                    continue;
                };
                let x = sight.square() * (far * o.precision);
                logs.add(x);
                let weight = o.precision / (1.0 + x);
                let entries = [o.camera_entry, o.lens_entry];
                if view.wide {
                    let rows = [sight.row::<FUSED, WIDE>(view, 0), sight.row::<FUSED, WIDE>(view, 1)];
                    let scaled = scaled(&rows, weight);
                    outer::<FUSED, WIDE>(&mut part.sums[view.sums as usize], &rows, &scaled);
                    if free {
                        of_point.add::<FUSED, WIDE>(&rows, &scaled, weight, &mut part.coupling, entries);
                    }
                } else {
                    let rows = [sight.row::<FUSED, NARROW>(view, 0), sight.row::<FUSED, NARROW>(view, 1)];
                    let scaled = scaled(&rows, weight);
                    if view.sums != NONE {
                        outer::<FUSED, NARROW>(&mut part.sums[view.sums as usize], &rows, &scaled);
                    }
                    if free {
                        of_point.add::<FUSED, NARROW>(&rows, &scaled, weight, &mut part.coupling, entries);
                    }
                }
            }
            if free {
                (part.matrix[point], part.right[point]) = (of_point.matrix, of_point.right);
            }
        }
        part.cost = self.scale * self.scale * logs.total();
    }
}

/// The rows of an observation, each with the derivatives by the point.
type Rows<const N: usize> = [([f64; N], [f64; 3]); 2];

#[inline(always)]
fn scaled<const N: usize>(rows: &Rows<N>, weight: f64) -> [[f64; N]; 2] {
    let mut scaled = [rows[0].0, rows[1].0];
    for row in &mut scaled {
        for x in row {
            *x *= weight;
        }
    }
    scaled
}

/// Adds the outer products of the rows of an observation.
#[inline(always)]
fn outer<const FUSED: bool, const N: usize>(sums: &mut Sums, rows: &Rows<N>, scaled: &[[f64; N]; 2]) {
    for (four, columns) in sums.0.iter_mut().enumerate().take(N / FOUR) {
        for a in four * FOUR..N {
            for c in 0..FOUR {
                let b = four * FOUR + c;
                let sum = fma::<FUSED>(rows[0].0[a], scaled[0][b], columns[a][c]);
                columns[a][c] = fma::<FUSED>(rows[1].0[a], scaled[1][b], sum);
            }
        }
    }
}

/// What is said of a point.
#[derive(Default)]
struct OfPoint {
    matrix: [f64; 6],
    right: [f64; 3],
}

impl OfPoint {
    #[inline(always)]
    fn add<const FUSED: bool, const N: usize>(
        &mut self,
        rows: &Rows<N>,
        scaled: &[[f64; N]; 2],
        weight: f64,
        couplings: &mut [Coupling],
        [camera, lens]: [u32; 2],
    ) {
        let ([u, v], [wu, wv]) = ([&rows[0].1, &rows[1].1], scaled);
        let mut products = [[0.0; N]; 3];
        for k in 0..3 {
            for b in 0..N {
                products[k][b] = fma::<FUSED>(u[k], wu[b], v[k] * wv[b]);
            }
            self.right[k] -= products[k][N - 1];
        }
        if camera != NONE {
            let coupling = &mut couplings[camera as usize].0;
            for k in 0..3 {
                for b in 0..BLOCK {
                    coupling[k][b] += products[k][b];
                }
            }
        }
        if N == WIDE && lens != NONE {
            let coupling = &mut couplings[lens as usize].0;
            for k in 0..3 {
                for b in 0..NUMBERS {
                    coupling[k][b] += products[k][BLOCK + b];
                }
            }
        }
        let mut at = 0;
        for k in 0..3 {
            let (wu, wv) = (weight * u[k], weight * v[k]);
            for l in k..3 {
                self.matrix[at] += fma::<FUSED>(wu, u[l], wv * v[l]);
                at += 1;
            }
        }
    }
}
