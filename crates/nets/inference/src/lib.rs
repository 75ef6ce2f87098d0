//! Photos to cameras and 3-D Gaussians with trained weights, on a CPU.
//!
//! [`Predictor`] is the interface of every model; [`SplatWeaverPredictor`] is SplatWeaver with its weights, opened from
//! the folder of a training run. Other models are crates of their own, built on [`Pretrained`]. [`Refined`] optimizes a
//! predictor's output; [`predict_to_folder`] runs a predictor on photo files and writes a scene; [`published`] runs the
//! published checkpoints of SplatWeaver and VGGT-1B. Nothing here needs a training run's configuration file, and
//! nothing here trains.

mod capture;
mod checkpoint;
mod depth_to_points;
mod error;
mod given_cameras;
mod looks;
pub mod pictures;
mod pixel_aligned;
mod predict_to_folder;
mod predictor;
mod pretrained;
pub mod published;
mod refined;
mod run_folder;
mod scene_network;
mod splatweaver;
mod take_size;
mod view_opacity;
mod weights;

pub use capture::{predict_capture, predict_group, predict_photos};
pub use checkpoint::{Checkpoint, Defaults, FORMAT, Partly, WeightSet};
pub use depth_to_points::{DepthCorrection, SeenPoint, depth_to_points};
pub use error::Error;
pub use given_cameras::GivenCameras;
pub use looks::Looks;
pub use pixel_aligned::{PixelAligned, PixelAlignedNetwork, PixelAlignedPredictor, of_pixels, one_for_each};
pub use predict_to_folder::{PredictOptions, PredictReport, check_prediction_folder, predict_to_folder};
pub use predictor::{
    CameraSource, Density, Joint, JointPrediction, Lights, Look, LookPrediction, Photos, Prediction, Predictor,
    Resizable, planar,
};
pub use pretrained::{Network, Pretrained, cameras_of};
pub use refined::{Effort, Refined};
pub use run_folder::RunFolder;
pub use scene_network::{LitNetwork, SceneNetwork};
pub use splatweaver::SplatWeaverPredictor;
pub use view_opacity::{ViewOpacity, ViewOpacityRasterizer};
pub use weaver_io::OutputFolder;
pub use weights::is_of_run;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
