//! Photos of a capture of any kind before they are read.

use crate::Error;
use crate::undistorted::undistorted;
use crate::unreadable::Fault;
use weaver_geometry::geodesy::Origin;
use weaver_geometry::{Camera, Intrinsics, Undistortion};
use weaver_io::{Bitmap, PhotoFile};

use super::lenses::Lenses;
use std::f64::consts::PI;
use std::path::Path;
use weaver_geometry::glam::DVec3;
use weaver_geometry::lens::Lens;
use weaver_scene::Frame;

/// One photo and its camera, at the photo's own size.
#[derive(Clone, Debug)]
pub(super) struct Photo {
    /// Name, image file, camera, time and number.
    pub frame: Frame,
    pub held_out: bool,
    /// Indices of the points it observes, ascending, each once; of none if [`Photos::tracked`] is false.
    pub track: Vec<u32>,
}

/// The photos and points of a capture.
#[derive(Clone, Debug, Default)]
pub(super) struct Photos {
    pub photos: Vec<Photo>,
    pub points: Vec<DVec3>,
    /// sRGB colors of the points, as many.
    pub colors: Vec<[u8; 3]>,
    /// True if the capture itself has a list of held-out photos, even an empty one.
    pub split: bool,
    /// True if its photos are drawn, so that by convention white lies behind transparent pixels.
    pub synthetic: bool,
    /// The origin of the world, where the capture has one.
    pub origin: Option<Origin>,
    /// Remarks for the user.
    pub remarks: Vec<String>,
}

impl Photo {
    /// Opens the photo, turned as its camera is, after its camera was checked.
    pub fn open(&self) -> Result<PhotoFile, Fault> {
        let Frame { path, camera, .. } = &self.frame;
        self.check_camera()?;
        let file = PhotoFile::at(path).map_err(Fault::unreadable)?.for_camera(camera.width, camera.height);
        check_size(path, file.size(), camera)?;
        Ok(file)
    }

    /// Lens that undoes its distortion where it has the size of `camera`; `None` if it has none.
    pub fn lens(&self, camera: Camera) -> Result<Option<Undistortion>, Error> {
        let Some(distortion) = self.frame.distortion else { return Ok(None) };
        let lens = Undistortion::new(camera, distortion).ok_or_else(|| {
            let expected =
                "one that leaves a photo without blank borders; --undistort=false draws photos through their lens";
            Error::unexpected(&self.frame.path, "lens distortion", expected, format!("{distortion:?}"))
        })?;
        Ok(Some(lens))
    }

    /// The lens that the photo keeps at a choice; `None` if its distortion is undone, or there is none.
    pub fn kept_lens(&self, lenses: Lenses) -> Option<Lens> {
        let lens = Lens::Distorted(self.frame.distortion?);
        let wide = || lens.field_of_view(&self.frame.camera) >= WIDE;
        let kept = match lenses {
            Lenses::Keep => true,
            Lenses::Undistort => false,
            Lenses::Auto => wide(),
        };
        kept.then_some(lens)
    }

    fn check_camera(&self) -> Result<(), Error> {
        let Frame { path, camera, .. } = &self.frame;
        let Camera { pose, intrinsics: Intrinsics { fx, fy, cx, cy }, .. } = camera;
        if !(pose.rotation.is_finite() && pose.translation.is_finite()) {
            return Err(Error::unexpected(path, "pose", "finite numbers", format!("{pose:?}")));
        }
        let valid = *fx > 0.0 && *fy > 0.0 && [fx, fy, cx, cy].iter().all(|x| x.is_finite());
        if !valid {
            let found = format!("fx {fx} fy {fy} cx {cx} cy {cy}");
            return Err(Error::unexpected(path, "intrinsics", "finite numbers, focal lengths above 0", found));
        }
        Ok(())
    }
}

/// Field of view from which photos keep their lens, radians: 120 degrees.
const WIDE: f64 = 2.0 / 3.0 * PI;

/// Largest factor on a photo's final size while its distortion is undone: between pixels of the final size,
/// interpolation would cost detail.
const FINER: f64 = 3.0;

/// A photo without distortion, if its lens has one. `read` gives the photo so many times larger than it will be, where
/// `shrink` is how many times larger its file is.
pub(super) fn straight<E>(
    lens: Option<&Undistortion>,
    shrink: f64,
    read: impl Fn(usize) -> Result<Bitmap, E>,
) -> Result<Bitmap, E> {
    let Some(lens) = lens else { return read(1) };
    let times = shrink.ceil().clamp(1.0, FINER) as usize;
    let large = undistorted(lens, &read(times)?);
    Ok(if times == 1 { large } else { large.resize(large.width / times, large.height / times) })
}

/// The camera of a photo without distortion, if its lens has one.
pub(super) fn straight_camera(camera: Camera, lens: Option<&Undistortion>) -> Camera {
    lens.map_or(camera, |lens| lens.to)
}

/// Checks that a file has the size of its photo's camera.
pub(super) fn check_size(path: &Path, (width, height): (usize, usize), camera: &Camera) -> Result<(), Error> {
    if (width, height) == (camera.width, camera.height) {
        return Ok(());
    }
    let expected = format!("{}x{}, its camera's", camera.width, camera.height);
    Err(Error::unexpected(path, "image size", expected, format!("{width}x{height}")))
}

impl Photos {
    /// Photos with names and cameras alone.
    pub fn without_points(frames: Vec<Frame>) -> Self {
        let photos = frames.into_iter().map(|frame| Photo { frame, held_out: false, track: Vec::new() }).collect();
        Self { photos, ..Self::default() }
    }

    /// The image files.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        self.photos.iter().map(|photo| photo.frame.path.as_path())
    }

    /// True if the capture has tracks.
    pub fn tracked(&self) -> bool {
        self.photos.iter().any(|photo| !photo.track.is_empty())
    }
}
