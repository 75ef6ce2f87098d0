//! Photos to a scene of Gaussians in one call.
//!
//! - [`reconstruct()`] makes a scene from photos, clips or a capture: cameras, size of the photos, fit and results.
//! - [`cameras()`] estimates cameras alone, [`fit()`] fits a capture, and [`resume`] goes on with a fit.
//! - [`align_photos`] finds the cameras of further photos of a finished scene; [`SceneComparison`] judges a scene by
//!   the photos of a capture.
//! - [`clean()`] removes what the photos of a capture do not need from a scene of any origin.
//! - [`SurfaceOptions`] make a mesh of a scene, and [`TexturePhotos`] paint it.
//! - [`self_test()`] measures the machine, for reports of faults.
//! - [`Run`] is a fit of a capture on disk, [`RunSettings`] its settings, [`plan`](fn@plan) its memory.
//! - [`blocks`] cuts a large capture into captures that are fitted apart, and joins their fits; [`partition`] is the
//!   geometry of that.
//!
//! Work is watched by a [`weaver_io::Observe`]. A fit has a folder to itself:
//!
//! | file | content |
//! |---|---|
//! | `run.json` | the settings, with the number of steps once it is known, and checksums of the inputs |
//! | `init.ply` | the Gaussians it began with, if they were given or lie on surfaces that photos agree about |
//! | `checkpoint.safetensors` | everything needed to go on |
//! | `scene.ply` | the Gaussians; also in other requested formats, as `scene.spz` |
//! | `scene.wsz` | the Gaussians compressed, if the fit was made for it |
//! | `transforms.json`, `sparse/0` | the cameras, refined ones too, of the photos as they are on disk; the points, moved with them |
//! | `summary.json` | the outcome |
//! | `metrics.jsonl`, `events/` | logged values, also for TensorBoard |
//! | `report.html` | held-out photos beside renders, maps, curves |
//! | `view.html` | the scene to look at in a browser, with cameras and photos |
//! | `written.jsonl` | the list of files that the fit wrote, and may replace |

mod align;
pub mod blocks;
mod budget;
mod cameras;
mod clean;
mod compressed;
mod coverage;
mod demo;
mod depths;
mod error;
mod fit;
mod fitting;
mod gaining;
mod judged;
mod keeping;
mod live;
mod loaded;
mod looks;
mod maps;
mod matching;
mod outcome;
mod pace;
pub mod partition;
mod photos;
mod plan;
mod prolonging;
mod reconstruct;
mod report;
mod results;
mod run;
mod scene_comparison;
mod self_test;
mod settings;
mod sources;
mod start;
mod surface;
mod time_budget;
mod view;

pub use align::{AlignRequest, AlignedPhoto, AlignedPhotos, align_photos, claim_alignment, closest_views};
pub use budget::{Budget, Work};
pub use cameras::{CameraComparison, CamerasRequest, EstimatedCameras, cameras};
pub use clean::clean;
pub use coverage::Coverage;
pub use error::Error;
pub use fit::{FitContext, FitRequest, GivenGaussians, fit, resume};
pub use gaining::{End, Gaining};
pub use matching::Matching;
pub use outcome::{Cleaning, Outcome, PoseChange, Views};
pub use pace::Pace;
pub use photos::Photos;
pub use plan::{Plan, plan};
pub use reconstruct::{Quality, Request, reconstruct};
pub use report::CURVES;
pub use run::Run;
pub use scene_comparison::{ComparedScene, SceneComparison};
pub use self_test::self_test;
use settings::RunFile;
pub use settings::{ByPhotos, Initial, RunSettings};
pub use surface::{SceneSurface, SurfaceOptions, TexturePhotos};
pub use view::FILE as VIEW;
pub use weaver_run::{Folder, StepReport};

/// The examples of the README, compiled.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
