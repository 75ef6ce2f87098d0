//! Energy of the detail sub-bands at each coefficient.

use weaver_autograd::{Backward, Op, Pool, Real, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::parallel;

/// Added under the square root, which keeps the derivative finite in flat regions.
pub const ENERGY_EPSILON: f64 = 1e-8;

/// Writes sqrt(b1^2 + b2^2 + b3^2 + 1e-8) of sub-bands `[N, 4, h, w]` to `out` `[N, h, w]`, with `band` = h w; see
/// [`detail_energy`].
pub fn detail_energy_into<T: Real>(bands: &[T], band: usize, out: &mut [T]) {
    let epsilon = T::from_f64(ENERGY_EPSILON);
    parallel::for_chunks(out, band, |n, out| {
        let details = &bands[(4 * n + 1) * band..4 * (n + 1) * band];
        let (a, rest) = details.split_at(band);
        let (b, c) = rest.split_at(band);
        for (e, ((a, b), c)) in out.iter_mut().zip(a.iter().zip(b).zip(c)) {
            *e = (*a * *a + *b * *b + *c * *c + epsilon).sqrt();
        }
    });
}

#[derive(Debug)]
struct DetailEnergy;

impl<T: Real> Op<T> for DetailEnergy {
    fn name(&self) -> &'static str {
        "detail_energy"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(ins.len() == 1 && ins[0].rank() == 4 && ins[0][1] == 4, "sub-bands [N, 4, h, w]");
        Ok(Shapes::one([ins[0][0], ins[0][2], ins[0][3]]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let shape = ins[0].shape();
        detail_energy_into(&ins[0], shape[2] * shape[3], &mut outs[0]);
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, outs, douts, dins, .. } = at;
        let Some(dx) = &mut dins[0] else { return };
        let band = ins[0].shape()[2] * ins[0].shape()[3];
        dx.add_each(|i| {
            let (plane, at) = (i / band, i % band);
            let e = plane / 4 * band + at;
            if plane % 4 == 0 { T::ZERO } else { douts[0][e] * ins[0][i] / outs[0][e] }
        });
    }
}

/// The local high-frequency energy sqrt(b1^2 + b2^2 + b3^2 + 1e-8) of the detail bands b1, b2, b3.
///
/// Sub-bands `[N, 4, h, w]` give `[N, h, w]`. Differentiable in the three detail bands; the low band is not used.
/// Panics on other shapes.
#[track_caller]
pub fn detail_energy<T: Real>(bands: Var<'_, T>) -> Var<'_, T> {
    let [y] = bands.tape().apply(DetailEnergy, &[bands]);
    y
}
