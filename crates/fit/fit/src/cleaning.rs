//! Scenes without what no photo needs.

use crate::FitError;
use crate::cleaned::{Cleaned, Reason};
use crate::evidence::{Drawn, Evidence, Witness, error, evidence};
use crate::fit::Fit;
use crate::strategy::Moment;
use std::time::Instant;
use weaver_kernels::nearest_neighbors::nearest_neighbors;
use weaver_splat::RasterError;

/// Pixels of all photos together that Gaussians are judged by, about: more photos are evenly spread ones of them.
const PIXELS: usize = 16 << 20;
/// Photos whose work is timed to know that of all.
const TIMED: usize = 2;
/// Gaussians nearest to one, itself among them, of which one goes in a round.
const NEIGHBORS: usize = 9;
/// The least photos, however large, if there are as many.
const LEAST_PHOTOS: usize = 24;
/// Standard deviations of the sum of what photos say that are added to it: they have to agree.
const CAUTION: f64 = 2.0;
/// Part of what all photos lose by a Gaussian that one of them may gain, where they do not agree.
const NEEDED: f64 = 0.1;
/// Part of a run after which it cleans by itself: Gaussians come and go no more, and what is left of the run heals.
pub(crate) const MOMENT: f64 = 0.8;

/// Rules of cleaning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CleaningRules {
    /// The sum of the rises may be this part of the error of the photos.
    pub rise: f64,
    /// The error itself may rise by this part, or everything stays: Gaussians that look alike are missed more together
    /// than one by one.
    pub bound: f64,
    /// A Gaussian that one photo needs goes where the others are worse with it by more than this part of what the one
    /// gains.
    pub others: f64,
    /// Rounds: where some hide others that look like them, the evidence of each alone says nothing of all of them.
    pub rounds: usize,
    /// The part of the Gaussians that a round takes at most, but for those that no photo shows.
    pub part: f64,
}

impl Default for CleaningRules {
    fn default() -> Self {
        Self { rise: 0.002, bound: 0.002, others: 0.5, rounds: 4, part: 0.1 }
    }
}

impl CleaningRules {
    /// Rules within a run, whose further steps heal: one round.
    const IN_A_RUN: Self = Self { rise: 0.0, bound: 0.0, others: 0.5, rounds: 1, part: 0.15 };
}

impl Fit {
    /// Removes Gaussians that no photo needs, by the photos alone: those that no photo shows, those without which the
    /// photos are met better or as well, and those that one photo needs although the others see through their place.
    /// Of neighbors one alone goes in a round. Of many photos, or large ones, some are asked. Nothing is removed where
    /// no photo shows anything, nor where the photos are met too badly then.
    ///
    /// # Errors
    /// When the rasterizer refuses.
    pub fn clean(&mut self, rules: &CleaningRules) -> Result<Cleaned, FitError> {
        self.fetch()?;
        let photos = self.asked();
        let mut cleaned = Cleaned::default();
        // What rises is shared by the rounds.
        let [mut allowed, mut bound] = [f64::INFINITY; 2];
        for round in 0..rules.rounds {
            let found = self.judged(&photos, evidence)?;
            bound = bound.min((1.0 + rules.bound) * found.error);
            allowed = allowed.min((1.0 + rules.rise) * found.error);
            let rise = (allowed - found.error).max(0.0) / (rules.rounds - round) as f64;
            let reasons = reasons(&found, photos.len() == self.photos(), rise, rules, &self.neighbors());
            // A scene that lies outside all photos is not judged by them.
            let shown = found.photos.iter().any(|photos| *photos > 0);
            if !shown || reasons.iter().flatten().next().is_none() {
                break;
            }
            let before = self.population.clone();
            self.keep(&reasons.iter().map(Option::is_none).collect::<Vec<_>>());
            let after = self.judged(&photos, error)?;
            if after > bound {
                self.population = before;
                self.keep(&vec![true; self.population.len()]);
                break;
            }
            reasons.into_iter().flatten().for_each(|reason| cleaned.add(reason));
        }
        Ok(cleaned)
    }

    /// True if the next step of a run that [cleans](crate::FitSettings::clean) will do so before anything else.
    pub fn is_cleaning_due(&self) -> bool {
        let Moment { since, step, steps, .. } = self.moment();
        self.settings.clean && (since..=step).contains(&((MOMENT * steps as f64).ceil() as usize))
    }

    /// Gaussians that the run removed so far by [cleaning](crate::FitSettings::clean).
    pub fn cleaned(&self) -> Cleaned {
        self.cleaned
    }

    /// Cleans if that is due.
    pub(crate) fn clean_in_a_run(&mut self) -> Result<(), FitError> {
        if self.is_cleaning_due() {
            let cleaned = self.clean(&CleaningRules::IN_A_RUN)?;
            let (before, now) = (self.cleaned.row(), cleaned.row());
            self.cleaned = Cleaned::of(std::array::from_fn(|i| before[i] + now[i]));
            self.changed();
        }
        Ok(())
    }

    /// Seconds that cleaning within a run takes, by a few of the photos.
    pub(crate) fn seconds_of_cleaning(&self) -> Result<f64, FitError> {
        let photos = self.asked();
        let few = &photos[..photos.len().min(TIMED)];
        let start = Instant::now();
        self.judged(few, evidence)?;
        self.judged(few, error)?;
        Ok(start.elapsed().as_secs_f64() * photos.len() as f64 / few.len() as f64)
    }

    /// Keeps some Gaussians, without statistics.
    fn keep(&mut self, keep: &[bool]) {
        self.population.retain(keep);
        self.statistics.clear();
        self.statistics.resize(self.population.len(), Default::default());
    }

    /// The nearest Gaussians of each, itself first, `[N, NEIGHBORS]`.
    fn neighbors(&self) -> Vec<u32> {
        let means = self.population.to_gaussians(0).means;
        let mut neighbors = vec![0; NEIGHBORS * means.len()];
        nearest_neighbors(means.as_flattened(), NEIGHBORS - 1, &mut neighbors);
        neighbors
    }

    /// The photos to ask, evenly spread.
    fn asked(&self) -> Vec<usize> {
        let all = self.photos();
        let pixels = |photo: usize| self.photo(photo).camera.width * self.photo(photo).camera.height;
        let most = (all * PIXELS / (0..all).map(pixels).sum::<usize>()).clamp(LEAST_PHOTOS.min(all), all);
        (0..most).map(|i| i * all / most).collect()
    }

    /// The scene as some photos judge it.
    fn judged<T>(
        &self,
        photos: &[usize],
        judge: impl Fn(Drawn<'_>, &[Witness<'_>]) -> Result<T, RasterError>,
    ) -> Result<T, FitError> {
        let witness = |index: &usize| Witness {
            photo: self.photo(*index),
            counts: self.counted(*index),
            camera: self.camera(*index),
            exposure: self.exposure(*index).copied().unwrap_or_default().matrix,
        };
        let witnesses: Vec<Witness<'_>> = photos.iter().map(witness).collect();
        let scene = &self.population.to_gaussians(self.settings.sh_degree).to_activated();
        Ok(judge(Drawn { scene, background: self.settings.background, raster: &self.raster }, &witnesses)?)
    }
}

/// The Gaussians to remove in a round, `[N]`, by the evidence of all photos or of some: those with the most against
/// them first, of neighbors one alone; then those that are needed least, as long as the error rises by no more than
/// `rise`.
fn reasons(
    found: &Evidence,
    all_asked: bool,
    rise: f64,
    rules: &CleaningRules,
    neighbors: &[u32],
) -> Vec<Option<Reason>> {
    let Evidence { rise: rises, square, most, photos, .. } = found;
    // The sum of what photos say, and by how much the sum of others like them may be worse.
    let cautious = |sum: f64, square: f64, photos: u32| {
        let count = f64::from(photos.max(2));
        sum + CAUTION * (count / (count - 1.0) * (square - sum * sum / f64::from(photos.max(1))).max(0.0)).sqrt()
    };
    let reason = |i: usize| {
        let all = cautious(rises[i], square[i], photos[i]);
        let others = cautious(rises[i] - most[i], square[i] - most[i] * most[i], photos[i].saturating_sub(1));
        match () {
            () if photos[i] == 0 && !all_asked => None,
            () if photos[i] == 0 => Some((f64::NEG_INFINITY, i, Reason::Unseen)),
            () if rises[i] < 0.0 && (all < 0.0 || most[i] <= NEEDED * -rises[i]) => {
                Some((rises[i], i, Reason::Harmful))
            }
            () if photos[i] > 2 && others < -rules.others * most[i] => Some((others, i, Reason::Contradicted)),
            () => Some((all, i, Reason::Unneeded)),
        }
    };
    let mut order: Vec<(f64, usize, Reason)> = (0..rises.len()).filter_map(reason).collect();
    let last = |reason| reason == Reason::Unneeded;
    order.sort_unstable_by(|a, b| last(a.2).cmp(&last(b.2)).then(a.0.total_cmp(&b.0)).then(a.1.cmp(&b.1)));
    let (mut reasons, mut taken) = (vec![None; rises.len()], vec![false; rises.len()]);
    let (mut sum, mut left) = (0.0, (rules.part * rises.len() as f64) as usize);
    for (against, i, reason) in order {
        let near = &neighbors[i * NEIGHBORS..][..NEIGHBORS];
        match reason {
            Reason::Unseen => {}
            _ if left == 0 => break,
            _ if near.iter().any(|other| taken[*other as usize]) => continue,
            Reason::Unneeded if sum + against > rise => break,
            Reason::Unneeded => sum += against,
            Reason::Harmful | Reason::Contradicted => {}
        }
        if reason != Reason::Unseen {
            (taken[i], left) = (true, left - 1);
        }
        reasons[i] = Some(reason);
    }
    reasons
}
