//! A run that is to end in its time, however fast the machine turns out to be.

use weaver_fit::{FitSettings, Rehearsal};

/// Moments of a run at which its pace is compared with the rehearsed one.
const MOMENTS: usize = 20;
/// Weight of the last moment in the pace: other work comes and goes, and a scene gets slower to draw.
const SMOOTHED: f64 = 0.4;
/// A change of the steps that are left by less than this part is not worth it.
const WORTH: f64 = 0.02;

/// The pace of a run that is to end in its time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Keeping {
    rehearsal: Rehearsal,
    /// Seconds of the whole run, and of its results by the rehearsal.
    pub seconds: f64,
    pub results: f64,
    /// The least steps that are taken.
    least: usize,
    /// The most Gaussians, where fewer steps mean fewer of them.
    pub gaussians: Option<usize>,
    /// Number of the last step that was compared, and seconds of the run then.
    compared: usize,
    then: f64,
    /// Seconds of a step over the rehearsed ones, smoothed over the last moments.
    slower: Option<f64>,
}

impl Keeping {
    /// The pace of a run that was rehearsed and whose steps begin now, `began` seconds after the run itself.
    pub fn new(rehearsal: Rehearsal, [seconds, results, began]: [f64; 3], least: usize) -> Self {
        Self { rehearsal, seconds, results, least, gaussians: None, compared: 0, then: began, slower: None }
    }

    /// Number of the remaining steps to take, where there are too many or too few for the remaining time: `now` is the
    /// time of the run after `done` of its steps.
    ///
    /// A machine that is slower than it was rehearsed to be makes fewer steps, and more again once it is faster; never
    /// more than were planned.
    pub fn kept(&mut self, settings: &FitSettings, done: usize, now: f64) -> Option<usize> {
        let (steps, moment) = (settings.steps, |step: usize| step * MOMENTS / settings.steps.max(1));
        if done >= steps || moment(done) == moment(self.compared) {
            return None;
        }
        let part = |step: usize| step as f64 / steps as f64;
        let left_out = |from: usize, to: usize| settings.left_out(to) - settings.left_out(from);
        let taken = 1.0 - left_out(self.compared, done) as f64 / (done - self.compared) as f64;
        let [of_steps, of_rounds] = self.rehearsal.between(part(self.compared), part(done), steps);
        let last = (now - self.then) / (taken * of_steps + of_rounds).max(1e-9);
        let slower = self.slower.map_or(last, |slower| slower + SMOOTHED * (last - slower));
        (self.compared, self.then, self.slower) = (done, now, Some(slower));
        let [of_steps, of_rounds] = self.rehearsal.between(part(done), 1.0, steps).map(|seconds| slower * seconds);
        let left = self.seconds - now - self.results * slower.max(1.0) - of_rounds;
        let rest = steps - done;
        let in_time = rest as f64 * (left / of_steps.max(1e-9)).clamp(0.0, 1.0);
        let least = self.least.saturating_sub(done - settings.left_out(done)).max(1);
        let kept = (in_time as usize).max(least).min(rest);
        let planned = rest - left_out(done, steps);
        (kept.abs_diff(planned) as f64 > WORTH * rest as f64).then_some(kept)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A run of 1000 steps at a second of a machine that is `slower(second)` times as slow as rehearsed, and its
    /// seconds.
    fn run(least: usize, slower: impl Fn(f64) -> f64) -> (FitSettings, f64) {
        let mut settings = FitSettings { steps: 1000, ..FitSettings::default() };
        let rehearsal = Rehearsal::even(0.01, 1.0);
        let mut keeping = Keeping::new(rehearsal, [13.0, 1.0, 0.5], least);
        let (mut done, mut now, mut numbers) = (0, 0.5, 0);
        while done < settings.steps {
            let before = done;
            let last = settings.thinned.last().copied();
            done = last.map_or(done + 1, |thinning| thinning.next(done, 1000));
            numbers += 1;
            now += slower(now) * (0.01 + 0.001 * (done - before) as f64);
            if let Some(kept) = keeping.kept(&settings, done, now) {
                settings.thinned.push(weaver_fit::Thinning::new(done, kept));
            }
        }
        assert_eq!(settings.left_out(1000), 1000 - numbers);
        (settings, now + slower(now))
    }

    /// Promise (fits): a machine as fast as rehearsed takes all steps; a slower one leaves out as many as end the run
    /// in time, but for the least.
    #[test]
    fn slower_machines_leave_out_steps() {
        let (settings, seconds) = run(1, |_| 1.0);
        assert!(settings.thinned.is_empty() && seconds < 12.6, "{seconds}");
        for slower in [1.3, 2.0, 4.0] {
            let (settings, seconds) = run(1, |_| slower);
            assert!((12.0..13.3).contains(&seconds) && settings.left_out(1000) > 100, "{slower}: {seconds}");
        }
        // Other work comes in the middle, or has gone by then.
        let (settings, seconds) = run(1, |now| if now > 6.0 { 2.0 } else { 1.0 });
        assert!((12.0..14.0).contains(&seconds) && settings.left_out(1000) > 100, "{seconds}");
        let (settings, seconds) = run(1, |now| if now < 4.0 { 2.0 } else { 1.0 });
        assert!((11.0..13.3).contains(&seconds) && settings.left_out(1000) < 300, "{seconds}");
    }

    /// However slow a machine is, the least steps are taken.
    ///
    /// Promise of `slower_machines_leave_out_steps`.
    #[test]
    fn least_steps_are_taken_of_any_time() {
        let (settings, _) = run(800, |_| 10.0);
        assert_eq!(settings.left_out(1000), 200);
        let (settings, _) = run(2000, |_| 10.0);
        assert_eq!(settings.left_out(1000), 0);
    }
}
