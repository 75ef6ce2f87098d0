//! The command line's flags of light.

use clap::Args;
use std::path::PathBuf;

/// In whose light the place is shown.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Light, for runs of --model wild")]
pub struct LightFlags {
    /// Shows the place in the light of this photo, which need not be one of it; looks.png is a strip of renders
    /// [default: the first photo's]
    #[arg(long, value_name = "PHOTO")]
    pub light: Option<PathBuf>,
    /// Changes the light from --light to this photo's: a PLY for each step in the folder looks
    #[arg(long, value_name = "PHOTO", requires = "light")]
    pub to: Option<PathBuf>,
    /// Steps from --light to --to, both included
    #[arg(long, value_name = "N", requires = "to", default_value_t = 9, value_parser = clap::value_parser!(u32).range(2..=1000))]
    pub light_steps: u32,
}
