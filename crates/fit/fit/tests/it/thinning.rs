//! Runs that leave out steps.

use crate::scenes::{cloud, photos, plain};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use weaver_fit::{Fit, FitSettings, Moment, Population, Strategy, StrategyKind, Thinning};
use weaver_splat::{CpuRasterizer, GaussianStatistics};

/// Steps of the runs, numbered throughout.
const STEPS: usize = 60;

/// A strategy that counts its rounds, ten of any run.
#[derive(Debug)]
struct Counting(Arc<AtomicUsize>);

impl Strategy for Counting {
    fn wants_statistics(&self, _: &Moment) -> bool {
        false
    }

    fn is_due(&self, moment: &Moment) -> bool {
        moment.multiple_of(moment.steps / 10).is_some()
    }

    fn adapt(&mut self, _: &Moment, _: &mut Population, _: &[GaussianStatistics<f32>]) -> bool {
        self.0.fetch_add(1, Ordering::Relaxed);
        false
    }
}

/// Promise (fits): a run that leaves out steps has all its rounds, and its settings lead to the same bits after any
/// stop.
#[test]
fn thinned_runs_have_all_their_rounds() {
    for kept in [[None, None], [Some(30), None], [Some(30), Some(10)], [Some(1), None], [Some(7), Some(30)]] {
        let rounds = Arc::new(AtomicUsize::new(0));
        let strategy = Box::new(Counting(rounds.clone()));
        let settings = plain(StrategyKind::Keep, STEPS, 20);
        let fit = Fit::with(Arc::new(CpuRasterizer), strategy, photos(3, &cloud(9, 1)), &cloud(5, 2), settings);
        let (mut fit, mut taken, mut expected) = (fit.expect("a fit"), 0, STEPS);
        while fit.steps_done() < STEPS {
            let due = [12, 20].iter().position(|at| *at == taken).and_then(|i| kept[i]);
            if let Some(kept) = due {
                fit.leave_out(kept, None);
                expected = taken + kept.min(STEPS - fit.steps_done());
            }
            fit.step().expect("a step");
            taken += 1;
        }
        assert_eq!((fit.steps_done(), taken), (STEPS, expected), "{kept:?}");
        assert_eq!(fit.settings().left_out(STEPS), STEPS - taken, "{kept:?}");
        let passed = rounds.load(Ordering::Relaxed);
        // One step takes the place of all that are left: their rounds are one.
        assert!(passed == 10 || taken < 20, "{kept:?}: {passed} rounds");
    }
}

/// Settings that name the steps that are left out lead to the same bits, after an interruption at any step as
/// well.
///
/// Promise of `thinned_runs_have_all_their_rounds`.
#[test]
fn thinned_runs_go_on_to_the_same_bits() {
    for strategy in [StrategyKind::Split, StrategyKind::Mcmc] {
        let mut settings = FitSettings { coarse_until: 0.4, transients: true, ..plain(strategy, 40, 70) };
        settings.density.rounds = 8;
        settings.thinned = vec![Thinning::new(9, 20), Thinning::new(21, 7)];
        let begun = || Fit::new(photos(3, &cloud(60, 1)), &cloud(40, 2), settings.clone()).expect("a fit");
        let finished = |mut fit: Fit| {
            let mut numbers = vec![fit.steps_done()];
            while fit.steps_done() < 40 {
                numbers.push(fit.step().expect("a step").step);
            }
            (numbers, fit.population().clone())
        };
        let (numbers, expected) = finished(begun());
        assert!(numbers.len() < 28 && numbers.is_sorted_by(|a, b| a < b), "{numbers:?}");
        let mut first = begun();
        for number in numbers.iter().take(numbers.len() - 1) {
            let mut second = begun();
            second.restore(&first.state()).expect("a state");
            assert_eq!(second.steps_done(), *number);
            assert!(finished(second).1 == expected, "{strategy:?} after step {number}");
            first.step().expect("a step");
        }
    }
}

/// Promise (fits): steps that cannot be left out are refused with the key.
#[test]
fn impossible_thinnings_are_refused() {
    let of = |thinned: &[[usize; 2]]| {
        let thinned = thinned.iter().map(|[at, kept]| Thinning::new(*at, *kept)).collect();
        FitSettings { thinned, ..plain(StrategyKind::Keep, 10, 20) }.check()
    };
    assert!(of(&[]).is_ok() && of(&[[0, 1], [9, 100]]).is_ok());
    for wrong in [&[[10, 1]][..], &[[3, 0]], &[[5, 1], [4, 1]], &[[5, 1], [5, 1]]] {
        let error = of(wrong).expect_err("refused").to_string();
        assert!(error.starts_with("thinned: expected"), "{wrong:?}: {error}");
    }
}
