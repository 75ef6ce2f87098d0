//! Steps that look at several photos, by one process or, as threads, by several.

use crate::scenes::{cloud, finish, photos, plain};
use std::sync::Arc;
use weaver_fit::{Fit, FitSettings, Photo, Population, StrategyKind, steps_in};
use weaver_ranks::{Ranks, threads};

/// A fit with everything that has a state, of four of five photos a step.
fn fit(strategy: StrategyKind) -> Fit {
    let mut settings = FitSettings { sh_degree: 2, coarse_until: 0.4, ..plain(strategy, 16, 70) };
    settings.views_per_step = 4;
    (settings.density.rounds, settings.density.from) = (8, 0.1);
    (settings.exposure, settings.poses.refine, settings.dropout, settings.transients) = (true, true, 0.2, true);
    Fit::new(photos(5, &cloud(60, 1)), &cloud(40, 2), settings).expect("a fit")
}

type Outcome = (Population, Vec<weaver_geometry::Camera>, Vec<[f32; 12]>);

fn outcome(fit: &Fit) -> Outcome {
    let photos = 0..fit.photos();
    let exposures = photos.clone().map(|i| fit.exposure(i).expect("a correction").matrix).collect();
    (fit.population().clone(), photos.map(|i| fit.camera(i)).collect(), exposures)
}

/// Outcomes of each of some processes.
fn by<R: Send>(count: usize, run: impl Fn(Arc<dyn Ranks>) -> R + Sync) -> Vec<R> {
    std::thread::scope(|scope| {
        let run = &run;
        let threads: Vec<_> = threads(count).into_iter().map(|ranks| scope.spawn(move || run(ranks))).collect();
        threads.into_iter().map(|thread| thread.join().expect("a process")).collect()
    })
}

/// 1, 2, 3 and 4 processes come to the same bits, also where another number had begun.
///
/// Promise of `gradients_of_photos_are_averaged`.
#[test]
fn any_number_of_processes_comes_to_the_same_bits() {
    for strategy in [StrategyKind::Split, StrategyKind::Mcmc, StrategyKind::Keep] {
        let mut alone = fit(strategy);
        (0..5).for_each(|_| _ = alone.step().expect("a step"));
        let state = alone.state();
        finish(&mut alone);
        let expected = outcome(&alone);
        for count in [1, 2, 3, 4] {
            let whole = by(count, |ranks| {
                let mut fit = fit(strategy);
                fit.share(ranks).expect("the same fit");
                finish(&mut fit);
                outcome(&fit)
            });
            assert!(whole.iter().all(|found| *found == expected), "{strategy:?} by {count}");
            let rest = by(count, |ranks| {
                let mut fit = fit(strategy);
                fit.restore(&state).expect("a state");
                fit.share(ranks).expect("the same fit");
                finish(&mut fit);
                outcome(&fit)
            });
            assert!(rest.iter().all(|found| *found == expected), "{strategy:?} gone on with by {count}");
        }
    }
}

/// Promise (kept): a fit's steps of several photos go down their mean gradient, and come to the same bits by any
/// number of processes, also where another number had begun; processes that hold other fits are refused by name.
#[test]
fn gradients_of_photos_are_averaged() {
    let all = photos(2, &cloud(60, 1));
    let after = |photos: &[Photo]| {
        let mut settings = FitSettings { near: 0.0, ..plain(StrategyKind::Keep, 10, 70) };
        settings.views_per_step = photos.len();
        let mut fit = Fit::new(photos.to_vec(), &cloud(40, 2), settings).expect("a fit");
        let loss = fit.step().expect("a step").loss;
        // After one step, Adam's first moments are a tenth of the gradients.
        let moments: Vec<f32> = fit.population().fields().iter().flat_map(|(_, field)| field.first.clone()).collect();
        (loss, moments)
    };
    let [(loss, both), (one, first), (two, second)] = [&all[..], &all[..1], &all[1..]].map(after);
    assert!((loss - 0.5 * (one + two)).abs() < 1e-6, "{loss}, {one}, {two}");
    let largest = both.iter().fold(0.0, |most: f32, x| most.max(x.abs()));
    for (both, (first, second)) in both.iter().zip(first.iter().zip(&second)) {
        assert!((both - 0.5 * (first + second)).abs() < 1e-5 * largest, "{both}, {first}, {second}");
    }
}

/// Processes that hold other fits are refused, all of them with the process and the part that differs.
///
/// Promise of `gradients_of_photos_are_averaged`.
#[test]
fn processes_hold_the_same_fit() {
    let said = |change: &(dyn Fn(&mut Fit) + Sync)| {
        by(2, |ranks| {
            let mut fit = fit(StrategyKind::Keep);
            if ranks.rank() == 1 {
                change(&mut fit);
            }
            fit.share(ranks).expect_err("another fit").to_string()
        })
    };
    for (part, change) in [
        ("settings", (&|fit: &mut Fit| fit.set_steps(20)) as &(dyn Fn(&mut Fit) + Sync)),
        ("steps done", &|fit| _ = fit.step().expect("a step")),
    ] {
        let line = format!("process 1: {part}: expected that of process 0, found another");
        assert_eq!(said(change), [line.clone(), line]);
    }
    let many = by(5, |ranks| fit(StrategyKind::Keep).share(ranks).expect_err("too many").to_string());
    assert!(many.iter().all(|said| said.contains("at least one photo for each of 5 processes, found 4")), "{many:?}");
}

/// Processes of different speed make as many steps as the first one has time for.
#[test]
fn processes_agree_about_steps_in_a_time() {
    let found = by(2, |ranks| {
        let mut fit = fit(StrategyKind::Keep);
        let seconds = if ranks.rank() == 0 { 0.5 } else { 50.0 };
        fit.share(ranks).expect("the same fit");
        steps_in(&mut fit, seconds).expect("steps")
    });
    assert!(found[0] == found[1], "{found:?}");
}
