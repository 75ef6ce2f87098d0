//! Runs that go on for as long as held-out photos gain.

use crate::{capture, settings};
use serde_json::Value;
use std::ops::ControlFlow;
use std::path::Path;
use weaver_io::{Bitmap, Observe, Part};
use weaver_reconstruct::{FitContext, FitRequest, Gaining, Outcome, RunSettings, fit, resume};

/// The most Gaussians.
const MOST: usize = 150;
/// Steps to the first end.
const STEPS: usize = 60;
/// Gain that is worth twice the steps, dB: at least 0.2 from the gains of all ends, which differ between processors.
const WORTH: f64 = 1.2;

/// An observer that ends the fit after a step.
struct Until(usize);

impl Observe for Until {
    fn progress(&mut self, part: &Part) -> ControlFlow<()> {
        if part.label == "fit" && part.done >= self.0 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

fn begun(data: &Path, out: &Path, observe: &mut dyn Observe) -> Outcome {
    fitted(settings(data), out, observe)
}

fn fitted(settings: RunSettings, out: &Path, observe: &mut dyn Observe) -> Outcome {
    let gaining = Gaining { worth: WORTH, most_gaussians: Some(MOST), ..Gaining::default() };
    let mut settings = RunSettings { gaining: Some(gaining), ..settings };
    settings.fit.steps = STEPS;
    let request = FitRequest { out: out.into(), settings, gaussians: Some(100), estimate: None, read: Vec::new() };
    fit(request, FitContext::default(), observe).unwrap()
}

/// Steps, Gaussians and held-out PSNR of the ends of a run.
fn ends(out: &Path) -> Vec<(usize, usize, f64)> {
    let file: Value = serde_json::from_str(&std::fs::read_to_string(out.join("run.json")).unwrap()).unwrap();
    let ends = file["gaining"]["ends"].as_array().unwrap();
    let whole = |value: &Value| value.as_u64().unwrap() as usize;
    ends.iter().map(|end| (whole(&end["steps"]), whole(&end["gaussians"]), end["psnr"].as_f64().unwrap())).collect()
}

/// Promise (scenes): a fit of the best quality goes on to twice its steps for as long as held-out photos gain, and its
/// scene is the one that met them best.
#[test]
fn the_best_quality_ends_when_photos_stop_gaining() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out) = (folder.path().join("data"), folder.path().join("out"));
    capture(&data, 16);
    let outcome = begun(&data, &out, &mut ());
    let ends = ends(&out);
    assert!(ends.len() >= 3, "{ends:?}");
    assert!(ends.windows(2).all(|pair| pair[1].0 == 2 * pair[0].0 && pair[1].1 == MOST), "{ends:?}");
    let gains: Vec<f64> = ends.windows(2).map(|pair| pair[1].2 - pair[0].2).collect();
    let (last, before) = gains.split_last().unwrap();
    assert!(before.iter().all(|gain| *gain >= WORTH) && (0.0..WORTH).contains(last), "{gains:?}");
    let (met, end) = (outcome.test.unwrap().quality.psnr, ends[ends.len() - 1]);
    assert!((met - end.2).abs() < 1e-3 && outcome.steps == end.0, "{met} after {} of {ends:?}", outcome.steps);
    assert!(!out.join("before.safetensors").exists());
    // A run that is at its end stays there.
    let again = resume(&out, FitContext::default(), &mut ()).unwrap();
    assert_eq!((again.steps, crate::gaining::ends(&out)), (outcome.steps, ends));
}

/// Promise (scenes): where held-out photos lose, a fit of the best quality ends with the scene as it was before.
#[test]
fn the_best_quality_goes_back_to_what_was_better() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out) = (folder.path().join("data"), folder.path().join("out"));
    capture(&data, 16);
    // Noise that no two photos share: the two that are fitted are learned by heart.
    for n in 0..16 {
        let noise = |i: usize| ((i + 4001 * n).wrapping_mul(2_654_435_761) >> 24) as u8;
        let photo = Bitmap { width: 40, height: 32, pixels: (0..3 * 40 * 32).map(noise).collect() };
        photo.write_png(data.join(format!("images/{n:02}.png"))).unwrap();
    }
    let outcome = fitted(RunSettings { views: Some(2), ..settings(&data) }, &out, &mut ());
    let ends = ends(&out);
    let [.., before, last] = ends.as_slice() else { panic!("{ends:?}") };
    let met = outcome.test.unwrap().quality.psnr;
    assert!(last.2 < before.2, "{ends:?}");
    assert!((met - before.2).abs() < 1e-3 && outcome.steps == before.0, "{met} after {} of {ends:?}", outcome.steps);
}

/// Promise (scenes): a fit of the best quality that was interrupted in any part comes to the same bits.
#[test]
fn the_best_quality_goes_on_after_an_interruption() {
    let folder = tempfile::tempdir().unwrap();
    let (data, whole) = (folder.path().join("data"), folder.path().join("whole"));
    capture(&data, 16);
    begun(&data, &whole, &mut ());
    for stop in [STEPS / 3, STEPS, STEPS * 8 / 5] {
        let cut = folder.path().join(stop.to_string());
        begun(&data, &cut, &mut Until(stop));
        resume(&cut, FitContext::default(), &mut ()).unwrap();
        assert_eq!(ends(&cut), ends(&whole));
        let [a, b] = [&whole, &cut].map(|out| std::fs::read(out.join("scene.ply")).unwrap());
        assert!(a == b, "stopped at {stop}");
    }
}
