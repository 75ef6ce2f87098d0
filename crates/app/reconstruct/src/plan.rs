//! Memory of a run, before it begins.

use crate::start::{FEWEST, PHOTOS};
use crate::{ByPhotos, Error, Initial, RunSettings};
use std::fmt;
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
    /// True if they are more than a part of the free memory: their colors are then kept in a file without a name in the
    /// run's folder, and read as they are needed.
    pub on_disk: bool,
    /// Bytes of the photos' masks, which are in memory in any case.
    pub masks: u64,
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

/// Bytes of a pixel's color.
const COLORS: u64 = 3;
/// Part of the free memory that photos may take.
const PHOTOS_IN_MEMORY: f64 = 0.3;

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
            photos: all * COLORS * 4 / 3,
            on_disk: false,
            masks: if masks { all * 4 / 3 } else { 0 },
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
        let photos = if self.on_disk { 0 } else { self.photos };
        photos + self.masks + (self.gaussians + self.rasterizer).max(self.start + PROGRAM)
    }
}

/// The bytes of each part and of all, a line each.
impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mb = |bytes: u64| format!("{:>9.1} MB", bytes as f64 / 1e6);
        match self.on_disk {
            true => writeln!(f, "photos      {}, and {} on disk", mb(self.masks), mb(self.photos).trim_start())?,
            false => writeln!(f, "photos      {}", mb(self.photos + self.masks))?,
        }
        writeln!(f, "Gaussians   {}", mb(self.gaussians))?;
        writeln!(f, "rasterizer  {}\nstart       {}", mb(self.rasterizer), mb(self.start))?;
        write!(f, "at most     {}", mb(self.total()))
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
    let free = weaver_io::available_memory().map_or(f64::INFINITY, |free| free as f64);
    let on_disk = plan.photos as f64 > PHOTOS_IN_MEMORY * free;
    let plan = Plan { training: plan.training.min(settings.views.unwrap_or(usize::MAX)), on_disk, ..plan };
    let asked =
        settings.init == Initial::Auto && settings.by_photos.contains(&ByPhotos::Start) && plan.asks_for_depth();
    Ok(if asked || settings.init == Initial::Dense { plan.with_dense_start(&cameras) } else { plan })
}
