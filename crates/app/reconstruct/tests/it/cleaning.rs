//! Gaussians that no photo needs.

use crate::{capture, settings};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use weaver_fit::{Judge, StrategyKind};
use weaver_reconstruct::{Initial, Outcome, Run, RunSettings};
use weaver_splat::CpuRasterizer;

/// Promise (fits): a fit that cleans says what it removed, and what became of held-out photos, also after a stop.
#[test]
fn what_is_removed_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    capture(&data, 10);
    let mut given = {
        let settings = RunSettings { init: Initial::Random, ..settings(&data) };
        let out = folder.path().join("first");
        Run::create(&out, settings, None, Judge::default(), Arc::new(CpuRasterizer)).unwrap().fit().gaussians()
    };
    // Far below the last bit of a pixel.
    let hidden = 5;
    given.opacity_logits[..hidden].fill(-12.0);
    let scene = |name: &str, clean: bool, stop_at: usize| -> Outcome {
        let out = folder.path().join(name);
        let mut settings = RunSettings { init: Initial::Given, ..settings(&data) };
        (settings.fit.clean, settings.fit.density.strategy) = (clean, StrategyKind::Keep);
        let mut run = Run::create(&out, settings, Some(&given), Judge::default(), Arc::new(CpuRasterizer)).unwrap();
        let stop = AtomicBool::new(false);
        run.advance(&stop, |report| stop.store(report.step == stop_at, Ordering::Relaxed)).unwrap();
        if stop_at > 0 {
            drop(run);
            run = Run::resume(&out, Judge::default(), Arc::new(CpuRasterizer)).unwrap();
            run.advance(&AtomicBool::new(false), |_| {}).unwrap();
        }
        run.finish().unwrap()
    };
    let whole = scene("whole", true, 0);
    let cleaning = whole.cleaning.expect("something was removed");
    assert!(cleaning.removed.unseen >= hidden && cleaning.held_out.is_some(), "{cleaning}");
    assert_eq!(whole.gaussians, given.len() - cleaning.removed.count());
    assert_eq!(scene("stopped", true, 18).cleaning, whole.cleaning);
    assert_eq!(scene("ended", true, 20).cleaning, whole.cleaning);
    let without = scene("without", false, 0);
    assert_eq!((without.cleaning, without.gaussians), (None, given.len()));
}
