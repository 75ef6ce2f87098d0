//! Matching and adjusting in turns, with cameras that are nearly right.

use crate::bundle::{Bundle, Observation};
use crate::epipolar::Epipolar;
use crate::evidence::EXACT;
use crate::features::Features;
use crate::matching::{Match, Near, matches};
use crate::tracks::tracks;
use std::borrow::Cow;
use weaver_geometry::Camera;
use weaver_geometry::glam::DVec3;
use weaver_kernels::parallel;

/// Scales of the robust loss, one adjustment after the other: while cameras are wrong, once they are adjusted, in the
/// end, and where a camera is located. Observations off by more than `FARTHEST` times a scale are then left out.
const WIDE: [f64; 4] = [16.0, 8.0, 4.0, 2.0];
const NARROW: [f64; 1] = [2.0];
const LAST: [f64; 2] = [2.0, 1.0];
const ALL: [f64; 4] = [8.0, 4.0, 2.0, 1.0];
const FARTHEST: f64 = 3.0;
/// Steps of an adjustment.
const STEPS: usize = 40;
/// Cosine of the largest angle between the axes of two cameras whose photos are compared.
const ANGLE: f64 = 0.5;
/// Pixels from the epipolar line up to which a match counts once cameras are adjusted.
const CERTAIN: f64 = 3.0;
/// Least deviation of keypoints in photos of this width or wider, pixels: keypoints of smaller scale are no more exact.
/// Narrower photos are enlarged before keypoints are found.
const SHARPEST: f64 = 1.0;
const WIDTH: f64 = 384.0;
const NARROWEST: f64 = 1.0 / 3.0;

/// Least deviation of the keypoints of a camera, pixels.
pub(crate) fn sharpest(camera: &Camera) -> f64 {
    SHARPEST * (camera.width.max(camera.height) as f64 / WIDTH).clamp(NARROWEST, 1.0)
}

/// A way to match the keypoints of two photos, the second also sorted by place; and the way along epipolar lines.
type Find = fn(&Features, (&Features, &Near), &Epipolar) -> Vec<Match>;
const ALONG: Find = |first, (_, second), epipolar| second.matches(first, epipolar);
/// Two photos that are compared, with their matches if they have some already.
pub(crate) type Compared = ([usize; 2], Vec<Match>);

/// Matches, triangulates and adjusts once.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pass {
    scales: &'static [f64],
    farthest: f64,
    find: Find,
    /// True if cameras were adjusted before: then only the last adjustment must be exact, as the earlier ones only
    /// choose the outliers.
    adjusted: bool,
    /// True if cameras are adjusted once more afterward.
    again: bool,
}

impl Pass {
    /// For cameras as wrong as this, in deviations of keypoints: a match that is unambiguous in a whole photo is more
    /// certain than one within a wide band.
    pub fn wide(farthest: f64) -> Self {
        Self { scales: &WIDE, farthest, find: |a, (b, _), _| matches(a, b), adjusted: false, again: false }
    }

    /// For cameras that were adjusted.
    pub const FINE: [Self; 2] = [
        Self { scales: &NARROW, farthest: 2.0 * CERTAIN, find: ALONG, adjusted: true, again: false },
        Self { scales: &LAST, farthest: CERTAIN, find: ALONG, adjusted: true, again: false },
    ];

    /// The same before another adjustment.
    pub fn once_more(self) -> Self {
        Self { again: true, ..self }
    }
}

impl Bundle {
    /// Finds points anew with the cameras as they are, and adjusts both. Cameras that are `located` find no points:
    /// they move to fit the points of the others.
    pub(crate) fn pass(&mut self, features: &[Features], near: Vec<Compared>, located: &[bool], pass: &Pass) {
        let straight = self.straight(features);
        let pairs = paired(self, &straight, near, pass);
        drop(straight);
        let counts: Vec<usize> = features.iter().map(|f| f.keypoints.len()).collect();
        let tracks = tracks(&counts, &pairs);
        drop(pairs);
        let all = self.observe(features, &tracks, located, pass.farthest);
        drop(tracks);
        self.observations = all.iter().filter(|o| !located[o.camera]).copied().collect();
        for scale in pass.scales {
            if pass.adjusted && *scale > LAST[1] {
                self.adjust_roughly(*scale, STEPS);
            } else if pass.again {
                self.adjust_as_needed(*scale, STEPS);
            } else {
                self.adjust(*scale, STEPS);
            }
            self.leave_out(FARTHEST * scale);
        }
        self.locate(located, all);
    }

    /// Keypoints with distortion undone.
    fn straight<'a>(&self, features: &'a [Features]) -> Cow<'a, [Features]> {
        if self.lenses.iter().all(|lens| lens.k1 == 0.0 && lens.k2 == 0.0) {
            return Cow::Borrowed(features);
        }
        let mut straight = features.to_vec();
        for (photo, features) in straight.iter_mut().enumerate() {
            let lens = &self.lenses[self.lens_of[photo]];
            features.keypoints.iter_mut().for_each(|k| k.pixel = lens.undistort(&self.cameras[photo], k.pixel));
        }
        Cow::Owned(straight)
    }

    /// Leaves out uncertain observations in the end.
    pub(crate) fn finish(&mut self) {
        self.prune(FARTHEST * LAST[1]);
    }

    /// Moves located cameras to fit the points, which stay.
    fn locate(&mut self, located: &[bool], all: Vec<Observation>) {
        if !located.contains(&true) {
            return;
        }
        let agreed = self.agreed();
        let locating = Self {
            fixed: located.iter().map(|located| !located).collect(),
            fixed_points: true,
            lenses: self.lenses.iter().map(|lens| lens.held()).collect(),
            observations: all.into_iter().filter(|o| located[o.camera] && agreed[o.point]).collect(),
            ..self.clone()
        };
        // Where a camera stands wrong only wide scales reach the right observations; once it stands right, wide scales
        // let wrong ones pull.
        let mut most = vec![0.0; self.cameras.len()];
        for scales in [&ALL[..], &NARROW, &LAST] {
            let mut tried = locating.clone();
            scales.iter().for_each(|scale| _ = tried.adjust(*scale, STEPS));
            // By all observations of a rig.
            let mut explained = vec![0.0; most.len()];
            let fits = tried.observations.iter().zip(tried.fits(EXACT));
            fits.for_each(|(o, fit)| explained[self.mounted(o.camera).on] += fit);
            for camera in 0..most.len() {
                let explained = explained[self.mounted(camera).on];
                if explained > most[camera] {
                    (most[camera], self.cameras[camera]) = (explained, tried.cameras[camera]);
                }
            }
        }
    }
}

/// Matches of pairs of photos that are near their epipolar lines, also of the ones that are known.
fn paired(bundle: &Bundle, features: &[Features], mut pairs: Vec<Compared>, pass: &Pass) -> Vec<Compared> {
    pairs.sort_unstable_by_key(|([a, b], _)| [*b, *a]);
    // The keypoints of a photo are sorted once for all others.
    let mut of_second: Vec<&mut [Compared]> = pairs.chunk_by_mut(|one, other| one.0[1] == other.0[1]).collect();
    parallel::for_chunks(&mut of_second, 1, |_, of_second| {
        for pairs in of_second {
            let second = &features[pairs[0].0[1]];
            let near = Near::new(second);
            for ([a, b], found) in pairs.iter_mut() {
                let [from, to] = [bundle.camera(*a), bundle.camera(*b)];
                let epipolar = Epipolar::new(&from, &to, pass.farthest * sharpest(&to));
                let first = &features[*a];
                if found.is_empty() {
                    *found = (pass.find)(first, (second, &near), &epipolar);
                }
                found.retain(|m| {
                    let [a, b] = m.numbers();
                    epipolar.allows(first.keypoints[a].pixel, second.keypoints[b].pixel)
                });
            }
        }
    });
    pairs
}

/// Pairs without known matches.
pub(crate) fn compared(pairs: &[[usize; 2]]) -> Vec<Compared> {
    pairs.iter().map(|pair| (*pair, Vec::new())).collect()
}

/// Pairs of placed cameras that look in similar directions, each with the nearest others.
pub(crate) fn near(bundle: &Bundle, placed: &[bool], most: usize) -> Vec<[usize; 2]> {
    let mut near = neighbors(&bundle.cameras, most);
    near.retain(|pair| pair.iter().all(|p| placed[*p]));
    near
}

/// Pairs of cameras that look in similar directions, each with the nearest others.
pub(crate) fn neighbors(cameras: &[Camera], most: usize) -> Vec<[usize; 2]> {
    let centers: Vec<DVec3> = cameras.iter().map(|c| c.pose.center()).collect();
    let axis = |i: usize| cameras[i].pose.rotation.row(2);
    let mut pairs = Vec::new();
    for i in 0..cameras.len() {
        let mut near: Vec<usize> = (0..cameras.len()).filter(|j| *j != i && axis(i).dot(axis(*j)) > ANGLE).collect();
        let far = |j: &usize| centers[i].distance(centers[*j]);
        near.sort_by(|a, b| far(a).total_cmp(&far(b)));
        // The nearest half, and some spread evenly over the others: long links hold the shape.
        let close = near.len().min(most.div_ceil(2));
        let (rest, more) = (near.len() - close, (most - close).min(near.len() - close));
        let chosen = (0..close).chain((0..more).map(|k| close + k * rest / more.max(1)));
        pairs.extend(chosen.map(|k| [i.min(near[k]), i.max(near[k])]));
    }
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}
