//! Occupied voxels as an octree: the eight children of every cell, level by level.

use crate::error::CodecError;
use crate::mixed::{MixedModel, MixedNibble};
use crate::quantizer::LARGEST_SYMBOL;
use crate::range::Coder;
use weaver_kernels::simd;

/// Greatest depth: Morton codes have 63 bits.
pub const DEEPEST: u32 = 21;

/// In place of a neighbor that is not there.
const NONE: u32 = u32::MAX;

/// Codes points on the grid of an octree, as Morton codes in ascending order, equal ones for equal points.
///
/// Children of a cell are coded in two halves. Each is predicted by the faces of the cell behind which there are
/// others, and by the parent's children. An encoder takes the points, a decoder any slice; both return the points.
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
    simd::dispatch(
        #[inline(always)]
        || code(coder, depth, count, points),
    )
}

#[inline(always)]
fn code(coder: &mut impl Coder, depth: u32, count: usize, points: &[u64]) -> Result<Vec<u64>, CodecError> {
    if depth > DEEPEST {
        return Err(CodecError::invalid("octree", format!("a depth up to {DEEPEST}"), depth));
    }
    if count == 0 {
        return Ok(Vec::new());
    }
    if count > NONE as usize {
        return Err(CodecError::invalid("octree", "fewer than 2^32 points", count));
    }
    let mut model = Children::new();
    let mut cells = vec![Cell { code: 0, brothers: 0, neighbors: [NONE; 6] }];
    for level in 0..depth {
        let mut ahead = Ahead { points, shift: 3 * (depth - level - 1), next: 0 };
        // Start of the children of each cell, and a mask of them.
        let mut families = Vec::with_capacity(cells.len());
        let mut children = 0;
        for cell in &cells {
            let occupancy = model.code(coder, cell, ahead.children(cell.code));
            families.push(Family { first: children, occupancy });
            children += occupancy.count_ones();
            if children as usize > count || coder.exhausted() {
                let found = if coder.exhausted() { "the end of the stream" } else { "more" };
                return Err(CodecError::invalid(format!("octree, level {level}"), format!("{count} points"), found));
            }
        }
        cells = next_level(&cells, &families, children as usize);
    }
    multiply(coder, &cells, count, points)
}

/// An occupied cell.
struct Cell {
    code: u64,
    /// Children of its parent.
    brothers: u8,
    /// Cells of its level behind its faces, in the order -x, +x, -y, +y, -z, +z.
    neighbors: [u32; 6],
}

impl Cell {
    /// Mask of the faces with a neighboring cell, one bit for each.
    #[inline(always)]
    fn faces(&self) -> usize {
        (0..6).fold(0, |faces, face| faces | usize::from(self.neighbors[face] != NONE) << face)
    }
}

/// Children of a cell.
#[derive(Clone, Copy)]
struct Family {
    first: u32,
    occupancy: u8,
}

impl Family {
    /// The number of a child in its level.
    #[inline(always)]
    fn child(self, child: usize) -> u32 {
        let before = self.occupancy & ((1 << child) - 1);
        if self.occupancy >> child & 1 == 1 { self.first + before.count_ones() } else { NONE }
    }
}

/// The children of all cells. Behind a face of a child is a brother, or a child of the cell behind the same face.
fn next_level(cells: &[Cell], families: &[Family], count: usize) -> Vec<Cell> {
    let mut level = Vec::with_capacity(count);
    for (cell, &family) in cells.iter().zip(families) {
        for child in (0..8).filter(|child| family.occupancy >> child & 1 == 1) {
            let behind = |face: usize| {
                let side = 1 << (face / 2);
                let inside = (child & side == 0) == (face % 2 == 1);
                let neighbor = cell.neighbors[face] as usize;
                let family = if inside { Some(&family) } else { families.get(neighbor) };
                family.map_or(NONE, |family| family.child(child ^ side))
            };
            let neighbors = std::array::from_fn(behind);
            level.push(Cell { code: cell.code << 3 | child as u64, brothers: family.occupancy, neighbors });
        }
    }
    level
}

/// Children of cells by the points ahead of an encoder.
struct Ahead<'a> {
    points: &'a [u64],
    /// Bits of a point below its child.
    shift: u32,
    next: usize,
}

impl Ahead<'_> {
    #[inline(always)]
    fn children(&mut self, code: u64) -> u8 {
        let mut occupancy = 0;
        while let Some(point) = self.points.get(self.next).filter(|&&point| point >> self.shift >> 3 == code) {
            occupancy |= 1 << (point >> self.shift & 7);
            self.next += 1;
        }
        occupancy
    }
}

/// Models of the first four children of a cell, and of the others.
struct Children {
    first: MixedNibble<3>,
    second: MixedNibble<3>,
}

impl Children {
    fn new() -> Self {
        Self { first: MixedNibble::new([4, 64, 256]), second: MixedNibble::new([16 * 4, 64 * 16, 256 * 4]) }
    }

    /// Codes a mask of the eight children, at least one.
    #[inline(always)]
    fn code(&mut self, coder: &mut impl Coder, cell: &Cell, occupancy: u8) -> u8 {
        let (faces, brothers) = (cell.faces(), usize::from(cell.brothers));
        let number = (faces.count_ones() as usize).div_ceil(2);
        let first = self.first.code(coder, [number, faces, brothers], false, occupancy & 15);
        let found = usize::from(first);
        let filled = found.count_ones().min(3) as usize;
        let contexts = [found * 4 + number, faces * 16 + found, brothers * 4 + filled];
        let second = self.second.code(coder, contexts, first == 0, occupancy >> 4);
        first | second << 4
    }
}

/// Codes how many points each voxel has.
#[inline(always)]
fn multiply(coder: &mut impl Coder, voxels: &[Cell], count: usize, points: &[u64]) -> Result<Vec<u64>, CodecError> {
    let mut model = MixedModel::new([1]);
    let mut found = Vec::with_capacity(count);
    let mut next = 0;
    for &Cell { code, .. } in voxels {
        let same = points[next.min(points.len())..].iter().take_while(|&&point| point == code).count();
        next += same;
        let more = same.saturating_sub(1);
        if more > LARGEST_SYMBOL as usize {
            return Err(CodecError::invalid("octree", format!("{LARGEST_SYMBOL} equal points"), more));
        }
        let total = found.len() + 1 + model.code(coder, [0], more as i32).unsigned_abs() as usize;
        if total > count {
            return Err(CodecError::invalid("octree, points of voxels", format!("{count} points"), total));
        }
        found.resize(total, code);
    }
    if found.len() != count || coder.exhausted() {
        return Err(CodecError::invalid("octree, points of voxels", format!("{count} points"), found.len()));
    }
    Ok(found)
}
