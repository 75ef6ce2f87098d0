//! Means of Gaussians: points of their pixels plus bounded offsets.

use crate::{Origin, Parametrization};
use weaver_autograd::{Backward, Op, Pool, Real, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};

#[derive(Debug)]
struct Place {
    reach: f64,
}

impl Place {
    fn reach<T: Real>(&self, ins: &[View<'_, T>], i: usize) -> T {
        T::from_f64(self.reach) * ins.get(2).map_or(T::ONE, |footprint| footprint[i])
    }
}

impl<T: Real> Op<T> for Place {
    fn name(&self) -> &'static str {
        "place"
    }

    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let n = ins[0].rows();
        ensure_shape!(ins[0] == Shape::from([n, 3]), "points [N, 3]");
        ensure_shape!(ins[1].rank() == 2 && ins[1][0] == n && ins[1][1] >= 3, "raw parameters [{n}, S], S >= 3");
        ensure_shape!(ins.len() == 2 || ins[2] == Shape::from([n]), "footprints [{n}]");
        Ok(Shapes::one(ins[0]))
    }

    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let slot = ins[1].shape().last();
        for (i, mean) in outs[0].chunks_exact_mut(3).enumerate() {
            let reach = self.reach(ins, i);
            for a in 0..3 {
                mean[a] = ins[0][3 * i + a] + reach * ins[1][slot * i + a].tanh();
            }
        }
    }

    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, .. } = at;
        let (raw, dmean) = (ins[1], douts[0]);
        let slot = raw.shape().last();
        if let Some(dpoint) = &mut dins[0] {
            dpoint.add(&dmean);
        }
        if let Some(draw) = &mut dins[1] {
            for (i, draw) in draw.accumulator().chunks_exact_mut(slot).enumerate() {
                let reach = self.reach(ins, i);
                for a in 0..3 {
                    let bend = raw[slot * i + a].tanh();
                    draw[a] += dmean[3 * i + a] * reach * (T::ONE - bend * bend);
                }
            }
        }
        if let Some(Some(dfootprint)) = dins.get_mut(2) {
            let reach = T::from_f64(self.reach);
            dfootprint.add_each(|i| {
                let moved: T = (0..3).map(|a| dmean[3 * i + a] * raw[slot * i + a].tanh()).sum();
                reach * moved
            });
        }
    }
}

#[derive(Debug)]
struct PlaceOnPatch {
    reach: f64,
}

impl PlaceOnPatch {
    /// Axes times the longest offset along each `[3][3]`.
    fn axes<T: Real>(&self, ins: &[View<'_, T>], i: usize) -> [[T; 3]; 3] {
        let axes = rotation([0, 1, 2, 3].map(|a| ins[3][4 * i + a]));
        [0, 1, 2].map(|a| axes[a].map(|x| x * T::from_f64(self.reach) * ins[2][3 * i + a]))
    }
}

/// The axes of a unit quaternion wxyz: the columns of its rotation matrix.
fn rotation<T: Real>([w, x, y, z]: [T; 4]) -> [[T; 3]; 3] {
    let (one, two) = (T::ONE, T::from_f64(2.0));
    [
        [one - two * (y * y + z * z), two * (x * y + w * z), two * (x * z - w * y)],
        [two * (x * y - w * z), one - two * (x * x + z * z), two * (y * z + w * x)],
        [two * (x * z + w * y), two * (y * z - w * x), one - two * (x * x + y * y)],
    ]
}

impl<T: Real> Op<T> for PlaceOnPatch {
    fn name(&self) -> &'static str {
        "place_on_patch"
    }

    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let n = ins[0].rows();
        ensure_shape!(ins[0] == Shape::from([n, 3]), "points [N, 3]");
        ensure_shape!(ins[1].rank() == 2 && ins[1][0] == n && ins[1][1] >= 3, "raw parameters [{n}, S], S >= 3");
        ensure_shape!(ins[2] == ins[0] && ins[3] == Shape::from([n, 4]), "extents [{n}, 3] and rotations [{n}, 4]");
        Ok(Shapes::one(ins[0]))
    }

    fn differentiable(&self, index: usize) -> bool {
        index < 2
    }

    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let slot = ins[1].shape().last();
        for (i, mean) in outs[0].chunks_exact_mut(3).enumerate() {
            mean.copy_from_slice(&ins[0][3 * i..3 * i + 3]);
            for (a, axis) in self.axes(ins, i).into_iter().enumerate() {
                let bend = ins[1][slot * i + a].tanh();
                mean.iter_mut().zip(axis).for_each(|(mean, axis)| *mean += bend * axis);
            }
        }
    }

    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, .. } = at;
        let (raw, dmean) = (ins[1], douts[0]);
        let slot = raw.shape().last();
        if let Some(dpoint) = &mut dins[0] {
            dpoint.add(&dmean);
        }
        if let Some(draw) = &mut dins[1] {
            for (i, draw) in draw.accumulator().chunks_exact_mut(slot).enumerate() {
                for (a, axis) in self.axes(ins, i).into_iter().enumerate() {
                    let bend = raw[slot * i + a].tanh();
                    let along: T = axis.iter().zip(&dmean[3 * i..]).map(|(axis, d)| *axis * *d).sum();
                    draw[a] += along * (T::ONE - bend * bend);
                }
            }
        }
    }
}

/// The means of Gaussians: their points plus bounded offsets, mu = Q + r tanh(o), componentwise in world axes, or in a
/// patch's.
///
/// Q is `point` `[N, 3]`, o the first three of `raw` `[N, S]`; r is the published constant in world units, or the
/// constant of the parametrization times the pixel's footprint, or times the extents of the patch along its axes.
/// `point`, `raw` and footprints are differentiable; the result is `[N, 3]`, in world units. Panics on other shapes,
/// and if the parametrization needs an `origin` of another kind. Source: official SplatWeaver code,
/// `CardinalityGaussian`.
#[track_caller]
pub fn place<'t, T: Real>(
    point: Var<'t, T>,
    raw: Var<'t, T>,
    origin: Option<Origin<'t, T>>,
    parametrization: Parametrization,
) -> Var<'t, T> {
    let tape = point.tape();
    let [mean] = match (parametrization, origin) {
        (Parametrization::Published { offset_reach: reach, .. }, _) => tape.apply(Place { reach }, &[point, raw]),
        (Parametrization::Footprint { offset_reach: reach, .. }, Some(Origin::Pixel(pixel))) => {
            tape.apply(Place { reach }, &[point, raw, pixel.footprint])
        }
        (Parametrization::Patch { offset_reach: reach, .. }, Some(Origin::Patch(patch))) => {
            tape.apply(PlaceOnPatch { reach }, &[point, raw, patch.extents, patch.rotation])
        }
        _ => panic!("{parametrization:?} is given what it is relative to"),
    };
    mean
}
