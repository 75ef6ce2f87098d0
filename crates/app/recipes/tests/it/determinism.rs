//! Same seed, same bits: at any number of threads, and across an interruption.

use crate::capture;
use weaver_recipes::SplatWeaverRecipe;
use weaver_trainer::{Config, Recipe, Session};

/// The preset as it is, on the built-in scenes: these are drawn by all threads, too.
fn config(steps: usize) -> Config<SplatWeaverRecipe> {
    let mut config = Config::resolve(Some("micro"), None, &[]).unwrap();
    config.rescale(steps);
    config
}

/// Runs a session to its end on so many threads.
fn finished<R: Recipe>(threads: usize, begun: impl FnOnce() -> Session<R> + Send) -> String {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let mut session = begun();
        while session.advance().unwrap().is_some() {}
        session.checksum()
    })
}

/// Checks that a run comes to the same bits on one thread, on three, and interrupted after each of these numbers of steps.
pub fn same_bits<R: Recipe>(config: impl Fn() -> Config<R> + Sync, stops: [usize; 3]) {
    let folder = tempfile::tempdir().unwrap();
    let checkpoint = |stop: usize| folder.path().join(format!("{stop}.safetensors"));
    let begun = || {
        let mut session = Session::new(config()).unwrap();
        for step in 1..=stops[2] {
            session.advance().unwrap();
            if stops.contains(&step) {
                session.save(&checkpoint(step)).unwrap();
            }
        }
        session
    };
    let whole = finished(1, begun);
    assert_eq!(finished(3, || Session::new(config()).unwrap()), whole);
    for stop in stops {
        let resumed = || {
            let session = Session::resume(config(), &checkpoint(stop)).unwrap();
            assert_eq!(session.steps().0, stop);
            session
        };
        assert_eq!(finished(2, resumed), whole, "stopped after {stop}");
    }
}

/// Promise of `the_number_of_threads_does_not_change_the_weights`.
#[test]
fn bits_do_not_depend_on_threads_or_interruptions() {
    // In the middle of each stage, and before the last step.
    same_bits(|| config(20), [3, 12, 19]);
}

#[test]
fn another_seed_is_another_run() {
    let run = |seed: u64| {
        let mut config = Config { seed, ..config(4) };
        config.data.folders = capture::folders();
        finished(1, || Session::new(config).unwrap())
    };
    assert_ne!(run(0), run(1));
}
