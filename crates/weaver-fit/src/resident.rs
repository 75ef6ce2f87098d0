//! Gaussians that lie where the rasterizer works.

use crate::population::Population;
use weaver_splat::{Fitted, RasterError, ResidentFit};

/// Gaussians that are fitted elsewhere, and which of the two copies is newer.
#[derive(Debug)]
pub(crate) struct Resident {
    pub there: Box<dyn ResidentFit>,
    pub newer: Newer,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Newer {
    Here,
    Neither,
    There,
}

impl Resident {
    pub fn new(there: Box<dyn ResidentFit>) -> Self {
        Self { there, newer: Newer::Here }
    }

    /// Brings a population there.
    pub fn load(&mut self, population: &Population) -> Result<(), RasterError> {
        let [means, log_scales, quats, logits, sh] = population.fields().map(|(_, field)| field.slices());
        self.there.load(&Fitted { means, quats, log_scales, logits, sh, degree: population.degree() })
    }
}
