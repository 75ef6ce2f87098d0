//! The same bits, however a fit is run.

use crate::scenes::{cloud, finish, photos, plain};
use weaver_fit::{Fit, FitSettings, Population, StrategyKind};

const ALL: [StrategyKind; 3] = [StrategyKind::Split, StrategyKind::Mcmc, StrategyKind::Keep];

/// A fit with everything that has a state.
fn fit(strategy: StrategyKind) -> Fit {
    let mut settings = FitSettings { sh_degree: 2, coarse_until: 0.4, ..plain(strategy, 24, 70) };
    (settings.density.rounds, settings.density.from) = (8, 0.1);
    (settings.exposure, settings.poses.refine, settings.dropout) = (true, true, 0.2);
    Fit::new(photos(3, &cloud(60, 1)), &cloud(40, 2), settings).expect("a fit")
}

fn result(mut fit: Fit) -> (Population, Vec<weaver_geometry::Camera>) {
    finish(&mut fit);
    let cameras = (0..fit.photos()).map(|i| fit.camera(i)).collect();
    (fit.population().clone(), cameras)
}

#[test]
fn at_any_number_of_threads() {
    for strategy in ALL {
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
            pool.install(|| result(fit(strategy)))
        };
        let expected = run(1);
        assert!(run(2) == expected, "{strategy:?} at 2 threads");
        assert!(run(3) == expected, "{strategy:?} at 3 threads");
    }
}

#[test]
fn after_an_interruption_at_any_step() {
    for strategy in ALL {
        let expected = result(fit(strategy));
        let mut first = fit(strategy);
        for step in 0..24 {
            let mut second = fit(strategy);
            second.restore(&first.state()).expect("a state");
            assert_eq!(second.steps_done(), step);
            assert!(result(second) == expected, "{strategy:?} after step {step}");
            first.step().expect("a step");
        }
    }
}
