//! Settings of a fit.

use crate::{Density, FitError, Rates, Surfaces, Thinning};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Settings of a fit. All times are fractions of the run, so that a short run is a whole one.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct FitSettings {
    /// Optimizer steps; each looks at one photo, or at [`views_per_step`](Self::views_per_step).
    pub steps: usize,
    /// Photos that a step looks at, whose gradients are averaged. It changes the result: more photos make a step as
    /// many times as long, and steadier. Several processes can share them ([`Fit::share`](crate::Fit::share)). Steps
    /// toward several are not taken on a device.
    #[serde(default = "one")]
    pub views_per_step: usize,
    /// The most Gaussians there may be at any time.
    pub gaussians: usize,
    /// Seed of everything that is drawn at random.
    pub seed: u64,
    /// Degree of the spherical harmonics, 0 to 3.
    pub sh_degree: usize,
    /// Part of the run between the degrees of the harmonics, which come into use one after the other.
    pub sh_interval: f64,
    /// True if opacities are lowered where the low-pass filter widens a Gaussian (Mip-Splatting).
    pub antialiased: bool,
    /// The color behind everything, three numbers from 0 to 1.
    pub background: [f32; 3],
    /// Gaussians nearer to a camera than this are not drawn, as a part of the depth in front of which a hundredth of
    /// the initial Gaussians lies in photos. Blobs right before a camera are how photos that are few get overfitted.
    pub near: f64,
    /// Weight of 1 - SSIM in the loss; the rest is L1.
    pub ssim_weight: f64,
    /// Part of the run in which photos are seen at half their resolution.
    pub coarse_until: f64,
    /// Number of halvings of photos at the beginning; the coarse part is divided among the sizes.
    pub halvings: usize,
    /// Opacity of initial Gaussians, from points or random.
    pub initial_opacity: f32,
    /// Size of initial Gaussians over the mean distance of their three nearest neighbors.
    pub initial_scale: f32,
    /// Learning rates.
    pub rates: Rates,
    /// Density control.
    pub density: Density,
    /// Refinement of cameras.
    pub poses: Poses,
    /// True if the colors of each photo are corrected: by gains, or by an affine map ([`Rates::exposure_rest`]).
    pub exposure: bool,
    /// Part of the Gaussians that each step leaves out, drawn at random, at the end of the run; it grows from nothing
    /// in proportion to the steps done. The rest is as much more opaque, so that pictures stay as bright in the mean.
    /// Steps are then not taken on a device. Source: Park et al., DropGaussian, 2025.
    #[serde(default)]
    pub dropout: f64,
    /// True if photos are searched for transients, things that no other photo shows, which are then left out of them
    /// ([`Transients`](crate::Transients)).
    #[serde(default)]
    pub transients: bool,
    /// Losses of surfaces.
    #[serde(default)]
    pub surfaces: Surfaces,
    /// True if a run ends without the Gaussians that no photo needs ([`Fit::clean`](crate::Fit::clean)), which is up to
    /// whoever lets it run.
    #[serde(default)]
    pub clean: bool,
    /// Steps that are left out, as where a run would not have ended in its time: each entry holds from its step on, in
    /// place of those before it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub thinned: Vec<Thinning>,
}

/// Longest side of photos at the beginning of a run, about, pixels.
const COARSEST: f64 = 200.0;
/// The most steps, which the command line takes, too.
const MOST_STEPS: usize = u32::MAX as usize;
/// The most Gaussians, whose bytes can be counted.
const MOST_GAUSSIANS: usize = 1 << 48;
/// The most halvings: a photo of 65,536 pixels is then one.
const MOST_HALVINGS: usize = 16;

/// Value in settings that are older than the key.
fn one() -> usize {
    1
}

impl Default for FitSettings {
    fn default() -> Self {
        Self {
            steps: 1500,
            views_per_step: 1,
            gaussians: 30_000,
            seed: 0,
            sh_degree: 3,
            sh_interval: 1.0 / 15.0,
            antialiased: false,
            background: [1.0; 3],
            near: 0.5,
            ssim_weight: 0.2,
            coarse_until: 0.4,
            halvings: 1,
            initial_opacity: 0.5,
            initial_scale: 0.5,
            rates: Rates::default(),
            density: Density::default(),
            poses: Poses::default(),
            exposure: false,
            dropout: 0.0,
            transients: false,
            surfaces: Surfaces::default(),
            clean: false,
            thinned: Vec::new(),
        }
    }
}

/// Steps that decisions leave out before number `step` of a run.
fn left_out(thinned: &[Thinning], step: usize, steps: usize) -> usize {
    let ends = thinned.iter().skip(1).map(|next| next.at.min(step)).chain([step]);
    let of = |(thinning, end): (&Thinning, usize)| end.saturating_sub(thinning.at) - thinning.taken(end, steps);
    thinned.iter().zip(ends).map(of).sum()
}

/// Refinement of cameras: whenever a photo is looked at, its camera goes toward where the photo fits the scene.
///
/// That is for the last tenths of a degree: the scene lies where cameras are in the mean, and an error that neighbors
/// share hardly shrinks. `weaver_sfm::refine` finds such errors beforehand.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Poses {
    /// True if cameras are refined.
    pub refine: bool,
    /// Part of the way to where its photo fits the scene that a camera goes in a step, at the beginning.
    pub rate: f64,
    /// Rate at the end, as a factor; in between its logarithm is linear.
    pub rate_end: f64,
    /// Part of the run before cameras begin to go toward the scene.
    pub from: f64,
    /// Part of the run after which they stay.
    pub until: f64,
}

impl Default for Poses {
    fn default() -> Self {
        Self { refine: false, rate: 1.0, rate_end: 0.1, from: 0.22, until: 0.95 }
    }
}

impl FitSettings {
    /// [`dropout`](Self::dropout) that pays for so many photos: the fewer there are, the more Gaussians fit each photo
    /// from its own side alone. From 12 photos on it is nothing.
    pub fn dropout_for(photos: usize) -> f64 {
        if photos < 12 { (1.2 / photos.max(1) as f64).min(0.2) } else { 0.0 }
    }

    /// [`halvings`](Self::halvings) and [`coarse_until`](Self::coarse_until) that pay for photos of this longest side,
    /// pixels: a run begins at some 200 pixels, where steps cost least and move Gaussians farthest.
    ///
    /// ```
    /// use weaver_fit::FitSettings;
    /// assert_eq!([384, 800, 1600].map(FitSettings::coarse_for), [(1, 0.4), (2, 0.6), (3, 0.6)]);
    /// ```
    pub fn coarse_for(long_side: usize) -> (usize, f64) {
        let halvings = (long_side as f64 / COARSEST).log2().round().clamp(1.0, 3.0) as usize;
        (halvings, if halvings > 1 { 0.6 } else { 0.4 })
    }

    /// The settings of a run of more steps and at most so many Gaussians that goes on from the end of this one: what
    /// has passed, the small photos above all, does not come again.
    ///
    /// ```
    /// use weaver_fit::FitSettings;
    /// let settings = FitSettings { steps: 1000, coarse_until: 0.6, ..FitSettings::default() };
    /// let longer = settings.prolonged(2000, 60_000);
    /// assert_eq!((longer.steps, longer.gaussians, longer.coarse_until), (2000, 60_000, 0.3));
    /// ```
    pub fn prolonged(&self, steps: usize, gaussians: usize) -> Self {
        let shorter = self.steps as f64 / steps.max(1) as f64;
        let mut longer = Self { steps, gaussians, ..self.clone() };
        for part in [&mut longer.coarse_until, &mut longer.sh_interval, &mut longer.poses.from] {
            *part *= shorter;
        }
        longer
    }

    /// Number of the step after number `step`.
    pub(crate) fn after(&self, step: usize) -> usize {
        let thinning = self.thinned.iter().rfind(|thinning| thinning.at <= step);
        thinning.map_or(step + 1, |thinning| thinning.next(step, self.steps))
    }

    /// The decisions to leave out steps that were made up to number `step`.
    fn thinned_at(&self, step: usize) -> &[Thinning] {
        &self.thinned[..self.thinned.partition_point(|thinning| thinning.at <= step)]
    }

    /// Steps that are left out before number `step`.
    pub fn left_out(&self, step: usize) -> usize {
        left_out(&self.thinned, step, self.steps)
    }

    /// Steps of the run but for those that are left out.
    pub fn taken(&self) -> usize {
        self.steps - self.left_out(self.steps)
    }

    /// Steps of the run but for those that are left out, as known at number `step`.
    pub(crate) fn taken_at(&self, step: usize) -> usize {
        self.steps - left_out(self.thinned_at(step), self.steps, self.steps)
    }

    /// The most Gaussians at number `step`.
    pub(crate) fn gaussians_at(&self, step: usize) -> usize {
        self.thinned_at(step).last().and_then(|thinning| thinning.gaussians).unwrap_or(self.gaussians)
    }

    /// Number of halvings of photos at this part of the run.
    pub(crate) fn level(&self, fraction: f64) -> usize {
        if fraction >= self.coarse_until || self.halvings == 0 {
            return 0;
        }
        let stage = (fraction / self.coarse_until * self.halvings as f64) as usize;
        self.halvings - stage.min(self.halvings - 1)
    }

    /// Checks that a step has a photo for each of so many processes.
    ///
    /// # Errors
    /// When [`views_per_step`](Self::views_per_step) is smaller.
    pub fn check_processes(&self, count: usize) -> Result<(), FitError> {
        if count > self.views_per_step {
            let expected = format!("at least one photo for each of {count} processes");
            return Err(FitError::setting("views_per_step", expected, self.views_per_step));
        }
        Ok(())
    }

    /// Checks that every number is in its range.
    ///
    /// # Errors
    /// The first that is not, with its range.
    pub fn check(&self) -> Result<(), FitError> {
        let parts = [
            ("sh_interval", self.sh_interval),
            ("ssim_weight", self.ssim_weight),
            ("coarse_until", self.coarse_until),
            ("density.from", self.density.from),
            ("density.until", self.density.until),
            ("density.initial_part", self.density.initial_part),
            ("density.least_opacity", f64::from(self.density.least_opacity)),
            ("density.opacity_decay", f64::from(self.density.opacity_decay)),
            ("dropout", self.dropout),
            ("initial_opacity", f64::from(self.initial_opacity)),
            ("poses.from", self.poses.from),
            ("poses.until", self.poses.until),
            ("poses.rate_end", self.poses.rate_end),
            ("rates.means_end", self.rates.means_end),
            ("surfaces.normals_from", self.surfaces.normals_from),
            ("surfaces.end", self.surfaces.end),
            ("rates.end", self.rates.end),
            ("rates.last", self.rates.last),
            ("background", f64::from(self.background[0])),
            ("background", f64::from(self.background[1])),
            ("background", f64::from(self.background[2])),
        ];
        if let Some((key, found)) = parts.into_iter().find(|(_, x)| !(0.0..=1.0).contains(x)) {
            return Err(FitError::setting(key, "0 to 1", found));
        }
        let positive = [
            ("rates.means", self.rates.means),
            ("rates.scales", self.rates.scales),
            ("rates.quats", self.rates.quats),
            ("rates.opacities", self.rates.opacities),
            ("rates.sh", self.rates.sh),
            ("rates.sh_rest", self.rates.sh_rest),
            ("rates.exposure", self.rates.exposure),
            ("rates.exposure_rest", self.rates.exposure_rest),
            ("rates.power", self.rates.power),
            ("poses.rate", self.poses.rate),
            ("near", self.near),
            ("surfaces.depth", self.surfaces.depth),
            ("surfaces.normals", self.surfaces.normals),
            ("density.growth", self.density.growth),
            ("density.noise", self.density.noise),
            ("density.opacity_weight", f64::from(self.density.opacity_weight)),
            ("density.scale_weight", f64::from(self.density.scale_weight)),
        ];
        if let Some((key, found)) = positive.into_iter().find(|(_, x)| !(x.is_finite() && *x >= 0.0)) {
            return Err(FitError::setting(key, "a number that is not negative", found));
        }
        if !(self.initial_scale.is_finite() && self.initial_scale > 0.0) {
            return Err(FitError::setting("initial_scale", "a positive number", self.initial_scale));
        }
        if !(self.surfaces.off.is_finite() && self.surfaces.off > 0.0) {
            return Err(FitError::setting("surfaces.off", "a positive number", self.surfaces.off));
        }
        let counts = [
            ("steps", self.steps),
            ("views_per_step", self.views_per_step),
            ("gaussians", self.gaussians),
            ("density.rounds", self.density.rounds),
        ];
        if let Some((key, _)) = counts.into_iter().find(|(_, n)| *n == 0) {
            return Err(FitError::setting(key, "at least 1", 0));
        }
        if self.sh_degree > 3 {
            return Err(FitError::setting("sh_degree", "0 to 3", self.sh_degree));
        }
        let most = [("steps", self.steps, MOST_STEPS), ("gaussians", self.gaussians, MOST_GAUSSIANS)];
        let most = most.into_iter().chain([
            ("views_per_step", self.views_per_step, MOST_STEPS),
            ("density.rounds", self.density.rounds, MOST_STEPS),
            ("halvings", self.halvings, MOST_HALVINGS),
        ]);
        if let Some((key, found, most)) = most.into_iter().find(|(_, found, most)| found > most) {
            return Err(FitError::setting(key, format!("at most {most}"), found));
        }
        let kept = |thinning: &Thinning| thinning.kept > 0 && thinning.at < self.steps;
        if !self.thinned.iter().all(kept) || !self.thinned.is_sorted_by(|a, b| a.at < b.at) {
            let expected = "steps of the run, one after the other, and at least one kept after each";
            return Err(FitError::setting("thinned", expected, format!("{:?}", self.thinned)));
        }
        Ok(())
    }
}
