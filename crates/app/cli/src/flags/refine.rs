//! Flags of refinement, shared by commands that run a network.

use clap::Args;
use std::path::PathBuf;
use std::sync::Arc;
use weaver_command::{Failure, number};
use weaver_fit::FitRasterizer;
use weaver_inference::{Effort, Predictor, Refined};

/// For how long, and at which size, predictions are refined on the photos that they were made from.
#[derive(Args, Clone, Copy, Debug, Default)]
pub struct RefineFlags {
    /// Refines the Gaussians on the photos for so many seconds, and cameras that were predicted; never to more
    /// Gaussians than were predicted
    #[arg(long, value_name = "SECONDS", num_args = 0..=1, default_missing_value = "10", value_parser = number(0.01..=1e6, "expected seconds, from 0.01 to 1000000"), help_heading = REFINEMENT)]
    pub refine: Option<f64>,
    /// Refines for so many steps, instead of a time
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), conflicts_with = "refine", help_heading = REFINEMENT)]
    pub refine_steps: Option<u32>,
    /// Long side of the photos for refinement [default: infer: as they are; eval: the network's]
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(16..=16_384), help_heading = REFINEMENT)]
    pub refine_size: Option<u32>,
    /// Moves every Gaussian by the photos alone: none is given up for another where the error is
    #[arg(long, help_heading = REFINEMENT)]
    pub refine_in_place: bool,
}

impl RefineFlags {
    /// True if any flag of refinement is given.
    pub fn is_asked(&self) -> bool {
        self.refine.is_some() || self.refine_steps.is_some() || self.refine_size.is_some() || self.refine_in_place
    }

    /// The predictor, refined by `rasterizer` if the flags request it, on photos of a size that follows from `photos`.
    pub fn refined(
        &self,
        predictor: Box<dyn Predictor>,
        photos: &[PathBuf],
        rasterizer: Arc<dyn FitRasterizer>,
    ) -> Result<Box<dyn Predictor>, Failure> {
        let effort = match (self.refine, self.refine_steps) {
            (Some(seconds), _) => Effort::Seconds(seconds),
            (None, Some(steps)) => Effort::Steps(steps as usize),
            (None, None) if self.is_asked() => {
                let flag = if self.refine_in_place { "--refine-in-place" } else { "--refine-size" };
                return Err(Failure::Usage(format!("{flag}: expected --refine or --refine-steps with it")));
            }
            (None, None) => return Ok(predictor),
        };
        let side = self.refine_size.map(|side| side as usize);
        let refined = Refined::at_size(predictor, side, photos, effort)?.fitted_by(rasterizer);
        Ok(Box::new(if self.refine_in_place { refined.in_place() } else { refined }))
    }
}

const REFINEMENT: &str = "Refinement";
