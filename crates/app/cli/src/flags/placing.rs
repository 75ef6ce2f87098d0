//! Flags of the world that estimated cameras are brought to.

use super::matching::MATCHING;
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use weaver_data::Placing;

/// Sources of meters and of the vertical.
#[derive(Args, Clone, Debug, Default, PartialEq)]
pub struct PlacingFlags {
    /// Positions of the cameras, in place of the photos' GPS: a table (CSV) that begins with name,x,y,z in meters, or with
    /// name,latitude,longitude,altitude
    #[arg(long, value_name = "FILE", help_heading = MATCHING)]
    pub positions: Option<PathBuf>,
    /// A bar of known length: a table (CSV) that begins with name,ax,ay,bx,by,length, and has the pixels of its ends in two photos or more,
    /// and its length in meters
    #[arg(long, value_name = "FILE", help_heading = MATCHING)]
    pub scale_bar: Option<PathBuf>,
    /// Ignores the GPS of photos
    #[arg(long, help_heading = MATCHING)]
    pub no_gps: bool,
    /// Which way the scene stands [default: level, upright by what the photos tell]
    #[arg(long, value_enum, value_name = "level|keep", help_heading = MATCHING, conflicts_with_all = ["positions", "scale_bar"])]
    pub up: Option<UpChoice>,
}

/// Which way a scene stands.
#[derive(Clone, Copy, Debug, Eq, PartialEq, ValueEnum)]
pub enum UpChoice {
    /// Upright, on a level ground: y down, or with positions in meters, east, north and up
    Level,
    /// As it was estimated: the first camera is the origin
    Keep,
}

impl From<&PlacingFlags> for Placing {
    fn from(flags: &PlacingFlags) -> Self {
        Self {
            positions: flags.positions.clone(),
            gps: !flags.no_gps,
            scale_bar: flags.scale_bar.clone(),
            up: flags.up != Some(UpChoice::Keep),
        }
    }
}

impl PlacingFlags {
    /// The files that are read.
    pub fn files(&self) -> impl Iterator<Item = PathBuf> {
        self.positions.clone().into_iter().chain(self.scale_bar.clone())
    }
}
