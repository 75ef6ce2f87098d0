//! Photos in memory.

use crate::{Model, Pixels};
use weaver_geometry::Camera;
use weaver_geometry::lens::{Lens, LensCamera};

/// A photo and its camera.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Photo {
    /// Its name in messages and results.
    pub name: String,
    /// Pose, and intrinsics in pixels of [`rgb`](Self::rgb).
    pub camera: Camera,
    /// sRGB, `[height, width, 3]`.
    pub rgb: Pixels,
    /// Mask of the pixels that count, `[height, width]`; `None` if all do.
    pub mask: Option<Vec<bool>>,
    /// The lens of a photo that is drawn through its own; `None` if it is a pinhole's.
    #[cfg_attr(feature = "serde", serde(default))]
    pub lens: Option<Lens>,
}

impl Photo {
    /// Height and width, pixels.
    pub fn size(&self) -> [usize; 2] {
        [self.camera.height, self.camera.width]
    }

    /// The model of its camera.
    pub fn model(&self) -> Model {
        self.lens.map_or(Model::Pinhole, Model::Lens)
    }

    /// Its camera with its lens.
    pub fn lens_camera(&self) -> LensCamera {
        LensCamera::new(self.camera, self.lens)
    }

    /// True if no pixel counts.
    ///
    /// ```
    /// use weaver_geometry::{Camera, Intrinsics, Pose};
    /// use weaver_scene::Photo;
    /// let intrinsics = Intrinsics { fx: 2.0, fy: 2.0, cx: 1.0, cy: 0.5 };
    /// let camera = Camera { pose: Pose::IDENTITY, intrinsics, width: 2, height: 1 };
    /// let mut photo = Photo { name: "a.jpg".into(), camera, rgb: vec![0; 6].into(), mask: None, lens: None };
    /// assert!(!photo.is_masked());
    /// photo.mask = Some(vec![false; 2]);
    /// assert!(photo.is_masked());
    /// ```
    pub fn is_masked(&self) -> bool {
        self.mask.as_ref().is_some_and(|mask| !mask.contains(&true))
    }
}
