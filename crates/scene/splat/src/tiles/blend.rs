//! Blending a window: color, depth and features summed front to back.

use super::primitive::Response;
use super::record;
use super::traverse::{Hit, Visitor};
use super::window::{Cell, Plane};
use crate::each::each;
use weaver_kernels::lanes::{LANES, Row, Vector};
use weaver_scene::Features;

/// Place of the depth among the planes behind the transmittance.
pub(crate) const DEPTH_PLANE: usize = 3;

/// A primitive's numbers for the first `C` planes behind the transmittance: red, green, blue, depth.
#[inline(always)]
pub(crate) fn values<V: Vector, const C: usize>(numbers: &[V::Scalar; LANES]) -> [V; C] {
    each!(C, |i| V::splat(numbers[if i < DEPTH_PLANE { record::COLOR + i } else { record::DEPTH }]))
}

/// The value of plane `i` behind the transmittance at the pixels of a sample: only depth varies from pixel to pixel.
#[inline(always)]
pub(crate) fn at_pixels<V: Vector, R: Response>(response: &R, i: usize, value: V, sample: &R::Sample<V>) -> V {
    if i == DEPTH_PLANE { response.depth(sample, value) } else { value }
}

/// Adds primitives to the planes of a window: transmittance, `C` planes of red, green, blue and, where C is 4, depth,
/// then features. `MORE` says that there may be features.
pub(crate) struct Blend<'a, V: Vector, R, const C: usize, const MORE: bool> {
    response: &'a R,
    features: Features<'a, V::Scalar>,
    /// Primitives per view.
    per_view: usize,
    sums: &'a mut [Plane<V::Scalar>; C],
    /// Sums of features.
    more: &'a mut [Plane<V::Scalar>],
    /// Meeting of each cell whose features are not added yet; none without features.
    met: Vec<Met<'a, V>>,
    /// The primitive's numbers for the planes.
    values: [V; C],
    /// Its features.
    row: &'a [V::Scalar],
}

/// Primitives that a cell met: their weights and features.
#[derive(Clone, Copy)]
struct Met<'a, V: Vector> {
    hits: [(V, &'a [V::Scalar]); LANES],
    count: usize,
}

impl<'a, V: Vector, R, const C: usize, const MORE: bool> Blend<'a, V, R, C, MORE> {
    /// `planes` are those after the transmittance.
    #[inline(always)]
    pub fn new(
        response: &'a R,
        features: Option<Features<'a, V::Scalar>>,
        per_view: usize,
        planes: &'a mut [Plane<V::Scalar>],
    ) -> Self {
        planes.as_flattened_mut().fill(Row::default());
        let (sums, more) = planes.split_first_chunk_mut().expect("planes of colors and depth");
        let features = features.unwrap_or(Features { values: &[], channels: 0 });
        // Features are rare, and then the work is not in this allocation.
        let cells = if MORE && features.channels > 0 { LANES * LANES / V::WIDTH } else { 0 };
        let met = vec![Met { hits: [(V::zero(), &[][..]); LANES], count: 0 }; cells];
        Self { response, features, per_view, sums, more, met, values: [V::zero(); C], row: &[] }
    }

    /// Adds the features that are not added yet.
    #[inline(always)]
    pub fn finish(&mut self) {
        if MORE {
            (0..self.met.len()).for_each(
                #[inline(always)]
                |cell| self.add_features(Cell(cell)),
            );
        }
    }

    /// Adds the features of the primitives that a cell met; sixteen channels stay in registers meanwhile.
    #[inline(always)]
    fn add_features(&mut self, cell: Cell) {
        let channels = self.more.len();
        let whole = channels / LANES * LANES;
        for first in (0..whole).step_by(LANES) {
            self.add_channels::<LANES>(cell, first);
        }
        for first in whole..channels {
            self.add_channels::<1>(cell, first);
        }
        self.met[cell.0].count = 0;
    }

    #[inline(always)]
    fn add_channels<const N: usize>(&mut self, cell: Cell, first: usize) {
        let planes = &mut self.more[first..][..N];
        let mut sums: [V; N] = each!(N, |i| cell.load(&planes[i]));
        let Met { hits, count } = &self.met[cell.0];
        for (weight, row) in &hits[..*count] {
            let row = &row[first..][..N];
            for (sum, value) in sums.iter_mut().zip(row) {
                *sum = weight.mul_add(V::splat(*value), *sum);
            }
        }
        for (plane, sum) in planes.iter_mut().zip(sums) {
            cell.store(sum, plane);
        }
    }
}

impl<V: Vector, R: Response, const C: usize, const MORE: bool> Visitor<V, R> for Blend<'_, V, R, C, MORE> {
    #[inline(always)]
    fn begin(&mut self, primitive: usize, record: &[V::Scalar; LANES]) {
        self.values = values(record);
        if MORE && self.features.channels > 0 {
            self.row = self.features.of(primitive % self.per_view);
        }
    }

    #[inline(always)]
    fn hit(&mut self, hit: &Hit<V, R::Sample<V>>) {
        for i in 0..C {
            let plane = &mut self.sums[i];
            let value = at_pixels(self.response, i, self.values[i], &hit.sample);
            hit.cell.store(hit.weight.mul_add(value, hit.cell.load(plane)), plane);
        }
        if MORE && let Some(Met { hits, count }) = self.met.get_mut(hit.cell.0) {
            hits[*count % LANES] = (hit.weight, self.row);
            *count += 1;
            if *count == LANES {
                self.add_features(hit.cell);
            }
        }
    }

    #[inline(always)]
    fn end(&mut self, _place: usize) {}
}
