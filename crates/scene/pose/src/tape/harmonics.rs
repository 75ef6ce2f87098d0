//! Spherical harmonics of directions on the tape.

use super::row_map::{RowMap, RowMapOp};
use weaver_autograd::{Dual, Real, Var};
use weaver_geometry::sh;

#[derive(Debug)]
struct Harmonics;

impl RowMap<3, 9> for Harmonics {
    const NAME: &'static str = "harmonics";
    const INPUTS: &'static [&'static [usize]] = &[&[3]];
    const OUTPUTS: &'static [&'static [usize]] = &[&[9]];
    fn eval<T: Real>(&self, direction: [Dual<T, 3>; 3]) -> [Dual<T, 3>; 9] {
        let all = sh::basis(2, direction, Dual::from);
        std::array::from_fn(|k| all[k])
    }
}

/// The nine real spherical harmonics up to degree 2 of unit vectors `[.., 3]`: `[.., 9]`, in the order and with the
/// signs of 3DGS.
///
/// Differentiable; the three numbers are taken as independent, so that the normalization before it makes the gradient a
/// tangent.
///
/// ```
/// use weaver_autograd::Tape;
/// let tape = Tape::<f64>::new();
/// let y = weaver_pose::harmonics(tape.constant(&[0.0, 0.0, 1.0], [1, 3])).to_vec();
/// assert_eq!((y[1], y[2], y[3]), (0.0, 0.488_602_511_902_919_9, 0.0));
/// ```
#[track_caller]
pub fn harmonics<T: Real>(directions: Var<'_, T>) -> Var<'_, T> {
    let [values] = directions.tape().apply(RowMapOp(Harmonics), &[directions]);
    values
}
