//! The bits of a run, for any threads and interruptions.

use weaver_trainer::{Config, Recipe, Session};

/// Runs a session to its end on `threads` threads.
pub fn finished<R: Recipe>(threads: usize, begun: impl FnOnce() -> Session<R> + Send) -> String {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let mut session = begun();
        while session.advance().unwrap().is_some() {}
        session.checksum()
    })
}

/// Checks that a run comes to the same bits on one thread, on three, and interrupted after each of these numbers of
/// steps.
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
