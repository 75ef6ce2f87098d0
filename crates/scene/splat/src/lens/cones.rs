//! Which pixels of an image may see a Gaussian: a pyramid of cones around the rays of blocks of pixels.

use crate::tiles::BLOCK;
use std::f64::consts::FRAC_PI_2;
use weaver_geometry::glam::DVec3;
use weaver_kernels::lanes::LANES;

/// Angle that rounding of rays may add.
const SLACK: f64 = 1e-6;

/// A cone around rays.
#[derive(Clone, Copy, Debug)]
struct Cone {
    axis: DVec3,
    /// Half of its angle; negative if there is no ray.
    angle: f64,
    /// The sine of it: 2 for one that no plane has on one side, -2 if there is no ray.
    sine: f64,
}

impl Cone {
    fn new(axis: DVec3, angle: f64) -> Self {
        let sine = if angle < 0.0 {
            -2.0
        } else if angle < FRAC_PI_2 {
            angle.sin()
        } else {
            2.0
        };
        Self { axis, angle, sine }
    }

    /// The cone around others.
    fn around(parts: impl Iterator<Item = Cone> + Clone) -> Self {
        let parts = parts.filter(|part| part.angle >= 0.0);
        let axis = parts.clone().map(|part| part.axis).sum::<DVec3>().normalize_or(DVec3::Z);
        let angle = parts.map(|part| axis.dot(part.axis).clamp(-1.0, 1.0).acos() + part.angle).fold(-1.0, f64::max);
        // The arc cosine is not exact near 1.
        Self::new(axis, if angle < 0.0 { angle } else { angle + SLACK })
    }
}

/// Cones around the rays of ever larger squares of blocks.
#[derive(Debug)]
pub(crate) struct Cones {
    /// From blocks to the whole image: columns, rows and cones.
    levels: Vec<(usize, usize, Vec<Cone>)>,
}

/// A rectangle of blocks: the first columns and rows, and the last.
#[derive(Clone, Copy, Debug, Default)]
struct Blocks {
    low: [usize; 2],
    high: [usize; 2],
}

impl Cones {
    /// Around the rays of blocks in rows of `across`; rays of 0 count as none.
    pub fn new(directions: &[[DVec3; LANES]], across: usize) -> Self {
        let of_block = |rays: &[DVec3; LANES]| {
            let seen = rays.iter().filter(|ray| **ray != DVec3::ZERO);
            Cone::around(seen.map(|ray| Cone::new(*ray, 0.0)))
        };
        let mut levels = vec![(across, directions.len() / across.max(1), directions.iter().map(of_block).collect())];
        while let Some((columns, rows, below)) = levels.last()
            && columns * rows > 1
        {
            let below: &Vec<Cone> = below;
            let (across, down) = (columns.div_ceil(2), rows.div_ceil(2));
            let cone = |i: usize| {
                let (x, y) = (2 * (i % across), 2 * (i / across));
                let places = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
                let inside = places.into_iter().filter(|(x, y)| x < columns && y < rows);
                Cone::around(inside.map(|(x, y)| below[y * columns + x]))
            };
            let next = (0..across * down).map(cone).collect();
            levels.push((across, down, next));
        }
        Self { levels }
    }

    /// A rectangle around the pixel centers whose rays w may have `n . w <= 0` for all of five normals n: left, right,
    /// top, bottom. `None` if there are none. Around a seam, where the image is periodic, left exceeds right.
    pub fn cover(&self, normals: &[DVec3; 5], periodic: bool) -> Option<[f64; 4]> {
        // A normal that is not finite has nothing on one side.
        let normals = normals.map(|n| n / n.length());
        let middle = self.levels[0].0 / 2;
        let mut halves: [Option<Blocks>; 2] = [None; 2];
        self.visit(self.levels.len() - 1, [0, 0], &normals, middle, &mut halves);
        let side = |blocks: usize| (blocks * BLOCK) as f64 + 0.5;
        let end = |blocks: usize| side(blocks) + (BLOCK - 1) as f64;
        let found = halves[0].or(halves[1])?;
        let (a, b) = (halves[0].unwrap_or(found), halves[1].unwrap_or(found));
        let (top, bottom) = (side(a.low[1].min(b.low[1])), end(a.high[1].max(b.high[1])));
        let (low, high) = (a.low[0].min(b.low[0]), a.high[0].max(b.high[0]));
        let both = halves[0].is_some() && halves[1].is_some();
        let outer = low + self.levels[0].0 - high;
        if periodic && both && b.low[0] - a.high[0] > outer {
            return Some([side(b.low[0]), end(a.high[0]), top, bottom]);
        }
        Some([side(low), end(high), top, bottom])
    }

    /// Adds the blocks below a cone that may see something to the rectangle of their half of the image.
    fn visit(
        &self,
        level: usize,
        at: [usize; 2],
        normals: &[DVec3; 5],
        middle: usize,
        halves: &mut [Option<Blocks>; 2],
    ) {
        let (columns, rows, cones) = &self.levels[level];
        let cone = &cones[at[1] * columns + at[0]];
        if normals.iter().any(|n| n.dot(cone.axis) > cone.sine) {
            return;
        }
        let low = at.map(|x| x << level);
        let high = [low[0] + (1 << level) - 1, low[1] + (1 << level) - 1];
        // All of it is in a rectangle already.
        let half = usize::from(low[0] >= middle);
        if half == usize::from(high[0] >= middle)
            && halves[half].is_some_and(|found| (0..2).all(|i| found.low[i] <= low[i] && high[i] <= found.high[i]))
        {
            return;
        }
        if level == 0 {
            let found = halves[half].get_or_insert(Blocks { low, high });
            for i in 0..2 {
                found.low[i] = found.low[i].min(low[i]);
                found.high[i] = found.high[i].max(high[i]);
            }
            return;
        }
        let (columns, rows) = (*columns, *rows);
        debug_assert!(at[0] < columns && at[1] < rows);
        let (across, down, _) = &self.levels[level - 1];
        for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let below = [2 * at[0] + x, 2 * at[1] + y];
            if below[0] < *across && below[1] < *down {
                self.visit(level - 1, below, normals, middle, halves);
            }
        }
    }
}
