//! Settings of runs.

use crate::run::RunError;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use weaver_data::film::{self, Film};
use weaver_procedural::FilmOptions;

/// Settings of a run.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RunSettings {
    /// The training film.
    pub film: FilmSource,
    /// The experts, at least two. An expert named twice begins with other Gaussians and other parameters the second
    /// time.
    pub experts: Vec<ExpertKind>,
    /// Sizes of the experts.
    pub preset: Preset,
    /// Initial Gaussians of each expert.
    pub gaussians: usize,
    /// Trains on the held-out photos, too. Their figures are then meaningless.
    #[serde(default)]
    pub all: bool,
    /// The stages, in order.
    pub stages: Vec<Stage>,
    /// Divisor of the gate's logits, in training and in use.
    pub temperature: f64,
    /// Values of the router's drawn numbers on an expert's empty pixels.
    pub background_weight: f64,
    /// Seed of numbers and order.
    pub seed: u64,
    /// Seconds between checkpoints, at least.
    pub save_every: f64,
    /// Origin of the run in another.
    #[serde(rename = "made")]
    pub derived_from: Option<DerivedFrom>,
}

/// Source of a film.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum FilmSource {
    /// Generated from a seed.
    Procedural {
        /// The seed.
        seed: u64,
        /// Width and height, pixels.
        size: [usize; 2],
        /// Number of cameras and of frames by each.
        shots: [usize; 2],
    },
    /// Read from a folder.
    Folder {
        /// The folder.
        path: PathBuf,
        /// Longest side of the photos, pixels; `None` takes the layout's usual size.
        long_side: Option<usize>,
    },
}

/// One of the four models of motion.
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ExpertKind {
    /// [`crate::Field`], 4DGaussians.
    Field,
    /// [`crate::Code`], E-D3DGS.
    Code,
    /// [`crate::Keys`], Ex4DGS.
    Keys,
    /// [`crate::Poly`], Spacetime Gaussians.
    Poly,
}

/// Sizes of the experts.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Preset {
    /// For minutes on a processor.
    #[default]
    Tiny,
    /// As published.
    Published,
}

/// A part of a training.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Stage {
    /// An expert by photos alone.
    Expert {
        /// Index of the expert, from 0.
        index: usize,
        /// Steps.
        steps: usize,
    },
    /// The router; the experts are frozen.
    Router {
        /// Steps.
        steps: usize,
    },
    /// An expert by photos at pixels of its own, as weighted by the gate, and by the mixture elsewhere.
    Distil {
        /// Index of the expert, from 0.
        index: usize,
        /// Steps.
        steps: usize,
        /// The share of photos.
        lambda: f64,
    },
}

/// Origin of a run in another.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct DerivedFrom {
    /// The folder of the other run.
    pub from: PathBuf,
    /// The command and its arguments.
    pub by: String,
}

impl RunSettings {
    /// Fails unless all settings are in their ranges.
    ///
    /// # Errors
    /// The setting out of range, with its range.
    pub fn check(&self) -> Result<(), RunError> {
        let count = self.experts.len();
        if count < 2 {
            let names: Vec<&str> = self.experts.iter().map(|kind| kind.name()).collect();
            return Err(RunError::setting("experts", "at least two", names.join(",")));
        }
        let positive = |key, x: f64| match x.is_finite() && x > 0.0 {
            true => Ok(()),
            false => Err(RunError::setting(key, "a positive number", x)),
        };
        positive("temperature", self.temperature)?;
        positive("save_every", self.save_every)?;
        if !self.background_weight.is_finite() {
            return Err(RunError::setting("background_weight", "a finite number", self.background_weight));
        }
        if self.gaussians < LEAST_GAUSSIANS {
            return Err(RunError::setting("gaussians", format!("at least {LEAST_GAUSSIANS}"), self.gaussians));
        }
        for stage in &self.stages {
            match *stage {
                Stage::Expert { index, .. } | Stage::Distil { index, .. } if index >= count => {
                    return Err(RunError::setting("stages", format!("one of {count} experts, from 0"), index));
                }
                Stage::Distil { lambda, .. } if !(0.0..=1.0).contains(&lambda) => {
                    return Err(RunError::setting("lambda", "0 to 1", lambda));
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Names of the experts: their kinds, with a number from the second of a kind on.
    pub fn labels(&self) -> Vec<String> {
        let earlier = |i: usize| self.experts[..i].iter().filter(|kind| **kind == self.experts[i]).count();
        let label = |(i, kind): (usize, &ExpertKind)| match earlier(i) {
            0 => kind.name().to_string(),
            n => format!("{}-{}", kind.name(), n + 1),
        };
        self.experts.iter().enumerate().map(label).collect()
    }

    /// The index of the expert with this name.
    ///
    /// # Errors
    /// When there is none, with the existing names.
    pub fn expert(&self, name: &str) -> Result<usize, RunError> {
        let labels = self.labels();
        let found = labels.iter().position(|label| label == name);
        found.ok_or_else(|| RunError::setting("expert", format!("one of {}", labels.join(", ")), name))
    }
}

/// Least number of Gaussians, for enough neighbors.
const LEAST_GAUSSIANS: usize = 32;

impl FilmSource {
    /// Its folder, if it has one.
    pub fn path(&self) -> Option<&Path> {
        match self {
            Self::Folder { path, .. } => Some(path),
            Self::Procedural { .. } => None,
        }
    }

    /// Reads or generates the film.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn open(&self) -> Result<Film, RunError> {
        match self {
            Self::Procedural { seed, size: [width, height], shots: [cameras, frames] } => {
                let (width, height, cameras, frames) = (*width, *height, *cameras, *frames);
                Ok(weaver_procedural::film(
                    *seed,
                    &FilmOptions { width, height, cameras, frames, ..FilmOptions::default() },
                ))
            }
            Self::Folder { path, long_side } => Ok(film::open(path, *long_side)?),
        }
    }
}

impl ExpertKind {
    /// All kinds, in the order of the publication's code.
    pub const ALL: [Self; 4] = [Self::Field, Self::Code, Self::Keys, Self::Poly];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Field => "field",
            Self::Code => "code",
            Self::Keys => "keys",
            Self::Poly => "poly",
        }
    }
}

impl fmt::Display for ExpertKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for ExpertKind {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let names = Self::ALL.map(Self::name).join(", ");
        Self::ALL.into_iter().find(|kind| kind.name() == text).ok_or_else(|| format!("expected one of {names}"))
    }
}

impl Stage {
    /// Number of its steps.
    pub fn steps(&self) -> usize {
        match *self {
            Self::Expert { steps, .. } | Self::Router { steps } | Self::Distil { steps, .. } => steps,
        }
    }

    /// Its name, given the experts' names.
    pub fn name(&self, labels: &[String]) -> String {
        match *self {
            Self::Expert { index, .. } => labels[index].clone(),
            Self::Router { .. } => "router".into(),
            Self::Distil { index, .. } => format!("{} distilled", labels[index]),
        }
    }
}
