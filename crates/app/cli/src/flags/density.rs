//! Flags of density, shared by commands that run a network.

use clap::Args;
use weaver_inference::Density;
use weaver_router::AllocationKind;

const DENSITY: &str = "How many Gaussians, and where";

/// Which pixels get Gaussians, and how many.
#[derive(Args, Clone, Copy, Debug)]
pub struct DensityFlags {
    /// Gaussians per pixel, 0 to 1, for dithered, quadtree (0 to 3), quadtree-grid, grid and random [default: the
    /// run's]
    #[arg(long, value_name = "G", help_heading = DENSITY)]
    pub budget: Option<f64>,
    /// sampled, argmax, dithered, quadtree, quadtree-grid, grid, random or fixed:K [default: the run's]
    #[arg(long, value_name = "A", help_heading = DENSITY)]
    pub allocation: Option<AllocationKind>,
}

impl From<DensityFlags> for Density {
    fn from(flags: DensityFlags) -> Self {
        Self { allocation: flags.allocation, budget: flags.budget }
    }
}
