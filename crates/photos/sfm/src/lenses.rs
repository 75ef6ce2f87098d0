//! The lenses that photos were taken with, and their focal lengths before any matching.

use crate::bundle::{Bundle, Lens, Mounted};
use crate::photo::{EstimateOptions, Photo};
use weaver_geometry::glam::DMat3;
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_kernels::order::median_high;

/// Facts about how a photo was taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Taken {
    /// Height and width, pixels.
    pub size: [usize; 2],
    /// As in [`Photo`].
    pub focal: Option<f64>,
    pub lens: usize,
    /// Its place in a rig, by the numbers of all photos that are looked at together.
    pub mounted: Option<Mounted>,
}

impl Taken {
    pub fn of(photo: &Photo<'_>) -> Self {
        Self { size: photo.size, focal: photo.focal, lens: photo.lens, mounted: photo.mounted }
    }

    /// Its camera with a focal length, pixels, without a pose.
    fn camera(&self, focal: f64) -> Camera {
        let [height, width] = self.size;
        let [cx, cy] = [width as f64 / 2.0, height as f64 / 2.0];
        let intrinsics = Intrinsics { fx: focal, fy: focal, cx, cy };
        Camera { pose: Pose::IDENTITY, intrinsics, width, height }
    }

    /// The longer side, pixels.
    pub fn longer(&self) -> f64 {
        self.size[0].max(self.size[1]) as f64
    }
}

/// Expected focal length without any other information, over the longer side, and the standard deviation of its
/// logarithm.
pub(crate) const USUAL: f64 = 0.9;
const UNKNOWN: f64 = 0.4;
/// Standard deviation of a keypoint's position, pixels.
pub(crate) const PIXEL: f64 = 0.5;
/// Ratios of sensors' sides, from phones to cameras. Other proportions are crops.
const SENSOR: [f64; 2] = [4.0 / 3.0, 1.5];

/// Exactness of keypoints, in pixels of the largest photo.
pub(crate) fn tau(photos: &[Taken]) -> f64 {
    photos.iter().map(|p| p.size[1] as f64 / 384.0).fold(0.5, f64::max)
}

/// The lenses of photos, numbered without gaps.
struct Lenses {
    /// The lens of each photo.
    of: Vec<usize>,
    /// For each lens, the part of the sensor's longer side that its photos are expected to show, as for the largest
    /// crop of their proportions. Proportions are all that is left of a crop once a photo is resized.
    shown: Vec<f64>,
    /// The lens that most photos have.
    common: usize,
}

impl Lenses {
    fn new(photos: &[Taken]) -> Self {
        let mut numbers: Vec<usize> = photos.iter().map(|p| p.lens).collect();
        numbers.sort_unstable();
        numbers.dedup();
        let of: Vec<usize> = photos.iter().map(|p| numbers.partition_point(|n| *n < p.lens)).collect();
        let mut counts = vec![0; numbers.len()];
        let mut proportions = vec![1.0; numbers.len()];
        for (photo, lens) in photos.iter().zip(&of).rev() {
            counts[*lens] += 1;
            proportions[*lens] = photo.longer() / photo.size[0].min(photo.size[1]) as f64;
        }
        let common = (0..counts.len()).rev().max_by_key(|lens| counts[*lens]).unwrap_or(0);
        let sensor = proportions.get(common).map_or(SENSOR[0], |p| p.clamp(SENSOR[0], SENSOR[1]));
        let shown = proportions.iter().map(|p| p.min(sensor) / sensor).collect();
        Self { of, shown, common }
    }

    /// Ratio of one lens's focal length to another's, over the longer sides of their photos.
    fn ratio(&self, of: usize, to: usize) -> f64 {
        self.shown[to] / self.shown[of]
    }
}

fn median(of: impl Iterator<Item = f64>) -> Option<f64> {
    median_high(&mut of.collect::<Vec<_>>())
}

impl EstimateOptions {
    /// Cameras without poses. A photo without a focal length takes the median of its lens's others. If these have none
    /// either, it takes the median of all photos or, if none has one, this factor of the longer side; the part of the
    /// sensor that it shows is taken into account.
    pub(crate) fn bundle(&self, photos: &[Taken], factor: f64) -> Bundle {
        let lenses = Lenses::new(photos);
        let each = || photos.iter().zip(&lenses.of);
        let told_by = |lens: usize| {
            median(each().filter(|(_, of)| **of == lens).filter_map(|(p, _)| Some(p.focal? / p.longer())))
        };
        let told_by_others = |lens: usize| {
            let other = |(p, of): (&Taken, &usize)| Some(p.focal? / p.longer() * lenses.ratio(lens, *of));
            median(each().filter(|(photo, _)| photo.mounted.is_none()).filter_map(other))
        };
        let calibrated = |lens: usize| each().any(|(photo, of)| *of == lens && photo.mounted.is_some());
        let known = |lens: usize| {
            let of = |focal: f64, expected: f64, deviation: f64| {
                let free_focal = deviation > 0.0;
                let weight = if free_focal { (PIXEL / deviation).powi(2) } else { 0.0 };
                (focal, Lens { expected, weight, free_focal, ..Lens::default() })
            };
            if let Some(told) = told_by(lens) {
                of(told, 0.0, if calibrated(lens) { 0.0 } else { self.focal_deviation })
            } else if let Some(told) = told_by_others(lens) {
                of(told, 0.0, UNKNOWN)
            } else {
                of(factor * lenses.ratio(lens, lenses.common), (USUAL / factor).ln(), UNKNOWN)
            }
        };
        let (focal, known): (Vec<f64>, Vec<Lens>) = (0..lenses.shown.len()).map(known).unzip();
        let camera =
            |(photo, lens): (&Taken, &usize)| photo.camera(photo.focal.unwrap_or(focal[*lens] * photo.longer()));
        Bundle {
            cameras: each().map(camera).collect(),
            lenses: known,
            fixed: vec![false; photos.len()],
            lens_of: lenses.of,
            rig: rig(photos),
            ..Bundle::default()
        }
    }
}

/// True for two photos of one rig: they were taken in one place, so that matches between them tell no depth.
pub(crate) fn is_one_rig(photos: &[Taken], pair: &[usize; 2]) -> bool {
    let [a, b] = pair.map(|photo| photos[photo].mounted.map(|mounted| mounted.on));
    a.is_some() && a == b
}

/// The place of each photo in a rig; empty if all stand alone.
fn rig(photos: &[Taken]) -> Vec<Mounted> {
    let alone = |on: usize| Mounted { on, rotation: DMat3::IDENTITY };
    let mounted = photos.iter().enumerate().map(|(i, photo)| photo.mounted.unwrap_or(alone(i)));
    if photos.iter().any(|photo| photo.mounted.is_some()) { mounted.collect() } else { Vec::new() }
}

impl Bundle {
    /// The cameras of `photos`; this bundle holds the cameras with these numbers, ascending. The others share the lens
    /// of one of these if it is the same, with their given focal length; else they have one of their own, with their
    /// given focal length or the median of these.
    pub(crate) fn among(self, numbers: &[usize], photos: &[Taken]) -> Self {
        let lenses = Lenses::new(photos);
        let of_longer = |i: usize| self.camera(i).intrinsics.fx / photos[numbers[i]].longer();
        let mut all = Self { lenses: self.lenses.clone(), ..Self::default() };
        for (photo, taken) in photos.iter().enumerate() {
            if let Ok(i) = numbers.binary_search(&photo) {
                all.cameras.push(self.cameras[i]);
                all.lens_of.push(self.lens_of[i]);
                continue;
            }
            let same = (0..numbers.len()).find(|i| lenses.of[numbers[*i]] == lenses.of[photo]);
            let as_these = |i: usize| of_longer(i) * lenses.ratio(lenses.of[photo], lenses.of[numbers[i]]);
            let focal = taken.focal.or_else(|| {
                let factor = same.map_or(1.0, |i| self.lenses[self.lens_of[i]].log_focal.exp());
                let mut those: Vec<f64> = match same {
                    Some(i) => vec![of_longer(i) / factor],
                    None => (0..numbers.len()).map(as_these).collect(),
                };
                Some(median_high(&mut those)? * taken.longer())
            });
            all.cameras.push(taken.camera(focal.unwrap_or(USUAL * taken.longer())));
            all.lens_of.push(same.map_or(all.lenses.len(), |i| self.lens_of[i]));
            if same.is_none() {
                all.lenses.push(Lens::default());
            }
        }
        all.fixed = vec![false; photos.len()];
        all.rig = rig(photos);
        all.observations = self.observations;
        all.observations.iter_mut().for_each(|o| o.camera = numbers[o.camera]);
        all.points = self.points;
        all
    }

    /// True for lenses of photos with a place.
    fn in_use(&self, placed: &[bool]) -> Vec<bool> {
        let mut used = vec![false; self.lenses.len()];
        self.lens_of.iter().zip(placed).for_each(|(lens, placed)| used[*lens] |= placed);
        used
    }

    /// Frees the focal lengths of lenses that are `free` and in use. Others are not adjusted, as they have no
    /// observations: `free` ones follow the lenses in use.
    pub(crate) fn free_focal(&mut self, free: &[bool], placed: &[bool]) {
        let of_placed = self.lens_of.iter().zip(placed).filter(|(_, placed)| **placed);
        let middle = median(of_placed.map(|(lens, _)| self.lenses[*lens].log_focal)).unwrap_or(0.0);
        let used = self.in_use(placed);
        for ((lens, free), used) in self.lenses.iter_mut().zip(free).zip(used) {
            lens.free_focal = *free && used;
            if *free && !used {
                lens.log_focal = middle;
            }
        }
    }
}
