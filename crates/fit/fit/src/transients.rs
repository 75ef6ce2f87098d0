//! Things that one photo alone shows: passers-by, a finger, foliage right before the lens.
//!
//! While a scene is still young, it shows the majority of the photos. A place that a photo shows far worse than the
//! other photos that see it is therefore hidden in this photo by something else, and is left out of it; a place that
//! all photos show badly is only fine or shiny, and stays. Sources of the idea that residuals show transients:
//! RobustNeRF (Sabour et al., 2023), SpotLessSplats (2024); the comparison with the other photos' residuals at the same
//! place is our own, and needs no trained features.
//!
//! Residuals at a visible place are taken to be distributed exponentially, with the photos' mean there, and residuals
//! of a thing before it with a mean of their own. The logarithm of the ratio of both is the evidence of a pixel. One
//! pixel says little, since a thing resembles its background in places: regions are found in the mean of the evidence
//! around each pixel.

use std::borrow::Cow;
use weaver_geometry::Camera;
use weaver_geometry::glam::DVec2;
use weaver_geometry::lens::LensCamera;
use weaver_kernels::order::median_high;
use weaver_scene::Photo;

/// Parts of a run after which photos are searched. A first search after 8 % of a run lost 0.17 dB.
pub(crate) const MOMENTS: [f64; 6] = [0.15, 0.25, 0.35, 0.45, 0.55, 0.65];
/// Photos that a photo is compared with: the nearest.
const NEIGHBORS: usize = 12;
/// Fewer other photos say nothing about a photo.
pub(crate) const LEAST_OTHERS: usize = 3;
/// Passes through the photos before the first search: a scene that has seen its photos less often misses places of each
/// of them, and fine ones look like things.
pub(crate) const LEAST_PASSES: usize = 12;
/// Largest difference of depths, relative, at which two photos are taken to show the same place.
const SAME_DEPTH: f64 = 0.1;
/// Bounds of the mean residual between a thing and its background; where colors are alike all over, it is far below the
/// upper one.
const THING: [f32; 2] = [0.1, 0.3];
/// Mean residuals of a place below this count as this: a fit better than noise says nothing.
const NOISE: f32 = 0.03;
/// Bounds of the evidence of a pixel, so that none speaks for its whole surroundings.
const BOUNDS: [f32; 2] = [-3.0, 4.0];
/// Radius of the window that evidence is averaged over, as a part of the longest side; a single pixel says little.
const RADIUS: f64 = 0.05;
/// Pixels against a thing that each window is given beside its own, as a part of it: where little is known, nothing is
/// hidden.
const PRIOR: f32 = 0.2;
/// Mean evidence above which a hidden region begins ...
const STRONG: f32 = 0.5;
/// ... and above which it goes on to neighbors.
const WEAK: f32 = 0.0;
/// Part of a photo below which a region is no thing.
const LEAST_PART: f64 = 0.004;
/// Part of a photo above which the whole photo misfits, which a mask cannot mend.
const MOST_PART: f64 = 0.5;

/// Pixels of a photo, in cells, whose content no other photo shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Transients {
    /// Number of columns and rows.
    pub size: [usize; 2],
    /// True where a cell is left out, row by row.
    pub hidden: Vec<bool>,
}

impl Transients {
    /// Part of the photo that is left out.
    pub fn part(&self) -> f64 {
        self.hidden.iter().filter(|hidden| **hidden).count() as f64 / self.hidden.len().max(1) as f64
    }

    /// True for each pixel of the photo at this size that is left out.
    pub fn at_size(&self, width: usize, height: usize) -> Vec<bool> {
        let [columns, rows] = self.size;
        let cell = |y: usize, x: usize| self.hidden[(y * rows / height) * columns + x * columns / width];
        (0..height).flat_map(|y| (0..width).map(move |x| (y, x))).map(|(y, x)| cell(y, x)).collect()
    }
}

/// Mask of the pixels of a photo that count: its own mask without transients; `None` if all do.
pub(crate) fn counted<'p>(photo: &'p Photo, transients: Option<&Transients>) -> Option<Cow<'p, [bool]>> {
    let own = photo.mask.as_deref();
    let Some(transients) = transients else { return own.map(Cow::Borrowed) };
    let mut counts = transients.at_size(photo.camera.width, photo.camera.height);
    counts.iter_mut().enumerate().for_each(|(at, hidden)| *hidden = !*hidden && own.is_none_or(|own| own[at]));
    Some(Cow::Owned(counts))
}

/// A photo beside the scene as it is, both small.
pub(crate) struct Seen {
    pub camera: LensCamera,
    /// Mean absolute difference of colors around each pixel; NaN where the photo's own mask is.
    pub residuals: Vec<f32>,
    /// Depth, world units; 0 where nothing is.
    pub depths: Vec<f32>,
    /// True where the photo is left out now, if anywhere: there, it is no evidence.
    pub hidden: Vec<bool>,
}

/// Mean absolute differences over 3 x 3 pixels and the channels.
pub(crate) fn residuals(image: &[f32], photo: &Photo) -> Vec<f32> {
    let Camera { width, height, .. } = photo.camera;
    let counts = |at: usize| photo.mask.as_ref().is_none_or(|mask| mask[at]);
    let at = |at: usize| -> f32 {
        let difference =
            |c: usize| (image[3 * at + c].clamp(0.0, 1.0) - f32::from(photo.rgb[3 * at + c]) / 255.0).abs();
        if counts(at) { (difference(0) + difference(1) + difference(2)) / 3.0 } else { f32::NAN }
    };
    let own: Vec<f32> = (0..width * height).map(at).collect();
    let around = |i: usize, n: usize| i.saturating_sub(1)..(i + 2).min(n);
    let mean = |(y, x): (usize, usize)| {
        let window = around(y, height).flat_map(|y| around(x, width).map(move |x| y * width + x));
        let (sum, n) = window.map(|at| own[at]).filter(|r| !r.is_nan()).fold((0.0, 0.0), |(s, n), r| (s + r, n + 1.0));
        if own[y * width + x].is_nan() { f32::NAN } else { sum / n }
    };
    (0..height).flat_map(|y| (0..width).map(move |x| (y, x))).map(mean).collect()
}

/// Mean residual between a thing and its background: the difference of unrelated colors, taken from another photo
/// upside down.
pub(crate) fn thing_residual(photos: &[Photo]) -> f32 {
    let differences = |i: usize| {
        let (own, other) = (&photos[i], &photos[(i + photos.len() / 2) % photos.len()]);
        let [pixels, others] = [own, other].map(|photo| photo.rgb.len() / 3);
        (0..3 * pixels).map(move |at| {
            let opposite = (pixels - 1 - at / 3) * others / pixels;
            u64::from(own.rgb[at].abs_diff(other.rgb[3 * opposite + at % 3]))
        })
    };
    let (sum, count) = (0..photos.len()).flat_map(differences).fold((0, 0_u64), |(sum, n), d| (sum + d, n + 1));
    (sum as f32 / (255.0 * count.max(1) as f32)).clamp(THING[0], THING[1])
}

/// The cells of a photo that are hidden in it alone, where a thing's residual is this in the mean.
pub(crate) fn hidden(photo: usize, seen: &[Seen], extent: f64, thing: f32) -> Option<Transients> {
    let own = &seen[photo];
    let Camera { pose, width, height, .. } = own.camera.camera;
    let to_world = pose.inverse();
    let others = nearest(photo, seen, extent);
    // The mean residual of the photos that see a place; a place that no other photo sees has none.
    let expected = |(at, residual, depth): (usize, f32, f64)| {
        let pixel = DVec2::new((at % width) as f64 + 0.5, (at / width) as f64 + 0.5);
        let point = to_world.apply(own.camera.point(pixel, depth)?);
        let elsewhere = others.iter().filter_map(|other| seen[*other].residual_of(point));
        let (sum, count) = elsewhere.fold((0.0, 0.0), |(sum, count), residual| (sum + residual, count + 1.0));
        (count > 0.0).then(|| (at, residual, (sum / count).max(NOISE)))
    };
    let expected: Vec<(usize, f32, f32)> = own.known().filter_map(expected).collect();
    // A photo that is met worse than its neighbors all over is judged by its own measure.
    let mut ratios: Vec<f32> = expected.iter().map(|(_, residual, mean)| residual / mean).collect();
    let worse = median_high(&mut ratios).unwrap_or(1.0).max(1.0);
    let mut evidence = vec![None; width * height];
    for (at, residual, mean) in expected {
        // Where photos are met as badly as that, a thing cannot be recognized.
        let mean = (mean * worse).min(thing);
        let ratio = (mean / thing).ln() + residual * (1.0 / mean - 1.0 / thing);
        evidence[at] = Some(ratio.clamp(BOUNDS[0], BOUNDS[1]));
    }
    let found = Transients { size: [width, height], hidden: regions(&averaged(&evidence, width), width) };
    (found.part() > 0.0 && found.part() <= MOST_PART).then_some(found)
}

/// The photos that a photo is compared with.
fn nearest(photo: usize, seen: &[Seen], extent: f64) -> Vec<usize> {
    let pose = seen[photo].camera.camera.pose;
    let distance = |other: usize| {
        let other = seen[other].camera.camera.pose;
        pose.center().distance(other.center()) / extent.max(f64::MIN_POSITIVE) + pose.angle_to(&other)
    };
    let mut others: Vec<usize> = (0..seen.len()).filter(|other| *other != photo).collect();
    others.sort_by(|a, b| distance(*a).total_cmp(&distance(*b)).then(a.cmp(b)));
    others.truncate(NEIGHBORS);
    others
}

/// The mean evidence around each pixel.
fn averaged(evidence: &[Option<f32>], width: usize) -> Vec<f32> {
    let height = evidence.len() / width;
    let radius = (RADIUS * width.max(height) as f64).round() as usize;
    let prior = PRIOR * ((2 * radius + 1) * (2 * radius + 1)) as f32;
    let around = |i: usize, n: usize| i.saturating_sub(radius)..(i + radius + 1).min(n);
    let mean = |at: usize| {
        let window = around(at / width, height).flat_map(|y| around(at % width, width).map(move |x| y * width + x));
        let known = window.filter_map(|at| evidence[at]);
        let (sum, count) = known.fold((-prior, prior), |(sum, count), evidence| (sum + evidence, count + 1.0));
        sum / count
    };
    (0..evidence.len()).map(mean).collect()
}

/// True where a region of evidence for a thing is large enough.
fn regions(evidence: &[f32], width: usize) -> Vec<bool> {
    let (pixels, height) = (evidence.len(), evidence.len() / width);
    let (mut hidden, mut visited) = (vec![false; pixels], vec![false; pixels]);
    for start in 0..pixels {
        if visited[start] || evidence[start] <= STRONG {
            continue;
        }
        visited[start] = true;
        let mut region = vec![start];
        let mut next = 0;
        while let Some(at) = region.get(next).copied() {
            next += 1;
            for neighbor in neighbors(at, width, height) {
                if !visited[neighbor] && evidence[neighbor] > WEAK {
                    visited[neighbor] = true;
                    region.push(neighbor);
                }
            }
        }
        if region.len() as f64 >= LEAST_PART * pixels as f64 {
            region.iter().for_each(|at| hidden[*at] = true);
        }
    }
    hidden
}

/// The pixels beside a pixel, corners included.
fn neighbors(at: usize, width: usize, height: usize) -> impl Iterator<Item = usize> {
    let (y, x) = (at / width, at % width);
    let around = |i: usize, n: usize| i.saturating_sub(1)..(i + 2).min(n);
    around(y, height).flat_map(move |y| around(x, width).map(move |x| y * width + x)).filter(move |n| *n != at)
}

impl Seen {
    /// The pixels that show the scene and count: place, residual and depth.
    fn known(&self) -> impl Iterator<Item = (usize, f32, f64)> {
        let all = self.residuals.iter().zip(&self.depths).enumerate();
        let known = all.filter(|(_, (residual, depth))| !residual.is_nan() && **depth > 0.0);
        known.map(|(at, (residual, depth))| (at, *residual, f64::from(*depth)))
    }

    /// The residual where a point is seen, if it is.
    fn residual_of(&self, point: weaver_geometry::glam::DVec3) -> Option<f32> {
        let Camera { pose, width, height, .. } = self.camera.camera;
        let (pixel, distance) = self.camera.see(pose.apply(point))?;
        let inside = |x: f64, n: usize| (x >= 0.0 && x < n as f64).then_some(x as usize);
        let at = inside(pixel.y, height)? * width + inside(pixel.x, width)?;
        if self.hidden.get(at) == Some(&true) {
            return None;
        }
        let depth = f64::from(self.depths[at]);
        let residual = self.residuals[at];
        ((depth - distance).abs() <= SAME_DEPTH * distance && !residual.is_nan()).then_some(residual)
    }
}
