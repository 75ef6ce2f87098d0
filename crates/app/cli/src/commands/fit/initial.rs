//! Where the Gaussians of a fit begin.

use crate::methods;
use std::error::Error;
use std::path::{Path, PathBuf};
use weaver_command::Failure;
use weaver_data::capture::CaptureOptions;
use weaver_fit::init;
use weaver_inference::{RunFolder, predict_photos};
use weaver_reconstruct::{GivenGaussians, Initial, RunSettings};
use weaver_scene::Gaussians;
use weaver_trainer::OpenRun;

/// Where Gaussians begin.
pub enum Start {
    Here(Initial),
    File(PathBuf),
    /// The prediction of a run's network, or of the weights that come with the program.
    Network(Option<RunFolder>),
}

impl Start {
    /// Reads `--init`.
    pub fn of(text: Option<&str>) -> Result<Self, Failure> {
        match text {
            None => Ok(Self::Here(Initial::Auto)),
            Some("points") => Ok(Self::Here(Initial::Points)),
            Some("dense") => Ok(Self::Here(Initial::Dense)),
            Some("random") => Ok(Self::Here(Initial::Random)),
            Some("built-in") => Ok(Self::Network(None)),
            Some(path) if Path::new(path).is_file() => {
                // Before photos are matched.
                if weaver_io::open_scene(path)?.gaussians.is_empty() {
                    let expected = "expected Gaussians to begin with, found an empty scene";
                    return Err(Failure::message(format!("--init {path}: {expected}")));
                }
                Ok(Self::File(path.into()))
            }
            Some(path) if RunFolder::at(path).checkpoint_path().exists() => {
                Ok(Self::Network(Some(RunFolder::at(path))))
            }
            Some(path) => Err(Failure::message(format!(
                "--init {path}: expected points, dense, random, built-in, a file of Gaussians or the folder of a trained network, found none of them"
            ))),
        }
    }

    /// The file that it is read from; of a trained network its weights.
    pub fn file(&self) -> Option<PathBuf> {
        match self {
            Self::File(path) => Some(path.clone()),
            Self::Network(folder) => folder.as_ref().map(RunFolder::checkpoint_path),
            Self::Here(_) => None,
        }
    }

    /// The start as the run's settings name it.
    pub fn kind(&self) -> Initial {
        match self {
            Self::Here(initial) => *initial,
            _ => Initial::Given,
        }
    }

    /// Makes the Gaussians that are given.
    pub fn given(self) -> Option<Box<GivenGaussians>> {
        match self {
            Self::Here(_) => None,
            Self::File(path) => Some(Box::new(move |_| Ok(weaver_io::read_gaussians(&path)?))),
            Self::Network(folder) => Some(Box::new(move |settings| predicted(folder.as_ref(), settings))),
        }
    }
}

/// Predicts Gaussians of the photos to fit to, thinned so that there is room to work in.
fn predicted(folder: Option<&RunFolder>, settings: &RunSettings) -> Result<Gaussians, Box<dyn Error + Send + Sync>> {
    let mut run = match folder {
        Some(folder) => methods::models().open_run(folder)?,
        None => OpenRun::built_in()?,
    };
    let options = CaptureOptions { hold_out: settings.hold_out, masks: settings.masks, ..CaptureOptions::default() };
    let (most, seed) = (settings.views, settings.fit.seed);
    let gaussians = predict_photos(&mut *run.predictor, &settings.capture, &options, most, seed)?;
    Ok(init::part_of(&gaussians, init::room(&settings.fit), seed))
}
