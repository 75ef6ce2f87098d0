//! Random shapes and inputs.

use proptest::prelude::*;
use weaver_autograd::Shape;
use weaver_autograd::gradcheck::Input;

/// Few cases: every one of them tries many coordinates and directions. More if `PROPTEST_CASES` is above 256.
pub fn cases(cases: u32) -> ProptestConfig {
    let default = ProptestConfig::default();
    ProptestConfig { cases: (default.cases * cases / 256).max(1), failure_persistence: None, ..default }
}

/// A dimension: mostly 2 to 5, often 1, sometimes 0.
pub fn dim() -> impl Strategy<Value = usize> {
    prop_oneof![1 => Just(0), 3 => Just(1), 8 => 2usize..6]
}

/// A dimension that is not 0.
pub fn length() -> impl Strategy<Value = usize> {
    prop_oneof![1 => Just(1), 3 => 2usize..6]
}

/// A shape of the given rank.
pub fn shape(rank: usize) -> impl Strategy<Value = Shape> {
    prop::collection::vec(dim(), rank).prop_map(|d| Shape::new(&d))
}

/// A shape of rank 1 to 4, and one of its axes.
pub fn shape_and_axis() -> impl Strategy<Value = (Shape, usize)> {
    (1usize..5).prop_flat_map(|rank| (shape(rank), 0..rank))
}

/// Numbers of magnitude `margin` to about 3: apart from a kink at 0.
pub fn away_from_zero(seed: u64, margin: f64, shape: impl Into<Shape>) -> Input {
    let mut x = Input::normal(seed, shape);
    x.data.iter_mut().for_each(|x| *x += margin.copysign(*x));
    x
}
