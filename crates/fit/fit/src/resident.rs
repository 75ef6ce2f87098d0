//! The two copies of the Gaussians of a fit on a device.

use crate::device_fit::{DeviceFit, Fitted};
use crate::population::Population;
use weaver_splat::RasterError;

/// Gaussians that are fitted on a device, and a mark of the newer copy.
#[derive(Debug)]
pub(crate) struct Resident {
    pub device: Box<dyn DeviceFit>,
    pub newer: Newer,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Newer {
    Host,
    Neither,
    Device,
}

impl Resident {
    pub fn new(device: Box<dyn DeviceFit>) -> Self {
        Self { device, newer: Newer::Host }
    }

    /// Copies a population to the device.
    pub fn load(&mut self, population: &Population) -> Result<(), RasterError> {
        let [means, log_scales, quats, logits, sh] = population.fields().map(|(_, field)| field.slices());
        self.device.load(&Fitted { means, quats, log_scales, logits, sh, degree: population.degree() })
    }
}
