//! Opacities, constant or dependent on the view direction.

use weaver_autograd::{Outputs, Real, Var, ops};
use weaver_geometry::sh;
use weaver_pose::harmonics;

/// Harmonics up to degree 2.
const HARMONICS: usize = 9;

/// Dependence of a Gaussian's opacity on the view direction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OpacityDegree {
    /// One opacity for all directions.
    #[default]
    Constant,
    /// Harmonics up to degree 2, as published: one drawing for each camera.
    Two,
}

impl OpacityDegree {
    /// Numbers of a Gaussian: 1 or 9.
    pub fn numbers(self) -> usize {
        match self {
            Self::Constant => 1,
            Self::Two => HARMONICS,
        }
    }
}

/// Opacities of N Gaussians: logits, or harmonics of them.
#[derive(Clone, Copy, Debug)]
pub struct Opacities<'t, T: Real = f32> {
    /// Logits `[N, 1]`, or coefficients `[N, 9]` with the logit in direction d being sum_k Y_k(d) a_k.
    pub numbers: Var<'t, T>,
}

impl<T: Real> Outputs<T> for Opacities<'_, T> {
    fn for_each_var(&self, visit: &mut dyn FnMut(Var<'_, T>)) {
        visit(self.numbers);
    }
}

impl<'t, T: Real> Opacities<'t, T> {
    /// From the network's output `[N, 1]` or `[N, 9]`; 2 is taken off the first number of harmonics, as published.
    #[track_caller]
    pub(crate) fn of_raw(raw: Var<'t, T>) -> Self {
        let numbers = match raw.shape()[1] {
            HARMONICS => ops::concat(&[raw.slice(1, 0, 1) - 2.0, raw.slice(1, 1, HARMONICS - 1)], 1),
            _ => raw,
        };
        Self { numbers }
    }

    /// True if the opacities depend on the view direction.
    pub fn depend_on_view(&self) -> bool {
        self.numbers.shape()[1] == HARMONICS
    }

    /// Opacities `[N]` without regard to directions: sigmoid of the logit's mean over all of them.
    #[track_caller]
    pub fn mean(&self) -> Var<'t, T> {
        let even = self.numbers.slice(1, 0, 1).reshape([self.numbers.shape()[0]]);
        if self.depend_on_view() { (even * sh::DC).sigmoid() } else { even.sigmoid() }
    }

    /// Opacities `[N]` of Gaussians at `means` `[N, 3]` along the directions from a camera at `center` `[3]`.
    ///
    /// Differentiable in numbers, means and center.
    #[track_caller]
    pub fn seen_from(&self, means: Var<'t, T>, center: Var<'t, T>) -> Var<'t, T> {
        if !self.depend_on_view() {
            return self.mean();
        }
        let n = means.shape()[0];
        self.along((means - center.reshape([1, 3]).expand([n, 3])).normalize_rows(0.0))
    }

    /// Opacities `[N]` along unit vectors `[N, 3]`; the published loss on opacities takes random ones.
    #[track_caller]
    pub fn along(&self, directions: Var<'t, T>) -> Var<'t, T> {
        if !self.depend_on_view() {
            return self.mean();
        }
        (harmonics(directions) * self.numbers).sum_axis(1).sigmoid()
    }

    /// The opacities selected by `kept` `[N]`.
    #[must_use]
    pub fn kept(&self, kept: &[bool]) -> Self {
        let rows: Vec<u32> = (0..).zip(kept).filter(|(_, kept)| **kept).map(|(row, _)| row).collect();
        Self { numbers: self.numbers.gather_rows(&rows) }
    }
}
