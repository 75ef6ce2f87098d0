//! Training: it learns, the same seed gives the same bits, and files keep what was learned.

use weaver_kernels::random::Stream;
use weaver_vad::metrics::{SNIPPET, ScoredVideo, frame_metrics};
use weaver_vad::{
    ConvolutionSizes, Detector, EncoderKind, Error, Experts, Features, Labels, Planted, Rule, Schedule, Splatting,
    TrainingSet, UrDmuSizes,
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
    let detector =
        schedule.train(&TrainingSet::planted(&planted), convolutions(4), &mut |step| losses.push(step.loss)).unwrap();
    assert_eq!(losses.len(), 60);
    assert!(losses[50..].iter().sum::<f64>() < 0.8 * losses[..10].iter().sum::<f64>(), "{losses:?}");
    let scored = planted.test().into_iter().map(|video| ScoredVideo {
        scores: detector.curves(&video.features).unwrap().scores().to_vec(),
        labels: video.labels.iter().flat_map(|label| [*label; SNIPPET]).collect(),
    });
    let metrics = frame_metrics(&scored.collect::<Vec<_>>());
    assert!(metrics.auc_abnormal.unwrap() > 0.6, "{metrics:?}");
}

#[test]
fn whole_trainings_repeat_to_the_bit_and_are_kept_in_files() {
    let planted = Planted::new(4);
    let set = TrainingSet::planted(&planted);
    let kind = EncoderKind::UrDmu(UrDmuSizes { classes: 4, ..UrDmuSizes::small(32) });
    let features = &planted.test()[1].features;
    let train = |experts| {
        let schedule = schedule(experts, 6);
        let mut steps = 0;
        let detector = schedule.train(&set, kind, &mut |_| steps += 1).unwrap();
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

    let clusters = train(Experts::Clusters(3));
    assert!((1..=3).contains(&clusters.experts().len()));
}

#[test]
fn a_loss_that_is_not_finite_ends_training() {
    let mut schedule = Schedule { labels: Labels::None, ..schedule(Experts::None, 20) };
    schedule.encoder.rate = f64::INFINITY;
    let error = schedule.train(&TrainingSet::planted(&Planted::new(0)), convolutions(0), &mut |_| ()).unwrap_err();
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
