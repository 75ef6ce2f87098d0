//! Means of Gaussians: points of their pixels plus bounded offsets.

use crate::parametrization::Parametrization;
use weaver_autograd::{Grad, Op, Pool, Real, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};

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

    fn backward(
        &self,
        ins: &[View<'_, T>],
        _outs: &[View<'_, T>],
        douts: &[View<'_, T>],
        dins: &mut [Option<Grad<'_, T>>],
        _pool: &Pool,
    ) {
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

/// The means of Gaussians: their pixels' points plus bounded offsets, mu = Q + r tanh(o), componentwise in world axes.
///
/// Q is `point` `[N, 3]`, o the first three of `raw` `[N, S]`; r is the published constant in world units, or the
/// constant of the footprint parametrization times `footprint` `[N]` = depth / fx. All three are differentiable; the
/// result is `[N, 3]`, in world units. Panics on other shapes, and if the parametrization needs footprints and there
/// are none. Source: official SplatWeaver code, `CardinalityGaussian`.
#[track_caller]
pub fn place<'t, T: Real>(
    point: Var<'t, T>,
    raw: Var<'t, T>,
    footprint: Option<Var<'t, T>>,
    parametrization: Parametrization,
) -> Var<'t, T> {
    let tape = point.tape();
    let [mean] = match parametrization {
        Parametrization::Published { offset_reach, .. } => tape.apply(Place { reach: offset_reach }, &[point, raw]),
        Parametrization::Footprint { offset_reach, .. } => {
            let footprint = footprint.expect("the footprint parametrization is given footprints");
            tape.apply(Place { reach: offset_reach }, &[point, raw, footprint])
        }
    };
    mean
}
