//! Flags of masks of photos whose cameras are estimated.

use super::matching::MATCHING;
use clap::Args;
use std::path::PathBuf;
use weaver_command::choice;
use weaver_data::capture::MaskOptions;
use weaver_data::posed::{Lenses, Masked};

/// Meanings of masked pixels.
pub const MASKED: [(&str, Masked, &str); 2] = [
    ("unknown", Masked::Unknown, "Anything may stand there: these pixels do not count"),
    ("empty", Masked::Empty, "Nothing stands there: these pixels show the background"),
];

/// Treatments of lenses.
pub const LENSES: [(&str, Lenses, &str); 2] = [
    ("keep", Lenses::Keep, "The scene is drawn through the photo's own lens: no pixel of it is lost"),
    ("undistort", Lenses::Undistort, "Photos become a pinhole's, at most about 145 degrees wide"),
];

/// Masks of photos.
#[derive(Args, Clone, Debug, Default, PartialEq)]
pub struct MaskFlags {
    /// Leaves out what is black in masks: files in FOLDER named as the photos; without FOLDER, those in a folder masks beside the photo
    /// or beside its folder, else the photo's alpha
    #[arg(long, value_name = "FOLDER", num_args = 0..=1, help_heading = MATCHING)]
    masks: Option<Option<PathBuf>>,
    /// Leaves out what is white in masks in place of what is black
    #[arg(long, requires = "masks", help_heading = MATCHING)]
    invert_masks: bool,
}

impl MaskFlags {
    /// The masks, if any were asked for.
    pub fn options(&self) -> Option<MaskOptions> {
        let folder = self.masks.clone()?;
        Some(MaskOptions { folder, inverted: self.invert_masks })
    }

    /// The folder of masks, if one was named.
    pub fn folder(&self) -> Option<PathBuf> {
        self.masks.clone().flatten()
    }
}

/// The meaning of masked pixels.
#[derive(Args, Clone, Copy, Debug, Default, PartialEq)]
pub struct MaskedFlag {
    /// Meaning of masked pixels: unknown, or empty space [default: unknown]
    #[arg(long, value_parser = choice(&MASKED), requires = "masks", help_heading = MATCHING)]
    pub masked: Option<Masked>,
}
