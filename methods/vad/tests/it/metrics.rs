//! Metrics against stored numbers, known distributions and the golden values of the published lists.

use crate::real_lists::real_lists;
use weaver_fixtures::{Fixture, Tolerance};
use weaver_kernels::random::Stream;
use weaver_vad::metrics::{FrameMetrics, SNIPPET, ScoredVideo, frame_metrics};
use weaver_vad::{Annotation, Length};

fn close(found: Option<f64>, expected: f64, tolerance: f64) {
    let found = found.unwrap();
    assert!((found - expected).abs() < tolerance, "{found}, expected {expected}");
}

/// Promise of `golden_values_of_ucf_crime`.
#[test]
fn metrics_with_ties_equal_the_reference() {
    let file = Fixture::open("vad_splat_metrics.safetensors").with(Tolerance::DOUBLE);
    let [scores, labels, of] = ["in.scores", "in.labels", "in.video"].map(|key| file.f64(key));
    let video = |v: usize| {
        let frames: Vec<usize> = (0..of.len()).filter(|i| of[*i] == v as f64).collect();
        let scores = frames.iter().step_by(SNIPPET).map(|i| scores[*i] as f32).collect();
        ScoredVideo { scores, labels: frames.iter().map(|i| labels[*i] > 0.0).collect() }
    };
    let FrameMetrics { auc, ap, auc_abnormal, ap_abnormal, false_alarms, .. } =
        frame_metrics(&(0..8).map(video).collect::<Vec<_>>());
    let (ap, ap_abnormal) = (ap.unwrap(), ap_abnormal.unwrap());
    let found =
        [auc, Some(ap.trapezoid), Some(ap.step), auc_abnormal, Some(ap_abnormal.trapezoid), Some(ap_abnormal.step)];
    for (found, expected) in found.into_iter().chain([false_alarms]).zip(file.f64("out.metrics")) {
        close(found, expected, 1e-6);
    }
}

/// The AUC of two normal distributions follows from their difference.
#[test]
fn the_auc_of_two_normal_distributions() {
    let stream = Stream::new(5, 0, "test.auc");
    let n = 20_000;
    let video = |shift: f32, start: u64, label| ScoredVideo {
        scores: (0..n).map(|i| shift + stream.normal::<f32>(start + i)).collect(),
        labels: vec![label; n as usize * SNIPPET],
    };
    let metrics = frame_metrics(&[video(1.0, 0, true), video(0.0, n, false)]);
    // Phi(1 / sqrt 2); its standard error here is 0.0022.
    close(metrics.auc, 0.760_250, 0.008);
}

#[test]
fn numbers_without_frames_of_a_kind_are_none() {
    let normal = ScoredVideo { scores: vec![0.2, 0.7], labels: vec![false; 2 * SNIPPET] };
    let metrics = frame_metrics(std::slice::from_ref(&normal));
    assert_eq!((metrics.auc, metrics.ap, metrics.auc_abnormal), (None, None, None));
    assert_eq!(metrics.false_alarms, Some(0.5));
    let abnormal = ScoredVideo { labels: vec![true; 2 * SNIPPET], ..normal };
    let metrics = frame_metrics(&[abnormal]);
    assert_eq!((metrics.auc, metrics.false_alarms), (None, None));
    assert_eq!(metrics.ap.map(|ap| ap.step), Some(1.0));
    assert_eq!(frame_metrics(&[]).auc, None);
}

/// Scores for each snippet of the annotation, by the number of snippets.
fn scored(annotation: &Annotation, length: Length, score: impl Fn(&str, usize) -> Vec<f32>) -> FrameMetrics {
    let names: Vec<String> = annotation.videos().map(str::to_string).collect();
    let snippets = |name: &str| {
        let frames = annotation.frames(name).unwrap();
        if length == Length::Ceil { frames.div_ceil(SNIPPET) } else { frames / SNIPPET }
    };
    let scores = names.into_iter().map(|name| (name.clone(), score(&name, snippets(&name)))).collect();
    frame_metrics(&annotation.join(scores, length).unwrap())
}

/// Promise (results): frame metrics of videos equal the published evaluator's, on the published lists to the digit.
#[test]
fn golden_values_of_ucf_crime() {
    let Some(folder) = real_lists() else { return };
    let annotation = Annotation::read(&folder.join("UCF_Annotation.txt")).unwrap();
    assert_eq!(annotation.videos().count(), 290);
    let of_video = |name: &str, n| vec![f32::from(u8::from(!name.starts_with("Normal"))); n];
    let labels = scored(&annotation, Length::Floor, of_video);
    assert_eq!((labels.frames, labels.positives, labels.abnormal_frames), (1_109_824, 84_309, 461_968));
    close(labels.auc, 0.815_869, 5e-7);
    close(labels.ap.map(|ap| ap.trapezoid), 0.591_250, 5e-7);
    close(labels.ap.map(|ap| ap.step), 0.182_500, 5e-7);
    close(labels.auc_abnormal, 0.5, 1e-12);
    let relative = |_: &str, n: usize| (0..n).map(|i| i as f32 / (n.max(2) - 1) as f32).collect();
    let position = scored(&annotation, Length::Floor, relative);
    close(position.auc, 0.513_240, 5e-7);
    close(position.ap.map(|ap| ap.trapezoid), 0.071_418, 5e-7);
    close(position.ap.map(|ap| ap.step), 0.070_798, 5e-7);
    close(position.auc_abnormal, 0.514_956, 5e-7);
    let ceil = scored(&annotation, Length::Ceil, of_video);
    assert_eq!((ceil.frames, ceil.positives, ceil.abnormal_frames), (1_114_144, 84_343, 464_048));
}
