//! Occupied voxels as an octree: the eight children of every cell, level by level.

use crate::adaptive::AdaptiveModel;
use crate::error::CodecError;
use crate::mixed::MixedModel;
use crate::morton::{from_morton3, morton3};
use crate::range::Coder;

/// Greatest depth: Morton codes have 63 bits.
pub const DEEPEST: u32 = 21;

/// Numbers of points in a voxel that have a symbol of their own; the rest is a number.
const COUNTS: usize = 16;

/// Codes points on the grid of an octree, as Morton codes in ascending order, equal ones for equal points.
///
/// A child is occupied or not with a probability in three contexts: its brothers that are decided; faces of the cell behind which there
/// are others; the parent's children. An encoder takes the points, a decoder any slice; both return the points.
///
/// # Errors
/// When a stream has other than `count` points, or ends.
///
/// ```
/// use weaver_codec::{RangeDecoder, RangeEncoder, code_octree, morton3};
///
/// let points = [morton3([1, 2, 3]), morton3([1, 2, 3]), morton3([6, 0, 5])];
/// let mut encoder = RangeEncoder::default();
/// code_octree(&mut encoder, 3, 3, &points)?;
/// let bytes = encoder.finish();
/// assert_eq!(code_octree(&mut RangeDecoder::new(&bytes), 3, 3, &[])?, points);
/// # Ok::<(), weaver_codec::CodecError>(())
/// ```
pub fn code_octree(coder: &mut impl Coder, depth: u32, count: usize, points: &[u64]) -> Result<Vec<u64>, CodecError> {
    if depth > DEEPEST {
        return Err(CodecError::invalid("octree", format!("a depth up to {DEEPEST}"), depth));
    }
    if count == 0 {
        return Ok(Vec::new());
    }
    let mut model = MixedModel::of_bits([256 * 3, 64 * 8, 256 * 8]);
    let mut cells = Cells { codes: vec![0], occupancies: Vec::new() };
    let mut parents = Cells { codes: Vec::new(), occupancies: Vec::new() };
    for level in 0..depth {
        let mut ahead = Ahead { points, shift: 3 * (depth - level - 1), next: 0 };
        let mut children = Vec::new();
        let mut parent = 0;
        for at in 0..cells.codes.len() {
            let code = cells.codes[at];
            while level > 0 && parents.codes[parent] != code >> 3 {
                parent += 1;
            }
            let brothers = if level > 0 { parents.occupancies[parent] } else { 0 };
            let context = [cells.faces(code, level), usize::from(brothers)];
            let occupancy = code_children(coder, &mut model, context, ahead.children(code));
            cells.occupancies.push(occupancy);
            children.extend((0..8).filter(|child| occupancy >> child & 1 == 1).map(|child| code << 3 | child));
            if children.len() > count || coder.exhausted() {
                let found = if coder.exhausted() { "the end of the stream" } else { "more" };
                return Err(CodecError::invalid(format!("octree, level {level}"), format!("{count} points"), found));
            }
        }
        parents = std::mem::replace(&mut cells, Cells { codes: children, occupancies: Vec::new() });
    }
    multiply(coder, &cells.codes, count, points)
}

/// Cells of one level in Morton order, and the children of those that are coded.
struct Cells {
    codes: Vec<u64>,
    occupancies: Vec<u8>,
}

impl Cells {
    /// Which of the six neighbors of a cell are there, one bit for each.
    fn faces(&self, code: u64, level: u32) -> usize {
        let place = from_morton3(code);
        let end = 1 << level;
        (0..6).fold(0, |faces, face| {
            let mut neighbor = place;
            let (axis, up) = (face / 2, face % 2 == 1);
            neighbor[axis] = if up { place[axis] + 1 } else { place[axis].wrapping_sub(1) };
            let there = neighbor[axis] < end && self.codes.binary_search(&morton3(neighbor)).is_ok();
            faces | usize::from(there) << face
        })
    }
}

/// Children of cells by the points ahead of an encoder.
struct Ahead<'a> {
    points: &'a [u64],
    /// Bits of a point below its child.
    shift: u32,
    next: usize,
}

impl Ahead<'_> {
    fn children(&mut self, code: u64) -> u8 {
        let mut occupancy = 0;
        while let Some(point) = self.points.get(self.next).filter(|&&point| point >> self.shift >> 3 == code) {
            occupancy |= 1 << (point >> self.shift & 7);
            self.next += 1;
        }
        occupancy
    }
}

/// Codes which of eight children there are, at least one.
fn code_children(
    coder: &mut impl Coder,
    model: &mut MixedModel<3>,
    [faces, brothers]: [usize; 2],
    occupancy: u8,
) -> u8 {
    let mut found = 0;
    let neighbors = (faces.count_ones() as usize).div_ceil(2).min(2);
    for child in 0..8 {
        // The children before this one, behind a one.
        let decided = 1 << child | usize::from(found);
        let last = child == 7 && found == 0;
        let contexts = [decided * 3 + neighbors, faces * 8 + child, brothers * 8 + child];
        let bit = last || model.code_bit(coder, contexts, occupancy >> child & 1 == 1);
        found |= u8::from(bit) << child;
    }
    found
}

/// Codes how many points each voxel has.
fn multiply(coder: &mut impl Coder, voxels: &[u64], count: usize, points: &[u64]) -> Result<Vec<u64>, CodecError> {
    let mut model = AdaptiveModel::new(COUNTS + 1);
    let mut found = Vec::with_capacity(count);
    let mut next = 0;
    for &voxel in voxels {
        let same = points[next.min(points.len())..].iter().take_while(|&&point| point == voxel).count();
        next += same;
        let mut more = model.code(coder, same.saturating_sub(1).min(COUNTS));
        if more == COUNTS {
            more += coder.raw(32, same.saturating_sub(1 + COUNTS) as u32) as usize;
        }
        let total = found.len() + more + 1;
        if total > count {
            return Err(CodecError::invalid("octree, points of voxels", format!("{count} points"), total));
        }
        found.extend(std::iter::repeat_n(voxel, more + 1));
    }
    if found.len() != count || coder.exhausted() {
        return Err(CodecError::invalid("octree, points of voxels", format!("{count} points"), found.len()));
    }
    Ok(found)
}
