//! Cameras of photos of which nothing else is known.

use crate::bundle::{Bundle, Lens, Observation};
use crate::evidence::{Evidence, Trust};
use crate::features::Features;
use crate::grow::{Grown, beginnings};
use crate::matching::Match;
use crate::pairs::{self, Pair};
use crate::passes::{Pass, neighbors};
use crate::tracks::{Track, tracks};
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Intrinsics, Pose, Similarity};

/// Focal lengths that are tried where nothing is known, over the longer side of the photo.
const FOCAL: [f64; 6] = [0.55, 0.75, 0.95, 1.2, 1.5, 1.9];
/// What is expected where nothing is known, and the standard deviation of its logarithm.
const USUAL: f64 = 0.9;
const UNKNOWN: f64 = 0.4;
/// Pairs that the choice of a focal length is made by where there are many photos.
const VOTERS: usize = 10;
/// Photos of which many beginnings and every focal length can be tried.
const FEW: usize = 8;
/// Beginnings that are tried, and the most photos of which more than one is where the first reaches all.
const BEGINNINGS: usize = 6;
const SEVERAL: usize = 12;
/// Points that a photo with a camera must see at least.
const LEAST_SEEN: usize = 25;
/// Standard deviation of where a keypoint is found, pixels.
const PIXEL: f64 = 0.5;
/// Rotations farther apart than this are different explanations, radians.
const DIFFERENT: f64 = 0.1;
/// The part of the points, the farthest, that says nothing about the size of a scene.
const FARTHEST: f64 = 0.02;
/// A photo with fewer keypoints has no texture.
const TEXTURE: usize = 30;

/// A photo without a camera.
#[derive(Clone, Debug)]
pub struct Photo<'a> {
    /// Gray, from 0 to 1, `[height, width]`.
    pub gray: Vec<f32>,
    /// Height and width.
    pub size: [usize; 2],
    /// What of it counts, `[height, width]`: 0 where masked.
    pub mask: Option<&'a [u8]>,
    /// The focal length, pixels, as far as it is known.
    pub focal: Option<f64>,
    /// Whether the other cameras and the points are found without it: it is located in what they found.
    pub located: bool,
}

impl Photo<'_> {
    /// A photo in sRGB, `[height, width, 3]`, whose mean of colors is taken for gray.
    pub fn new(rgb: &[u8], size: [usize; 2]) -> Self {
        let gray = rgb.chunks_exact(3).map(|c| c.iter().map(|c| f32::from(*c)).sum::<f32>() / 765.0).collect();
        Self { gray, size, mask: None, focal: None, located: false }
    }
}

/// How cameras are estimated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EstimateSettings {
    /// Keypoints of a photo, at most.
    pub keypoints: usize,
    /// Photos that each is compared with, at most: those that look most alike.
    pub candidates: usize,
    /// How wrong known focal lengths may be, as a part of them; 0 keeps them.
    pub focal_deviation: f64,
    /// Whether all photos have one factor of their focal lengths, rather than each its own.
    pub shared: bool,
    /// Whether a radial distortion is found.
    pub distortion: bool,
}

impl Default for EstimateSettings {
    fn default() -> Self {
        Self { keypoints: 3000, candidates: 20, focal_deviation: 0.05, shared: true, distortion: false }
    }
}

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
#[derive(Clone, Debug, Default)]
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
    let matched = pairs::matched(&features, &pairs::candidates(&features, settings.candidates));
    let mut search = Search { photos, settings, features: &features, matched: &matched, found: Vec::new() };
    let posed = search.run();
    let Some(best) = (0..search.found.len()).reduce(|a, b| if search.value(b) > search.value(a) { b } else { a })
    else {
        return left_out(photos, &features, &matched, &posed, &[]);
    };
    let rival = search.rival(best);
    let Grown { mut bundle, mut placed, .. } = search.found.swap_remove(best);
    bundle.lenses.iter_mut().for_each(|lens| lens.free_k1 = settings.distortion);
    let mut near = neighbors(&bundle.cameras, settings.candidates);
    near.retain(|pair| pair.iter().all(|p| placed[*p]));
    for pass in Pass::FINE {
        let missing: Vec<bool> = placed.iter().map(|p| !p).collect();
        bundle.pass(&features, &near, &missing, &pass);
    }
    bundle.finish();
    let mut seen = vec![0; photos.len()];
    bundle.observations.iter().for_each(|o| seen[o.camera] += 1);
    if placed.iter().zip(&seen).any(|(placed, seen)| *placed && *seen < LEAST_SEEN) {
        placed.iter_mut().zip(&seen).for_each(|(placed, seen)| *placed &= *seen >= LEAST_SEEN);
        bundle.observations.retain(|o| placed[o.camera]);
        bundle.finish();
    }
    locate(photos, &search, &posed, &mut bundle, &mut placed);
    let mut errors = bundle.errors();
    errors.sort_unstable_by(f64::total_cmp);
    let mut estimate = left_out(photos, &features, &matched, &posed, &placed);
    bundle.observations.iter().for_each(|o| estimate.seen[o.camera] += 1);
    estimate.rival = rival;
    let known = photos.iter().all(|p| p.focal.is_some());
    estimate.focal_guessed = !known && placed.iter().filter(|p| **p).count() < 3;
    estimate.error = errors.get(errors.len() / 2).copied().unwrap_or(f64::NAN);
    for photo in (0..photos.len()).filter(|i| placed[*i]) {
        estimate.cameras[photo] = Ok(bundle.camera(photo));
        estimate.k1[photo] = bundle.lenses[bundle.lens_of[photo]].k1;
    }
    (estimate.points, estimate.observations) = (bundle.points, bundle.observations);
    estimate.normalize();
    estimate
}

/// Places the photos that are only located, by the points that the others found.
fn locate(photos: &[Photo<'_>], search: &Search<'_>, posed: &[Pair], bundle: &mut Bundle, placed: &mut [bool]) {
    let absent: Vec<bool> = photos.iter().map(|p| !p.located).collect();
    if absent.iter().all(|absent| *absent) {
        return;
    }
    let tracks = search.linked(posed);
    let evidence =
        Evidence { features: search.features, pairs: posed, tracks: &tracks, absent: &absent, trust: Trust::PAIRS };
    let before = placed.to_vec();
    let mut found = Grown { bundle: bundle.clone(), placed: before.clone(), support: 0.0 };
    found.join(&evidence);
    placed.copy_from_slice(&found.placed);
    let mut near = neighbors(&found.bundle.cameras, search.settings.candidates);
    near.retain(|pair| pair.iter().all(|p| placed[*p]));
    let located: Vec<bool> = before.iter().map(|placed| !placed).collect();
    // The others stay: only what is located moves.
    let fixed = std::mem::replace(&mut found.bundle.fixed, before);
    found.bundle.pass(search.features, &near, &located, &Pass::FINE[1]);
    bundle.cameras = found.bundle.cameras;
    bundle.fixed = fixed;
}

/// What was tried.
struct Search<'a> {
    photos: &'a [Photo<'a>],
    settings: &'a EstimateSettings,
    features: &'a [Features],
    matched: &'a [([usize; 2], Vec<Match>)],
    found: Vec<Grown>,
}

impl Search<'_> {
    /// Grows scenes; returns the pairs' poses with the last focal length.
    fn run(&mut self) -> Vec<Pair> {
        let absent: Vec<bool> = self.photos.iter().map(|p| p.located).collect();
        let tau = self.photos.iter().map(|p| p.size[1] as f64 / 384.0).fold(0.5, f64::max);
        let few = self.photos.len() <= FEW;
        let mut posed = Vec::new();
        for factor in self.focal_lengths(tau) {
            let bundle = self.settings.bundle(self.photos, factor);
            posed = pairs::posed(self.features, &bundle.cameras, self.matched, tau);
            // Among many photos, pairs that are chance do more harm than those that are doubtful do good.
            let certain: Vec<Pair> = posed.iter().filter(|pair| few || pair.certain()).cloned().collect();
            let (all_tracks, tracks) = (self.linked(&posed), self.linked(&certain));
            let evidence = Evidence {
                features: self.features,
                pairs: &certain,
                tracks: &tracks,
                absent: &absent,
                trust: Trust::PAIRS,
            };
            let all = Evidence { pairs: &posed, tracks: &all_tracks, trust: Trust::POINTS, ..evidence };
            let mut tried = 0;
            for from in beginnings(&evidence).into_iter().map(|i| &certain[i]) {
                // Of many photos, the next beginning is in what the others did not reach.
                let reached = |grown: &Grown| from.photos.iter().all(|p| grown.placed[*p]);
                if tried == BEGINNINGS || self.photos.len() > SEVERAL && self.found.iter().any(reached) {
                    continue;
                }
                tried += 1;
                for pose in std::iter::once(&from.pose).chain(&from.rival) {
                    let mut grown = Grown::new(bundle.clone(), from.photos, pose);
                    grown.grow(&evidence);
                    if !few {
                        grown.grow(&all);
                    }
                    self.found.push(grown);
                }
            }
        }
        posed
    }

    /// What pairs say to be the same.
    fn linked(&self, pairs: &[Pair]) -> Vec<Track> {
        let links: Vec<([usize; 2], Vec<Match>)> = pairs.iter().map(|p| (p.photos, p.matches.clone())).collect();
        let counts: Vec<usize> = self.features.iter().map(|f| f.keypoints.len()).collect();
        tracks(&counts, &links)
    }

    /// Photos with a place, then how well they explain each other.
    fn value(&self, number: usize) -> (usize, f64) {
        let Grown { placed, support, .. } = &self.found[number];
        (placed.iter().filter(|p| **p).count(), *support)
    }

    /// How much is explained by the best explanation that is different, over that by the best.
    fn rival(&self, best: usize) -> f64 {
        let Grown { bundle, placed, support } = &self.found[best];
        let differs = |other: &&Grown| {
            let both: Vec<usize> = (0..placed.len()).filter(|i| placed[*i] && other.placed[*i]).collect();
            let turn = |bundle: &Bundle, i: usize| bundle.cameras[i].pose.relative_to(&bundle.cameras[both[0]].pose);
            both.iter().any(|i| turn(bundle, *i).angle_to(&turn(&other.bundle, *i)) > DIFFERENT)
        };
        self.found.iter().filter(differs).map(|other| other.support / support).fold(0.0, f64::max)
    }

    /// Focal lengths to begin with, over the longer side: what is known, every usual one, or the one that pairs like best.
    fn focal_lengths(&self, tau: f64) -> Vec<f64> {
        if self.photos.iter().all(|p| p.focal.is_some()) {
            return vec![USUAL];
        }
        if self.photos.len() <= FEW {
            return FOCAL.to_vec();
        }
        let mut voters = self.matched.to_vec();
        voters.sort_by_key(|(_, matches)| std::cmp::Reverse(matches.len()));
        voters.truncate(VOTERS);
        let score = |factor: &f64| -> f64 {
            let cameras = self.settings.bundle(self.photos, *factor).cameras;
            pairs::posed(self.features, &cameras, &voters, tau).iter().map(|p: &Pair| p.score).sum()
        };
        let ranked = FOCAL.iter().map(|f| (score(f), *f));
        ranked.max_by(|a, b| a.0.total_cmp(&b.0)).map(|best| best.1).into_iter().collect()
    }
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
        ..Estimate::default()
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

impl EstimateSettings {
    /// Cameras without poses: known focal lengths, or this factor of the longer side.
    fn bundle(&self, photos: &[Photo<'_>], factor: f64) -> Bundle {
        let camera = |photo: &Photo<'_>| {
            let [height, width] = photo.size;
            let focal = photo.focal.unwrap_or(factor * height.max(width) as f64);
            let [cx, cy] = [width as f64 / 2.0, height as f64 / 2.0];
            let intrinsics = Intrinsics { fx: focal, fy: focal, cx, cy };
            Camera { pose: Pose::IDENTITY, intrinsics, width, height }
        };
        let known = photos.iter().all(|p| p.focal.is_some());
        let deviation = if known { self.focal_deviation } else { UNKNOWN };
        let free_focal = deviation > 0.0;
        let weight = if free_focal { (PIXEL / deviation).powi(2) } else { 0.0 };
        let expected = if known { 0.0 } else { (USUAL / factor).ln() };
        let lens = Lens { expected, weight, free_focal, ..Lens::default() };
        let count = if self.shared { 1 } else { photos.len() };
        Bundle {
            cameras: photos.iter().map(camera).collect(),
            lenses: vec![lens; count],
            lens_of: (0..photos.len()).map(|i| if self.shared { 0 } else { i }).collect(),
            fixed: vec![false; photos.len()],
            ..Bundle::default()
        }
    }
}
