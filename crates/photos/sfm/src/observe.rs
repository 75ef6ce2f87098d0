//! Points of tracks, and their observations.

use crate::bundle::{Bundle, Lens, Observation};
use crate::features::{Features, Keypoint};
use crate::passes::sharpest;
use crate::tracks::Track;
use crate::triangulation::{agreed, error};
use weaver_geometry::Camera;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_kernels::parallel;

/// Tracks of a task.
const GRAIN: usize = 64;

/// Cameras that observe points.
pub(crate) struct Observers<'a> {
    features: &'a [Features],
    /// With their focal lengths, and as given.
    cameras: Vec<Camera>,
    told: &'a [Camera],
    lenses: Vec<Lens>,
    sharpest: Vec<f64>,
    /// True for photos that find no points.
    located: &'a [bool],
    /// Largest error of a point's observation, pixels.
    farthest: f64,
}

impl<'a> Observers<'a> {
    /// The cameras of a bundle; `farthest` is in deviations of the keypoints of the largest photo.
    pub fn new(bundle: &'a Bundle, features: &'a [Features], located: &'a [bool], farthest: f64) -> Self {
        let cameras: Vec<Camera> = (0..bundle.cameras.len()).map(|i| bundle.camera(i)).collect();
        let sharpest: Vec<f64> = cameras.iter().map(sharpest).collect();
        let farthest = farthest * sharpest.iter().copied().fold(0.0, f64::max);
        let lenses = bundle.lens_of.iter().map(|lens| bundle.lenses[*lens]).collect();
        Self { features, cameras, told: &bundle.cameras, lenses, sharpest, located, farthest }
    }

    fn keypoint(&self, (photo, number): (usize, usize)) -> Keypoint {
        self.features[photo].keypoints[number]
    }

    /// The pixel of a keypoint in a camera without distortion.
    fn undistorted(&self, photo: usize, pixel: DVec2) -> DVec2 {
        self.lenses[photo].undistort(&self.told[photo], pixel)
    }

    /// The point of each track that agrees with the most photos, located ones left out.
    pub fn points<T: AsRef<[(usize, usize)]> + Sync>(&self, tracks: &[T]) -> Vec<Option<DVec3>> {
        let mut points: Vec<Option<DVec3>> = vec![None; tracks.len()];
        parallel::for_chunks(&mut points, GRAIN, |chunk, points| {
            for (point, track) in points.iter_mut().zip(&tracks[chunk * GRAIN..]) {
                let known = track.as_ref().iter().filter(|(photo, _)| !self.located[*photo]);
                let sight = |seen: &(usize, usize)| {
                    (self.cameras[seen.0], self.undistorted(seen.0, self.keypoint(*seen).pixel))
                };
                let known: Vec<(Camera, DVec2)> = known.map(sight).collect();
                *point = agreed(&known, self.farthest);
            }
        });
        points
    }

    /// The observations of the point of a track, which gets the number `point`. Cameras that are located only now may
    /// still be far off.
    pub fn observations(&self, track: &Track, position: DVec3, point: usize) -> impl Iterator<Item = Observation> {
        let near = move |(photo, k): &(usize, Keypoint)| {
            self.located[*photo]
                || error(&self.cameras[*photo], position, self.undistorted(*photo, k.pixel)) < self.farthest
        };
        let observation = move |(camera, k): (usize, Keypoint)| Observation {
            camera,
            point,
            pixel: k.pixel,
            deviation: k.scale.max(self.sharpest[camera]),
        };
        track.iter().map(|seen| (seen.0, self.keypoint(*seen))).filter(near).map(observation)
    }
}

impl Bundle {
    /// Triangulates tracks from the photos that are not located, and returns the observations of the points in all
    /// photos.
    pub(crate) fn observe(
        &mut self,
        features: &[Features],
        tracks: &[Track],
        located: &[bool],
        farthest: f64,
    ) -> Vec<Observation> {
        let observers = Observers::new(self, features, located, farthest);
        let (mut points, mut all) = (Vec::new(), Vec::new());
        for (track, position) in tracks.iter().zip(observers.points(tracks)) {
            if let Some(position) = position {
                all.extend(observers.observations(track, position, points.len()));
                points.push(position);
            }
        }
        self.points = points;
        all
    }
}
