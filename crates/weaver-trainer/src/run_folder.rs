//! The folder of a run: what lies where.

use crate::{Config, Error};
use std::path::{Path, PathBuf};

/// The folder that a run writes to and that later commands read from.
///
/// | file | content |
/// |---|---|
/// | `config.toml` | the resolved configuration |
/// | `checkpoint.safetensors` | everything needed to go on or to evaluate |
/// | `metrics.jsonl` | one line per logged step |
/// | `events/` | the same for TensorBoard |
/// | `samples/` | pictures: input, render, depth, expert map |
/// | `summary.json` | what came out |
/// | `report.html` | curves and pictures in one file |
#[derive(Clone, Debug)]
pub struct RunFolder {
    path: PathBuf,
}

impl RunFolder {
    /// Creates the folder of a new run and saves its configuration.
    ///
    /// # Errors
    /// When there is a run in it already, or it cannot be written.
    pub fn create(path: &Path, config: &Config) -> Result<Self, Error> {
        let folder = Self { path: path.to_path_buf() };
        if folder.config_path().exists() || folder.checkpoint_path().exists() {
            return Err(Error::Usage(format!(
                "{}: there is a run in this folder already; give another --out, or continue it with --resume",
                path.display()
            )));
        }
        weaver_io::create_folder(path.join("samples"))?;
        weaver_io::write_text(folder.config_path(), &config.to_toml())?;
        Ok(folder)
    }

    /// Opens the folder of an earlier run and reads its configuration.
    ///
    /// # Errors
    /// When it is no run folder.
    pub fn open(path: &Path) -> Result<(Self, Config), Error> {
        let folder = Self { path: path.to_path_buf() };
        let config = Config::read(&folder.config_path())?;
        weaver_io::create_folder(path.join("samples"))?;
        Ok((folder, config))
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

    /// One line per logged step.
    pub fn metrics_path(&self) -> PathBuf {
        self.path.join("metrics.jsonl")
    }

    /// What came out of the run.
    pub fn summary_path(&self) -> PathBuf {
        self.path.join("summary.json")
    }

    /// Curves and pictures in one file.
    pub fn report_path(&self) -> PathBuf {
        self.path.join("report.html")
    }

    /// TensorBoard's folder.
    pub fn events_path(&self) -> PathBuf {
        self.path.join("events")
    }

    /// The sample picture of a step.
    pub fn sample_path(&self, step: usize) -> PathBuf {
        self.path.join("samples").join(format!("step-{step:06}.png"))
    }
}
