//! Cameras of fisheye photos whose lens is not known.
//!
//! A photo of a fisheye that is known roughly is five photos of pinhole cameras in one place, the sides of a cube. They
//! are found as any rig is. All observations then adjust the cameras and the lens at once, in pixels of the fisheye,
//! and the better lens makes better sides.

mod adjust;
mod lens;
mod sides;

use crate::estimate::{Estimate, estimate_from};
use crate::features::Features;
use crate::photo::{EstimateOptions, Photo};
use adjust::Adjustment;
pub use lens::FisheyeLens;
use sides::Sides;
use weaver_geometry::{Camera, Distortion, Intrinsics};

/// Fields of view across the longer side that are tried, degrees: an adjustment reaches the ones between.
const FIELDS: [f64; 5] = [100.0, 125.0, 155.0, 190.0, 230.0];
/// Sides that each is compared with while fields of view are tried, and keypoints of a photo then.
const CANDIDATES: usize = 8;
const FEWER: usize = 1500;
/// Keypoints of a photo, over the usual number: it shows more.
const MORE: usize = 2;
/// Most rounds after the field of view is chosen, and the change of the focal length, in the logarithm, that ends them.
const ROUNDS: usize = 3;
const SETTLED: f64 = 5e-4;

/// Estimates the cameras of fisheye photos of one lens, and the lens: its focal length, principal point and k1 to k4 of
/// OpenCV's fisheye model, for fields of view beyond 180 degrees, too.
///
/// Photos have one size. Their given focal lengths, if all are alike, are where the lens begins; otherwise several
/// fields of view are tried. [`Estimate::cameras`] have the focal length and principal point, [`Estimate::distortion`]
/// the fisheye, and observations are pixels of the photos.
///
/// Source: Kannala and Brandt, A generic camera model and calibration method for conventional, wide-angle, and
/// fish-eye lenses, 2006.
///
/// ```
/// use weaver_sfm::{EstimateOptions, LeftOut, Photo, estimate_fisheye};
/// let blank = Photo::new(vec![128; 64 * 48 * 3], [48, 64]);
/// let found = estimate_fisheye(&[blank.clone(), blank], &EstimateOptions::default());
/// assert_eq!(found.cameras, [Err(LeftOut::Textureless), Err(LeftOut::Textureless)]);
/// ```
///
/// # Panics
/// If photos differ in size, or one is mounted on another.
pub fn estimate_fisheye(photos: &[Photo<'_>], settings: &EstimateOptions) -> Estimate {
    assert!(photos.iter().all(|photo| photo.size == photos[0].size), "fisheye photos of one size");
    assert!(photos.iter().all(|photo| photo.mounted.is_none()), "fisheye photos stand alone");
    let features: Vec<Features> = photos.iter().map(|photo| photo.features(MORE * settings.keypoints)).collect();
    let size = photos.first().map_or([1, 1], |photo| photo.size);
    let given: Option<f64> = photos.iter().map(|photo| photo.focal).collect::<Option<Vec<f64>>>().and_then(|all| {
        let first = *all.first()?;
        all.iter().all(|focal| *focal == first).then_some(first)
    });
    let fewer: Vec<Features> = features.iter().map(|features| features.largest(FEWER)).collect();
    let trial = EstimateOptions { candidates: CANDIDATES, ..*settings };
    let begin: Vec<FisheyeLens> = match given {
        Some(focal) => vec![FisheyeLens::new(size, focal)],
        None => FIELDS.iter().map(|degrees| FisheyeLens::across(size, *degrees)).collect(),
    };
    let tried = begin.into_iter().map(|lens| Found::new(photos, &fewer, lens, &trial));
    let Some(mut best) = tried.reduce(|best, next| if next.value() > best.value() { next } else { best }) else {
        return Found::new(photos, &features, FisheyeLens::new(size, 1.0), settings).estimate;
    };
    for number in 0..ROUNDS {
        let next = Found::new(photos, &features, best.lens, settings);
        let settled = number > 0 && (next.lens.focal / best.lens.focal).ln().abs() < SETTLED;
        // A round that explains less would be a step back; the first one has all keypoints.
        if number == 0 || next.value() >= best.value() {
            best = next;
        }
        if settled || best.adjusted.is_none() {
            break;
        }
    }
    best.finished(photos)
}

/// Cameras that were found with a lens, and the adjusted ones.
struct Found {
    lens: FisheyeLens,
    estimate: Estimate,
    /// The cameras of the photos and the points, adjusted to pixels of the fisheye; `None` if there are too few.
    adjusted: Option<Adjustment>,
}

impl Found {
    fn new(photos: &[Photo<'_>], features: &[Features], lens: FisheyeLens, settings: &EstimateOptions) -> Self {
        let sides = Sides::of(photos, features, lens);
        let estimate = estimate_from(&sides.photos, &sides.features, settings);
        let mut adjustment = sides.adjustment(&estimate, photos.len());
        let adjusted = adjustment.run();
        let lens = if adjusted { adjustment.lens } else { lens };
        Self { lens, estimate: sides.of_photos(estimate), adjusted: adjusted.then_some(adjustment) }
    }

    /// Photos with a place, then what the cameras explain.
    fn value(&self) -> (usize, f64) {
        let placed = self.estimate.cameras.iter().filter(|camera| camera.is_ok()).count();
        (placed, self.adjusted.as_ref().map_or(0.0, Adjustment::support))
    }

    /// The cameras and points in pixels of the photos.
    fn finished(self, photos: &[Photo<'_>]) -> Estimate {
        let Some(adjusted) = self.adjusted else { return self.estimate };
        let mut estimate = self.estimate;
        let FisheyeLens { focal, center, k, .. } = adjusted.lens;
        let intrinsics = Intrinsics { fx: focal, fy: focal, cx: center.x, cy: center.y };
        estimate.error = adjusted.median_error();
        if let Some(uncertainty) = &mut estimate.uncertainty {
            uncertainty.focal = adjusted.focal_deviation();
        }
        estimate.points.clone_from(&adjusted.points);
        estimate.observations = adjusted.observations();
        for (photo, camera) in estimate.cameras.iter_mut().enumerate() {
            let [height, width] = photos[photo].size;
            let pose = adjusted.poses[photo];
            if let (Ok(camera), Some(pose)) = (camera.as_mut(), pose) {
                *camera = Camera { pose, intrinsics, width, height };
                estimate.distortion[photo] = Some(Distortion::Fisheye { k });
            }
        }
        let count = |photo: usize| estimate.observations.iter().filter(|o| o.camera == photo).count();
        estimate.seen = (0..photos.len()).map(count).collect();
        estimate.normalize();
        estimate
    }
}
