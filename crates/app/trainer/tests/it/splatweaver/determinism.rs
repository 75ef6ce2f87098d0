//! Same seed, same bits: at any number of threads, and across an interruption.

use crate::capture;
use crate::same_bits::{finished, same_bits};
use weaver_trainer::splatweaver::SplatWeaverRecipe;
use weaver_trainer::{Config, Session};

/// The preset as it is, on the built-in scenes: these are drawn by all threads, too.
fn config(steps: usize) -> Config<SplatWeaverRecipe> {
    let mut config = Config::resolve(Some("micro"), None, &[]).unwrap();
    config.rescale(steps);
    config
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
