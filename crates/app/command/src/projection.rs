//! `--projection`: the lens that pictures are drawn through.

use crate::Failure;
use crate::camera_files::Size;
use weaver_geometry::lens::{self, Lens};
use weaver_geometry::{Camera, Pose};
use weaver_scene::Model;

/// The lens that pictures are drawn through.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Projection {
    /// The cameras' own pinholes.
    #[default]
    Pinhole,
    /// The whole sphere: longitude and latitude.
    Equirectangular,
    /// An equidistant fisheye of this field of view, radians.
    Fisheye(f64),
}

/// Names of projections, for messages.
const EXPECTED: &str = "pinhole, equirectangular, or fisheye:DEGREES from 1 to 360, as in fisheye:180";
/// Width of pictures of a sphere, and the side of those of a fisheye.
const SPHERE: usize = 2048;
const FISHEYE: usize = 1024;

/// Parses `--projection`.
pub fn projection(text: &str) -> Result<Projection, String> {
    let fisheye = |degrees: &str| {
        let degrees = degrees.parse::<f64>().ok().filter(|degrees| (1.0..=360.0).contains(degrees))?;
        Some(Projection::Fisheye(degrees.to_radians()))
    };
    let found = match (text, text.split_once(':')) {
        ("pinhole", _) => Some(Projection::Pinhole),
        ("equirectangular", _) => Some(Projection::Equirectangular),
        (_, Some(("fisheye", degrees))) => fisheye(degrees),
        _ => None,
    };
    found.ok_or_else(|| format!("expected {EXPECTED}"))
}

impl Projection {
    /// The model of its cameras.
    pub fn model(self) -> Model {
        match self {
            Self::Pinhole => Model::Pinhole,
            Self::Equirectangular => Model::Lens(Lens::Equirectangular),
            Self::Fisheye(_) => Model::Lens(Lens::EQUIDISTANT),
        }
    }

    /// The camera of a pose; `None` if it is a pinhole, whose intrinsics are the given ones.
    ///
    /// # Errors
    /// Pictures of a sphere that are not twice as wide as high.
    pub fn camera(self, pose: Pose, Size { width, height }: Size) -> Result<Option<Camera>, Failure> {
        let (intrinsics, width, height) = match self {
            Self::Pinhole => return Ok(None),
            Self::Equirectangular => {
                let width = width.or(height.map(|height| 2 * height)).unwrap_or(SPHERE);
                let height = height.unwrap_or(width.div_ceil(2));
                if width != 2 * height {
                    let expected = "expected pictures twice as wide as high; --width alone is enough";
                    let found = format!("--width {width} and --height {height}");
                    return Err(Failure::Usage(format!("--projection equirectangular: {expected}, found {found}")));
                }
                (lens::equirectangular(width, height), width, height)
            }
            Self::Fisheye(field) => {
                let width = width.or(height).unwrap_or(FISHEYE);
                let height = height.unwrap_or(width);
                (lens::fisheye(field, width, height), width, height)
            }
        };
        Ok(Some(Camera { pose, intrinsics, width, height }))
    }
}
