//! Photos in memory, at several sizes.

use crate::FitError;
use weaver_geometry::{Camera, Intrinsics};
use weaver_scene::Photo;

/// Checks that sizes agree, the camera is finite and something is not masked.
pub(crate) fn check(photo: &Photo) -> Result<(), FitError> {
    let Camera { pose, intrinsics: Intrinsics { fx, fy, cx, cy }, width, height } = photo.camera;
    let pixels = width * height;
    let wrong = |expected: String, found: String| Err(FitError::Photo { name: photo.name.clone(), expected, found });
    if pixels == 0 || photo.rgb.len() != 3 * pixels || photo.mask.as_ref().is_some_and(|m| m.len() != pixels) {
        let mask = photo.mask.as_ref().map_or(String::new(), |m| format!(" and a mask of {}", m.len()));
        return wrong(format!("{width}x{height} pixels"), format!("{} numbers{mask}", photo.rgb.len()));
    }
    if !(pose.rotation.is_finite() && pose.translation.is_finite()) {
        return wrong("a finite pose".into(), format!("{pose:?}"));
    }
    if !(fx > 0.0 && fy > 0.0 && [fx, fy, cx, cy].iter().all(|x| x.is_finite())) {
        return wrong("finite intrinsics with focal lengths above 0".into(), format!("{:?}", photo.camera.intrinsics));
    }
    Ok(())
}

/// The mean color of photos, where they count; white where nothing does.
///
/// As a background, it costs least where a scene has holes in views without a photo.
pub fn mean_color<'p>(photos: impl IntoIterator<Item = &'p Photo>) -> [f32; 3] {
    let (mut sum, mut count) = ([0u64; 3], 0u64);
    for photo in photos {
        for (at, pixel) in photo.rgb.chunks_exact(3).enumerate() {
            if photo.mask.as_ref().is_none_or(|mask| mask[at]) {
                (0..3).for_each(|c| sum[c] += u64::from(pixel[c]));
                count += 1;
            }
        }
    }
    if count == 0 { [1.0; 3] } else { sum.map(|sum| (sum as f64 / (255.0 * count as f64)) as f32) }
}

/// The photo at half its size: means of 2 x 2 pixels; an odd last row or column is left out. A pixel is masked if any
/// of the four is.
fn halved_photo(photo: &Photo) -> Photo {
    let Camera { width, height, .. } = photo.camera;
    let (w, h) = (width / 2, height / 2);
    let mut rgb = Vec::with_capacity(3 * w * h);
    for y in 0..h {
        for x in 0..w {
            for c in 0..3 {
                let at = |dy: usize, dx: usize| u32::from(photo.rgb[3 * ((2 * y + dy) * width + 2 * x + dx) + c]);
                rgb.push(((at(0, 0) + at(0, 1) + at(1, 0) + at(1, 1) + 2) / 4) as u8);
            }
        }
    }
    let mask = photo.mask.as_ref().map(|mask| {
        let at = |y: usize, x: usize| mask[y * width + x];
        let all = |y: usize, x: usize| at(y, x) && at(y, x + 1) && at(y + 1, x) && at(y + 1, x + 1);
        (0..h).flat_map(|y| (0..w).map(move |x| (2 * y, 2 * x))).map(|(y, x)| all(y, x)).collect()
    });
    Photo { name: String::new(), camera: halved(&photo.camera), rgb: rgb.into(), mask, lens: photo.lens }
}

/// The camera of a photo at half its size.
fn halved(camera: &Camera) -> Camera {
    let intrinsics = camera.intrinsics.resized(0.5, 0.5);
    Camera { intrinsics, width: camera.width / 2, height: camera.height / 2, ..*camera }
}

/// The camera of a photo that was halved several times.
pub(crate) fn at_level(camera: &Camera, level: usize) -> Camera {
    (0..level).fold(*camera, |camera, _| halved(&camera))
}

/// A photo at its own size and at halves of it.
#[derive(Clone, Debug)]
pub(crate) struct Pyramid {
    levels: Vec<Photo>,
}

/// A photo is not halved below this many pixels a side: a window of SSIM has to fit in with room.
const LEAST_SIDE: usize = 32;

impl Pyramid {
    pub fn new(photo: Photo, halvings: usize) -> Self {
        let mut levels = vec![photo];
        for _ in 0..halvings {
            let last = levels.last().expect("one at least");
            if last.camera.width.min(last.camera.height) < 2 * LEAST_SIDE {
                break;
            }
            levels.push(halved_photo(last));
        }
        Self { levels }
    }

    /// The pyramid of a photo, with all sizes kept where the photo is.
    pub fn kept(photo: Photo, halvings: usize) -> Self {
        let mut pyramid = Self::new(photo, halvings);
        if let [photo, smaller @ ..] = pyramid.levels.as_mut_slice() {
            smaller
                .iter_mut()
                .for_each(|level| level.rgb = photo.rgb.beside(std::mem::take(&mut level.rgb).into_vec()));
        }
        pyramid
    }

    /// The photo halved `level` times, or as often as its size allows, and how often that is.
    pub fn level(&self, level: usize) -> (&Photo, usize) {
        let level = level.min(self.levels.len() - 1);
        (&self.levels[level], level)
    }
}
