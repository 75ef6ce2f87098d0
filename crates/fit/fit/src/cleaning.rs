//! Scenes without what no photo needs.

use crate::FitError;
use crate::evidence::{Evidence, Witness, evidence};
use crate::fit::Fit;
use crate::photos::{Pyramid, at_level};
use crate::transients::counted;

/// Pixels of all photos together that Gaussians are judged by.
const PIXELS: usize = 8 << 20;
/// Longest side of these photos, at most and at least, pixels.
const SIDES: (usize, usize) = (400, 128);
/// Rounds, and the part of the Gaussians that each takes at most: where some hide others that look like them, the
/// evidence of each alone says nothing of all of them.
const ROUNDS: usize = 4;
const PART: f64 = 0.1;

/// Rules of cleaning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CleaningRules {
    /// The error of all photos may rise by this part.
    pub rise: f64,
    /// A Gaussian that one photo needs goes where the others are worse with it by more than this part of what the one
    /// gains.
    pub others: f64,
}

impl Default for CleaningRules {
    fn default() -> Self {
        Self { rise: 0.002, others: 0.5 }
    }
}

/// Gaussians that were removed, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cleaned {
    /// No photo shows them.
    pub unseen: usize,
    /// Photos are met better without them.
    pub harmful: usize,
    /// One photo needs them, and all others are worse with them.
    pub contradicted: usize,
    /// Photos are met as well without them.
    pub unneeded: usize,
}

impl Cleaned {
    /// All that were removed.
    pub fn count(&self) -> usize {
        self.unseen + self.harmful + self.contradicted + self.unneeded
    }
}

/// A reason to remove a Gaussian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Reason {
    Unseen,
    Harmful,
    Contradicted,
    Unneeded,
}

impl Fit {
    /// Removes Gaussians that no photo needs, by the photos alone: those that no photo shows, those without which the
    /// photos are met better or as well, and those that one photo needs although the others see through their place.
    /// Photos that are drawn through a lens say nothing; without others nothing is removed, nor where no photo shows
    /// anything.
    ///
    /// # Errors
    /// When the rasterizer refuses.
    pub fn clean(&mut self, rules: &CleaningRules) -> Result<Cleaned, FitError> {
        self.fetch()?;
        let pinholes = (0..self.photos()).filter(|photo| self.photo(*photo).lens.is_none());
        let witnesses: Vec<Witness> = pinholes.map(|photo| self.witness(photo)).collect();
        if witnesses.is_empty() {
            return Ok(Cleaned::default());
        }
        let mut cleaned = Cleaned::default();
        let mut found = self.evidence(&witnesses)?;
        // A scene that lies outside all photos is not judged by them.
        if found.photos.iter().all(|photos| *photos == 0) {
            return Ok(cleaned);
        }
        let mut bound = (1.0 + rules.rise) * found.error;
        for round in 1..=ROUNDS {
            // What rises is shared by the rounds.
            let allowed = found.error + (bound - found.error) / (ROUNDS + 1 - round) as f64;
            let reasons = reasons(&found, allowed - found.error, rules);
            let taken = reasons.iter().flatten().count();
            if taken == 0 {
                break;
            }
            let before = self.population.clone();
            self.keep(&reasons.iter().map(Option::is_none).collect::<Vec<_>>());
            let after = self.evidence(&witnesses)?;
            if after.error > bound {
                self.population = before;
                self.keep(&vec![true; self.population.len()]);
                break;
            }
            found = after;
            bound = bound.min((1.0 + rules.rise) * found.error);
            for reason in reasons.into_iter().flatten() {
                match reason {
                    Reason::Unseen => cleaned.unseen += 1,
                    Reason::Harmful => cleaned.harmful += 1,
                    Reason::Contradicted => cleaned.contradicted += 1,
                    Reason::Unneeded => cleaned.unneeded += 1,
                }
            }
        }
        Ok(cleaned)
    }

    /// Keeps some Gaussians, without statistics.
    fn keep(&mut self, keep: &[bool]) {
        self.population.retain(keep);
        self.statistics.clear();
        self.statistics.resize(self.population.len(), Default::default());
    }

    fn evidence(&self, witnesses: &[Witness]) -> Result<Evidence, FitError> {
        let scene = self.population.to_gaussians(self.settings.sh_degree).to_activated();
        Ok(evidence(&scene, witnesses, self.settings.background, &self.raster)?)
    }

    /// A photo to judge Gaussians by, halved until all photos together are small enough.
    fn witness(&self, index: usize) -> Witness {
        let photo = self.photo(index);
        let pixels = (PIXELS / self.photos()) as f64;
        let side = (pixels.sqrt() as usize).clamp(SIDES.1, SIDES.0);
        let longest = |level: usize| {
            let camera = at_level(&photo.camera, level);
            camera.width.max(camera.height)
        };
        let halvings = (0..).find(|level| longest(*level) <= side).unwrap_or(0);
        let pyramid = Pyramid::new(photo.clone(), halvings);
        let (small, halvings) = pyramid.level(halvings);
        let exposure = self.exposure(index).copied().unwrap_or_default().matrix;
        let counts = counted(small, self.transients(index)).map(|counts| counts.into_owned());
        Witness { photo: small.clone(), counts, camera: at_level(&self.camera(index), halvings), exposure }
    }
}

/// The Gaussians to remove in a round, `[N]`: those with the most against them first, as long as the error rises by no
/// more than `rise`. Others are unneeded only beside those that stay: they wait for a round without anything else.
fn reasons(found: &Evidence, rise: f64, rules: &CleaningRules) -> Vec<Option<Reason>> {
    let Evidence { rise: rises, most, photos, .. } = found;
    let reason = |i: usize| {
        let others = rises[i] - most[i];
        match () {
            () if photos[i] == 0 => (f64::NEG_INFINITY, i, Reason::Unseen),
            () if rises[i] <= 0.0 => (rises[i], i, Reason::Harmful),
            () if photos[i] > 2 && others < -rules.others * most[i] => (others, i, Reason::Contradicted),
            () => (rises[i], i, Reason::Unneeded),
        }
    };
    let mut order: Vec<(f64, usize, Reason)> = (0..rises.len()).map(reason).collect();
    order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    if order.first().is_some_and(|(.., reason)| *reason != Reason::Unneeded) {
        order.retain(|(.., reason)| *reason != Reason::Unneeded);
    }
    let mut reasons = vec![None; rises.len()];
    let (mut sum, mut taken) = (0.0, 0);
    for (_, i, reason) in order {
        if reason != Reason::Unseen {
            if taken as f64 >= PART * rises.len() as f64 {
                break;
            }
            sum += rises[i].max(0.0);
            if sum > rise {
                break;
            }
            taken += 1;
        }
        reasons[i] = Some(reason);
    }
    reasons
}
