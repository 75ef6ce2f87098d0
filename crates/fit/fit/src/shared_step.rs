//! Steps that look at several photos, which several processes may share.

use crate::FitError;
use crate::cameras::TWIST;
use crate::exposure;
use crate::fit::Fit;
use crate::gradients::GradientsMut;
use crate::host_step::{Look, PhotoLevel};
use crate::strategy::Moment;
use std::sync::Arc;
use weaver_kernels::random::fnv1a;
use weaver_ranks::{Ranks, joined};
use weaver_splat::GaussianStatistics;

/// Numbers of a row for the report of the step: the loss, the mean squared difference, the pairs.
const NUMBERS: usize = 3;
/// Numbers of a row for each photo: its gradient with respect to the color correction, its camera's twist, and 1 if
/// there is a twist.
const OWN: usize = exposure::NUMBERS + TWIST + 1;
/// Statistics of a Gaussian that are added, and statistics that take the largest.
const STATISTICS: [usize; 2] = [4, 2];
/// Times that processes compare their Gaussians in a run.
const COMPARISONS: usize = 30;

impl Fit {
    /// Shares the photos of each step ([`FitSettings::views_per_step`](crate::FitSettings::views_per_step)) with other
    /// processes, which hold the same fit and take the same steps: each draws some photos, and a binary tree over the
    /// photos sums the gradients, so that the bits do not depend on the number of processes.
    ///
    /// # Errors
    /// When there are more processes than photos in a step, and when they do not hold the same fit, on all of them.
    ///
    /// ```
    /// use weaver_fit::{Fit, FitSettings, Photo, init};
    /// use weaver_geometry::{Camera, Intrinsics, Pose};
    /// use weaver_ranks::threads;
    ///
    /// let intrinsics = Intrinsics { fx: 20.0, fy: 20.0, cx: 12.0, cy: 8.0 };
    /// let camera = Camera { pose: Pose::IDENTITY, intrinsics, width: 24, height: 16 };
    /// let rgb = vec![90; 3 * 24 * 16].into();
    /// let photos = vec![Photo { name: "gray".into(), camera, rgb, mask: None, lens: None }; 2];
    /// let settings = FitSettings { steps: 3, gaussians: 20, views_per_step: 2, ..FitSettings::default() };
    /// let initial = init::random(&photos, &settings)?;
    /// let fitted = |ranks| -> Result<_, weaver_fit::FitError> {
    ///     let mut fit = Fit::new(photos.clone(), &initial, settings.clone())?;
    ///     fit.share(ranks)?;
    ///     (0..3).try_for_each(|_| fit.step().map(drop))?;
    ///     Ok(fit.gaussians())
    /// };
    /// let run = |count| std::thread::scope(|scope| {
    ///     let threads: Vec<_> = threads(count).into_iter().map(|ranks| scope.spawn(|| fitted(ranks))).collect();
    ///     threads.into_iter().map(|thread| thread.join().unwrap()).collect::<Result<Vec<_>, _>>()
    /// });
    /// assert_eq!(run(2)?[1], run(1)?[0]);
    /// # Ok::<(), weaver_fit::FitError>(())
    /// ```
    pub fn share(&mut self, ranks: Arc<dyn Ranks>) -> Result<(), FitError> {
        self.settings.check_processes(ranks.size())?;
        let of = |text: String| fnv1a(text.bytes());
        let sizes = self.photos.iter().map(|photo| photo.level(0).0.camera).collect::<Vec<_>>();
        let parts = [
            ("settings", of(format!("{:?}", self.settings))),
            ("steps done", self.step as u64),
            ("cameras", of(format!("{sizes:?} {:?}", self.poses))),
            ("Gaussians", self.checksum()),
        ];
        for (key, word) in parts {
            if let Some(process) = ranks.other(word) {
                return Err(FitError::Process { process, key });
            }
        }
        self.ranks = ranks;
        Ok(())
    }

    /// The number of process 0, on all of them.
    pub(crate) fn agreed(&self, number: usize) -> usize {
        self.ranks.agreed(number as u64) as usize
    }

    /// Checks now and then that processes hold the same Gaussians: processors of different kinds may not come to the
    /// same bits.
    pub(crate) fn check_agreement(&self) -> Result<(), FitError> {
        let interval = self.settings.steps.div_ceil(COMPARISONS);
        let due = self.moment().multiple_of(interval).is_some() || self.step == self.settings.steps;
        if self.ranks.size() == 1 || !due {
            return Ok(());
        }
        let other = self.ranks.other(self.checksum());
        other.map_or(Ok(()), |process| Err(FitError::Process { process, key: "Gaussians" }))
    }

    fn checksum(&self) -> u64 {
        let numbers = self.population.fields().into_iter().flat_map(|(_, field)| field.slices()).flatten();
        fnv1a(numbers.flat_map(|x| x.to_le_bytes()))
    }

    /// Draws the views of a step that are this process's, and finds the mean gradients over all of the step; cameras
    /// and corrections take their steps. Returns the mean loss, the mean squared difference and the pairs.
    pub(crate) fn mean_gradients(&mut self, level: usize, moment: &Moment) -> Result<(f64, f64, u64), FitError> {
        let views = self.settings.views_per_step;
        let photos: Vec<usize> = (0..views).map(|view| self.photo_of(self.step * views + view)).collect();
        let drawn = self.activate(moment)?;
        let wanted = self.strategy.wants_statistics(moment);
        let layout = Layout { views, gaussians: self.population.len(), sh: self.population.sh.width(), wanted };
        let mut statistics = Vec::new();
        let ranks = self.ranks.clone();
        let row = |view: usize| -> Result<Vec<f32>, FitError> {
            let mut row = vec![0.0; layout.length()];
            let Row { numbers, own, gradients, sums, largest } = layout.parts(&mut row);
            statistics.clear();
            statistics.resize(if wanted { layout.gaussians } else { 0 }, GaussianStatistics::default());
            let into = wanted.then_some(&mut statistics[..]);
            let look = self.look(PhotoLevel { photo: photos[view], level }, drawn.as_ref(), moment, gradients, into)?;
            numbers.copy_from_slice(&[look.loss as f32, look.mse as f32, look.pairs as f32]);
            put_own(&look, &mut own[view * OWN..][..OWN]);
            put_statistics(&statistics, sums, largest);
            Ok(row)
        };
        let mut all = joined(&*ranks, views, row, |first, second| layout.join(first, second))?;
        let Row { numbers, own, gradients, sums, largest } = layout.parts(&mut all);
        let mean = 1.0 / views as f32;
        self.gradients.resize(&self.population);
        let to = self.gradients.parts_mut();
        let pairs = [
            (to.means, gradients.means),
            (to.quats, gradients.quats),
            (to.scales, gradients.scales),
            (to.opacities, gradients.opacities),
            (to.sh, gradients.sh),
        ];
        for (to, sum) in pairs {
            to.iter_mut().zip(sum).for_each(|(to, sum)| *to = *sum * mean);
        }
        self.strategy.regularizer(moment, self.population.len()).add(&mut self.gradients);
        add_statistics(&mut self.statistics, sums, largest);
        for (photo, own) in photos.iter().zip(own.chunks_exact(OWN)) {
            let look = look_of(own, !self.exposures.is_empty());
            self.follow_look(*photo, &look, moment);
        }
        let [loss, mse, pairs] = [numbers[0] * mean, numbers[1] * mean, numbers[2]].map(f64::from);
        Ok((loss, mse, pairs as u64))
    }
}

/// Places in a row of everything that processes pass on.
#[derive(Clone, Copy)]
struct Layout {
    views: usize,
    gaussians: usize,
    /// Numbers of the harmonics of a Gaussian.
    sh: usize,
    /// True if there are statistics.
    wanted: bool,
}

/// The parts of a row.
struct Row<'a> {
    numbers: &'a mut [f32],
    /// [`OWN`] numbers for each photo, which are zero in the rows of others.
    own: &'a mut [f32],
    gradients: GradientsMut<'a>,
    sums: &'a mut [f32],
    largest: &'a mut [f32],
}

impl Layout {
    /// Lengths of the parts.
    fn lengths(&self) -> [usize; 9] {
        let n = self.gaussians;
        let [sums, largest] = STATISTICS.map(|count| if self.wanted { count * n } else { 0 });
        [NUMBERS, self.views * OWN, 3 * n, 4 * n, 3 * n, n, self.sh * n, sums, largest]
    }

    fn length(&self) -> usize {
        self.lengths().iter().sum()
    }

    fn parts<'a>(&self, row: &'a mut [f32]) -> Row<'a> {
        let mut rest = row;
        let [numbers, own, means, quats, scales, opacities, sh, sums, largest] = self.lengths().map(|length| {
            let (part, after) = std::mem::take(&mut rest).split_at_mut(length);
            rest = after;
            part
        });
        Row { numbers, own, gradients: GradientsMut { means, quats, scales, opacities, sh }, sums, largest }
    }

    /// Adds a row to another; of the last part the larger numbers stay.
    fn join(&self, first: &mut [f32], second: &[f32]) {
        let added = self.length() - self.lengths()[8];
        let (sums, largest) = first.split_at_mut(added);
        sums.iter_mut().zip(second).for_each(|(a, b)| *a += b);
        largest.iter_mut().zip(&second[added..]).for_each(|(a, b)| *a = a.max(*b));
    }
}

fn put_own(look: &Look, to: &mut [f32]) {
    if let Some(gradient) = look.exposure {
        to[..exposure::NUMBERS].copy_from_slice(&gradient);
    }
    if let Some(twist) = look.twist {
        let to = &mut to[exposure::NUMBERS..];
        to.iter_mut().zip(twist).for_each(|(to, x)| *to = x as f32);
        to[TWIST] = 1.0;
    }
}

/// The part of a look that moves its photo's correction and camera.
fn look_of(own: &[f32], corrected: bool) -> Look {
    let exposure = corrected.then(|| std::array::from_fn(|i| own[i]));
    let twist = &own[exposure::NUMBERS..];
    let twist = (twist[TWIST] > 0.0).then(|| std::array::from_fn(|i| f64::from(twist[i])));
    Look { loss: 0.0, mse: 0.0, pairs: 0, exposure, twist }
}

fn put_statistics(statistics: &[GaussianStatistics<f32>], sums: &mut [f32], largest: &mut [f32]) {
    let [added, compared] = STATISTICS;
    let rows = sums.chunks_exact_mut(added).zip(largest.chunks_exact_mut(compared));
    for ((sums, largest), s) in rows.zip(statistics) {
        sums.copy_from_slice(&[s.screen_gradient, s.absgrad, s.views as f32, s.contribution]);
        largest.copy_from_slice(&[s.radius, s.largest_weight]);
    }
}

fn add_statistics(statistics: &mut [GaussianStatistics<f32>], sums: &[f32], largest: &[f32]) {
    let [added, compared] = STATISTICS;
    let rows = sums.chunks_exact(added).zip(largest.chunks_exact(compared));
    for (s, (sums, largest)) in statistics.iter_mut().zip(rows) {
        s.screen_gradient += sums[0];
        s.absgrad += sums[1];
        s.views += sums[2] as u32;
        s.contribution += sums[3];
        s.radius = s.radius.max(largest[0]);
        s.largest_weight = s.largest_weight.max(largest[1]);
    }
}

/// Bytes that a step passes each way between processes: gradients of so many Gaussians, with statistics.
pub fn bytes_per_step(gaussians: usize, sh_degree: usize) -> u64 {
    let layout = Layout { views: 0, gaussians, sh: 3 * weaver_geometry::sh::coefficients(sh_degree), wanted: true };
    4 * layout.length() as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Statistics that are sums are added, and of others the largest stay, whichever row they come from.
    #[test]
    fn rows_join_as_statistics_do() {
        let layout = Layout { views: 2, gaussians: 1, sh: 3, wanted: true };
        let seen = |views, radius, weight| GaussianStatistics {
            screen_gradient: 0.5,
            absgrad: 1.0,
            views,
            radius,
            contribution: 2.0,
            largest_weight: weight,
        };
        let row = |statistics| {
            let mut row = vec![1.0; layout.length()];
            let Row { sums, largest, .. } = layout.parts(&mut row);
            put_statistics(&[statistics], sums, largest);
            row
        };
        let mut all = row(seen(1, 3.0, 0.25));
        layout.join(&mut all, &row(seen(1, 2.0, 0.75)));
        let Row { own, sums, largest, .. } = layout.parts(&mut all);
        assert!(own.iter().all(|x| *x == 2.0) && own.len() == 2 * OWN);
        let mut statistics = [seen(4, 1.0, 0.5)];
        add_statistics(&mut statistics, sums, largest);
        let GaussianStatistics { screen_gradient, absgrad, views, radius, contribution, largest_weight } =
            statistics[0];
        assert_eq!((screen_gradient, absgrad, views, radius), (1.5, 3.0, 6, 3.0));
        assert_eq!((contribution, largest_weight), (6.0, 0.75));
        // 59 gradients and 6 statistics of a Gaussian, and 3 numbers.
        assert_eq!(bytes_per_step(1000, 3), 4 * (65_000 + 3));
    }
}
