//! Same seed, same bits: at any number of threads, and across an interruption.

use weaver_recipes::SplatWeaverRecipe;
use weaver_trainer::Session;

type Config = weaver_trainer::Config<SplatWeaverRecipe>;

fn config(steps: usize) -> Config {
    let mut config = Config::resolve(Some("micro"), None, &[]).unwrap();
    config.rescale(steps);
    config
}

fn checksum_after(config: Config, threads: usize) -> String {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let mut session = Session::new(config).unwrap();
        while session.advance().unwrap().is_some() {}
        session.checksum()
    })
}

#[test]
fn threads_do_not_change_a_bit() {
    assert_eq!(checksum_after(config(50), 1), checksum_after(config(50), 2));
}

#[test]
fn another_seed_is_another_run() {
    let other = Config { seed: 1, ..config(4) };
    assert_ne!(checksum_after(config(4), 1), checksum_after(other, 1));
}

#[test]
fn a_resumed_run_equals_an_uninterrupted_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.safetensors");
    // Interrupted in the middle of each stage.
    for stop in [3, 12] {
        let mut first = Session::new(config(20)).unwrap();
        for _ in 0..stop {
            first.advance().unwrap();
        }
        first.save(&path).unwrap();
        let mut second = Session::resume(config(20), &path).unwrap();
        assert_eq!(second.steps(), (stop, 20));
        for session in [&mut first, &mut second] {
            while session.advance().unwrap().is_some() {}
        }
        assert_eq!(first.checksum(), second.checksum(), "stopped after {stop}");
    }
}
