//! How exact estimated cameras are expected to be.

use crate::bundle::{Bundle, Covariance};
use crate::lenses::PIXEL;
use crate::photo::Find;
use weaver_geometry::glam::DVec3;

/// Standard deviation of a distortion that is expected before anything is seen.
const BENT: f64 = 0.2;
/// A distortion is told that is so many of its standard deviations from 0, and moves a corner by so many pixels.
const TOLD: f64 = 4.0;
const MOVED: f64 = 0.3;
/// Photos from which on two coefficients of it are looked for.
const MANY: usize = 20;
/// Steps of an adjustment.
const STEPS: usize = 20;

/// How exact cameras are expected to be: standard deviations from the normal equations of the adjustment, with the noise that its
/// residuals show. Where the world's place, turn and scale are is left open.
///
/// Systematic errors, such as matches that are wrong alike, are not in it.
#[derive(Clone, Debug, PartialEq)]
pub struct Uncertainty {
    /// Of focal lengths, as a part of them: the lens that is told least; 0 where all were given.
    pub focal: f64,
    /// Of rotations, radians, by photo; 0 without a camera.
    pub rotations: Vec<f64>,
    /// Of centers, world units, by photo; 0 without a camera.
    pub centers: Vec<f64>,
    /// The root of the mean square distance of centers from their middle, world units.
    pub spread: f64,
}

impl Uncertainty {
    /// That of the cameras that have a place.
    pub(crate) fn of(bundle: &Bundle, placed: &[bool]) -> Option<Self> {
        let Covariance { focal, rotation, center, .. } = bundle.of_placed(placed).covariance(1.0)?;
        let spread = spread(bundle, placed);
        let spread_out = |of: Vec<f64>| {
            let mut of = of.into_iter();
            placed.iter().map(|placed| placed.then(|| of.next()).flatten().unwrap_or(0.0)).collect()
        };
        let focal = focal.into_iter().fold(0.0, f64::max);
        Some(Self { focal, rotations: spread_out(rotation), centers: spread_out(center), spread })
    }

    /// The same, where the photos have these numbers of so many.
    pub(crate) fn renumbered(self, numbers: &[usize], count: usize) -> Self {
        let spread_out = |of: Vec<f64>| {
            let mut all = vec![0.0; count];
            numbers.iter().zip(of).for_each(|(number, value)| all[*number] = value);
            all
        };
        Self { rotations: spread_out(self.rotations), centers: spread_out(self.centers), ..self }
    }

    /// In units of a world that is so many times as large.
    pub(crate) fn scale(&mut self, by: f64) {
        self.spread *= by;
        self.centers.iter_mut().for_each(|c| *c *= by);
    }

    /// The largest of rotations, radians, and of centers over their spread.
    pub fn most(&self) -> [f64; 2] {
        let most = |of: &[f64]| of.iter().copied().fold(0.0, f64::max);
        [most(&self.rotations), most(&self.centers) / self.spread]
    }
}

/// The root of the mean square distance of centers from their middle.
fn spread(bundle: &Bundle, placed: &[bool]) -> f64 {
    let placed = bundle.cameras.iter().zip(placed).filter(|(_, placed)| **placed);
    let centers: Vec<DVec3> = placed.map(|(camera, _)| camera.pose.center()).collect();
    let n = centers.len().max(1) as f64;
    let middle = centers.iter().sum::<DVec3>() / n;
    (centers.iter().map(|c| c.distance_squared(middle)).sum::<f64>() / n).sqrt()
}

impl Bundle {
    /// The same with the cameras that have a place, and no others.
    fn of_placed(&self, placed: &[bool]) -> Self {
        let kept: Vec<usize> = (0..placed.len()).filter(|i| placed[*i]).collect();
        let observations = self.observations.iter().filter(|o| placed[o.camera]).map(|o| {
            let camera = kept.partition_point(|i| *i < o.camera);
            crate::bundle::Observation { camera, ..*o }
        });
        let used = |lens: usize| kept.iter().any(|i| self.lens_of[*i] == lens);
        let lens = |i: usize| if used(i) { self.lenses[i] } else { self.lenses[i].held() };
        Self {
            cameras: kept.iter().map(|i| self.cameras[*i]).collect(),
            lenses: (0..self.lenses.len()).map(lens).collect(),
            lens_of: kept.iter().map(|i| self.lens_of[*i]).collect(),
            fixed: vec![false; kept.len()],
            points: self.points.clone(),
            observations: observations.collect(),
            ..Self::default()
        }
    }

    /// Frees the distortion of lenses as far as it is asked for and told, and adjusts it.
    pub(crate) fn free_distortion(&mut self, find: Find, placed: &[bool]) {
        let [first, second] = match find {
            Find::Off => return,
            Find::Told => [true, placed.iter().filter(|placed| **placed).count() >= MANY],
            Find::K1 => [true, false],
            Find::K1K2 => [true, true],
        };
        let mut used = vec![false; self.lenses.len()];
        self.lens_of.iter().zip(placed).for_each(|(lens, placed)| used[*lens] |= placed);
        if find != Find::Told {
            self.free([first, second], &used);
            return;
        }
        for coefficients in [[true, true], [true, false]] {
            if coefficients[1] && !second {
                continue;
            }
            let mut tried = self.clone();
            tried.free(coefficients, &used);
            tried.adjust(1.0, STEPS);
            let Some(covariance) = tried.of_placed(placed).covariance(1.0) else { continue };
            let told = |lens: usize| {
                let Some(camera) = (0..placed.len()).find(|i| placed[*i] && self.lens_of[*i] == lens) else {
                    return false;
                };
                let camera = tried.camera(camera);
                let corner = DVec3::new(camera.width as f64, camera.height as f64, 0.0).length() * 0.5;
                let r2 = (corner / camera.intrinsics.fx).powi(2);
                let [k1, k2] = [tried.lenses[lens].k1, tried.lenses[lens].k2];
                let moved = |k: f64| corner * k.abs() > MOVED;
                if coefficients[1] {
                    k2.abs() > TOLD * covariance.distortion[lens][1] && moved(k2 * r2 * r2)
                } else {
                    k1.abs() > TOLD * covariance.distortion[lens][0] && moved(k1 * r2)
                }
            };
            let told: Vec<bool> = (0..used.len()).map(|lens| used[lens] && told(lens)).collect();
            if told.contains(&true) {
                self.free(coefficients, &told);
                return;
            }
        }
    }

    fn free(&mut self, [first, second]: [bool; 2], which: &[bool]) {
        for (lens, _) in self.lenses.iter_mut().zip(which).filter(|(_, which)| **which) {
            (lens.free_k1, lens.free_k2) = (first, second);
            lens.distortion_weight = (PIXEL / BENT).powi(2);
        }
    }
}
