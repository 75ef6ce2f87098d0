//! Fitting of Gaussians, and of cameras, to photos whose cameras are known, or nearly.
//!
//! - [`Fit`] is an optimization under way: photos, [`Population`], optimizer, one [`step`](Fit::step) after the other.
//! - [`FitSettings`] says how; all times in it are fractions of the run.
//! - [`Strategy`] is density control: [`Split`](strategy::Split), [`Mcmc`](strategy::Mcmc), [`Keep`](strategy::Keep),
//!   or one's own.
//! - [`Rounding`] trains with quantization: rounded Gaussians are drawn in place of those that are optimized.
//! - [`FitRasterizer`] draws; one on a device may keep the Gaussians there ([`DeviceFit`]).
//! - Cameras go toward where their photos fit the scene, on request: [`Poses`].
//! - [`Transients`] are the things that one photo alone shows; they are found and left out on request.
//! - Several processes share the photos of a step, if it looks at more than one: [`Fit::share`].
//! - [`init`] makes the Gaussians to start from.
//! - `align` (feature `align`) finds where photos of a finished scene were taken.
//!
//! Everything is on slices, without a tape and without files. The same seed gives the same bits at any number of
//! threads.

pub mod align;
mod cameras;
mod cleaned;
mod cleaning;
mod color_agreement;
mod comparison;
mod contributions;
mod device_fit;
mod device_step;
mod error;
mod evaluate;
mod evidence;
mod exposure;
mod fit;
mod gradients;
mod host_step;
pub mod init;
mod photos;
mod population;
mod rates;
mod removal;
mod resident;
mod rounding;
mod settings;
mod shared_step;
mod sky;
#[cfg(feature = "state")]
mod state;
pub mod strategy;
mod surfaces;
mod thinning;
mod timing;
mod transient_search;
mod transients;
mod view;

pub use cameras::{Alignment, Views, motion};
pub use cleaned::Cleaned;
pub use cleaning::CleaningRules;
pub use color_agreement::ColorAgreement;
pub use contributions::contributions;
pub use device_fit::{DeviceFit, FitRasterizer, Fitted, FittedRates, PhotoLoss, PhotoStep};
pub use error::FitError;
pub use evaluate::{Judge, Quality};
pub use exposure::Exposure;
pub use fit::{Fit, StepReport, StepTimings};
pub use gradients::Gradients;
pub use photos::mean_color;
pub use population::{Field, Population};
pub use rates::Rates;
pub use rounding::Rounding;
pub use settings::{FitSettings, Poses};
pub use shared_step::bytes_per_step;
pub use sky::sky;
#[cfg(feature = "state")]
pub use state::gaussians_of;
pub use strategy::{Density, Moment, Regularizer, Strategy, StrategyKind};
pub use surfaces::{KnownDepth, Surfaces};
pub use thinning::Thinning;
pub use timing::{Rehearsal, in_time, steps_in};
pub use transients::Transients;
pub use weaver_scene::Photo;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
