//! Parts of space between upright planes.

use super::BlockError;
use weaver_geometry::glam::DVec3;

/// Points that each region has at least.
const LEAST: usize = 8;
/// Part of a region's points that its width along an axis leaves out at either end: stray points are far away.
const STRAY: f64 = 0.1;

/// One side of a plane: the points `p` with `normal . p < offset`, or where [`above`](Self::above) is true the others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cut {
    /// Unit normal of the plane.
    pub normal: [f64; 3],
    /// Distance of the plane from the origin along the normal, world units.
    pub offset: f64,
    /// The side.
    pub above: bool,
}

impl Cut {
    /// True if a point lies on this side; exactly one of two opposite sides has it.
    pub fn contains(&self, point: [f32; 3]) -> bool {
        (along(DVec3::from(self.normal), point) >= self.offset) == self.above
    }
}

/// The part of space on one side of each of some planes; all of space without any.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Region {
    /// The sides.
    pub cuts: Vec<Cut>,
}

impl Region {
    /// True if a point lies within.
    pub fn contains(&self, point: [f32; 3]) -> bool {
        self.cuts.iter().all(|cut| cut.contains(point))
    }

    fn with(&self, normal: DVec3, offset: f64, above: bool) -> Self {
        let mut cuts = self.cuts.clone();
        cuts.push(Cut { normal: normal.to_array(), offset, above });
        Self { cuts }
    }
}

/// Coordinate of a point along an axis.
fn along(axis: DVec3, point: [f32; 3]) -> f64 {
    axis.dot(DVec3::from(point.map(f64::from)))
}

/// Cuts space into `count` regions of equally many points, give or take one for each cut.
///
/// A region is halved across the axis along which the middle 80 % of its points spread most, and so are its halves (a
/// k-d tree); where an odd number of regions is left, in that proportion. Every point of space lies in exactly one
/// region.
///
/// # Errors
/// When there are fewer than 8 points for each region.
///
/// ```
/// use weaver_reconstruct::partition::regions;
/// use weaver_geometry::glam::DVec3;
/// let points: Vec<[f32; 3]> = (0..30).map(|i| [i as f32, 0.0, (i % 3) as f32]).collect();
/// let three = regions(&points, [DVec3::X, DVec3::Z], 3)?;
/// assert_eq!(three.iter().filter(|region| region.contains([1e6, 5.0, 0.0])).count(), 1);
/// # Ok::<(), weaver_reconstruct::partition::BlockError>(())
/// ```
pub fn regions(points: &[[f32; 3]], axes: [DVec3; 2], count: usize) -> Result<Vec<Region>, BlockError> {
    let needed = LEAST * count;
    if count == 0 || points.len() < needed {
        return Err(BlockError::Points { blocks: count.max(1), needed: needed.max(LEAST), found: points.len() });
    }
    let mut found = Vec::with_capacity(count);
    halve(points.to_vec(), axes, count, Region::default(), &mut found);
    Ok(found)
}

fn halve(points: Vec<[f32; 3]>, axes: [DVec3; 2], count: usize, region: Region, found: &mut Vec<Region>) {
    if count == 1 {
        found.push(region);
        return;
    }
    let sorted = axes.map(|axis| {
        let mut all: Vec<f64> = points.iter().map(|point| along(axis, *point)).collect();
        all.sort_unstable_by(f64::total_cmp);
        all
    });
    let width = |all: &[f64]| {
        let end = (STRAY * all.len() as f64) as usize;
        all[all.len() - 1 - end] - all[end]
    };
    let wider = usize::from(width(&sorted[1]) > width(&sorted[0]));
    let (axis, values) = (axes[wider], &sorted[wider]);
    let first = count / 2;
    let at = points.len() * first / count;
    let offset = 0.5 * (values[at - 1] + values[at]);
    let (below, above): (Vec<_>, Vec<_>) = points.into_iter().partition(|point| along(axis, *point) < offset);
    halve(below, axes, first, region.with(axis, offset, false), found);
    halve(above, axes, count - first, region.with(axis, offset, true), found);
}
