//! No density control.

use super::{Moment, Strategy};
use crate::population::Population;
use weaver_splat::GaussianStatistics;

/// Leaves the number of Gaussians as it is.
#[derive(Clone, Copy, Debug, Default)]
pub struct Keep;

impl Strategy for Keep {
    fn wants_statistics(&self, _: &Moment) -> bool {
        false
    }

    fn is_due(&self, _: &Moment) -> bool {
        false
    }

    fn adapt(&mut self, _: &Moment, _: &mut Population, _: &[GaussianStatistics<f32>]) -> bool {
        false
    }
}
