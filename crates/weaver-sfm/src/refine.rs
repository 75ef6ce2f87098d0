//! Better cameras from nearly right ones.

use crate::bundle::{Bundle, Lens, Observation};
use crate::epipolar::Epipolar;
use crate::features::{Features, Keypoint};
use crate::matching::{Match, matches, matches_along};
use crate::tracks::tracks;
use weaver_geometry::Camera;
use weaver_geometry::glam::{DMat3, DVec2, DVec3};
use weaver_kernels::parallel;

/// Differences, in pixels, beyond which observations count for less and less, one adjustment after the other; what is off
/// by three of them is then left out.
const SCALES: [f64; 4] = [8.0, 4.0, 2.0, 1.0];
const FARTHEST: f64 = 3.0;
/// Steps of an adjustment.
const STEPS: usize = 40;
/// Cosine of the largest angle between the axes of two cameras whose photos are compared.
const ANGLE: f64 = 0.5;
/// How often as wrong as expected cameras may be for a match to be believed.
const BELIEVED: f64 = 3.0;
/// Pixels from the epipolar line at which a match is believed once cameras are adjusted.
const CERTAIN: f64 = 3.0;
/// Standard deviation of where a keypoint is found, pixels.
const PIXEL: f64 = 0.5;
/// Least deviation of keypoints, pixels: smaller ones are no more exact.
const SHARPEST: f64 = 1.0;
/// Least sine of the angle between rays of a point.
const PARALLAX: f64 = 0.005;

/// A photo and its camera, which may be a little wrong.
#[derive(Clone, Debug)]
pub struct View<'a> {
    /// The camera.
    pub camera: Camera,
    /// The photo, gray from 0 to 1, `[height, width]`.
    pub gray: Vec<f32>,
    /// What of it counts, `[height, width]`: 0 where masked.
    pub mask: Option<&'a [u8]>,
    /// Whether the other cameras and the points are found without it: it is located in what they found.
    pub located: bool,
}

impl<'a> View<'a> {
    /// A view of a photo in sRGB, `[height, width, 3]`, whose mean of colors is taken for gray.
    pub fn new(camera: Camera, rgb: &[u8], mask: Option<&'a [u8]>) -> Self {
        let gray = rgb.chunks_exact(3).map(|c| c.iter().map(|c| f32::from(*c)).sum::<f32>() / 765.0).collect();
        Self { camera, gray, mask, located: false }
    }
}

/// How cameras are refined.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RefineSettings {
    /// Whether the focal length is refined, one factor for all.
    pub focal: bool,
    /// Whether a radial distortion is found, one for all.
    pub distortion: bool,
    /// Keypoints of a photo, at most.
    pub keypoints: usize,
    /// Photos that each is compared with, at most: those from nearby.
    pub neighbors: usize,
    /// How wrong cameras are taken to be, independently of one another: degrees, and part of the distance.
    pub expected: [f64; 2],
}

impl Default for RefineSettings {
    fn default() -> Self {
        Self { focal: false, distortion: false, keypoints: 3000, neighbors: 20, expected: [1.0, 0.01] }
    }
}

/// Refined cameras, and what they were refined by.
#[derive(Clone, Debug)]
pub struct Refined {
    /// The cameras, in the order of the views; one that shares too few points with others is as it was.
    pub cameras: Vec<Camera>,
    /// Radial distortion.
    pub k1: f64,
    /// The points that photos agree about.
    pub points: Vec<DVec3>,
    /// Where they were seen.
    pub observations: Vec<Observation>,
    /// Median difference between where points are and were seen, pixels.
    pub error: f64,
    /// Points that each photo sees.
    pub seen: Vec<usize>,
}

/// Matches photos that nearly right cameras say to overlap, and adjusts cameras and points.
///
/// Each given camera counts as a measurement of itself, as wrong as [`RefineSettings::expected`] says: of all scenes
/// that explain the photos, which a similarity at least takes to one another, the nearest to the given cameras is found.
pub fn refine(views: &[View<'_>], settings: &RefineSettings) -> Refined {
    let features: Vec<Features> = views
        .iter()
        .map(|v| Features::new(&v.gray, [v.camera.height, v.camera.width], v.mask, settings.keypoints))
        .collect();
    let near = neighbors(views, settings.neighbors);
    let mut bundle = settings.bundle(views);
    // While cameras are wrong the band along epipolar lines is wide: what is clear in the whole photo is clearer than in it.
    let wide = views.iter().map(|v| BELIEVED * settings.pixels(&v.camera)).fold(0.0, f64::max);
    for (scales, farthest, find) in [
        (&SCALES[..3], wide, (|a, b, _| matches(a, b)) as Find),
        (&SCALES[2..3], 2.0 * CERTAIN, matches_along),
        (&SCALES[2..], CERTAIN, matches_along),
    ] {
        let pairs = paired(&bundle, &features, &near, farthest, find);
        let all = observe(&mut bundle, views, &features, &pairs, farthest);
        bundle.observations = all.iter().filter(|o| !views[o.camera].located).copied().collect();
        for scale in scales {
            bundle.adjust(*scale, STEPS);
            bundle.leave_out(FARTHEST * scale);
        }
        bundle.locate(views, all);
    }
    bundle.prune(FARTHEST * SCALES[SCALES.len() - 1]);
    let mut errors = bundle.errors();
    errors.sort_unstable_by(f64::total_cmp);
    let mut seen = vec![0; views.len()];
    bundle.observations.iter().for_each(|o| seen[o.camera] += 1);
    Refined {
        cameras: (0..views.len()).map(|i| bundle.camera(i)).collect(),
        k1: bundle.lenses[0].k1,
        error: errors.get(errors.len() / 2).copied().unwrap_or(f64::NAN),
        points: bundle.points,
        observations: bundle.observations,
        seen,
    }
}

/// A way to match the keypoints of two photos.
type Find = fn(&Features, &Features, &Epipolar) -> Vec<Match>;

/// Matches of pairs of photos that are no farther than this from their epipolar lines.
fn paired(
    bundle: &Bundle,
    features: &[Features],
    near: &[[usize; 2]],
    farthest: f64,
    find: Find,
) -> Vec<([usize; 2], Vec<Match>)> {
    let mut pairs: Vec<_> = near.iter().map(|pair| (*pair, Vec::new())).collect();
    parallel::for_chunks(&mut pairs, 1, |_, pairs| {
        for ([a, b], found) in pairs {
            let epipolar = Epipolar::new(&bundle.camera(*a), &bundle.camera(*b), farthest);
            let (first, second) = (&features[*a], &features[*b]);
            *found = find(first, second, &epipolar);
            found.retain(|m| epipolar.allows(first.keypoints[m.first].pixel, second.keypoints[m.second].pixel));
        }
    });
    pairs
}

/// Triangulates tracks from the photos that are not located, and returns what all photos see of the points.
fn observe(
    bundle: &mut Bundle,
    views: &[View<'_>],
    features: &[Features],
    pairs: &[([usize; 2], Vec<Match>)],
    farthest: f64,
) -> Vec<Observation> {
    let counts: Vec<usize> = features.iter().map(|f| f.keypoints.len()).collect();
    let mut all = Vec::new();
    bundle.points.clear();
    for track in tracks(&counts, pairs) {
        let seen: Vec<(usize, Keypoint)> = track.iter().map(|(v, k)| (*v, features[*v].keypoints[*k])).collect();
        let known: Vec<(Camera, DVec2)> =
            seen.iter().filter(|(v, _)| !views[*v].located).map(|(v, k)| (bundle.camera(*v), k.pixel)).collect();
        if let Some(position) = agreed(&known, farthest) {
            let point = bundle.points.len();
            // Cameras that are located only now may still be far off.
            let near = |(v, k): &&(usize, Keypoint)| {
                views[*v].located || error(&bundle.camera(*v), position, k.pixel) < farthest
            };
            all.extend(seen.iter().filter(near).map(|(camera, k)| Observation {
                camera: *camera,
                point,
                pixel: k.pixel,
                deviation: k.scale.max(SHARPEST),
            }));
            bundle.points.push(position);
        }
    }
    all
}

/// A point moved with the cameras that see it: the mean of where each takes it, at the same pixel and depth.
///
/// What was found with cameras that were wrong is thereby nearly right for those that were refined.
///
/// # Panics
/// When the numbers of cameras differ.
pub fn carried(point: DVec3, before: &[Camera], after: &[Camera]) -> DVec3 {
    assert_eq!(before.len(), after.len(), "as many cameras before as after");
    let (mut sum, mut count) = (DVec3::ZERO, 0.0);
    for (a, b) in before.iter().zip(after) {
        let p = a.pose.apply(point);
        let at = a.intrinsics.project(p);
        let inside = at.x >= 0.0 && at.y >= 0.0 && at.x < a.width as f64 && at.y < a.height as f64;
        if p.z > 0.0 && inside {
            sum += b.pose.inverse().apply(b.intrinsics.unproject(at, p.z));
            count += 1.0;
        }
    }
    if count > 0.0 { sum / count } else { point }
}

impl RefineSettings {
    /// How far a camera as wrong as expected moves the picture, pixels.
    fn pixels(&self, camera: &Camera) -> f64 {
        let [degrees, part] = self.expected;
        camera.intrinsics.fx * (degrees.to_radians() + part) + 1.0
    }

    fn bundle(&self, views: &[View<'_>]) -> Bundle {
        let [degrees, part] = self.expected;
        // The variances are those of three numbers together.
        let weight = |deviation: f64| 3.0 * (PIXEL / deviation).powi(2);
        let expected = |(view, depth): (&View<'_>, &f64)| {
            let (turn, shift) = (weight(degrees.to_radians()), weight(part * depth));
            (view.camera.pose, [shift, shift, shift, turn, turn, turn])
        };
        Bundle {
            cameras: views.iter().map(|v| v.camera).collect(),
            lenses: vec![Lens { free_focal: self.focal, free_k1: self.distortion, ..Lens::default() }],
            lens_of: vec![0; views.len()],
            expected: views.iter().zip(&distances(views)).map(expected).collect(),
            fixed: views.iter().map(|v| v.located).collect(),
            ..Bundle::default()
        }
    }
}

impl Bundle {
    /// Moves the cameras of the views that are only located to where they see points that stay.
    fn locate(&mut self, views: &[View<'_>], all: Vec<Observation>) {
        if !views.iter().any(|v| v.located) {
            return;
        }
        let mut seen = vec![0; self.points.len()];
        self.observations.iter().for_each(|o| seen[o.point] += 1);
        let mut locating = Self {
            fixed: views.iter().map(|v| !v.located).collect(),
            fixed_points: true,
            observations: all.into_iter().filter(|o| views[o.camera].located && seen[o.point] > 1).collect(),
            ..self.clone()
        };
        locating.lenses.iter_mut().for_each(|lens| (lens.free_focal, lens.free_k1) = (false, false));
        SCALES.iter().for_each(|scale| _ = locating.adjust(*scale, STEPS));
        self.cameras = locating.cameras;
    }
}

/// How far what each camera looks at is away: the point nearest to all axes or, where they are nearly parallel, some times
/// the distance between cameras.
fn distances(views: &[View<'_>]) -> Vec<f64> {
    let (mut matrix, mut sum) = (DMat3::ZERO, DVec3::ZERO);
    let centers: Vec<DVec3> = views.iter().map(|v| v.camera.pose.center()).collect();
    for (view, center) in views.iter().zip(&centers) {
        let axis = view.camera.pose.rotation.row(2);
        let across = DMat3::IDENTITY - DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
        matrix += across;
        sum += across * *center;
    }
    let n = views.len().max(1) as f64;
    let middle = centers.iter().sum::<DVec3>() / n;
    let spread = centers.iter().map(|c| c.distance(middle)).sum::<f64>() / n;
    // Where all stand in one place, nothing is known of distances: any unit will do.
    let spread = if spread > 0.0 { spread } else { 1.0 };
    let point = matrix.inverse() * sum;
    let depth = |view: &View<'_>| {
        let z = view.camera.pose.apply(point).z;
        if z.is_finite() && z > spread { z.min(20.0 * spread) } else { 4.0 * spread }
    };
    views.iter().map(depth).collect()
}

/// Pairs of views that look in similar directions, each with the nearest others.
fn neighbors(views: &[View<'_>], most: usize) -> Vec<[usize; 2]> {
    let centers: Vec<DVec3> = views.iter().map(|v| v.camera.pose.center()).collect();
    let axis = |i: usize| views[i].camera.pose.rotation.row(2);
    let mut pairs = Vec::new();
    for i in 0..views.len() {
        let mut near: Vec<usize> = (0..views.len()).filter(|j| *j != i && axis(i).dot(axis(*j)) > ANGLE).collect();
        let far = |j: &usize| centers[i].distance(centers[*j]);
        near.sort_by(|a, b| far(a).total_cmp(&far(b)));
        // The nearest half, and of the others some all over: long links hold the shape.
        let close = near.len().min(most.div_ceil(2));
        let (rest, more) = (near.len() - close, (most - close).min(near.len() - close));
        let chosen = (0..close).chain((0..more).map(|k| close + k * rest / more.max(1)));
        pairs.extend(chosen.map(|k| [i.min(near[k]), i.max(near[k])]));
    }
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

/// The point that most observations of a track agree about, to so many pixels; at least two must.
fn agreed(seen: &[(Camera, DVec2)], farthest: f64) -> Option<DVec3> {
    const TRIED: usize = 6;
    let near = |point: DVec3| -> Vec<(Camera, DVec2)> {
        seen.iter().filter(|(camera, pixel)| error(camera, point, *pixel) < farthest).copied().collect()
    };
    let tried = seen.len().min(TRIED);
    let pairs = (0..tried).flat_map(|i| (0..i).map(move |j| [i, j]));
    let candidates = pairs.filter_map(|pair| triangulated(&pair.map(|i| seen[i]))).chain(triangulated(seen));
    let best = candidates.map(near).max_by_key(Vec::len)?;
    triangulated(&best)
}

/// How far from a pixel a camera sees a point.
fn error(camera: &Camera, point: DVec3, pixel: DVec2) -> f64 {
    let p = camera.pose.apply(point);
    if p.z > 0.0 { camera.intrinsics.project(p).distance(pixel) } else { f64::INFINITY }
}

/// The point nearest to all rays; `None` behind a camera, or where rays are nearly parallel.
pub(crate) fn triangulated(seen: &[(Camera, DVec2)]) -> Option<DVec3> {
    let (mut matrix, mut sum) = (DMat3::ZERO, DVec3::ZERO);
    let rays: Vec<(DVec3, DVec3)> = seen
        .iter()
        .map(|(camera, pixel)| {
            let ray = camera.pose.rotation.transpose() * camera.intrinsics.unproject(*pixel, 1.0);
            (camera.pose.center(), ray.normalize())
        })
        .collect();
    for (center, ray) in &rays {
        let across = DMat3::IDENTITY - DMat3::from_cols(*ray * ray.x, *ray * ray.y, *ray * ray.z);
        matrix += across;
        sum += across * *center;
    }
    let widest = rays.iter().map(|(_, ray)| ray.cross(rays[0].1).length()).fold(0.0, f64::max);
    let point = matrix.inverse() * sum;
    let before = seen.iter().all(|(camera, _)| camera.pose.apply(point).z > 0.0);
    (seen.len() > 1 && widest > PARALLAX && before && point.is_finite()).then_some(point)
}
