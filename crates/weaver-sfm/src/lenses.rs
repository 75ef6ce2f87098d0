//! The lenses that photos were taken with, and how long their focal lengths are before anything is seen.

use crate::bundle::{Bundle, Lens};
use crate::photo::{EstimateSettings, Photo};
use weaver_geometry::{Camera, Intrinsics, Pose};

/// What is expected where nothing is known, over the longer side, and the standard deviation of its logarithm.
pub(crate) const USUAL: f64 = 0.9;
const UNKNOWN: f64 = 0.4;
/// Standard deviation of where a keypoint is found, pixels.
pub(crate) const PIXEL: f64 = 0.5;
/// How long sensors are over their other side: from those of phones to those of cameras. Other proportions are crops.
const SENSOR: [f64; 2] = [4.0 / 3.0, 1.5];

/// Which lens took which photo, numbered without gaps.
struct Lenses {
    /// The lens of each photo.
    of: Vec<usize>,
    /// Of each lens, what part of the sensor's longer side its photos are expected to show: the largest crops of their
    /// proportions do. Proportions are all that is left of a crop once a photo is resized.
    shown: Vec<f64>,
    /// The lens that most photos have.
    common: usize,
}

impl Lenses {
    fn new(photos: &[Photo<'_>]) -> Self {
        let mut numbers: Vec<usize> = photos.iter().map(|p| p.lens).collect();
        numbers.sort_unstable();
        numbers.dedup();
        let of: Vec<usize> = photos.iter().map(|p| numbers.partition_point(|n| *n < p.lens)).collect();
        let mut counts = vec![0; numbers.len()];
        let mut proportions = vec![1.0; numbers.len()];
        for (photo, lens) in photos.iter().zip(&of).rev() {
            counts[*lens] += 1;
            proportions[*lens] = longer(photo) / photo.size[0].min(photo.size[1]) as f64;
        }
        let common = (0..counts.len()).rev().max_by_key(|lens| counts[*lens]).unwrap_or(0);
        let sensor = proportions.get(common).map_or(SENSOR[0], |p| p.clamp(SENSOR[0], SENSOR[1]));
        let shown = proportions.iter().map(|p| p.min(sensor) / sensor).collect();
        Self { of, shown, common }
    }

    /// How many times as long one lens's focal length is as another's, over the longer sides of their photos.
    fn ratio(&self, of: usize, to: usize) -> f64 {
        self.shown[to] / self.shown[of]
    }
}

fn longer(photo: &Photo<'_>) -> f64 {
    photo.size[0].max(photo.size[1]) as f64
}

fn median(mut of: Vec<f64>) -> Option<f64> {
    of.sort_by(f64::total_cmp);
    of.get(of.len() / 2).copied()
}

impl EstimateSettings {
    /// Cameras without poses. A photo that does not tell its focal length has that of the others of its lens. Where these do
    /// not either, it has that of all others or, where none does, this factor of the longer side; what of the sensor it shows
    /// is taken into account.
    pub(crate) fn bundle(&self, photos: &[Photo<'_>], factor: f64) -> Bundle {
        let lenses = Lenses::new(photos);
        let each = || photos.iter().zip(&lenses.of);
        let told_by = |lens: usize| {
            median(each().filter(|(_, of)| **of == lens).filter_map(|(p, _)| Some(p.focal? / longer(p))).collect())
        };
        let told_by_others = |lens: usize| {
            let other = |(p, of): (&Photo<'_>, &usize)| Some(p.focal? / longer(p) * lenses.ratio(lens, *of));
            median(each().filter_map(other).collect())
        };
        let known = |lens: usize| {
            let of = |focal: f64, expected: f64, deviation: f64| {
                let free_focal = deviation > 0.0;
                let weight = if free_focal { (PIXEL / deviation).powi(2) } else { 0.0 };
                (focal, Lens { expected, weight, free_focal, ..Lens::default() })
            };
            if let Some(told) = told_by(lens) {
                of(told, 0.0, self.focal_deviation)
            } else if let Some(told) = told_by_others(lens) {
                of(told, 0.0, UNKNOWN)
            } else {
                of(factor * lenses.ratio(lens, lenses.common), (USUAL / factor).ln(), UNKNOWN)
            }
        };
        let (focal, known): (Vec<f64>, Vec<Lens>) = (0..lenses.shown.len()).map(known).unzip();
        let camera = |(photo, lens): (&Photo<'_>, &usize)| {
            let [height, width] = photo.size;
            let focal = photo.focal.unwrap_or(focal[*lens] * longer(photo));
            let [cx, cy] = [width as f64 / 2.0, height as f64 / 2.0];
            let intrinsics = Intrinsics { fx: focal, fy: focal, cx, cy };
            Camera { pose: Pose::IDENTITY, intrinsics, width, height }
        };
        Bundle {
            cameras: each().map(camera).collect(),
            lenses: known,
            fixed: vec![false; photos.len()],
            lens_of: lenses.of,
            ..Bundle::default()
        }
    }
}

impl Bundle {
    /// Of each lens, whether a photo with a place has it.
    fn in_use(&self, placed: &[bool]) -> Vec<bool> {
        let mut used = vec![false; self.lenses.len()];
        self.lens_of.iter().zip(placed).for_each(|(lens, placed)| used[*lens] |= placed);
        used
    }

    /// Frees the focal lengths of lenses that are `free` and in use. The others' are not adjusted, as nothing is seen through
    /// them: those that are free follow the lenses in use.
    pub(crate) fn free_focal(&mut self, free: &[bool], placed: &[bool]) {
        let of_placed = self.lens_of.iter().zip(placed).filter(|(_, placed)| **placed);
        let middle = median(of_placed.map(|(lens, _)| self.lenses[*lens].log_focal).collect()).unwrap_or(0.0);
        let used = self.in_use(placed);
        for ((lens, free), used) in self.lenses.iter_mut().zip(free).zip(used) {
            lens.free_focal = *free && used;
            if *free && !used {
                lens.log_focal = middle;
            }
        }
    }
}
