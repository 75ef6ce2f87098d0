//! Cameras of photos without any other information.

use crate::bundle::{Bundle, Mounted, Observation};
use crate::confidence::{Confidence, Grounds};
use crate::features::Features;
use crate::lenses::Taken;
use crate::locate::{SceneOfSome, locate};
use crate::pairs::{Pair, Pairs};
use crate::photo::{EstimateOptions, Photo};
use crate::search::{Scene, Search};
use crate::second_look::{Given, PairMatcher, again, better, register};
use crate::uncertainty::Uncertainty;
use std::borrow::Cow;
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Distortion, Pose, Similarity};

/// The part of the points, the farthest, that is left out of the size of a scene.
const FARTHEST: f64 = 0.02;
/// A photo with fewer keypoints has no texture.
const TEXTURE: usize = 30;

/// The reason why a photo has no camera.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum LeftOut {
    /// No keypoints to match: no texture, blur, or a mask.
    Textureless,
    /// It has nothing in common with the others.
    Unmatched,
    /// It was taken from the place of others, with a rotation or none: depth cannot be determined.
    OnePlace,
    /// Too few matches with others, or another scene.
    Unplaced,
}

/// Estimated cameras, and the points and observations behind them.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// The camera of each photo, or the reason why it has none. The first is the origin; the mean distance from it to
    /// the points is 1, without the farthest 2 %.
    pub cameras: Vec<Result<Camera, LeftOut>>,
    /// The radial distortion of each photo's lens, where one was found.
    pub distortion: Vec<Option<Distortion>>,
    /// The points that photos agree about.
    pub points: Vec<DVec3>,
    /// Observations of the points, ascending by point; cameras by number of the photo, in pixels of the photo as given.
    pub observations: Vec<Observation>,
    /// Median residual, pixels.
    pub error: f64,
    /// Points that each photo sees.
    pub seen: Vec<usize>,
    /// Expected errors of focal lengths, rotations and centers; `None` without cameras, or where nothing holds them.
    pub uncertainty: Option<Uncertainty>,
    /// Support of the best explanation with other rotations, over the support of the chosen one: 0 if there was none.
    pub rival: f64,
    /// Photos with a camera whose matches with most of the others may be chance; if there are none, the part of the
    /// scene with the most doubtful place, if more than half as many matches contradict it as hold it.
    pub untied: Vec<usize>,
    /// Ratio of estimated to given focal lengths, for the lens whose ratio is farthest from 1; 1 where none was given.
    pub focal_factor: f64,
    /// True if focal lengths were not given, and there are too few photos to determine them.
    pub focal_guessed: bool,
    /// Photos that [`estimate_with`] placed by a second look: all with a camera where it found the scene anew.
    pub second_look: Vec<usize>,
}

/// Estimates the cameras of photos and the points that they show: features, matches, relative poses of pairs, a scene
/// that grows photo by photo from the best pair, and adjustment of all of it.
///
/// Where focal lengths are not known, pairs vote for them. Initial pairs are tried until two lead to the same scene,
/// and the scene with the largest support is taken. Photos that are only [located](Photo::located) do not change the
/// result of the others, to the bit. The same bits at any number of threads.
///
/// Sources: Schönberger and Frahm, Structure-from-Motion Revisited, 2016, for the order of growth; relative poses as in
/// [`two_view`](crate::two_view()).
///
/// ```
/// use weaver_sfm::{EstimateOptions, LeftOut, Photo, estimate};
/// let blank = Photo::new(vec![128; 64 * 48 * 3], [48, 64]);
/// let found = estimate(&[blank.clone(), blank], &EstimateOptions::default());
/// assert_eq!(found.cameras, [Err(LeftOut::Textureless), Err(LeftOut::Textureless)]);
/// ```
pub fn estimate(photos: &[Photo<'_>], settings: &EstimateOptions) -> Estimate {
    let features: Vec<Features> = photos.iter().map(|photo| photo.features(settings.keypoints)).collect();
    estimate_from(photos, &features, settings)
}

/// Estimates cameras as [`estimate`] does, from features that are there already: of each photo, at most as many as
/// [`EstimateOptions::keypoints`] says.
///
/// # Panics
/// If there are not as many as photos, or photos of a rig do not follow one another.
///
/// ```
/// use weaver_procedural::{ProceduralOptions, scene};
/// use weaver_sfm::{EstimateOptions, Features, Photo, estimate_from};
///
/// let scene = scene(3, &ProceduralOptions { width: 96, height: 72, views: 4 });
/// let photos: Vec<Photo<'_>> = scene.views.iter().map(|view| Photo::new(view.image.to_bytes(), [72, 96])).collect();
/// let settings = EstimateOptions::default();
/// // Features are found once; settings may then be tried one after the other.
/// let features: Vec<Features> = photos.iter().map(|photo| photo.features(settings.keypoints)).collect();
/// let free = estimate_from(&photos, &features, &settings);
/// let told: Vec<Photo<'_>> = photos.into_iter().map(|photo| Photo { focal: Some(80.0), ..photo }).collect();
/// let held = estimate_from(&told, &features, &EstimateOptions { focal_deviation: 0.0, ..settings });
/// assert_eq!(free.cameras.len(), held.cameras.len());
/// assert!(held.cameras.iter().flatten().all(|camera| camera.intrinsics.fx == 80.0));
/// ```
pub fn estimate_from(photos: &[Photo<'_>], features: &[Features], settings: &EstimateOptions) -> Estimate {
    estimated(photos, features, settings, None)
}

/// Estimates cameras as [`estimate_from`] does, and takes a second look where that leaves photos out or is not
/// [`Confidence::Good`](crate::Confidence::Good): with the matches of `matcher` beside the own ones.
///
/// Photos that are left out are registered in the scene, whose other cameras stay the same to the bit. Up to 30 photos
/// whose cameras are in doubt are looked at again as a whole; the new scene counts only if it is good and places as
/// many photos, or if it places more, and turns those alike that the first was sure about, or places twice as many.
/// Otherwise the result is the one of [`estimate_from`] to the bit, and the matcher is not asked at all where nothing
/// is left out and the cameras are good.
///
/// # Panics
/// As [`estimate_from`].
pub fn estimate_with(
    photos: &[Photo<'_>],
    features: &[Features],
    settings: &EstimateOptions,
    matcher: &dyn PairMatcher,
) -> Estimate {
    estimated(photos, features, settings, Some(matcher))
}

fn estimated(
    photos: &[Photo<'_>],
    features: &[Features],
    settings: &EstimateOptions,
    matcher: Option<&dyn PairMatcher>,
) -> Estimate {
    assert_eq!(photos.len(), features.len(), "features of each photo");
    let taken: Vec<Taken> = photos.iter().map(Taken::of).collect();
    for (i, mounted) in taken.iter().enumerate().filter_map(|(i, taken)| Some((i, taken.mounted?))) {
        let follows = mounted.on == i || i > 0 && taken[i - 1].mounted.is_some_and(|before| before.on == mounted.on);
        assert!(follows, "photos of a rig follow one another: {i} on {}", mounted.on);
        assert_eq!(photos[i].located, photos[mounted.on].located, "photos of a rig are located together: {i}");
    }
    // Photos that are only located take no part while the others are found.
    let numbers: Vec<usize> = (0..photos.len()).filter(|i| !photos[*i].located).collect();
    let of_those = if numbers.len() == photos.len() {
        Cow::Borrowed(features)
    } else {
        Cow::Owned(numbers.iter().map(|i| features[*i].clone()).collect())
    };
    let photos_of_those: Vec<&Photo<'_>> = numbers.iter().map(|i| &photos[*i]).collect();
    let renumbered = |taken: Taken| {
        let mounted = taken.mounted.map(|m| Mounted { on: numbers.partition_point(|i| *i < m.on), ..m });
        Taken { mounted, ..taken }
    };
    let taken_of_those: Vec<Taken> = numbers.iter().map(|i| renumbered(taken[*i])).collect();
    let first = Search::new(&taken_of_those, &photos_of_those, &of_those, settings).scene();
    let mut judged = Judged::of(first, &taken_of_those);
    let mut second_look = Vec::new();
    if let Some(matcher) = matcher {
        let given = Given { taken: &taken_of_those, photos: &photos_of_those, features: &of_those, settings };
        second_look = judged.look_again(given, matcher).into_iter().map(|photo| numbers[photo]).collect();
    }
    let Judged { scene, uncertainty, focal_guessed, focal_factor } = judged;
    let Scene { found, pairs, rival, untied, one_place } = scene;
    let pairs = pairs.renumbered(&numbers);
    let Some((bundle, placed)) = found else {
        let mut none = without_cameras(features, &pairs, &vec![false; photos.len()]);
        if one_place {
            // Photos that are only located have nothing to be located in when the others have no place.
            let turned = |i: usize| photos[i].located || pairs.posed.iter().any(|pair| pair.photos.contains(&i));
            for (i, camera) in none.cameras.iter_mut().enumerate() {
                if *camera != Err(LeftOut::Textureless) && turned(i) {
                    *camera = Err(LeftOut::OnePlace);
                }
            }
        }
        return none;
    };
    let scene = SceneOfSome { numbers: &numbers, bundle, placed: &placed };
    let (bundle, placed, pairs) = locate(&taken, features, settings, scene, pairs);
    let error = bundle.median_error();
    let seen = bundle.seen();
    let reasons = without_cameras(features, &pairs, &placed);
    let uncertainty = uncertainty.map(|u| u.renumbered(&numbers, photos.len()));
    let untied = untied.into_iter().map(|photo| numbers[photo]).collect();
    let mut estimate =
        Estimate { error, seen, uncertainty, rival, untied, focal_guessed, focal_factor, second_look, ..reasons };
    for photo in (0..photos.len()).filter(|i| placed[*i]) {
        let lens = &bundle.lenses[bundle.lens_of[photo]];
        estimate.cameras[photo] = Ok(bundle.camera(photo));
        estimate.distortion[photo] =
            Distortion::Radial { k: [lens.k1, lens.k2, 0.0, 0.0, 0.0, 0.0], p: [0.0; 2] }.or_none();
    }
    (estimate.points, estimate.observations) = (bundle.points, bundle.observations);
    estimate.normalize();
    estimate
}

/// A scene with its exactness.
struct Judged {
    scene: Scene,
    uncertainty: Option<Uncertainty>,
    focal_guessed: bool,
    focal_factor: f64,
}

impl Judged {
    fn of(scene: Scene, taken: &[Taken]) -> Self {
        let Some((bundle, placed)) = &scene.found else {
            return Self { scene, uncertainty: None, focal_guessed: false, focal_factor: 1.0 };
        };
        let told = taken.iter().any(|t| t.focal.is_some());
        let focal_guessed = !told && placed.iter().filter(|placed| **placed).count() < 3;
        let uncertainty = Uncertainty::of(bundle, placed);
        let focal_factor = focal_factor(bundle, placed, taken);
        Self { scene, uncertainty, focal_guessed, focal_factor }
    }

    fn confidence(&self) -> Confidence {
        let bundle = self.scene.found.as_ref().map(|(bundle, _)| bundle);
        let grounds = Grounds {
            observed: bundle.is_some_and(|bundle| !bundle.observations.is_empty()),
            error: bundle.map_or(f64::NAN, Bundle::median_error),
            focal_guessed: self.focal_guessed,
            untied: !self.scene.untied.is_empty(),
            rival: self.scene.rival,
            uncertainty: self.uncertainty.as_ref(),
        };
        grounds.confidence()
    }

    /// Looks at the scene again with a matcher if it is in doubt, then at photos without a place; returns the photos
    /// that were placed by that.
    fn look_again(&mut self, given: Given<'_>, matcher: &dyn PairMatcher) -> Vec<usize> {
        // Photos from one place have no depths, however they are matched.
        if self.scene.one_place {
            return Vec::new();
        }
        let placed = |judged: &Self| judged.scene.found.as_ref().map_or(Vec::new(), |(_, placed)| placed.clone());
        let mut before = placed(self);
        if self.confidence() != Confidence::Good
            && let Some(scene) = again(given, matcher, &self.scene)
        {
            let other = Self::of(scene, given.taken);
            if better((&self.scene, self.confidence()), (&other.scene, other.confidence())) {
                // All of its cameras are new.
                before.fill(false);
                *self = other;
            }
        }
        if let Scene { found: Some((bundle, placed)), pairs, .. } = &mut self.scene {
            register(given, matcher, bundle, placed, pairs);
        }
        let after = placed(self);
        (0..after.len()).filter(|i| after[*i] && !before.get(*i).is_some_and(|before| *before)).collect()
    }
}

/// Ratio of estimated to given focal lengths, for the lens whose ratio is farthest from 1.
fn focal_factor(bundle: &Bundle, placed: &[bool], taken: &[Taken]) -> f64 {
    let tells = (0..placed.len()).filter(|i| placed[*i] && taken[*i].focal.is_some());
    let off = tells.map(|photo| bundle.lenses[bundle.lens_of[photo]].log_focal);
    off.reduce(|a, b| if b.abs() > a.abs() { b } else { a }).map_or(1.0, f64::exp)
}

/// An estimate without cameras, with the reasons for photos without a place.
fn without_cameras(features: &[Features], pairs: &Pairs, placed: &[bool]) -> Estimate {
    let reason = |photo: usize| {
        let mut posed = pairs.posed.iter().filter(|pair| pair.photos.contains(&photo)).peekable();
        if features[photo].keypoints.len() < TEXTURE {
            LeftOut::Textureless
        } else if !pairs.matched.iter().any(|(pair, _)| pair.contains(&photo)) {
            LeftOut::Unmatched
        } else if !placed.contains(&true) && posed.peek().is_some() && posed.all(Pair::turned) {
            LeftOut::OnePlace
        } else {
            LeftOut::Unplaced
        }
    };
    let n = features.len();
    Estimate {
        cameras: (0..n).map(|i| Err(reason(i))).collect(),
        distortion: vec![None; n],
        error: f64::NAN,
        seen: vec![0; n],
        points: Vec::new(),
        observations: Vec::new(),
        uncertainty: None,
        rival: 0.0,
        untied: Vec::new(),
        focal_factor: 1.0,
        focal_guessed: false,
        second_look: Vec::new(),
    }
}

impl Estimate {
    /// Makes the first camera the origin, and the mean distance from it to the points 1.
    pub(crate) fn normalize(&mut self) {
        let Some(origin) = self.cameras.iter().find_map(|c| c.ok()) else { return };
        let center = origin.pose.center();
        let mut distances: Vec<f64> = self.points.iter().map(|p| p.distance(center)).collect();
        distances.sort_unstable_by(f64::total_cmp);
        distances.truncate(distances.len() - (FARTHEST * distances.len() as f64) as usize);
        let mean = distances.iter().sum::<f64>() / distances.len().max(1) as f64;
        let scale = if mean > 0.0 { 1.0 / mean } else { 1.0 };
        let Pose { rotation, translation } = origin.pose;
        self.uncertainty.iter_mut().for_each(|u| u.scale(scale));
        let onto = Similarity { scale, rotation, translation: translation * scale };
        self.points.iter_mut().for_each(|p| *p = onto.apply(*p));
        for camera in self.cameras.iter_mut().flatten() {
            camera.pose = onto.apply_to_pose(&camera.pose);
        }
    }

    /// Confidence in the cameras.
    ///
    /// They are good if 2.5 of their standard deviations are within 2 degrees, 5 % of the spread of their centers, and
    /// 5 % of the focal length.
    pub fn confidence(&self) -> Confidence {
        let grounds = Grounds {
            observed: !self.observations.is_empty(),
            error: self.error,
            focal_guessed: self.focal_guessed,
            untied: !self.untied.is_empty(),
            rival: self.rival,
            uncertainty: self.uncertainty.as_ref(),
        };
        grounds.confidence()
    }
}
