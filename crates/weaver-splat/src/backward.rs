//! Differentiating a window: sums over pixels of what blending passes back to each splat.
//!
//! The walk is front to back again, with the very arithmetic of drawing. What lies behind a splat at a pixel is what the
//! whole list gave there, known from drawing, less what came up to it.

use crate::draw::values;
use crate::each::each;
use crate::gradients::Cotangents;
use crate::splat::slot;
use crate::window::{Hit, Plane, Visitor, Window};
use weaver_kernels::lanes::{LANES, Lanes, Row};
use weaver_scene::Features;

/// Where the sums of a splat over pixels are, in a row of [`LANES`]; g = alpha dL/dalpha where alpha is not capped, w =
/// alpha T.
pub(crate) mod moment {
    /// sum g
    pub const G: usize = 0;
    /// sum g u, sum g v
    pub const FIRST: usize = 1;
    /// sum g u^2, sum g u v, sum g v^2
    pub const SECOND: usize = 3;
    /// sum w dimage
    pub const COLOR: usize = 6;
    /// sum w ddepth
    pub const Z: usize = 9;
    /// sum |p g u|, sum |q g u + r g v|
    pub const ABSOLUTE: usize = 10;
}

/// Gradients that arrive at one view's outputs; `None` is zero.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ViewCotangents<'a, T> {
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
    /// Those of view `v`, of images of so many pixels.
    pub(crate) fn of_view(&self, v: usize, pixels: usize, channels: usize) -> ViewCotangents<'_, T> {
        ViewCotangents {
            image: part(self.image, 3 * v * pixels),
            alpha: part(self.alpha, v * pixels),
            depth: part(self.depth, v * pixels),
            features: part(self.features, channels * v * pixels),
        }
    }
}

/// What begins at `start`; nothing where there are no numbers.
fn part<T>(values: Option<&[T]>, start: usize) -> Option<&[T]> {
    values.filter(|values| !values.is_empty()).map(|values| &values[start..])
}

/// Fills `planes`, as many as drawing had: dL by what is left behind, then the cotangents of red, green, blue, depth if
/// it was drawn, features. They hold zeros where there are no cotangents. Works from the cotangents and from `drawn`, what
/// drawing left; returns the gradient of the background.
#[inline(always)]
pub(crate) fn prepare<V: Lanes>(
    window: &Window,
    depth: bool,
    background: [V::Scalar; 3],
    cotangents: &ViewCotangents<'_, V::Scalar>,
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

/// Sums what splats get from the pixels of a window, of `C` planes of colors and depth. `MORE` says that there are
/// features, or that pulls are asked for.
pub(crate) struct Undo<'a, V: Lanes, const C: usize, const MORE: bool> {
    alpha_max: V,
    features: Features<'a, V::Scalar>,
    gaussians: usize,
    /// dL by what is behind the splats that came.
    rest: &'a mut Plane<V::Scalar>,
    /// Cotangents.
    cotangents: &'a [Plane<V::Scalar>; C],
    /// Cotangents of features.
    more: &'a [Plane<V::Scalar>],
    /// Sums of the tile's list, [`moment`]s.
    moments: &'a mut [Row<V::Scalar>],
    /// Sums of features of the tile's list, `[entries, C]`.
    feature_sums: &'a mut [V::Scalar],
    /// The splat's numbers for the planes.
    values: [V; C],
    /// p, q, r.
    factor: [V; 3],
    sums: [V; 12],
    /// Its features, and their sums.
    row: &'a [V::Scalar],
    row_sums: &'a mut [Row<V::Scalar>],
}

impl<'a, V: Lanes, const C: usize, const MORE: bool> Undo<'a, V, C, MORE> {
    /// Adds to `moments` and `feature_sums`; `planes` are those of [`prepare`], `row_sums` is room for all features.
    #[inline(always)]
    pub fn new(
        alpha_max: f64,
        (features, gaussians): (Option<Features<'a, V::Scalar>>, usize),
        planes: &'a mut [Plane<V::Scalar>],
        (moments, feature_sums): (&'a mut [Row<V::Scalar>], &'a mut [V::Scalar]),
        row_sums: &'a mut [Row<V::Scalar>],
    ) -> Self {
        let zero = V::zero();
        let (rest, planes) = planes.split_first_mut().expect("a plane of the rest");
        let (cotangents, more) = planes.split_first_chunk().expect("planes of colors and depth");
        Self {
            alpha_max: V::constant(alpha_max),
            features: features.unwrap_or(Features { values: &[], channels: 0 }),
            gaussians,
            rest,
            cotangents,
            more,
            moments,
            feature_sums,
            values: [zero; C],
            factor: [zero; 3],
            sums: [zero; 12],
            row: &[],
            row_sums,
        }
    }
}

impl<V: Lanes, const C: usize, const MORE: bool> Visitor<V> for Undo<'_, V, C, MORE> {
    #[inline(always)]
    fn begin(&mut self, splat: usize, record: &[V::Scalar; LANES]) {
        self.values = values(record);
        self.sums = [V::zero(); 12];
        if MORE {
            self.factor = each!(3, |i| V::splat(record[slot::P + i]));
            self.row = self.features.of(splat % self.gaussians);
            self.row_sums.fill(Row::default());
        }
    }

    #[inline(always)]
    fn hit(&mut self, hit: &Hit<V>) {
        let Hit { block, seen, u, v, raw, alpha, weight, .. } = *hit;
        let sums = &mut self.sums;
        let mut value = V::zero();
        for i in 0..C {
            let d = V::load(&self.cotangents[i][block].0);
            value = if i == 0 { d * self.values[i] } else { d.mul_add(self.values[i], value) };
            sums[moment::COLOR + i] = weight.mul_add(d, sums[moment::COLOR + i]);
        }
        if MORE {
            for ((d, &feature), sum) in self.more.iter().zip(self.row).zip(self.row_sums.iter_mut()) {
                let d = V::load(&d[block].0);
                value = d.mul_add(V::splat(feature), value);
                weight.mul_add(d, V::load(&sum.0)).store(&mut sum.0);
            }
        }
        let value = weight * value;
        let rest = V::load(&self.rest[block].0) - value;
        rest.store(&mut self.rest[block].0);
        // alpha dL/dalpha = w value - alpha / (1 - alpha) rest
        let odds = alpha * (V::constant(1.0) - alpha).recip();
        let g = odds.neg_mul_add(rest, value).only(self.alpha_max.ge_among(raw, seen));
        let (gu, gv) = (g * u, g * v);
        sums[moment::G] = sums[moment::G] + g;
        sums[moment::FIRST] = sums[moment::FIRST] + gu;
        sums[moment::FIRST + 1] = sums[moment::FIRST + 1] + gv;
        sums[moment::SECOND] = gu.mul_add(u, sums[moment::SECOND]);
        sums[moment::SECOND + 1] = gu.mul_add(v, sums[moment::SECOND + 1]);
        sums[moment::SECOND + 2] = gv.mul_add(v, sums[moment::SECOND + 2]);
        if MORE {
            let [p, q, r] = self.factor;
            sums[moment::ABSOLUTE] = sums[moment::ABSOLUTE] + (p * gu).abs();
            sums[moment::ABSOLUTE + 1] = sums[moment::ABSOLUTE + 1] + q.mul_add(gu, r * gv).abs();
        }
    }

    #[inline(always)]
    fn end(&mut self, place: usize) {
        let zero = V::zero();
        let [a, b, c, d, e, f, g, h, i, j, k, l] = self.sums;
        let sums = V::sums(&[a, b, c, d, e, f, g, h, i, j, k, l, zero, zero, zero, zero]);
        let row = &mut self.moments[place].0;
        (V::load(row) + sums).store(row);
        if MORE {
            let channels = self.row.len();
            let totals = self.feature_sums[place * channels..][..channels].iter_mut();
            for (total, sums) in totals.zip(self.row_sums.iter()) {
                *total += V::sums(&[V::load(&sums.0); LANES]).to_array()[0];
            }
        }
    }
}
