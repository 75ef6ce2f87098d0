//! Scenes without what no photo needs.

use crate::FitError;
use crate::cleaned::{Cleaned, Reason};
use crate::evidence::{Drawn, Evidence, Witness, error, evidence, shown_in};
use crate::fit::Fit;
use crate::population::Population;
use crate::rates::Rates;
use crate::strategy::StrategyKind;
use std::time::Instant;
use weaver_kernels::nearest_neighbors::nearest_neighbors;
use weaver_scene::forms;
use weaver_splat::RasterError;

/// Photos whose work is timed, to know how long all take.
const TIMED: usize = 2;
/// Gaussians nearest to one, itself among them, of which one goes in a round.
const NEIGHBORS: usize = 9;
/// The least photos, however large, if there are as many.
const LEAST_PHOTOS: usize = 24;
/// Standard deviations of the sum of what photos say that are added to it: they have to agree.
const CAUTION: f64 = 2.0;
/// Part of what all photos lose by a Gaussian that one of them may gain, where they do not agree.
const NEEDED: f64 = 0.1;
/// Part of all harm that the worst Gaussians do.
const WORST: f64 = 0.5;
/// Part of its opacity below which a Gaussian has faded.
const FADED: f32 = 0.1;
/// Photos that have to show a Gaussian for judging it, where not all are asked: the others may need what these do not.
const WITNESSES: u32 = 5;
/// Steps of fading that take as long as a round, about.
const ROUND: usize = 50;
/// Photos from which a Gaussian that a single one shows goes: of fewer, much of a scene is in one alone.
const MANY: usize = 12;

/// Rules of cleaning. Errors of photos are squared ones, and rises of them parts of each photo's own: a photo that is
/// met badly has no more to say than others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CleaningRules {
    /// The rises by Gaussians that photos hardly need may add up to this, in the mean over the photos.
    pub rise: f64,
    /// The errors themselves may rise by this in the mean, or everything stays: Gaussians that look alike are missed
    /// more together than one by one.
    pub bound: f64,
    /// A Gaussian that one photo needs goes where the others are worse with it by more than this part of what the one
    /// gains.
    pub others: f64,
    /// Rounds: where some hide others that look like them, the evidence of each alone says nothing of all of them.
    pub rounds: usize,
    /// The part of the Gaussians that a round takes at most, but for those that one photo shows, or none.
    pub part: f64,
    /// Pixels of all photos together that Gaussians are judged by, about: of more, evenly spread photos are asked.
    pub pixels: usize,
    /// Steps of opacities alone before the first round. Gaussians whose opacity falls below a tenth go, all others are
    /// again as they were: where junk lies before junk and the scene behind it, each photo blames all of them.
    pub fading: usize,
}

impl Default for CleaningRules {
    fn default() -> Self {
        Self { rise: 0.002, bound: 0.002, others: 0.5, rounds: 2, part: 0.15, pixels: 32 << 20, fading: 0 }
    }
}

impl CleaningRules {
    /// Rules for a scene that was not fitted to these photos a moment ago, or has been changed since.
    pub const ANY_SCENE: Self =
        Self { rise: 0.002, bound: 0.002, others: 0.5, rounds: 8, part: 0.15, pixels: 32 << 20, fading: 400 };
}

impl CleaningRules {
    /// All the work, in parts that take about as long each.
    pub fn parts(&self) -> usize {
        self.fading + ROUND * self.rounds
    }
}

impl Fit {
    /// Removes Gaussians that no photo needs, by the photos alone: those that no photo shows, or a single one of many;
    /// those without which the photos are met better or as well; and those that one photo needs although the others
    /// see through their place. Of neighbors one alone goes in a round. Of many photos, or large ones, some are asked.
    /// Nothing is removed where no photo shows anything, nor where the photos are met too badly then.
    ///
    /// # Errors
    /// When the rasterizer refuses.
    pub fn clean(&mut self, rules: &CleaningRules) -> Result<Cleaned, FitError> {
        self.clean_watched(rules, |_| ())
    }

    /// The same, and tells how many of the [parts](CleaningRules::parts) are done.
    ///
    /// # Errors
    /// As [`clean`](Self::clean).
    pub fn clean_watched(&mut self, rules: &CleaningRules, mut done: impl FnMut(usize)) -> Result<Cleaned, FitError> {
        self.fetch()?;
        let photos = self.asked(rules);
        let count = photos.len() as f64;
        let mut cleaned = Cleaned { harmful: self.fade(rules.fading, &mut done)?, ..Cleaned::default() };
        let mut bound = f64::INFINITY;
        for round in 1..=rules.rounds {
            done(rules.fading + ROUND * (round - 1));
            let found = self.judged(&photos, evidence)?;
            // A scene that lies outside all photos is not judged by them.
            if found.photos.iter().all(|photos| *photos == 0) {
                break;
            }
            bound = bound.min(found.error + rules.bound * count);
            let part = if round < rules.rounds {
                Part::Worst
            } else {
                Part::All { shown: self.shown_by(&photos, &found)?, many: self.photos() >= MANY }
            };
            let witnesses = if photos.len() < self.photos() { WITNESSES } else { 1 };
            let all = reasons((&found, witnesses), &part, rules, &self.neighbors());
            // Where a photo is alone with all of its part of the scene, that part stays. Large Gaussians that make up
            // for each other seem harmful one by one, and stay as well.
            let without = |kept: &[Reason]| all.iter().map(|reason| reason.filter(|r| !kept.contains(r))).collect();
            let not_lone: Vec<_> = without(&[Reason::Lone]);
            let not_harmful = without(&[Reason::Lone, Reason::Harmful]);
            for reasons in [all.clone(), not_lone, not_harmful] {
                let before = self.population.clone();
                self.keep(&reasons.iter().map(Option::is_none).collect::<Vec<_>>());
                if self.judged(&photos, error)? <= bound {
                    reasons.into_iter().flatten().for_each(|reason| cleaned.add(reason));
                    break;
                }
                self.population = before;
                self.keep(&vec![true; self.population.len()]);
            }
        }
        self.changed();
        done(rules.parts());
        Ok(cleaned)
    }

    /// Seconds that [cleaning](Self::clean) takes, by a few of the photos and the Gaussians as they are.
    ///
    /// # Errors
    /// When the rasterizer refuses.
    pub fn seconds_of_cleaning(&self, rules: &CleaningRules) -> Result<f64, FitError> {
        let photos = self.asked(rules);
        let few = &photos[..photos.len().min(TIMED)];
        let start = Instant::now();
        self.judged(few, evidence)?;
        self.judged(few, error)?;
        Ok(start.elapsed().as_secs_f64() * (photos.len() * rules.rounds) as f64 / few.len() as f64)
    }

    /// The number of photos that show each Gaussian, as [`Evidence::photos`] but of all of them: pictures of those that
    /// were not asked are small. Only 0, 1 and more are told apart.
    fn shown_by(&self, asked: &[usize], found: &Evidence) -> Result<Vec<u32>, FitError> {
        let mut shown = found.photos.clone();
        let others = (0..self.photos()).filter(|photo| asked.binary_search(photo).is_err());
        let others: Vec<_> = others.map(|photo| (self.camera(photo), self.photo(photo).model())).collect();
        let scene = &self.population.to_gaussians(0).to_activated();
        let drawn = Drawn { scene, background: self.settings.background, raster: &self.raster };
        Ok(shown_in(drawn, &others, &mut shown).map(|()| shown)?)
    }

    /// Removes Gaussians that fade where opacities alone are fitted for so many steps, and returns their number.
    fn fade(&mut self, steps: usize, done: &mut impl FnMut(usize)) -> Result<usize, FitError> {
        if steps == 0 {
            return Ok(0);
        }
        let opacity = |logits: &[f32]| logits.iter().map(|logit| forms::opacity(*logit)).collect::<Vec<f32>>();
        let before = opacity(&self.population.to_gaussians(0).opacity_logits);
        let after = self.without_a_trace(|fit| {
            let settings = &mut fit.settings;
            (settings.steps, settings.thinned) = (steps, Vec::new());
            (settings.coarse_until, settings.sh_interval, settings.dropout) = (0.0, 0.0, 0.0);
            (settings.poses.refine, settings.transients) = (false, false);
            (settings.density.strategy, settings.density.opacity_weight) = (StrategyKind::Keep, 0.0);
            let still = Rates { means: 0.0, scales: 0.0, quats: 0.0, sh: 0.0, exposure: 0.0, ..Rates::default() };
            settings.rates = Rates { power: 0.0, end: 1.0, ..still };
            let strategy = std::mem::replace(&mut fit.strategy, settings.density.strategy());
            let rounding = fit.rounding.take();
            fit.population = Population::new(&fit.population.to_gaussians(0));
            let faded = (0..steps).try_for_each(|step| fit.step().map(|_| done(step + 1))).and_then(|()| fit.fetch());
            (fit.strategy, fit.rounding) = (strategy, rounding);
            faded.map(|()| opacity(&fit.population.to_gaussians(0).opacity_logits))
        })?;
        let keep: Vec<bool> = before.iter().zip(&after).map(|(before, after)| *after >= FADED * before).collect();
        self.keep(&keep);
        Ok(keep.iter().filter(|keep| !**keep).count())
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
    fn asked(&self, rules: &CleaningRules) -> Vec<usize> {
        let all = self.photos();
        let pixels = |photo: usize| self.photo(photo).camera.width * self.photo(photo).camera.height;
        let most = (all * rules.pixels / (0..all).map(pixels).sum::<usize>()).clamp(LEAST_PHOTOS.min(all), all);
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

/// The part of a scene that a round removes.
#[derive(Debug)]
enum Part {
    /// Those that do the most harm, and half of all of it: junk before a Gaussian makes that one look harmful, too, or
    /// hides it.
    Worst,
    /// All, with the number of photos that show each, and whether there are many photos.
    All { shown: Vec<u32>, many: bool },
}

/// The Gaussians to remove in a round, `[N]`: those with the most against them first, of neighbors one alone; then
/// those that are needed least. Those that fewer witnesses show stay.
fn reasons(
    (found, witnesses): (&Evidence, u32),
    part: &Part,
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
        match part {
            Part::All { shown, .. } if shown[i] == 0 => Some((f64::NEG_INFINITY, i, Reason::Unseen)),
            Part::All { shown, many: true } if shown[i] == 1 => Some((f64::NEG_INFINITY, i, Reason::Lone)),
            _ if photos[i] < witnesses => None,
            _ if rises[i] < 0.0 && (all < 0.0 || most[i] <= NEEDED * -rises[i]) => Some((rises[i], i, Reason::Harmful)),
            _ if photos[i] > 2 && others < -rules.others * most[i] => Some((others, i, Reason::Contradicted)),
            Part::All { .. } => Some((all, i, Reason::Unneeded)),
            Part::Worst => None,
        }
    };
    let mut order: Vec<(f64, usize, Reason)> = (0..rises.len()).filter_map(reason).collect();
    let last = |reason| reason == Reason::Unneeded;
    order.sort_unstable_by(|a, b| last(a.2).cmp(&last(b.2)).then(a.0.total_cmp(&b.0)).then(a.1.cmp(&b.1)));
    let harm: f64 = order.iter().map(|(against, ..)| against).filter(|against| **against < 0.0).sum();
    let (mut reasons, mut taken) = (vec![None; rises.len()], vec![false; rises.len()]);
    let (mut done, mut needed, mut left) = (0.0, 0.0, (rules.part * rises.len() as f64) as usize);
    for (against, i, reason) in order {
        if matches!(reason, Reason::Unseen | Reason::Lone) {
            reasons[i] = Some(reason);
            continue;
        }
        let near = &neighbors[i * NEIGHBORS..][..NEIGHBORS];
        if left == 0 || matches!(part, Part::Worst) && done < WORST * harm {
            break;
        }
        if near.iter().any(|other| taken[*other as usize]) {
            continue;
        }
        if reason == Reason::Unneeded {
            needed += against;
            if needed > rules.rise * found.asked as f64 {
                break;
            }
        }
        (done, left, taken[i], reasons[i]) = (done + against, left - 1, true, Some(reason));
    }
    reasons
}
