//! Flags of refinement, shared by commands that run a network.

use clap::Args;

/// For how long, and at which size, predictions are refined on the photos that they were made from.
#[derive(Args, Clone, Copy, Debug, Default)]
pub struct RefineFlags {
    /// Refines the Gaussians on the photos for so many seconds, and cameras that were predicted; never to more Gaussians than were predicted
    #[arg(long, value_name = "SECONDS", num_args = 0..=1, default_missing_value = "10", value_parser = seconds, help_heading = REFINEMENT)]
    pub refine: Option<f64>,
    /// Refines for so many steps, instead of a time
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), conflicts_with = "refine", help_heading = REFINEMENT)]
    pub refine_steps: Option<u32>,
    /// Long side of the photos for refinement [default: infer: as they are; eval: the network's]
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(16..=16_384), help_heading = REFINEMENT)]
    pub refine_size: Option<u32>,
    /// Leaves every Gaussian where it was predicted, but for what the photos move it: none is given up for another where the error is
    #[arg(long, help_heading = REFINEMENT)]
    pub refine_in_place: bool,
}

impl RefineFlags {
    /// True if any flag of refinement is given.
    pub fn is_asked(&self) -> bool {
        self.refine.is_some() || self.refine_steps.is_some() || self.refine_size.is_some() || self.refine_in_place
    }
}

const REFINEMENT: &str = "Refinement";

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if (0.01..=1e6).contains(&seconds) => Ok(seconds),
        _ => Err("expected seconds, from 0.01 to 1000000".into()),
    }
}
