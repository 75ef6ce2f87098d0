//! The layout of a training run's folder.

use std::path::{Path, PathBuf};

/// The folder that a training run writes to and that later commands read from.
///
/// | file | content |
/// |---|---|
/// | `config.toml` | the resolved configuration |
/// | `checkpoint.safetensors` | everything needed to continue, evaluate or infer |
/// | `metrics.jsonl` | one line per logged step |
/// | `events/` | the logged values for TensorBoard |
/// | `samples/` | pictures: input, render, depth, Gaussians per pixel |
/// | `summary.json` | the outcome |
/// | `report.html` | curves and pictures in one file |
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunFolder {
    path: PathBuf,
}

impl RunFolder {
    /// Files that a run writes; names that end with a slash are folders.
    pub const FILES: [&str; 6] =
        ["config.toml", "checkpoint.safetensors", "metrics.jsonl", "samples/", "summary.json", "report.html"];

    /// The run folder at a path, which need not exist.
    pub fn at(path: impl Into<PathBuf>) -> Self {
        Self { path: path.into() }
    }

    /// The folder itself.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The resolved configuration.
    pub fn config_path(&self) -> PathBuf {
        self.path.join("config.toml")
    }

    /// The latest checkpoint.
    pub fn checkpoint_path(&self) -> PathBuf {
        self.path.join("checkpoint.safetensors")
    }

    /// The outcome of the run.
    pub fn summary_path(&self) -> PathBuf {
        self.path.join("summary.json")
    }

    /// The folder of sample pictures.
    pub fn samples_path(&self) -> PathBuf {
        self.path.join("samples")
    }

    /// The sample picture of a step.
    pub fn sample_path(&self, step: usize) -> PathBuf {
        self.samples_path().join(format!("step-{step:06}.png"))
    }
}
