//! Blend backward for a window: sums over pixels of the gradients that blending passes back to each primitive.
//!
//! The walk is front to back again, with exactly the arithmetic of the forward pass. The light from behind a primitive
//! at a pixel is the total of the whole list there, known from the forward pass, less the sum up to it.

use super::blend::{DEPTH_PLANE, at_pixels, values};
use super::primitive::{MAX_SUMS, MAX_SUMS_WITH_STATISTICS, Response};
use super::traverse::{Hit, Visitor};
use super::window::{Plane, Window};
use crate::each::each;
use crate::gradients::Cotangents;
use weaver_kernels::Real;
use weaver_kernels::lanes::{LANES, Lanes, Row, Vector};
use weaver_scene::Features;

/// Places in the row of a list entry behind the [`Response::SUMS`] sums of the primitive's shape; w = alpha T.
pub(crate) mod moment {
    /// sum w dimage
    pub const COLOR: usize = 0;
    /// sum w ddepth
    pub const DEPTH: usize = COLOR + 3;
    /// sum |dL/dx|, sum |dL/dy| for a position (x, y) on the image; with statistics only, as all that follow.
    pub const ABSOLUTE: usize = DEPTH + 1;
    /// sum w
    pub const WEIGHT: usize = ABSOLUTE + 2;
    /// Number of sums so far.
    pub const SUMS: usize = WEIGHT + 1;
    /// Not a sum but a maximum: the largest w.
    pub const LARGEST_WEIGHT: usize = SUMS;
}

/// Gradients that arrive at one view's outputs; `None` is zero.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct PictureCotangents<'a, T> {
    /// `[H, W, 3]`
    pub image: Option<&'a [T]>,
    /// `[H, W]`
    pub alpha: Option<&'a [T]>,
    /// `[H, W]`
    pub depth: Option<&'a [T]>,
    /// `[H, W, C]`
    pub features: Option<&'a [T]>,
}

impl<T> Cotangents<'_, T> {
    /// The cotangents of a picture of `pixels` pixels.
    pub(crate) fn of_picture(&self, picture: usize, pixels: usize, channels: usize) -> PictureCotangents<'_, T> {
        PictureCotangents {
            image: part(self.image, 3 * picture * pixels),
            alpha: part(self.alpha, picture * pixels),
            depth: part(self.depth, picture * pixels),
            features: part(self.features, channels * picture * pixels),
        }
    }
}

/// The slice that begins at `start`; nothing where there are no numbers.
fn part<T>(values: Option<&[T]>, start: usize) -> Option<&[T]> {
    values.filter(|values| !values.is_empty()).map(|values| &values[start..])
}

/// Fills `planes`, as many as the forward pass had: the pixel's total, contracted with the cotangents, then the
/// cotangents of red, green, blue, depth if it was drawn, features. They hold zeros where there are no cotangents.
/// Works from the cotangents and from `drawn`, the planes of the forward pass; returns the gradient with respect to the
/// background.
#[inline(always)]
pub(crate) fn prepare<V: Lanes>(
    window: &Window,
    depth: bool,
    background: [V::Scalar; 3],
    cotangents: &PictureCotangents<'_, V::Scalar>,
    drawn: &[Plane<V::Scalar>],
    planes: &mut [Plane<V::Scalar>],
) -> [V::Scalar; 3] {
    let first = 4 + usize::from(depth);
    let channels = planes.len() - first;
    let background = each!(3, |c| V::splat(background[c]));
    let mut dbackground = [V::zero(); 3];
    for block in 0..LANES {
        let at = |plane: usize| V::load(&drawn[plane][block].0);
        let left = at(0);
        let mut seen = V::zero();
        let mut through = V::zero();
        if let Some(image) = cotangents.image {
            for c in 0..3 {
                let d = window.gather::<V>(block, image, 3, c);
                d.store(&mut planes[1 + c][block].0);
                seen = d.mul_add(at(1 + c), seen);
                through = d.mul_add(background[c], through);
                dbackground[c] = d.mul_add(left, dbackground[c]);
            }
        }
        if let Some(alpha) = cotangents.alpha {
            through = through - window.gather::<V>(block, alpha, 1, 0);
        }
        if let (true, Some(depths)) = (depth, cotangents.depth) {
            let d = window.gather::<V>(block, depths, 1, 0);
            d.store(&mut planes[4][block].0);
            seen = d.mul_add(at(4), seen);
        }
        if let Some(features) = cotangents.features {
            for c in 0..channels {
                let d = window.gather::<V>(block, features, channels, c);
                d.store(&mut planes[first + c][block].0);
                seen = d.mul_add(at(first + c), seen);
            }
        }
        left.mul_add(through, seen).store(&mut planes[0][block].0);
    }
    each!(3, |c| dbackground[c].to_array().into_iter().sum())
}

/// Sums the gradients of primitives from the pixels of a window, of `C` planes of colors and depth. `MORE` says that
/// there are features or statistics.
pub(crate) struct BlendBackward<'a, V: Vector, R: Response, const C: usize, const MORE: bool> {
    response: &'a R,
    alpha_max: V,
    features: Features<'a, V::Scalar>,
    /// Primitives per view.
    per_view: usize,
    /// True if statistics are summed, too.
    statistics: bool,
    /// Everything behind the primitives that came, contracted with the cotangents.
    rest: &'a mut Plane<V::Scalar>,
    /// Cotangents.
    cotangents: &'a [Plane<V::Scalar>; C],
    /// Cotangents of features.
    more: &'a [Plane<V::Scalar>],
    sums: EntrySums<'a, V::Scalar>,
    /// The primitive's numbers for the planes.
    values: [V; C],
    loaded: R::Loaded<V>,
    /// The first [`Response::SUMS`] are used.
    shape: [V; MAX_SUMS],
    blended: [V; moment::SUMS],
    largest: V,
    /// Its features, and their sums.
    row: &'a [V::Scalar],
    row_sums: &'a mut [Row<V::Scalar>],
}

/// Sums over pixels for each entry of a tile's list.
#[derive(Debug)]
pub(crate) struct EntrySums<'a, T> {
    /// By [`moment`].
    pub moments: &'a mut [Row<T>],
    /// `[entries, C]`
    pub features: &'a mut [T],
}

/// Attributes of the primitives for a backward walk, beside their records.
#[derive(Clone, Copy)]
pub(crate) struct Attributes<'a, T> {
    pub features: Option<Features<'a, T>>,
    /// Primitives per view.
    pub per_view: usize,
    pub statistics: bool,
}

impl<'a, V: Vector, R: Response, const C: usize, const MORE: bool> BlendBackward<'a, V, R, C, MORE> {
    /// Adds to `sums`; `planes` come from [`prepare`], `row_sums` is room for all features.
    #[inline(always)]
    pub fn new(
        response: &'a R,
        alpha_max: f64,
        attributes: Attributes<'a, V::Scalar>,
        planes: &'a mut [Plane<V::Scalar>],
        sums: EntrySums<'a, V::Scalar>,
        row_sums: &'a mut [Row<V::Scalar>],
    ) -> Self {
        const { assert!(R::SUMS <= MAX_SUMS, "a primitive with more sums than a row has places for") };
        let zero = V::zero();
        let (rest, planes) = planes.split_first_mut().expect("a plane of the rest");
        let (cotangents, more) = planes.split_first_chunk().expect("planes of colors and depth");
        Self {
            response,
            alpha_max: V::constant(alpha_max),
            features: attributes.features.unwrap_or(Features { values: &[], channels: 0 }),
            per_view: attributes.per_view,
            statistics: attributes.statistics && R::SUMS <= MAX_SUMS_WITH_STATISTICS,
            rest,
            cotangents,
            more,
            sums,
            values: [zero; C],
            loaded: response.load(&[V::Scalar::ZERO; LANES]),
            shape: [zero; _],
            blended: [zero; _],
            largest: zero,
            row: &[],
            row_sums,
        }
    }
}

impl<V: Vector, R: Response, const C: usize, const MORE: bool> Visitor<V, R> for BlendBackward<'_, V, R, C, MORE> {
    #[inline(always)]
    fn begin(&mut self, primitive: usize, record: &[V::Scalar; LANES]) {
        let zero = V::zero();
        self.values = values(record);
        self.shape[..R::SUMS].fill(zero);
        self.blended = [zero; _];
        if MORE {
            self.largest = zero;
            self.loaded = self.response.load(record);
        }
        if MORE && self.features.channels > 0 {
            self.row = self.features.of(primitive % self.per_view);
            self.row_sums.fill(Row::default());
        }
    }

    #[inline(always)]
    fn hit(&mut self, hit: &Hit<V, R::Sample<V>>) {
        let Hit { cell, seen, sample, raw, alpha, weight, .. } = hit;
        let (cell, weight) = (*cell, *weight);
        let mut value = V::zero();
        for i in 0..C {
            let d: V = cell.load(&self.cotangents[i]);
            let own = at_pixels(self.response, i, self.values[i], sample);
            value = if i == 0 { d * own } else { d.mul_add(own, value) };
            let sum = &mut self.blended[moment::COLOR + i];
            *sum = weight.mul_add(d, *sum);
            if i == DEPTH_PLANE {
                self.response.depth_backward(sample, weight * d, &mut self.shape[..R::SUMS]);
            }
        }
        if MORE {
            for ((d, &feature), sum) in self.more.iter().zip(self.row).zip(self.row_sums.iter_mut()) {
                let d: V = cell.load(d);
                value = d.mul_add(V::splat(feature), value);
                weight.mul_add(d, V::load_part(&sum.0, 0)).store_part(&mut sum.0, 0);
            }
        }
        let value = weight * value;
        let rest = cell.load::<V>(self.rest) - value;
        cell.store(rest, self.rest);
        // alpha dL/dalpha = w value - alpha / (1 - alpha) rest
        let odds = *alpha * (V::constant(1.0) - *alpha).recip();
        let g = odds.neg_mul_add(rest, value).only(self.alpha_max.ge_among(*raw, *seen));
        self.response.backward(sample, g, &mut self.shape[..R::SUMS]);
        if MORE && self.statistics {
            let [dx, dy] = self.response.screen_gradient(&self.loaded, sample, g);
            let [.., x, y, total] = &mut self.blended;
            *x = *x + dx.abs();
            *y = *y + dy.abs();
            *total = *total + weight;
            self.largest = self.largest.max(weight);
        }
    }

    #[inline(always)]
    fn end(&mut self, place: usize) {
        let zero = V::zero();
        let blended = if R::SUMS <= MAX_SUMS_WITH_STATISTICS { moment::SUMS } else { moment::ABSOLUTE };
        let mut sums = [zero; LANES];
        sums[..R::SUMS].copy_from_slice(&self.shape[..R::SUMS]);
        sums[R::SUMS..][..blended].copy_from_slice(&self.blended[..blended]);
        let row = &mut self.sums.moments[place].0;
        V::add_sums(&sums, row);
        if MORE {
            if self.statistics {
                let largest = &mut row[R::SUMS + moment::LARGEST_WEIGHT];
                *largest = self.largest.to_array().into_iter().fold(*largest, V::Scalar::max);
            }
            let channels = self.row.len();
            let totals = self.sums.features[place * channels..][..channels].chunks_mut(LANES);
            for (totals, rows) in totals.zip(self.row_sums.chunks(LANES)) {
                let mut sums = [V::Scalar::ZERO; LANES];
                let rows = each!(LANES, |i| if i < rows.len() { V::load_part(&rows[i].0, 0) } else { zero });
                V::add_sums(&rows, &mut sums);
                totals.iter_mut().zip(sums).for_each(|(total, sum)| *total += sum);
            }
        }
    }
}
