//! Drawing a window: colour, depth and features summed front to back.

use crate::each::each;
use crate::scene::Features;
use crate::splat::slot;
use crate::window::{Hit, Plane, Visitor};
use weaver_kernels::lanes::{LANES, Lanes, Row};

/// Planes of a window: transmittance, red, green, blue, depth if asked for, features.
pub(crate) fn planes(depth: bool, channels: usize) -> usize {
    4 + usize::from(depth) + channels
}

/// Adds splats to the planes of a window.
pub(crate) struct Draw<'a, V: Lanes, const DEPTH: bool> {
    features: Option<Features<'a, V::Scalar>>,
    /// Gaussians per view.
    gaussians: usize,
    /// Red, green, blue, depth.
    planes: [&'a mut Plane<V::Scalar>; 4],
    /// Features.
    more: &'a mut [Plane<V::Scalar>],
    /// The splat's numbers for the planes.
    values: [V; 4],
    /// Its features.
    row: &'a [V::Scalar],
}

impl<'a, V: Lanes, const DEPTH: bool> Draw<'a, V, DEPTH> {
    /// `planes` are those after the transmittance; `spare` stands for the depth where there is none.
    #[inline(always)]
    pub fn new(
        features: Option<Features<'a, V::Scalar>>,
        gaussians: usize,
        planes: &'a mut [Plane<V::Scalar>],
        spare: &'a mut Plane<V::Scalar>,
    ) -> Self {
        planes.as_flattened_mut().fill(Row::default());
        let (colour, rest) = planes.split_at_mut(3);
        let (depth, more) = rest.split_at_mut(usize::from(DEPTH));
        let [red, green, blue] = colour else { unreachable!("three planes of colour") };
        let planes = [red, green, blue, depth.first_mut().unwrap_or(spare)];
        Self { features, gaussians, planes, more, values: [V::zero(); 4], row: &[] }
    }
}

impl<V: Lanes, const DEPTH: bool> Visitor<V> for Draw<'_, V, DEPTH> {
    #[inline(always)]
    fn begin(&mut self, splat: usize, record: &[V::Scalar; LANES]) {
        let [r, g, b] = each!(3, |i| V::splat(record[slot::COLOUR + i]));
        self.values = [r, g, b, V::splat(record[slot::Z])];
        if let Some(Features { values, channels }) = self.features {
            let n = splat % self.gaussians;
            self.row = &values[n * channels..][..channels];
        }
    }

    #[inline(always)]
    fn hit(&mut self, hit: &Hit<V>) {
        for i in 0..3 + usize::from(DEPTH) {
            let sum = &mut self.planes[i][hit.block].0;
            hit.weight.mul_add(self.values[i], V::load(sum)).store(sum);
        }
        for (plane, &value) in self.more.iter_mut().zip(self.row) {
            let sum = &mut plane[hit.block].0;
            hit.weight.mul_add(V::splat(value), V::load(sum)).store(sum);
        }
    }

    #[inline(always)]
    fn end(&mut self, _place: usize) {}
}
