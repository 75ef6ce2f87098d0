//! Planted videos have their documented properties.

use weaver_vad::metrics::{SNIPPET, ScoredVideo, frame_metrics};
use weaver_vad::{Planted, TrainingSet, cluster_centers, nearest_center};

#[test]
fn videos_are_planted_as_described() {
    let planted = Planted::new(7);
    let (training, test) = (planted.training(), planted.test());
    assert_eq!((training.len(), test.len()), (240, 120));
    for video in training.iter().chain(&test) {
        assert_eq!((video.features.snippets(), video.features.width()), (64, 32));
        assert_eq!(video.class.is_some(), video.labels.contains(&true), "{}", video.name);
        assert!(video.name.starts_with(video.class.map_or("Normal", |c| ["ClassA", "ClassB", "ClassC", "ClassD"][c])));
    }
    let length = |class| {
        let of = training.iter().filter(|video| video.class == Some(class));
        of.map(|video| video.labels.iter().filter(|label| **label).count()).sum::<usize>()
    };
    assert!(length(0) < length(1) && length(1) < length(2) && length(2) < length(3));
    // The same seed, the same videos; another, others.
    let first = |planted: Planted| planted.test()[0].features.crop(0).unwrap().into_owned();
    assert_eq!(first(planted), first(Planted::new(7)));
    assert_ne!(first(planted), first(Planted::new(8)));
    let set = TrainingSet::planted(&planted);
    assert_eq!((set.normal().len(), set.abnormal().len(), set.classes.len()), (120, 120, 4));
}

/// The matched filter finds events; labels of whole videos find nothing within abnormal ones.
#[test]
fn the_matched_filter_finds_anomalies() {
    let planted = Planted::new(1);
    let scored = |score: &dyn Fn(&weaver_vad::PlantedVideo) -> Vec<f32>| {
        let test = planted.test();
        let video = |video| -> ScoredVideo {
            let video: &weaver_vad::PlantedVideo = video;
            let labels = video.labels.iter().flat_map(|label| [*label; SNIPPET]).collect();
            ScoredVideo { scores: score(video), labels }
        };
        frame_metrics(&test.iter().map(video).collect::<Vec<_>>())
    };
    let matched = scored(&|video| planted.matched_filter(&video.features.crop(0).unwrap()));
    assert!(matched.auc_abnormal.unwrap() > 0.85, "{matched:?}");
    let of_video = scored(&|video| vec![f32::from(u8::from(video.class.is_some())); 64]);
    assert_eq!(of_video.auc_abnormal, Some(0.5));
    assert!(of_video.auc.unwrap() > 0.7);
}

#[test]
fn clusters_of_separate_points_are_found() {
    let points: Vec<f32> = (0..30).flat_map(|i| [(i % 3) as f32 * 5.0 + 0.01 * i as f32, (i % 3) as f32]).collect();
    let centers = cluster_centers(&points, 2, 3, 4);
    assert_eq!(centers.len(), 6);
    let of: Vec<usize> = points.chunks_exact(2).map(|point| nearest_center(&centers, point)).collect();
    assert!((3..30).all(|i| of[i] == of[i - 3]) && of[0] != of[1] && of[1] != of[2] && of[0] != of[2], "{of:?}");
    // No more clusters than different points.
    assert_eq!(cluster_centers(&[1.0, 1.0, 1.0], 1, 3, 0).len(), 1);
}
