//! Scenes and cameras to look at.

use crate::Notes;
use serde_json::{Value, json};
use weaver_geometry::Camera;
use weaver_io::Bitmap;
use weaver_scene::Gaussians;
use weaver_splat::RasterSettings;

/// A scene, its name and how it is drawn.
#[derive(Clone, Copy, Debug)]
pub struct Subject<'a> {
    /// Title of the page; any text.
    pub title: &'a str,
    /// The scene.
    pub gaussians: &'a Gaussians,
    /// Rules of drawing it.
    pub look: Look,
    /// Notes on it. The meters of a unit are those of [`Look::meters`].
    pub notes: Option<&'a Notes>,
    /// A scene of this name that lies over it, right of a slider.
    pub second: Option<(&'a str, &'a Gaussians)>,
}

/// Rules of drawing that a page follows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// The color behind everything, sRGB from 0 to 1.
    pub background: [f32; 3],
    /// The rules of the rasterizer; a page follows `near`, `far`, `alpha_max` and `antialiased`.
    pub settings: RasterSettings,
    /// Meters of a unit of length, where that is known: a bar then shows the scale.
    pub meters: Option<f64>,
}

impl Default for Look {
    /// White behind the usual settings.
    fn default() -> Self {
        Self { background: [1.0; 3], settings: RasterSettings::default(), meters: None }
    }
}

/// A camera to jump to, and the photo that it took.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// Name of the photo; any text.
    pub name: String,
    /// Pose, intrinsics and size.
    pub camera: Camera,
    /// The photo was not fitted to.
    pub held_out: bool,
    /// Bytes of a JPEG or PNG file of any size, with the aspect ratio of the camera.
    pub photo: Option<Vec<u8>>,
    /// The part of the photo whose depth other photos agree about, 0 to 1, where that is known.
    pub coverage: Option<f64>,
}

impl Shot {
    /// A camera without a photo and without any other information.
    pub fn new(name: impl Into<String>, camera: Camera) -> Self {
        Self { name: name.into(), camera, held_out: false, photo: None, coverage: None }
    }
}

/// Photos that a page in one file holds at most.
const PHOTOS: usize = 32;

/// Longest side of the photos of a page in one file, pixels.
const LONG_SIDE: f64 = 640.0;
/// Quality of photos as libjpeg counts it.
const QUALITY: u8 = 82;

/// The shots whose photos belong into one file, at most 32: held-out ones first, then others, evenly spread.
///
/// ```
/// let held_out: Vec<bool> = (0..100).map(|i| i % 10 == 0).collect();
/// let chosen = weaver_view::pictured(&held_out);
/// assert_eq!((chosen.len(), chosen[..3].to_vec()), (32, vec![0, 10, 20]));
/// ```
pub fn pictured(held_out: &[bool]) -> Vec<usize> {
    let of = |wanted: bool| (0..held_out.len()).filter(|i| held_out[*i] == wanted).collect::<Vec<_>>();
    let evenly = |all: &[usize], most: usize| {
        let count = all.len().min(most);
        (0..count).map(|i| all[i * all.len() / count]).collect::<Vec<_>>()
    };
    let mut chosen = evenly(&of(true), PHOTOS);
    chosen.extend(evenly(&of(false), PHOTOS - chosen.len()));
    chosen
}

/// A photo as the JPEG file that a page in one file holds, at most 640 pixels on a side.
///
/// # Errors
/// When it has no pixels.
pub fn photo_file(photo: &Bitmap) -> std::io::Result<Vec<u8>> {
    let scale = LONG_SIDE / photo.width.max(photo.height).max(1) as f64;
    if scale >= 1.0 {
        return photo.to_jpeg(QUALITY);
    }
    let side = |pixels: usize| ((pixels as f64 * scale).round() as usize).max(1);
    photo.resize(side(photo.width), side(photo.height)).to_jpeg(QUALITY)
}

impl Look {
    pub(crate) fn json(&self) -> Value {
        let RasterSettings { near, far, alpha_max, antialiased, .. } = self.settings;
        let mut look = json!({ "background": self.background, "near": near, "far": far, "alphaMax": alpha_max, "antialiased": antialiased });
        look["meters"] = json!(self.meters);
        look
    }
}

/// A camera as scripts take it: rows of the rotation, center and lens.
pub(crate) fn camera_json(camera: &Camera) -> Value {
    let rows = camera.pose.rotation.transpose().to_cols_array();
    json!({ "A": rows, "eye": camera.pose.center().to_array(), "lens": lens_json(camera) })
}

/// Intrinsics and size in pixels.
pub(crate) fn lens_json(camera: &Camera) -> Value {
    let k = camera.intrinsics;
    json!({ "fx": k.fx, "fy": k.fy, "cx": k.cx, "cy": k.cy, "width": camera.width, "height": camera.height })
}
