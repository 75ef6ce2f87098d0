//! Training: it learns, the same seed gives the same bits, and files keep the detector.

use weaver_kernels::random::Stream;
use weaver_vad::metrics::{SNIPPET, ScoredVideo, frame_metrics};
use weaver_vad::{
    ConvolutionSizes, Detector, EncoderKind, Error, Experts, Features, Labels, Planted, Rule, Schedule, Splatting,
    StepReport, Training, TrainingSet, UrDmuSizes,
};

fn schedule(experts: Experts, steps: usize) -> Schedule {
    let schedule = Schedule::planted(Labels::Splat(Splatting::with(Rule::Time)), experts, 3);
    let factor = steps as f64 / schedule.encoder.steps as f64;
    schedule.scaled(factor)
}

fn convolutions(classes: usize) -> EncoderKind {
    EncoderKind::Convolutions(ConvolutionSizes { features: 32, width: 16, classes })
}

#[test]
fn an_encoder_learns_where_anomalies_are() {
    let planted = Planted::new(2);
    let mut losses = Vec::new();
    let mut schedule = Schedule { labels: Labels::None, ..schedule(Experts::None, 60) };
    schedule.encoder.rate = 1e-2;
    let detector = schedule
        .train(&TrainingSet::planted(&planted), convolutions(4), &mut |step: &StepReport| losses.push(step.loss))
        .unwrap();
    assert_eq!(losses.len(), 60);
    assert!(losses[50..].iter().sum::<f64>() < 0.8 * losses[..10].iter().sum::<f64>(), "{losses:?}");
    let scored = planted.test().into_iter().map(|video| ScoredVideo {
        scores: detector.curves(&video.features).unwrap().scores().to_vec(),
        labels: video.labels.iter().flat_map(|label| [*label; SNIPPET]).collect(),
    });
    let metrics = frame_metrics(&scored.collect::<Vec<_>>());
    assert!(metrics.auc_abnormal.unwrap() > 0.6, "{metrics:?}");
}

/// Whole trainings repeat to the bit and are kept in files.
///
/// Promise (results): a detector of anomalies is the same to the bit from the same seed, and after it was written and
/// read.
#[test]
fn trainings_repeat_to_the_bit() {
    let planted = Planted::new(4);
    let set = TrainingSet::planted(&planted);
    let kind = EncoderKind::UrDmu(UrDmuSizes { classes: 4, ..UrDmuSizes::small(32) });
    let features = &planted.test()[1].features;
    let train = |experts| {
        let schedule = schedule(experts, 6);
        let mut steps = 0;
        let detector = schedule.train(&set, kind, &mut |_: &StepReport| steps += 1).unwrap();
        assert_eq!(steps, schedule.steps(&set));
        detector
    };
    let detector = train(Experts::Classes);
    let curves = detector.curves(features).unwrap();
    assert_eq!(curves, train(Experts::Classes).curves(features).unwrap());
    assert_eq!((curves.classes.len(), curves.experts.len(), curves.scores().len()), (4, 4, 64));
    assert_ne!(curves, detector.curves_without(features, Some(1)).unwrap());

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.safetensors");
    detector.write(&path, "told").unwrap();
    let (read, told) = Detector::read(&path).unwrap();
    assert_eq!((read.curves(features).unwrap(), told.as_str()), (curves, "told"));
    assert_eq!(read.experts(), ["ClassA", "ClassB", "ClassC", "ClassD"]);

    // Published experts have other weights, and files record the choice.
    let mut published = Detector::new(convolutions(0), 1).with_published_experts();
    published.add_experts(vec!["one".into(), "other".into()], 1);
    published.add_gate(1);
    published.write(&path, "").unwrap();
    let (read, _) = Detector::read(&path).unwrap();
    assert_eq!(read.curves(features).unwrap(), published.curves(features).unwrap());
    assert!(read.params().len() > Detector::new(convolutions(0), 1).params().len() + 2 * 12);

    let clusters = train(Experts::Clusters(3));
    assert!((1..=3).contains(&clusters.experts().len()));
}

#[test]
fn a_loss_that_is_not_finite_ends_training() {
    let mut schedule = Schedule { labels: Labels::None, ..schedule(Experts::None, 20) };
    schedule.encoder.rate = f64::INFINITY;
    let error =
        schedule.train(&TrainingSet::planted(&Planted::new(0)), convolutions(0), &mut |_: &StepReport| ()).unwrap_err();
    assert!(matches!(error, Error::Diverged { .. }), "{error}");
}

/// Equal crops count as one.
#[test]
fn equal_crops_give_the_curve_of_one() {
    let stream = Stream::new(0, 0, "test.crops");
    let one: Vec<f32> = (0..7 * 32).map(|i| stream.normal(i)).collect();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npy");
    weaver_io::write_npy(&path, &[10, 7, 32], &one.repeat(10)).unwrap();
    let detector = Detector::new(EncoderKind::UrDmu(UrDmuSizes::small(32)), 1);
    let all = detector.curves(&Features::open(&[path]).unwrap()).unwrap();
    let single = detector.curves(&Features::in_memory(one, 32)).unwrap();
    assert!(all.scores().iter().zip(single.scores()).all(|(a, b)| (a - b).abs() < 1e-6));
}

/// Features so large that scores are no numbers are refused by their file.
#[test]
fn features_that_give_no_scores_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("large.npy");
    weaver_io::write_npy(&path, &[7, 32], &[3e38; 7 * 32]).unwrap();
    let detector = Detector::new(EncoderKind::UrDmu(UrDmuSizes::small(32)), 1);
    let message = detector.curves(&Features::open(&[path]).unwrap()).unwrap_err().to_string();
    assert!(message.contains("large.npy: scores: expected finite numbers"), "{message}");
}

/// Resuming from the checkpoint of any step gives the bits of an uninterrupted training.
///
/// Promise (results): a training of a detector that is stopped goes on to the same bits.
#[test]
fn a_stopped_training_goes_on_to_the_same_bits() {
    let planted = Planted::new(6);
    let set = TrainingSet::planted(&planted);
    let (schedule, kind) = (schedule(Experts::Clusters(2), 4), convolutions(0));
    let whole = schedule.train(&set, kind, &mut |_: &StepReport| ()).unwrap();
    let features = &planted.test()[1].features;
    let total = schedule.steps(&set);
    let mut last = None;
    // In the encoder, between stages, in the second expert, in the gate, at the very end.
    for at in [2, 4, 6, total - 4, total - 1, total] {
        let mut stopped = schedule.training(&set, kind);
        (0..at).for_each(|_| drop(stopped.step().unwrap()));
        let from = (stopped.detector().clone(), stopped.checkpoint());
        last = Some(from.clone());
        let mut resumed = Training::resume(&schedule, &set, from.0, from.1).unwrap();
        assert_eq!(resumed.steps(), [at, total]);
        while !resumed.is_done() {
            resumed.step().unwrap();
        }
        assert_eq!(resumed.steps(), [total; 2]);
        let resumed = resumed.into_detector();
        assert_eq!(resumed.curves(features).unwrap(), whole.curves(features).unwrap(), "stopped after {at}");
    }
    // A schedule without the stage is another training, and so is one with other parameters.
    let (detector, checkpoint) = last.unwrap();
    assert_eq!(checkpoint.stage, "gate");
    let plain = Schedule { experts: Experts::None, ..schedule.clone() };
    let others = Schedule { experts: Experts::Classes, ..schedule.clone() };
    for other in [plain, others] {
        let error = Training::resume(&other, &set, detector.clone(), checkpoint.clone()).unwrap_err();
        assert!(error.to_string().contains("stage: expected one of this training, found gate"), "{error}");
    }
    let mut strange = checkpoint.clone();
    strange.state.insert("no such parameter".into(), strange.state.values().next().unwrap().clone());
    let error = Training::resume(&schedule, &set, detector, strange).unwrap_err();
    assert!(error.to_string().contains("optimizer: ") && error.to_string().contains("no such parameter"), "{error}");
}
