//! Runs that are timed.

use crate::scenes::{cloud, photos, plain};
use std::sync::Arc;
use std::thread::sleep;
use std::time::{Duration, Instant};
use weaver_fit::{Fit, Moment, Population, Rehearsal, Strategy, StrategyKind};
use weaver_splat::{CpuRasterizer, GaussianStatistics};

/// Milliseconds of a round.
const ROUND: u64 = 20;

/// A strategy whose rounds, five of any run, take long.
#[derive(Debug)]
struct Slow;

impl Strategy for Slow {
    fn wants_statistics(&self, _: &Moment) -> bool {
        false
    }

    fn is_due(&self, moment: &Moment) -> bool {
        moment.step.is_multiple_of(moment.steps / 5)
    }

    fn adapt(&mut self, _: &Moment, _: &mut Population, _: &[GaussianStatistics<f32>]) -> bool {
        sleep(Duration::from_millis(ROUND));
        false
    }
}

/// Promise (scenes): the time of density control and searches is counted apart from the time of steps, and a long run
/// has more of it.
#[test]
fn rounds_are_no_part_of_steps() {
    let settings = plain(StrategyKind::Keep, 1000, 20);
    let fit = Fit::with(Arc::new(CpuRasterizer), Box::new(Slow), photos(2, &cloud(9, 1)), &cloud(5, 2), settings);
    let mut fit = fit.expect("a fit");
    for seconds in [0.0, 1.0] {
        let start = Instant::now();
        let found = Rehearsal::of(&mut fit, seconds).expect("a rehearsal");
        let rounds = 5.0 * ROUND as f64 / 1000.0;
        // A sleep takes no less than its length.
        assert!(found.rounds >= rounds, "{found:?}");
        // The shortest run alone has 30 steps; rounds that counted twice would make them longer than all of it.
        let all = start.elapsed().as_secs_f64();
        assert!(seconds > 0.0 || found.seconds(30) <= all, "{found:?} of {all} s");
    }
    assert_eq!(fit.steps_done(), 0);
}
