//! Records of surfels for the tile layer, and their footprints.

use crate::surfels::Surfel;
use crate::{Limits, SurfelCamera, SurfelSlices};
use weaver_geometry::Pose;
use weaver_geometry::glam::DVec2;
use weaver_kernels::Real;
use weaver_kernels::lanes::{LANES, LaneMask, Lanes};
use weaver_splat::tiles::{ALPHA_MIN, Footprint, Projected, Projection, record};

/// Places in a record, beside the depth, which is the distance of the center, and the color, which is the normal.
pub(crate) mod slot {
    /// t1 / s1, three numbers.
    pub const FIRST: usize = 0;
    /// s1 / s2: t2 / s2 is n x t1 / s1 times this.
    pub const RATIO: usize = 3;
    /// n.c
    pub const PLANE: usize = 4;
    /// t1.c / s1
    pub const A: usize = 5;
    /// t2.c / s2
    pub const B: usize = 6;
    pub const OPACITY: usize = 11;
    /// Column of the center.
    pub const U: usize = 12;
    /// Row of the center.
    pub const V: usize = 13;
    pub const HALF_WIDTH: usize = 14;
    pub const HALF_HEIGHT: usize = 15;
}

/// Surfels, and the cameras that see them: one lens at several poses.
#[derive(Clone, Copy, Debug)]
pub struct Sight<'a, T> {
    /// The surfels.
    pub surfels: SurfelSlices<'a, T>,
    /// Lens and size of all images.
    pub camera: &'a SurfelCamera,
    /// World-to-camera poses, one for each image.
    pub poses: &'a [Pose],
    /// Bounds of the visible range.
    pub limits: Limits,
}

impl<T: Real> Sight<'_, T> {
    /// Half the reach of alpha on the image around the center of a surfel.
    fn reach(&self, surfel: &Surfel) -> [f64; 2] {
        let visible = (surfel.opacity / ALPHA_MIN).ln().max(0.0);
        let reach = (2.0 * visible).sqrt() * (1.0 + 1e-5);
        let sides = [0, 1].map(|i| surfel.axes[i] * (surfel.scales[i] * reach));
        // Numbers of 32 bits round.
        let more = 0.01 + 1e-5 * self.camera.width.max(self.camera.height) as f64;
        // A surfel shows through its plane or through the low-pass filter: the footprint covers both.
        self.camera.reach(surfel.center, sides).max(DVec2::splat(visible.sqrt())).to_array().map(|half| half + more)
    }

    /// The record of a surfel in a view, if it is seen; `Err` if its numbers are not finite.
    fn record(&self, view: usize, n: usize) -> Result<Option<[f64; LANES]>, ()> {
        let surfel = self.surfels.placed(n, &self.poses[view]);
        let Surfel { center, axes: [t1, t2, normal], scales: [s1, s2], opacity } = surfel;
        let (distance, plane) = (center.length(), normal.dot(center));
        let Limits { near, far, .. } = self.limits;
        if !(distance.is_finite() && plane.is_finite() && opacity.is_finite()) {
            return Err(());
        }
        if distance <= near || distance > far || plane >= 0.0 || opacity < ALPHA_MIN {
            return Ok(None);
        }
        let mut numbers = [0.0; LANES];
        (t1 / s1).write_to_slice(&mut numbers[slot::FIRST..]);
        numbers[slot::RATIO] = s1 / s2;
        numbers[slot::PLANE] = plane;
        (numbers[slot::A], numbers[slot::B]) = (t1.dot(center) / s1, t2.dot(center) / s2);
        numbers[record::DEPTH] = distance;
        normal.write_to_slice(&mut numbers[record::COLOR..]);
        numbers[slot::OPACITY] = opacity;
        let at = self.camera.project(center);
        let [half_width, half_height] = self.reach(&surfel);
        (numbers[slot::U], numbers[slot::V]) = (at.x, at.y);
        (numbers[slot::HALF_WIDTH], numbers[slot::HALF_HEIGHT]) = (half_width, half_height);
        if numbers.iter().all(|x| T::from_f64(*x).is_finite()) { Ok(Some(numbers)) } else { Err(()) }
    }
}

impl<T: Real> Projection<T> for Sight<'_, T> {
    type State<V: Lanes<Scalar = T>> = usize;

    fn begin<V: Lanes<Scalar = T>>(&self, view: usize) -> usize {
        view
    }

    fn project<V: Lanes<Scalar = T>>(&self, view: &mut usize, first: usize, count: usize) -> Projected<V> {
        let mut rejected = 0;
        let records: [_; LANES] = std::array::from_fn(|i| {
            let record = if i < count { self.record(*view, first + i) } else { Ok(None) };
            record.unwrap_or_else(|()| {
                rejected |= 1 << i;
                None
            })
        });
        let projected = Projected::from_records(records.map(|record| record.map(|numbers| numbers.map(T::from_f64))));
        Projected { rejected: V::Mask::from_bits(rejected), ..projected }
    }
}

impl<T: Real> Footprint for Sight<'_, T> {
    #[inline(always)]
    fn rows<V: Lanes>(&self, columns: &[V; LANES]) -> (V, V) {
        let (v, half) = (columns[slot::V], columns[slot::HALF_HEIGHT]);
        (v - half, v + half)
    }

    #[inline(always)]
    fn span<V: Lanes>(&self, columns: &[V; LANES], top: V, bottom: V) -> (V, V, V::Mask) {
        let (u, half) = (columns[slot::U], columns[slot::HALF_WIDTH]);
        let (highest, lowest) = self.rows(columns);
        (u - half, u + half, bottom.ge(highest).and(lowest.ge(top)))
    }

    #[inline(always)]
    fn second_span<V: Lanes>(&self, columns: &[V; LANES], top: V, bottom: V) -> Option<(V, V, V::Mask)> {
        let period = self.camera.period()?;
        let (left, right, touched) = self.span(columns, top, bottom);
        // The image is periodic: a place beyond one end of a row is at the other.
        let around = V::constant(period).or(V::zero().ge(left), V::constant(-period));
        Some((left + around, right + around, touched))
    }
}
