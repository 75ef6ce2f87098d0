//! Runs whose steps several processes share, here as threads.

use super::{capture, settings};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use weaver_fit::Judge;
use weaver_ranks::{Ranks, threads};
use weaver_reconstruct::{Error, Run, RunSettings};
use weaver_splat::CpuRasterizer;

/// A run of `count` processes; the first one calls `first`, the others take part.
fn shared<R>(count: usize, first: impl FnOnce(Arc<dyn Ranks>) -> R) -> R {
    let mut all = threads(count).into_iter();
    let ranks = all.next().unwrap();
    std::thread::scope(|scope| {
        let others: Vec<_> = all.map(|ranks| scope.spawn(|| Run::take_part(Arc::new(CpuRasterizer), ranks))).collect();
        let done = first(ranks);
        others.into_iter().for_each(|other| other.join().unwrap().unwrap());
        done
    })
}

fn begun(out: &Path, settings: RunSettings, ranks: Arc<dyn Ranks>) -> Result<Run, Error> {
    let folder = Run::claim(out, [&settings.capture])?;
    Run::begin_shared(folder, settings, None, Judge::default(), Arc::new(CpuRasterizer), ranks)
}

/// Runs to the end, or until `until` steps are done.
fn advance(mut run: Run, until: usize) {
    let stop = AtomicBool::new(false);
    run.advance(&stop, |report| stop.store(report.step >= until, Ordering::Relaxed)).unwrap();
    if until == usize::MAX {
        run.finish().unwrap();
    }
}

/// The first process writes the same files as a single process, also where another number of them goes on; the
/// others write nothing.
///
/// Promise of `gradients_of_photos_are_averaged`.
#[test]
fn shared_runs_write_what_one_writes() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    capture(&path("data"), 6);
    let settings = || {
        let mut settings = settings(&path("data"));
        (settings.fit.views_per_step, settings.fit.exposure) = (3, true);
        settings
    };
    let scene = |out: &str| std::fs::read(path(out).join("scene.ply")).unwrap();
    let alone = Run::create(&path("alone"), settings(), None, Judge::default(), Arc::new(CpuRasterizer)).unwrap();
    advance(alone, usize::MAX);
    shared(3, |ranks| advance(begun(&path("three"), settings(), ranks).unwrap(), usize::MAX));
    shared(2, |ranks| advance(begun(&path("parts"), settings(), ranks).unwrap(), 7));
    shared(3, |ranks| {
        let judge = Judge::default();
        let run = Run::resume_shared(&path("parts"), judge, Arc::new(CpuRasterizer), ranks).unwrap();
        assert_eq!(run.fit().steps_done(), 7);
        advance(run, usize::MAX);
    });
    assert!(scene("three") == scene("alone") && scene("parts") == scene("alone"));
    // Given a time, the first process finds the number of steps.
    let timed = RunSettings { minutes: Some(0.02), ..settings() };
    shared(2, |ranks| advance(begun(&path("timed"), timed, ranks).unwrap(), usize::MAX));
    assert!(path("timed/summary.json").is_file());
}
