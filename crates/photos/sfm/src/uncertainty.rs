//! Expected accuracy of estimated cameras.

mod flat;
#[cfg(test)]
mod tests;

use crate::bundle::{Bundle, Covariance, LARGE, Lens, Observation};
use crate::lenses::PIXEL;
use crate::photo::Find;
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Pose, Similarity};
use weaver_kernels::parallel;

/// Prior standard deviation of a distortion.
const BENT: f64 = 0.2;
/// A distortion counts as determined if it is so many of its standard deviations from 0, and moves a corner by so many
/// pixels.
const TOLD: f64 = 6.0;
const MOVED: f64 = 0.3;
/// Photos from which on one coefficient of the distortion is tried, and two.
const SEVERAL: usize = 6;
const MANY: usize = 20;
/// Standard deviations of the parameters held fixed: of the principal point from the middle of photos, over their
/// longer sides, and of k1.
const OFF_CENTER: f64 = 0.005;
const UNSEEN: f64 = 0.01;
/// Matches of a photo of a plane that count as independent: the others share their errors.
const INDEPENDENT: f64 = 40.0;
/// Groups of photos that are left out, one after the other.
const GROUPS: usize = 8;
/// Steps of an adjustment.
const STEPS: usize = 20;

/// Expected errors of cameras: standard deviations, up to the world's place, turn and scale.
///
/// Two parts are added by squares: the uncertainty by the normal equations of the adjustment, with the noise of its
/// residuals; and the movement of the rest where photos are left out, which also shows errors that many observations
/// have in common. The focal length of a scene that is one plane is determined so weakly that neither shows its error,
/// and counts as if few matches of a photo were independent.
#[derive(Clone, Debug, PartialEq)]
pub struct Uncertainty {
    /// Of focal lengths, as a part of them: the largest of any lens; 0 where all were given.
    pub focal: f64,
    /// Of rotations, radians, by photo; 0 without a camera.
    pub rotations: Vec<f64>,
    /// Of centers, world units, by photo; 0 without a camera.
    pub centers: Vec<f64>,
    /// The root of the mean square distance of centers from their middle, world units.
    pub spread: f64,
}

impl Uncertainty {
    /// The uncertainty of the cameras that have a place.
    pub(crate) fn of(bundle: &Bundle, placed: &[bool]) -> Option<Self> {
        let bundle = bundle.of_placed(placed);
        let noise = bundle.covariance(1.0)?.sigma;
        // Parameters held fixed may yet be off, and the rest with them.
        let mut freed = bundle.clone();
        let uncertain = freed.lenses.iter_mut().zip(bundle.calibrated()).filter(|(_, calibrated)| !calibrated);
        for (lens, _) in uncertain {
            (lens.free_shift, lens.shift_weight) = (true, (noise / OFF_CENTER).powi(2));
            if !lens.free_k1 {
                (lens.free_k1, lens.distortion_weight) = (true, (noise / UNSEEN).powi(2));
            }
        }
        let Covariance { focal, rotation, center, .. } = freed.covariance(1.0)?;
        let left_out = left_out(&bundle);
        // An adjusted parameter without a variance is not known at all.
        let both = |of_all: f64, of_rest: f64| if of_all.is_nan() { f64::INFINITY } else { of_all.hypot(of_rest) };
        let focals =
            bundle.lenses.iter().zip(focal.into_iter().zip(left_out.focal)).filter(|(lens, _)| lens.free_focal);
        let focal = focals.map(|(_, (of_all, of_rest))| both(of_all, of_rest)).fold(0.0, f64::max);
        // A plane determines a focal length by second-order effects, which errors that all matches have in common
        // imitate.
        let each = bundle.observations.len() as f64 / bundle.cameras.len().max(1) as f64;
        let focal = if bundle.flat() { focal * (each / INDEPENDENT).max(1.0).sqrt() } else { focal };
        let of_photos = |of_all: Vec<f64>, of_rest: Vec<f64>| {
            let mut each = of_all.into_iter().zip(of_rest).map(|(of_all, of_rest)| both(of_all, of_rest));
            placed.iter().map(|placed| if *placed { each.next().unwrap_or(0.0) } else { 0.0 }).collect()
        };
        let rotations = of_photos(rotation, left_out.rotation);
        Some(Self { focal, rotations, centers: of_photos(center, left_out.center), spread: spread(&bundle.cameras) })
    }

    /// The same with the photos numbered by `numbers` among `count`.
    pub(crate) fn renumbered(self, numbers: &[usize], count: usize) -> Self {
        let spread_out = |of: Vec<f64>| {
            let mut all = vec![0.0; count];
            numbers.iter().zip(of).for_each(|(number, value)| all[*number] = value);
            all
        };
        Self { rotations: spread_out(self.rotations), centers: spread_out(self.centers), ..self }
    }

    /// In units of a world `by` times as large.
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

/// Cameras and lenses at the end of an adjustment.
type Ended = (Vec<Camera>, Vec<Lens>);

/// Movement of the rest where groups of photos are left out.
struct LeftOut {
    focal: Vec<f64>,
    rotation: Vec<f64>,
    center: Vec<f64>,
}

/// The deviations by leaving out groups of photos, one at a time.
///
/// Source: Efron, The jackknife, the bootstrap and other resampling plans, 1982, chapter 3.
fn left_out(bundle: &Bundle) -> LeftOut {
    let n = bundle.cameras.len();
    let plenty = bundle.has_plenty();
    let bundle: &Bundle = &bundle.by_some(1.0, STEPS);
    // A rig is left out as a whole.
    let bodies = bundle.bodies();
    let groups = bodies.last().map_or(0, |last| last + 1).min(GROUPS);
    let mut without: Vec<Option<Ended>> = vec![None; groups];
    parallel::for_chunks(&mut without, 1, |group, without| {
        let mut rest = bundle.clone();
        rest.observations.retain(|o| bodies[o.camera] % groups != group);
        let agreed = rest.agreed();
        rest.observations.retain(|o| agreed[o.point]);
        if plenty {
            rest.adjust_roughly(1.0, STEPS);
        } else if bundle.cameras.len() > LARGE {
            // The movement of hundreds of numbers together is seen well enough.
            rest.adjust_nearly(1.0, STEPS);
        } else {
            rest.adjust(1.0, STEPS);
        }
        // With hundreds of photos, eight copies of everything would not fit in memory.
        without[0] = Some((rest.cameras, rest.lenses));
    });
    let mut squares = LeftOut { focal: vec![0.0; bundle.lenses.len()], rotation: vec![0.0; n], center: vec![0.0; n] };
    for (group, (cameras, lenses)) in without.into_iter().flatten().enumerate() {
        let lenses = lenses.iter().zip(&bundle.lenses).map(|(a, b)| (a.log_focal - b.log_focal).powi(2));
        squares.focal.iter_mut().zip(lenses).for_each(|(sum, square)| *sum += square);
        let kept: Vec<usize> = (0..n).filter(|i| bodies[*i] % groups != group).collect();
        let poses = |of: &[Camera]| -> Vec<Pose> { kept.iter().map(|i| of[*i].pose).collect() };
        let (from, to) = (poses(&cameras), poses(&bundle.cameras));
        let Some(onto) = Similarity::fit_poses(&from, &to) else { continue };
        for ((i, from), to) in kept.iter().zip(&from).zip(&to) {
            let moved = onto.apply_to_pose(from);
            squares.rotation[*i] += moved.angle_to(to).powi(2);
            squares.center[*i] += moved.center().distance_squared(to.center());
        }
    }
    let deviations =
        |squares: Vec<f64>| squares.into_iter().map(|sum| (sum * (groups - 1) as f64 / groups as f64).sqrt()).collect();
    LeftOut {
        focal: deviations(squares.focal),
        rotation: deviations(squares.rotation),
        center: deviations(squares.center),
    }
}

/// The root of the mean square distance of centers from their middle.
fn spread(cameras: &[Camera]) -> f64 {
    let centers: Vec<DVec3> = cameras.iter().map(|camera| camera.pose.center()).collect();
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
            Observation { camera, ..*o }
        });
        let used = |lens: usize| kept.iter().any(|i| self.lens_of[*i] == lens);
        let lens = |i: usize| if used(i) { self.lenses[i] } else { self.lenses[i].held() };
        Self {
            cameras: kept.iter().map(|i| self.cameras[*i]).collect(),
            lenses: (0..self.lenses.len()).map(lens).collect(),
            lens_of: kept.iter().map(|i| self.lens_of[*i]).collect(),
            rig: self.rig_of(&kept),
            fixed: vec![false; kept.len()],
            points: self.points.clone(),
            observations: observations.collect(),
            ..Self::default()
        }
    }

    /// Frees the distortion of lenses as far as it is requested and determined; returns whether any is.
    pub(crate) fn free_distortion(&mut self, find: Find, placed: &[bool]) -> bool {
        let count = placed.iter().filter(|placed| **placed).count();
        let [first, second] = match find {
            Find::Off => return false,
            Find::Told if count < SEVERAL => return false,
            Find::Told => [true, count >= MANY],
            Find::K1 => [true, false],
            Find::K1K2 => [true, true],
        };
        let mut used = vec![false; self.lenses.len()];
        self.lens_of.iter().zip(placed).for_each(|(lens, placed)| used[*lens] |= placed);
        used.iter_mut().zip(self.calibrated()).for_each(|(used, calibrated)| *used &= !calibrated);
        if find != Find::Told {
            self.free([first, second], &used);
            return true;
        }
        for coefficients in [[true, true], [true, false]] {
            if coefficients[1] && !second {
                continue;
            }
            let mut tried = self.clone();
            tried.free(coefficients, &used);
            tried.adjust_as_needed(1.0, STEPS);
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
                    k2.abs() > TOLD * covariance.k2[lens] && moved(k2 * r2 * r2)
                } else {
                    k1.abs() > TOLD * covariance.k1[lens] && moved(k1 * r2)
                }
            };
            let told: Vec<bool> = (0..used.len()).map(|lens| used[lens] && told(lens)).collect();
            if told.contains(&true) {
                self.free(coefficients, &told);
                return true;
            }
        }
        false
    }

    fn free(&mut self, [first, second]: [bool; 2], which: &[bool]) {
        for (lens, _) in self.lenses.iter_mut().zip(which).filter(|(_, which)| **which) {
            (lens.free_k1, lens.free_k2) = (first, second);
            lens.distortion_weight = (PIXEL / BENT).powi(2);
        }
    }
}
