//! Where cameras come from: `--cameras given|estimated|predicted|FILE`.

use std::convert::Infallible;
use std::path::PathBuf;
use std::str::FromStr;
use weaver_command::Failure;

/// Where the cameras of photos come from. Each command accepts some of these.
#[derive(Clone, Debug, Default, Eq, PartialEq)]
pub enum CameraChoice {
    /// From the capture's own files.
    #[default]
    Given,
    /// By matching the photos.
    Estimated,
    /// From the network.
    Predicted,
    /// From this file, or this folder with a COLMAP model.
    File(PathBuf),
}

impl FromStr for CameraChoice {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(match text {
            "given" => Self::Given,
            "estimated" => Self::Estimated,
            "predicted" => Self::Predicted,
            file => Self::File(file.into()),
        })
    }
}

/// The file or folder, if it is one.
impl From<CameraChoice> for Option<PathBuf> {
    fn from(choice: CameraChoice) -> Self {
        if let CameraChoice::File(path) = choice { Some(path) } else { None }
    }
}

impl CameraChoice {
    /// The refusal of a choice that a command does not accept; `expected` lists the accepted ones.
    pub fn refused(&self, expected: &str) -> Failure {
        let found = match self {
            Self::Given => "given".into(),
            Self::Estimated => "estimated".into(),
            Self::Predicted => "predicted".into(),
            Self::File(path) => path.display().to_string(),
        };
        Failure::Usage(format!("--cameras: expected {expected}, found {found}"))
    }
}
