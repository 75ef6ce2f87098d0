//! Annotations: their labels, and refusals.

use crate::real_lists::real_lists;
use std::path::PathBuf;
use weaver_io::write_npy;
use weaver_vad::{Annotation, Length};

fn written(name: &str, text: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    weaver_io::write_text(&path, text).unwrap();
    (folder, path)
}

fn labeled(annotation: &Annotation, name: &str, snippets: usize, length: Length) -> Vec<bool> {
    let joined = annotation.join(vec![(name.into(), vec![0.5; snippets])], length).unwrap();
    joined[0].labels.clone()
}

/// Ends are inclusive in one format and exclusive in the other.
#[test]
fn ends_are_inclusive_in_one_format_alone() {
    let (_folder, path) =
        written("a.txt", "Arson/Arson022_x264.mp4 40 Arson 3 5 20 20 \nNormal_1.mp4 40 Normal -1 -1 -1 -1\n");
    let annotation = Annotation::read(&path).unwrap();
    let labels = labeled(&annotation, "Arson022_x264", 3, Length::Features);
    assert_eq!(labels.len(), 48);
    assert_eq!((0..48).filter(|t| labels[*t]).collect::<Vec<_>>(), [3, 4, 5, 20]);
    assert_eq!(labeled(&annotation, "Arson022_x264", 3, Length::Floor).len(), 32);
    assert_eq!(labeled(&annotation, "Arson022_x264", 3, Length::Ceil).len(), 48);
    let (_folder, path) = written("a.txt", "v=1_label_B1-0-0 3 5\n");
    let annotation = Annotation::read(&path).unwrap();
    let labels = labeled(&annotation, "v=1_label_B1-0-0", 2, Length::Features);
    assert_eq!((0..32).filter(|t| labels[*t]).collect::<Vec<_>>(), [3, 4]);
    // Normal videos have no line there.
    assert_eq!(labeled(&annotation, "v=2_label_A", 2, Length::Features), [false; 32]);
}

#[test]
fn frame_labels_follow_the_list() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("gt.npy");
    let labels: Vec<f32> = (0..48).map(|i| f32::from(u8::from(i >= 16))).collect();
    write_npy(&path, &[48], &labels).unwrap();
    let annotation = Annotation::read(&path).unwrap();
    let scores = |second| vec![("a".to_string(), vec![0.1]), ("b".to_string(), vec![0.9; second])];
    let videos = annotation.join(scores(2), Length::Features).unwrap();
    assert_eq!((videos[0].is_abnormal(), videos[1].is_abnormal()), (false, true));
    for wrong in [1, 3] {
        let error = annotation.join(scores(wrong), Length::Features).unwrap_err().to_string();
        assert!(error.contains("labels: expected") && error.contains("48"), "{error}");
    }
}

/// Promise of `what_does_not_fit_is_refused_with_its_file`.
#[test]
fn nonsense_is_refused_with_its_line() {
    for (text, part) in [
        ("", "expected annotated videos, found none"),
        ("a.mp4 x y", "line 1: expected `path frames class"),
        ("a.mp4", "line 1: expected pairs"),
        ("a.mp4 40 Arson 5 3 -1 -1", "not before the first"),
        ("a.mp4 40 Arson 50 60 -1 -1", "within the video"),
        ("a.mp4 40 Arson 5 60 -1 -1", "within the video"),
        ("a.mp4 40 Arson -5 3 -1 -1", "frames from 0"),
        ("a_label_G-0-0 1 2 3", "pairs"),
        ("a.mp4 40 Arson 5 9 -1 -1\na.mp4 40 Arson 5 9 -1 -1", "line 2: expected each video once"),
    ] {
        let (_folder, path) = written("a.txt", text);
        let error = Annotation::read(&path).unwrap_err().to_string();
        assert!(error.contains(part) && error.contains("a.txt"), "{error}");
    }
    let (_folder, path) = written("a.txt", "Arson1.mp4 400 Arson 5 9 -1 -1\n");
    let annotation = Annotation::read(&path).unwrap();
    let refused = |name: &str, snippets| {
        annotation.join(vec![(name.into(), vec![0.5; snippets])], Length::Features).unwrap_err().to_string()
    };
    assert!(refused("Arson2", 25).contains("expected one of the name Arson2"));
    assert!(refused("Normal2", 25).contains("expected one of the name Normal2"));
    assert!(refused("Arson1", 23).contains("expected scores for 25 snippets"));
}

#[test]
fn the_published_lists_are_read() {
    let Some(folder) = real_lists() else { return };
    let violence = Annotation::read(&folder.join("XD_Annotation.txt")).unwrap();
    assert_eq!(violence.videos().count(), 500);
    let frames = weaver_io::Npy::open(folder.join("gt-sh.npy")).unwrap();
    let labels = frames.numbers(0..frames.len());
    assert_eq!((labels.len(), labels.iter().filter(|x| **x > 0.5).count()), (142_912, 8_028));
    assert!(Annotation::read(&folder.join("gt-sh.npy")).is_ok());
}
