//! The outcome of a run.

use crate::Coverage;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;
use weaver_fit::{Cleaned, Exposure, Quality};

/// The outcome of a run, `summary.json`.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Outcome {
    /// Steps done.
    pub steps: usize,
    /// Steps of the whole run.
    pub planned: usize,
    /// The number of planned steps left out, so that the run ended in its time
    /// ([`FitSettings::thinned`](weaver_fit::FitSettings::thinned)).
    #[serde(default, skip_serializing_if = "is_zero")]
    pub left_out: usize,
    /// Seconds from the start to the written scene, loading included.
    pub seconds: f64,
    /// Gaussians.
    pub gaussians: usize,
    /// Width and height of the photos; of the first, if there are several.
    pub size: [usize; 2],
    /// Quality of the photos that were fitted.
    pub train: Views,
    /// Quality of the held-out photos, if there are any.
    pub test: Option<Views>,
    /// Changes of the cameras by refinement.
    pub poses: PoseChange,
    /// True if the scene is to be drawn antialiased.
    pub antialiased: bool,
    /// Distance before which nothing is drawn, world units.
    pub near: f64,
    /// Largest opacity of a single Gaussian at a pixel.
    #[serde(default = "alpha_max")]
    pub alpha_max: f64,
    /// The color behind everything.
    pub background: [f32; 3],
    /// Color correction of each photo, `[A | b]` row by row, if photos have them; held-out photos are judged with the
    /// correction of their neighbors ([`Fit::exposure_at`](weaver_fit::Fit::exposure_at)).
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub exposures: BTreeMap<String, [f32; 12]>,
    /// Part of each training photo that was left out as transient, since no other photo shows the same; photos without
    /// transients are not named.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub transients: BTreeMap<String, f64>,
    /// Gaussians that cleaning removed, if it did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cleaning: Option<Cleaning>,
    /// Part of each training photo with a depth that two others agree about, where it was measured.
    #[serde(default, skip_serializing_if = "Coverage::is_empty")]
    pub coverage: Coverage,
    /// Training photos that are met far worse than the others: they may not belong to the scene.
    #[serde(rename = "strangers")]
    pub outliers: Vec<String>,
    /// Results that could not be made, and why.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub missing: Vec<String>,
}

/// True for a count of 0, which is left out.
fn is_zero(count: &usize) -> bool {
    *count == 0
}

impl Outcome {
    /// The outcome of the run that made a scene: summary.json beside it; `None` where there is no such run.
    pub fn beside(scene: impl AsRef<Path>) -> Option<Self> {
        let summary = weaver_io::read_text(scene.as_ref().with_file_name("summary.json")).ok()?;
        serde_json::from_str(&summary).ok()
    }

    /// The quality of held-out and of fitted photos, a line each.
    pub fn table(&self) -> String {
        let line = |name: &str, Views { views, quality }: &Views| {
            let number = |x: Option<f64>, digits| x.map_or("-".into(), |x| format!("{x:.digits$}"));
            let Quality { psnr, psnr_aligned, ssim, lpips } = quality;
            let (aligned, ssim, lpips) = (number(*psnr_aligned, 2), number(*ssim, 4), number(*lpips, 4));
            format!("{name:<10}{views:>5}  {psnr:>7.2}  {aligned:>7}  {ssim:>6}  {lpips:>6}\n")
        };
        let test = self.test.as_ref().map_or("held out   none\n".into(), |test| line("held out", test));
        format!("photos   views     PSNR  aligned    SSIM   LPIPS\n{test}{}", line("fitted", &self.train))
    }

    /// The color correction that a photo of this name is judged with: of the same name, or of the only one whose file
    /// is called so.
    pub fn exposure_of(&self, photo: &str) -> Option<Exposure> {
        let file = |name: &str| Path::new(name).file_name().map(ToOwned::to_owned);
        let mut alike = self.exposures.iter().filter(|(name, _)| file(name) == file(photo)).map(|(_, matrix)| matrix);
        let only = match (alike.next(), alike.next()) {
            (only, None) => only,
            _ => None,
        };
        self.exposures.get(photo).or(only).map(|matrix| Exposure::of(*matrix))
    }
}

/// Value in summaries that are older than the key.
fn alpha_max() -> f64 {
    0.99
}

/// Gaussians that were removed because no photo needs them ([`Fit::clean`](weaver_fit::Fit::clean)).
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub struct Cleaning {
    /// Their numbers, by reason.
    #[serde(flatten)]
    pub removed: Cleaned,
    /// Mean PSNR of some of the held-out photos before and after, dB, if there are any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub held_out: Option<[f64; 2]>,
}

impl fmt::Display for Cleaning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.removed)?;
        match self.held_out {
            Some([before, after]) => write!(f, "; held-out photos: {before:.2} dB before, {after:.2} dB after"),
            None => Ok(()),
        }
    }
}

/// Mean quality over views.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub struct Views {
    /// Number of views.
    pub views: usize,
    /// Mean quality.
    #[serde(flatten)]
    pub quality: Quality,
}

/// Changes of the cameras by refinement.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct PoseChange {
    /// True if cameras were refined.
    pub refined: bool,
    /// Median angle that cameras turned by, degrees.
    pub degrees: f64,
    /// Median distance that cameras moved by, as a part of the scene's size.
    pub distance: f64,
    /// Factor of the focal lengths.
    pub focal: f64,
    /// Points that photos were found to agree about.
    pub points: usize,
    /// Median difference of where these points are and were seen, pixels.
    pub pixels: Option<f64>,
}
