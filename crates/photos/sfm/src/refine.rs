//! Better cameras from nearly right ones.

use crate::bundle::{Bundle, Lens, Observation};
use crate::features::{Features, gray};
use crate::passes::{Pass, compared, neighbors, sharpest};
use weaver_geometry::Camera;
use weaver_geometry::glam::{DMat3, DVec3};

/// Factor on cameras' expected errors up to which a match counts.
const BELIEVED: f64 = 3.0;
/// Standard deviation of a keypoint's position, pixels, beside the cameras' deviations: twice the deviation of a single
/// keypoint, as neighbors err alike.
const PIXEL: f64 = 1.0;

/// A photo and its camera, which may be a little wrong.
#[derive(Clone, Debug)]
pub struct View<'a> {
    /// The camera.
    pub camera: Camera,
    /// The photo, gray from 0 to 1, `[height, width]`.
    pub gray: Vec<f32>,
    /// Mask of the pixels that count, `[height, width]`; `None` if all do.
    pub mask: Option<&'a [bool]>,
    /// True if the other cameras and the points are found without it: it is then located in their scene.
    pub located: bool,
}

impl<'a> View<'a> {
    /// A view of a photo in sRGB, `[height, width, 3]`, whose mean of colors is taken for gray.
    pub fn new(camera: Camera, rgb: &[u8], mask: Option<&'a [bool]>) -> Self {
        Self { camera, gray: gray(rgb), mask, located: false }
    }
}

/// Settings of refining cameras.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RefineSettings {
    /// True if the focal length is refined, one factor for all.
    pub focal: bool,
    /// True if a radial distortion is found, one for all.
    pub distortion: bool,
    /// Keypoints of a photo, at most.
    pub keypoints: usize,
    /// Photos that each is compared with, at most: nearby ones.
    pub neighbors: usize,
    /// Expected errors of cameras, independent of one another: degrees, and part of the distance.
    pub expected: [f64; 2],
}

impl Default for RefineSettings {
    fn default() -> Self {
        Self { focal: false, distortion: false, keypoints: 3000, neighbors: 20, expected: [1.0, 0.01] }
    }
}

/// Refined cameras, and the evidence behind them.
#[derive(Clone, Debug)]
pub struct Refined {
    /// The cameras, in the order of the views; a camera that shares too few points with others stays.
    pub cameras: Vec<Camera>,
    /// Radial distortion.
    pub k1: f64,
    /// The points that photos agree about.
    pub points: Vec<DVec3>,
    /// Their observations.
    pub observations: Vec<Observation>,
    /// Median residual, pixels.
    pub error: f64,
    /// Points that each photo sees.
    pub seen: Vec<usize>,
}

/// Matches photos that overlap by nearly right cameras, and adjusts cameras and points.
///
/// Each given camera counts as a measurement with the errors of [`RefineSettings::expected`]: of all scenes that
/// explain the photos, equal up to a similarity at least, the one nearest to the given cameras is found.
pub fn refine(views: &[View<'_>], settings: &RefineSettings) -> Refined {
    let features: Vec<Features> = views
        .iter()
        .map(|v| Features::new(&v.gray, [v.camera.height, v.camera.width], v.mask, settings.keypoints))
        .collect();
    let cameras: Vec<Camera> = views.iter().map(|v| v.camera).collect();
    let located: Vec<bool> = views.iter().map(|v| v.located).collect();
    let near = neighbors(&cameras, settings.neighbors);
    let mut bundle = settings.bundle(views);
    let wide = views.iter().map(|v| BELIEVED * settings.pixels(&v.camera) / sharpest(&v.camera)).fold(0.0, f64::max);
    for pass in std::iter::once(Pass::wide(wide)).chain(Pass::FINE) {
        bundle.pass(&features, compared(&near), &located, &pass);
    }
    bundle.finish();
    Refined {
        cameras: (0..views.len()).map(|i| bundle.camera(i)).collect(),
        k1: bundle.lenses[0].k1,
        error: bundle.median_error(),
        seen: bundle.seen(),
        points: bundle.points,
        observations: bundle.observations,
    }
}

/// A point moved with the cameras that see it: the mean of the points at the same pixel and depth in each moved camera.
///
/// A point that was found with wrong cameras is then nearly right for the refined ones.
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
    /// Movement of the picture by the expected error of a camera, pixels.
    fn pixels(&self, camera: &Camera) -> f64 {
        let [degrees, part] = self.expected;
        camera.intrinsics.fx * (degrees.to_radians() + part) + 1.0
    }

    fn bundle(&self, views: &[View<'_>]) -> Bundle {
        let [degrees, part] = self.expected;
        let expected = |(view, depth): (&View<'_>, &f64)| {
            // Beside observations, whose differences are divided by deviations; each variance is the sum over three
            // numbers.
            let pixel = PIXEL / sharpest(&view.camera);
            let weight = |deviation: f64| 3.0 * (pixel / deviation).powi(2);
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

/// Distance of each camera's subject: the point nearest to all axes or, where they are nearly parallel, some times the
/// distance between cameras.
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
    // If all stand in one place, distances are undetermined: any unit will do.
    let spread = if spread > 0.0 { spread } else { 1.0 };
    let point = matrix.inverse() * sum;
    let depth = |view: &View<'_>| {
        let z = view.camera.pose.apply(point).z;
        if z.is_finite() && z > spread { z.min(20.0 * spread) } else { 4.0 * spread }
    };
    views.iter().map(depth).collect()
}
