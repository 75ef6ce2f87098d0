//! The gradient check finds wrong gradients at every scale, and accepts right ones.

use std::panic::{AssertUnwindSafe, catch_unwind};
use weaver_autograd::gradcheck::{Input, gradcheck};
use weaver_autograd::{Backward, Op, Pool, Shape, ShapeError, Shapes, View, ViewMut};

/// y = `offset` + `factor` x^2, with a claimed gradient of `claimed` times the true one, in the first element alone.
#[derive(Clone, Copy, Debug)]
struct Square {
    offset: f64,
    factor: f64,
    claimed: f64,
}

impl Op<f64> for Square {
    fn name(&self) -> &'static str {
        "square"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        Ok(Shapes::one(ins[0]))
    }
    fn forward(&mut self, ins: &[View<'_, f64>], outs: &mut [ViewMut<'_, f64>], _: &Pool) {
        for (y, x) in outs[0].iter_mut().zip(ins[0].iter()) {
            *y = self.offset + self.factor * x * x;
        }
    }
    fn backward(&self, at: Backward<'_, '_, f64>) {
        let Backward { ins, douts, dins, .. } = at;
        let mut dx: Vec<f64> = ins[0].iter().zip(douts[0].iter()).map(|(x, dy)| 2.0 * self.factor * x * dy).collect();
        dx[0] *= self.claimed;
        if let Some(grad) = &mut dins[0] {
            grad.add(&dx);
        }
    }
}

fn passes(offset: f64, factor: f64, claimed: f64) -> bool {
    let square = Square { offset, factor, claimed };
    let check = || gradcheck(&[Input::normal(3, [4])], |x| vec![x[0].tape().apply::<_, 1>(square, &[x[0]])[0]]);
    catch_unwind(AssertUnwindSafe(check)).is_ok()
}

/// Promise (kept): a wrong gradient is found whatever its scale.
#[test]
fn a_wrong_gradient_is_found_at_every_scale() {
    for factor in [1e-7, 1.0, 1e7] {
        assert!(passes(0.0, factor, 1.0), "right at {factor}");
        assert!(!passes(0.0, factor, 1.0 + 1e-4), "wrong at {factor}");
        assert!(!passes(0.0, factor, 0.0), "missing at {factor}");
    }
    // In outputs near 1, central differences still resolve a part in a hundred of such gradients.
    assert!(!passes(1.0, 1e-7, 1.05));
}

/// Rounding of large outputs is not taken for a wrong gradient.
#[test]
fn rounding_is_no_wrong_gradient() {
    for offset in [1.0, 1e6, 1e9] {
        assert!(passes(offset, 1e-7, 1.0), "{offset}");
        assert!(passes(offset, 1.0, 1.0), "{offset}");
    }
}
