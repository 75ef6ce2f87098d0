//! Weakly supervised video anomaly detection: training videos are labeled as normal or abnormal, and the detector finds
//! the times of anomalies.
//!
//! - Videos are rows of features, one for each snippet of 16 frames: [`Features`], [`read_list`], [`Planted`].
//! - [`UrDmu`] encodes them; [`Splatting`] makes labels of snippets from peaks of its curve; [`Expert`]s score classes
//!   or clusters of anomalies, and a [`Gate`] combines their scores (GS-MoE, D'Amicantonio et al., arXiv 2508.06318).
//!   DeepMIL and RTFM learn from the same bags.
//! - [`Trainer`] trains a [`Detector`] on a [`TrainingSet`]; [`Annotation`] and [`metrics`] evaluate it as the
//!   published evaluators do.

mod annotation;
mod chart;
mod checkpoint;
#[cfg(feature = "command")]
pub mod command;
mod decay_attention;
mod detector;
mod detector_file;
mod encoded;
mod encoder;
mod error;
mod expert;
mod features;
mod gate;
mod kmeans;
mod list;
pub mod losses;
mod memory;
pub mod metrics;
mod planted;
mod resample;
mod sampler;
mod schedule;
mod score_head;
mod splatting;
mod temporal_transformer;
mod top_k;
mod training;
mod training_set;
mod urdmu;

pub use annotation::{Annotation, Length};
pub use chart::Chart;
pub use checkpoint::Checkpoint;
pub use detector::{Curves, Detector};
pub use encoded::Encoded;
pub use encoder::{ConvolutionSizes, Convolutions, DeepMil, DeepMilSizes, Encoder, EncoderKind, Rtfm};
pub use error::{Error, Result};
pub use expert::{Expert, ExpertSizes};
pub use features::Features;
pub use gate::{Gate, GateSizes};
pub use kmeans::{cluster_centers, nearest_center};
pub use list::{FileName, Listed, classes_of, read_list};
pub use planted::{Planted, PlantedVideo};
pub use resample::resample;
pub use schedule::{Experts, Schedule, Training};
pub use splatting::{Peak, Rule, Splatting, topographic_peaks, window_peaks};
pub use temporal_transformer::UrDmuSizes;
pub use training::{Labels, Stage, StepReport, Trainer};
pub use training_set::{TrainingSet, TrainingVideo};
pub use urdmu::{UrDmu, UrDmuPass, UrDmuTerms};

/// The ops of this crate.
pub mod ops {
    pub use crate::decay_attention::decay_attention;
}

pub use top_k::top_k;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
