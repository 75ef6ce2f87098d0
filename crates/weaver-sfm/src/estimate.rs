//! Cameras of photos of which nothing else is known.

use crate::bundle::Observation;
use crate::features::Features;
use crate::grow::Grown;
use crate::matching::Match;
use crate::pairs::{self, Pair};
use crate::photo::{EstimateSettings, Photo};
use crate::retrieval::candidates;
use crate::search::Search;
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Pose, Similarity};

/// Points that a photo with a camera must see at least.
const LEAST_SEEN: usize = 25;
/// The part of the points, the farthest, that says nothing about the size of a scene.
const FARTHEST: f64 = 0.02;
/// A photo with fewer keypoints has no texture.
const TEXTURE: usize = 30;

/// Why a photo has no camera.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum LeftOut {
    /// Nothing in it is found again: no texture, blur, or a mask.
    Textureless,
    /// It has nothing in common with the others.
    Unmatched,
    /// It was taken from the place of others: how far anything is away cannot be told.
    OnePlace,
    /// It shows something in common with others, but too little, or of another scene.
    Unplaced,
}

/// Estimated cameras, and what they were found by.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// The camera of each photo, or why it has none. The first is the origin; the mean distance from it to the points is 1.
    pub cameras: Vec<Result<Camera, LeftOut>>,
    /// Radial distortion of each.
    pub k1: Vec<f64>,
    /// The points that photos agree about.
    pub points: Vec<DVec3>,
    /// Where they were seen, ascending by point; cameras by number of the photo.
    pub observations: Vec<Observation>,
    /// Median difference between where points are and were seen, pixels.
    pub error: f64,
    /// Points that each photo sees.
    pub seen: Vec<usize>,
    /// How much the best explanation with other rotations explains, over the one that was taken: 0 if none was met.
    pub rival: f64,
    /// How many times as long focal lengths are as they were told, by the lens of which that is farthest from 1; 1 where none was.
    pub focal_factor: f64,
    /// Whether focal lengths were not known, and there are too few photos to tell them.
    pub focal_guessed: bool,
}

/// Estimates the cameras of photos and the points that they show: features, matches, relative poses of pairs, a scene that
/// grows photo by photo from the best pair, and adjustment of all of it.
///
/// Where focal lengths are not known, several are tried. With few photos every good pair is tried for a beginning, and what
/// explains most is taken. The same bits at any number of threads.
///
/// Sources: Schönberger and Frahm, Structure-from-Motion Revisited, 2016, for the order of growth; relative poses as in
/// [`two_view`](crate::two_view()).
///
/// ```
/// use weaver_sfm::{EstimateSettings, LeftOut, Photo, estimate};
/// let blank = Photo::new(&[128; 64 * 48 * 3], [48, 64]);
/// let found = estimate(&[blank.clone(), blank], &EstimateSettings::default());
/// assert_eq!(found.cameras, [Err(LeftOut::Textureless), Err(LeftOut::Textureless)]);
/// ```
pub fn estimate(photos: &[Photo<'_>], settings: &EstimateSettings) -> Estimate {
    let features: Vec<Features> =
        photos.iter().map(|p| Features::new(&p.gray, p.size, p.mask, settings.keypoints)).collect();
    let present: Vec<bool> = photos.iter().map(|p| !p.located).collect();
    let matched = pairs::matched(&features, &candidates(&features, &present, settings.candidates, false));
    let mut search = Search::new(photos, settings, &features, &matched);
    let posed = search.run();
    let Some(best) = search.best() else {
        return left_out(photos, &features, &matched, &posed, &[]);
    };
    let rival = search.rival(best);
    let Grown { mut bundle, mut placed, .. } = search.found.swap_remove(best);
    search.refine(&mut bundle, &placed);
    placed.iter_mut().zip(bundle.seen()).for_each(|(placed, seen)| *placed &= seen >= LEAST_SEEN);
    bundle.observations.retain(|o| placed[o.camera]);
    bundle.finish();
    let told = photos.iter().any(|p| p.focal.is_some());
    let focal_guessed = !told && placed.iter().filter(|placed| **placed).count() < 3;
    search.locate(&posed, &mut bundle, &mut placed);
    let (error, seen) = (bundle.median_error(), bundle.seen());
    let tells = (0..photos.len()).filter(|i| placed[*i] && photos[*i].focal.is_some());
    let off = tells.map(|photo| bundle.lenses[bundle.lens_of[photo]].log_focal);
    let focal_factor = off.reduce(|a, b| if b.abs() > a.abs() { b } else { a }).map_or(1.0, f64::exp);
    let reasons = left_out(photos, &features, &matched, &posed, &placed);
    let mut estimate = Estimate { error, seen, rival, focal_guessed, focal_factor, ..reasons };
    for photo in (0..photos.len()).filter(|i| placed[*i]) {
        estimate.cameras[photo] = Ok(bundle.camera(photo));
        estimate.k1[photo] = bundle.lenses[bundle.lens_of[photo]].k1;
    }
    (estimate.points, estimate.observations) = (bundle.points, bundle.observations);
    estimate.normalize();
    estimate
}

/// No cameras, and why, for photos without a place.
fn left_out(
    photos: &[Photo<'_>],
    features: &[Features],
    matched: &[([usize; 2], Vec<Match>)],
    posed: &[Pair],
    placed: &[bool],
) -> Estimate {
    let reason = |photo: usize| {
        let mut pairs = posed.iter().filter(|pair| pair.photos.contains(&photo)).peekable();
        if features[photo].keypoints.len() < TEXTURE {
            LeftOut::Textureless
        } else if !matched.iter().any(|(pair, _)| pair.contains(&photo)) {
            LeftOut::Unmatched
        } else if !placed.contains(&true) && pairs.peek().is_some() && pairs.all(Pair::turned) {
            LeftOut::OnePlace
        } else {
            LeftOut::Unplaced
        }
    };
    let n = photos.len();
    Estimate {
        cameras: (0..n).map(|i| Err(reason(i))).collect(),
        k1: vec![0.0; n],
        error: f64::NAN,
        seen: vec![0; n],
        points: Vec::new(),
        observations: Vec::new(),
        rival: 0.0,
        focal_factor: 1.0,
        focal_guessed: false,
    }
}

impl Estimate {
    /// Makes the first camera the origin, and the mean distance from it to the points 1.
    fn normalize(&mut self) {
        let Some(origin) = self.cameras.iter().find_map(|c| c.ok()) else { return };
        let center = origin.pose.center();
        let mut distances: Vec<f64> = self.points.iter().map(|p| p.distance(center)).collect();
        distances.sort_unstable_by(f64::total_cmp);
        distances.truncate(distances.len() - (FARTHEST * distances.len() as f64) as usize);
        let mean = distances.iter().sum::<f64>() / distances.len().max(1) as f64;
        let scale = if mean > 0.0 { 1.0 / mean } else { 1.0 };
        let Pose { rotation, translation } = origin.pose;
        let onto = Similarity { scale, rotation, translation: translation * scale };
        self.points.iter_mut().for_each(|p| *p = onto.apply(*p));
        for camera in self.cameras.iter_mut().flatten() {
            camera.pose = onto.apply_to_pose(&camera.pose);
        }
    }
}
