//! Memory of a run, before it begins.

use crate::start::{FEWEST, PHOTOS};
use crate::{Error, Initial, RunSettings};
use weaver_data::posed::CaptureCameras;
use weaver_fit::{FitSettings, bytes_per_step};
use weaver_geometry::Camera;
use weaver_geometry::sh::coefficients;
use weaver_stereo::{Stereo, StereoSettings};

/// Memory and size of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// Photos to fit to.
    pub training: usize,
    /// Photos held out.
    pub held_out: usize,
    /// Largest width and height of a photo.
    pub size: [usize; 2],
    /// Bytes of the photos, with their smaller versions.
    pub photos: u64,
    /// Bytes of the Gaussians, their gradients, the optimizer's memory and a copy for checkpoints.
    pub gaussians: u64,
    /// Bytes of the rasterizer, of images and of the program itself.
    pub rasterizer: u64,
    /// Bytes of finding where Gaussians begin, before there are any; 0 where that takes none.
    pub start: u64,
}

/// Bytes of lists and statistics for each Gaussian, of images and their comparison for each pixel, and of the program;
/// measured, see docs/results/benchmarks.md.
const RASTERIZER: (u64, u64, u64) = (360, 360, PROGRAM);
const PROGRAM: u64 = 22_000_000;

/// Default number of Gaussians for each pixel of a photo, and the limits of their number.
const GAUSSIANS: (f64, usize, usize) = (0.4, 5_000, 1_000_000);

/// Bytes of a Gaussian's values, two moments, and gradients; a checkpoint copies the first three.
fn bytes_of_optimizer(sh_degree: usize) -> u64 {
    (3 + 3 + 4 + 1 + 3 * coefficients(sh_degree) as u64) * 4 * (4 + 3)
}

/// Bytes of a Gaussian while it is fitted and drawn.
pub(crate) fn bytes_of_gaussian(sh_degree: usize) -> u64 {
    bytes_of_optimizer(sh_degree) + RASTERIZER.0
}

impl Plan {
    /// Plans a run of photos with these cameras, each with true for a held-out photo.
    pub(crate) fn of(cameras: &[(Camera, bool)], masks: bool, fit: &FitSettings) -> Self {
        let pixels = |camera: &Camera| (camera.width * camera.height) as u64;
        let held_out = cameras.iter().filter(|(_, held_out)| *held_out).count();
        let bytes_of_pixel = 3 + u64::from(masks);
        let all: u64 = cameras.iter().map(|(camera, _)| pixels(camera)).sum();
        let largest = cameras.iter().map(|(camera, _)| camera).max_by_key(|camera| pixels(camera));
        let size = largest.map_or([0, 0], |camera| [camera.width, camera.height]);
        let n = fit.gaussians as u64;
        // Rows for a step with several photos: gradients and statistics that are not summed yet.
        let rows = if fit.views_per_step > 1 { 2 + u64::from(fit.views_per_step.ilog2()) } else { 0 };
        Self {
            training: cameras.len() - held_out,
            held_out,
            size,
            photos: all * bytes_of_pixel * 4 / 3,
            gaussians: n * bytes_of_optimizer(fit.sh_degree) + rows * bytes_per_step(fit.gaussians, fit.sh_degree),
            rasterizer: n * RASTERIZER.0 + (size[0] * size[1]) as u64 * RASTERIZER.1 + RASTERIZER.2,
            start: 0,
        }
    }

    /// The plan of a run that finds depth first.
    pub(crate) fn with_dense_start(self, cameras: &[(Camera, bool)]) -> Self {
        let training =
            cameras.iter().filter(|(_, held_out)| !*held_out).map(|(camera, _)| [camera.width, camera.height]);
        let sizes: Vec<[usize; 2]> = training.take(PHOTOS.min(self.training)).collect();
        let copies: usize = sizes.iter().map(|[width, height]| 3 * width * height).sum();
        Self { start: copies as u64 + Stereo::bytes(&sizes, &StereoSettings::default()), ..self }
    }

    /// Pixels of the largest photo.
    pub(crate) fn pixels(&self) -> f64 {
        (self.size[0] * self.size[1]) as f64
    }

    /// True if there are enough photos to find depth with the default start.
    pub(crate) fn asks_for_depth(&self) -> bool {
        self.training >= FEWEST
    }

    /// Settings of a fit when none are given: with a budget of Gaussians by the photos' size, and transients left out.
    pub fn usual(&self) -> FitSettings {
        let (per_pixel, least, most) = GAUSSIANS;
        let gaussians = ((per_pixel * self.pixels()) as usize).clamp(least, most);
        FitSettings { gaussians, ..RunSettings::usual_fit() }
    }

    /// Bytes of all of it, at the time when it takes most.
    pub fn total(&self) -> u64 {
        self.photos + (self.gaussians + self.rasterizer).max(self.start + PROGRAM)
    }
}

/// Plans a run: its memory, from the capture's camera files alone.
///
/// # Errors
/// When they cannot be read.
pub fn plan(settings: &RunSettings) -> Result<Plan, Error> {
    planned(settings, &CaptureCameras::read(&settings.capture, settings.hold_out)?)
}

/// Plans a run of a capture with these cameras.
pub(crate) fn planned(settings: &RunSettings, cameras: &CaptureCameras) -> Result<Plan, Error> {
    let cameras = cameras.at(settings.long_side, settings.lenses)?;
    let plan = Plan::of(&cameras, settings.masks, &settings.fit);
    let plan = Plan { training: plan.training.min(settings.views.unwrap_or(usize::MAX)), ..plan };
    let asked = settings.init == Initial::Auto && settings.by_photos.start && plan.asks_for_depth();
    Ok(if asked || settings.init == Initial::Dense { plan.with_dense_start(&cameras) } else { plan })
}
