//! Runs of small mixtures on small films.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use weaver_dynamic::run::{
    DerivedFrom, Evaluation, ExpertKind, FilmSource, KeepBy, Preset, Run, RunError, RunSettings, Scores, Stage,
};
use weaver_io::safetensors::Tensors;
use weaver_run::Folder;

fn settings(experts: &[ExpertKind], steps: usize) -> RunSettings {
    let stages = (0..experts.len()).map(|index| Stage::Expert { index, steps }).chain([Stage::Router { steps }]);
    RunSettings {
        film: FilmSource::Procedural { seed: 3, size: [32, 24], shots: [3, 8] },
        experts: experts.to_vec(),
        preset: Preset::Tiny,
        gaussians: 150,
        all: false,
        stages: stages.collect(),
        temperature: 1.0,
        background_weight: 1.0,
        seed: 5,
        save_every: 1e9,
        derived_from: None,
    }
}

fn trained(folder: &Path, settings: RunSettings) -> Run {
    let mut run = Run::create(folder, settings, None).unwrap();
    assert!(run.advance(&AtomicBool::new(false), |_| {}).unwrap());
    run
}

/// All parameters of a run, as bits.
fn bits(run: &Run) -> Vec<u32> {
    run.params().iter().flat_map(|(_, param)| param.value().iter().map(|x| x.to_bits()).collect::<Vec<_>>()).collect()
}

fn evaluation(run: &Run) -> Evaluation {
    run.evaluate(|_, _| {}).unwrap()
}

/// A stop in the middle of every stage, and another number of threads: the same bits.
///
/// Promise of `each_stage_trains_what_it_names`.
#[test]
fn a_run_that_was_stopped_goes_on_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let settings = settings(&ExpertKind::ALL, 4);
    let whole = trained(&folder.path().join("whole"), settings.clone());
    let parts = folder.path().join("parts");
    Run::create(&parts, settings, None).unwrap();
    let threads = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    let mut stops = 0;
    let resumed = threads.install(|| {
        loop {
            let mut run = Run::resume(&parts).unwrap();
            let (stop, mut seen) = (AtomicBool::new(false), 0);
            let complete = run.advance(&stop, |_| {
                seen += 1;
                stop.store(seen == 3, Ordering::Relaxed);
            });
            if complete.unwrap() {
                return run;
            }
            stops += 1;
        }
    });
    assert!(stops >= 6 && bits(&whole) == bits(&resumed));
    assert!(matches!(Run::resume(&parts), Err(RunError::Run(weaver_run::Error::Complete { .. }))));
    assert_eq!(bits(&Run::open(&parts).unwrap()), bits(&whole));
}

/// A checkpoint has the scene of the run that wrote it; a moving one differs from time to time.
#[test]
fn a_checkpoint_is_a_scene_at_any_time() {
    let folder = tempfile::tempdir().unwrap();
    let mut run = Run::create(folder.path(), settings(&[ExpertKind::Keys, ExpertKind::Poly], 4), None).unwrap();
    let scenes = run.scenes();
    let stop = AtomicBool::new(false);
    run.advance(&stop, |step| stop.store(step.step == 6, Ordering::Relaxed)).unwrap();
    let state = Tensors::read(folder.path().join(Folder::CHECKPOINT)).unwrap();
    let [first, middle] = [0.0, 0.5].map(|time| scenes(&state, time).unwrap());
    let moments = run.moments(run.expert_at_hand());
    assert!(first == moments(0.0) && middle == moments(0.5) && first.means != middle.means);
    assert_eq!(middle.len(), run.mixture().counts()[1]);
    let near: Vec<usize> = run.shots_near(0.5).iter().map(|shot| shot.viewpoint).collect();
    assert!(near == [0, 1, 2] && run.shots_near(0.5).iter().all(|shot| (shot.time - 0.5).abs() < 0.1));
}

/// Every stage lowers its loss, and a stage changes the parameters of its own expert only.
///
/// Promise (results): a mixture of moving Gaussians: each stage trains the parts that it names, at decaying rates,
/// stops anywhere and goes on to the same bits at any number of threads; pruning keeps the most valuable Gaussians.
#[test]
fn each_stage_trains_what_it_names() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run");
    let settings = settings(&[ExpertKind::Keys, ExpertKind::Poly], 60);
    let mut run = Run::create(&path, settings, None).unwrap();
    let mut losses: Vec<(String, f64)> = Vec::new();
    run.advance(&AtomicBool::new(false), |step| losses.push((step.stage.clone(), step.loss))).unwrap();
    for (name, most) in [("keys", 0.8), ("poly", 0.8), ("router", 1.02)] {
        let own: Vec<f64> = losses.iter().filter(|(stage, _)| stage == name).map(|(_, loss)| *loss).collect();
        let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
        let [first, last] = [mean(&own[..12]), mean(&own[48..])];
        assert!(own.len() == 60 && last < most * first, "{name}: {first} {last}");
    }
    // A student moves away from its teacher: the next step draws its learned parameters.
    let green = RunSettings { stages: vec![Stage::Router { steps: 30 }], ..run.settings().clone() };
    let green = trained(&folder.path().join("green"), green);
    let stages = vec![Stage::Distil { index: 0, steps: 60, lambda: 0.5 }];
    let settings = RunSettings { stages, ..green.settings().clone() };
    let mut student = Run::create(&folder.path().join("student"), settings, Some(green.tensors())).unwrap();
    let mut losses = Vec::new();
    student.advance(&AtomicBool::new(false), |step| losses.push(step.loss)).unwrap();
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    // With the teacher's parameters in the drawing, it would not fall.
    assert!(mean(&losses[48..]) < 0.9 * mean(&losses[..12]), "{losses:?}");

    let before = Run::open(&path).unwrap();
    let stages = vec![Stage::Distil { index: 1, steps: 2, lambda: 0.5 }];
    let settings = RunSettings { stages, ..before.settings().clone() };
    let mut other = Run::create(&folder.path().join("on"), settings, Some(before.tensors())).unwrap();
    other.advance(&AtomicBool::new(false), |_| {}).unwrap();
    for ((_, a), (_, b)) in before.params().iter().zip(other.params().iter()) {
        assert_eq!(a.value() != b.value(), a.name().starts_with("poly."), "{}", a.name());
    }
}

#[test]
fn figures_fit_together_and_a_report_shows_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run");
    let run = trained(&path, settings(&[ExpertKind::Keys, ExpertKind::Keys], 30));
    let found = evaluation(&run);
    assert_eq!(found.experts, ["keys", "keys-2"]);
    // Three cameras, the middle one held out; eight frames, the third and the seventh held out.
    let shots = |scores: &Option<Scores>| scores.as_ref().unwrap().shots;
    let all = [&found.held_out_cameras, &found.held_out_times, &found.held_out_both, &found.trained];
    assert_eq!(all.map(shots), [6, 4, 2, 12]);
    for scores in all.into_iter().flatten() {
        assert!((scores.shares.iter().sum::<f64>() - 1.0).abs() < 1e-5);
        let best = scores.experts.iter().map(|quality| quality.psnr).fold(0.0, f64::max);
        assert!(scores.oracle.psnr >= best && scores.mixture.psnr > best - 3.0);
        assert!((0.0..=1.0).contains(&scores.right));
    }
    let pixels: usize = found.motions.iter().map(|motion| motion.pixels).sum();
    assert_eq!(pixels, 12 * 32 * 24);
    run.report(&found).unwrap();
    let page = std::fs::read_to_string(path.join("report.html")).unwrap();
    for text in ["keys-2", "oracle", "held-out cameras", "loss, router", "In the gate: keys orange, keys-2 blue"] {
        assert!(page.contains(text), "{text}");
    }
    // Photos, mixture, differences, gate, and each expert.
    assert_eq!(page.matches("<img ").count(), 6);
    let told = std::fs::read_to_string(path.join("summary.json")).unwrap();
    assert_eq!(told.trim_end(), serde_json::to_string_pretty(&found).unwrap());
}

/// Promise of `each_stage_trains_what_it_names`.
#[test]
fn pruning_keeps_what_is_worth_most() {
    let folder = tempfile::tempdir().unwrap();
    let run = trained(&folder.path().join("run"), settings(&[ExpertKind::Code, ExpertKind::Poly], 40));
    let before = evaluation(&run).trained.unwrap().mixture.psnr;
    let smaller = |keep: f64, by: KeepBy| {
        let derived_from = Some(DerivedFrom { from: "run".into(), by: by.to_string() });
        let settings = RunSettings { stages: vec![Stage::Router { steps: 2 }], derived_from, ..run.settings().clone() };
        let tensors = run.pruned(keep, by, |_, _| {}).unwrap();
        let folder = folder.path().join(format!("{by}-{keep}"));
        let mut smaller = Run::create(&folder, settings, Some(tensors)).unwrap();
        let psnr = evaluation(&smaller).trained.unwrap().mixture.psnr;
        smaller.advance(&AtomicBool::new(false), |_| {}).unwrap();
        (smaller.mixture().counts().iter().sum::<usize>(), psnr)
    };
    assert_eq!(smaller(1.0, KeepBy::Contribution), (300, before));
    let (half, by_worth) = smaller(0.5, KeepBy::Contribution);
    let (_, by_chance) = smaller(0.5, KeepBy::Chance);
    assert_eq!((half, smaller(0.5, KeepBy::Sensitivity).0), (150, 150));
    assert!(by_worth > by_chance && by_worth > before - 3.0, "{before} {by_worth} {by_chance}");
    for keep in [0.0, -1.0, 1.5, f64::NAN] {
        let error = run.pruned(keep, KeepBy::Contribution, |_, _| {}).unwrap_err().to_string();
        assert!(error.contains("keep: expected above 0, at most 1"), "{error}");
    }
}

/// On all photos: held-out ones are trained on, and the run says so.
///
/// Promise of `photos_that_are_not_kept_are_read_when_needed`.
#[test]
fn nothing_is_held_out_where_all_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let some = settings(&[ExpertKind::Keys, ExpertKind::Poly], 5);
    let all = RunSettings { all: true, ..some.clone() };
    let [some, all] =
        [("some", some), ("all", all)].map(|(name, settings)| trained(&folder.path().join(name), settings));
    assert_eq!([some.training(), all.training()], [some.film().training(), (0..some.film().shots.len()).collect()]);
    assert!(some.film().remarks.is_empty() && all.film().remarks[0].contains("judge nothing"));
    // Other photos are drawn, and other parameters learned.
    assert!(bits(&some) != bits(&all));
}

#[test]
fn what_cannot_be_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run");
    let good = settings(&[ExpertKind::Keys, ExpertKind::Poly], 2);
    let refused = |settings: RunSettings| {
        let error = Run::create(&path, settings, None).unwrap_err().to_string();
        assert!(!path.exists(), "{error}");
        error
    };
    let single = RunSettings { experts: vec![ExpertKind::Keys], ..good.clone() };
    assert_eq!(refused(single), "experts: expected at least two, found keys");
    let cold = RunSettings { temperature: 0.0, ..good.clone() };
    assert_eq!(refused(cold), "temperature: expected a positive number, found 0");
    let few = RunSettings { gaussians: 3, ..good.clone() };
    assert_eq!(refused(few), "gaussians: expected at least 32, found 3");
    let stage = Stage::Distil { index: 0, steps: 1, lambda: 2.0 };
    assert_eq!(refused(RunSettings { stages: vec![stage], ..good.clone() }), "lambda: expected 0 to 1, found 2");
    let nowhere = FilmSource::Folder { path: folder.path().join("none"), long_side: None };
    assert!(refused(RunSettings { film: nowhere, ..good.clone() }).contains("none"));
    assert!(good.expert("poly").is_ok());
    assert_eq!(good.expert("field").unwrap_err().to_string(), "expert: expected one of keys, poly, found field");

    let mut run = Run::create(&path, good.clone(), None).unwrap();
    assert!(matches!(Run::create(&path, good, None), Err(RunError::Run(weaver_run::Error::RunExists { .. }))));
    run.advance(&AtomicBool::new(true), |_| {}).unwrap();
    let error = Run::open(&path).unwrap_err().to_string();
    assert!(error.contains("expected a complete run, found one in stage 1, step 0"), "{error}");
    std::fs::write(path.join("run.json"), "{\"film\":3}").unwrap();
    let error = Run::resume(&path).unwrap_err().to_string();
    assert!(error.contains("run.json") && error.contains("expected those of a mixture"), "{error}");
}

/// Promise of `a_capture_that_changed_is_not_gone_on_with`.
#[test]
fn a_run_of_another_film_is_not_gone_on_with() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run");
    let mut run = Run::create(&path, settings(&[ExpertKind::Keys, ExpertKind::Poly], 3), None).unwrap();
    let (stop, mut seen) = (AtomicBool::new(false), 0);
    let stopped = run.advance(&stop, |_| {
        seen += 1;
        stop.store(seen == 2, Ordering::Relaxed);
    });
    assert!(!stopped.unwrap());
    let message = Run::resume(&path).unwrap_err().to_string();
    assert!(message.contains("in use"), "{message}");
    drop(run);
    let file = path.join("run.json");
    let text = std::fs::read_to_string(&file).unwrap();
    // The same number of photos by the same cameras, of another scene.
    std::fs::write(&file, text.replace("\"seed\": 3", "\"seed\": 4")).unwrap();
    let error = Run::resume(&path).unwrap_err();
    assert!(matches!(error, RunError::FilmChanged { .. }), "{error}");
    std::fs::write(&file, text).unwrap();
    assert!(Run::resume(&path).unwrap().advance(&AtomicBool::new(false), |_| {}).unwrap());
}
