//! Lists and feature files in their published layouts, and refusals.

use std::path::Path;
use weaver_io::write_npy;
use weaver_vad::{FileName, TrainingSet, classes_of, read_list};

fn features(folder: &Path, name: &str, shape: &[usize], first: f32) {
    let path = folder.join(name);
    path.parent().map(weaver_io::create_folder).unwrap().unwrap();
    let numbers: Vec<f32> = (0..shape.iter().product::<usize>()).map(|i| first + i as f32).collect();
    write_npy(path, shape, &numbers).unwrap();
}

fn list(folder: &Path, lines: &str) -> std::path::PathBuf {
    let path = folder.join("list.txt");
    weaver_io::write_text(&path, lines).unwrap();
    path
}

#[test]
fn crops_in_files_of_their_own_are_one_video() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    features(at, "Abuse/Abuse001_x264__0.npy", &[2, 3], 0.0);
    features(at, "Abuse/Abuse001_x264__1.npy", &[2, 3], 100.0);
    features(at, "Normal_1_x264__0.npy", &[4, 3], 0.0);
    features(at, "Normal_1_x264__1.npy", &[4, 3], 0.0);
    // Leading folders that are not there are left out.
    let lines =
        "Abuse/Abuse001_x264__0.npy\nAbuse/Abuse001_x264__1.npy\nfar/Normal_1_x264__0.npy\nNormal_1_x264__1.npy\n";
    let path = list(at, lines);
    let videos = read_list(&path, at).unwrap();
    assert_eq!((videos.len(), videos[0].features.crops(), videos[1].features.snippets()), (2, 2, 4));
    assert_eq!(videos[0].features.crop(1).unwrap()[0], 100.0);
    let set = TrainingSet::listed(&path, videos, None).unwrap();
    assert_eq!((set.classes.clone(), set.abnormal()), (vec!["Abuse".to_string()], vec![0]));
}

#[test]
fn crops_in_one_file_may_come_first_or_second() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    features(at, "Abuse1_i3d.npy", &[4, 10, 3], 0.0);
    features(at, "Abuse2_i3d.npy", &[10, 4, 3], 0.0);
    let videos = read_list(&list(at, "Abuse1_i3d.npy\nAbuse2_i3d.npy\n"), at).unwrap();
    assert_eq!(videos[0].features.crop(2).unwrap()[..4], [6.0, 7.0, 8.0, 36.0]);
    assert_eq!(videos[1].features.crop(2).unwrap()[..4], [24.0, 25.0, 26.0, 27.0]);
}

#[test]
fn names_tell_videos_crops_and_classes() {
    let name = "Bad.Boys.1995__#01-11-55_01-12-40_label_G-B2-B6";
    assert_eq!(FileName::of(&format!("{name}__4.npy")), FileName { video: name.into(), crop: 4 });
    assert_eq!(FileName::of("a/Abuse028_x264.npy"), FileName { video: "Abuse028_x264".into(), crop: 0 });
    assert_eq!(classes_of(name).unwrap(), ["G", "B2", "B6"]);
    assert_eq!(classes_of("v=1_label_A"), Some(vec![]));
    assert_eq!(classes_of("RoadAccidents021_x264").unwrap(), ["RoadAccidents"]);
}

/// Promise (results): lists, features and annotations that do not fit are refused with file, expected and found;
/// nothing pickled is read.
#[test]
fn what_does_not_fit_is_refused_with_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    features(at, "Abuse1.npy", &[2, 3], 0.0);
    features(at, "Abuse2.npy", &[2, 4], 0.0);
    features(at, "Abuse3__0.npy", &[2, 3], 0.0);
    features(at, "Abuse3__1.npy", &[3, 3], 0.0);
    features(at, "Abuse4__2.npy", &[2, 3], 0.0);
    features(at, "Empty1.npy", &[0, 3], 0.0);
    features(at, "Flat1.npy", &[6], 0.0);
    write_npy(at.join("Broken1.npy"), &[1, 2], &[1.0, f32::NAN]).unwrap();
    weaver_io::write_text(at.join("Text1.npy"), "no array").unwrap();
    for (lines, part) in [
        ("", "expected paths of feature files"),
        ("Abuse9.npy", "line 1: expected a file below"),
        ("Abuse1.npy\nAbuse1.npy", "line 2: expected each crop of a video once"),
        ("Abuse1.npy\nAbuse2.npy", "Abuse2.npy: shape: expected 3 features"),
        ("Abuse3__0.npy\nAbuse3__1.npy", "Abuse3__1.npy: shape: expected [2, 3]"),
        ("Abuse4__2.npy", "Abuse4: expected crops 0 to 0"),
        ("Empty1.npy", "at least one snippet"),
        ("Flat1.npy", "expected [S, D]"),
        ("Text1.npy", "a complete NPY file"),
    ] {
        let error = read_list(&list(at, lines), at).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    }
    let broken = read_list(&list(at, "Broken1.npy"), at).unwrap();
    let error = broken[0].features.crop(0).unwrap_err().to_string();
    assert!(error.contains("Broken1.npy: crop 0, snippet 0, number 1: expected a finite number, found NaN"), "{error}");

    let path = list(at, "Abuse1.npy");
    let error = |abnormal| TrainingSet::listed(&path, read_list(&path, at).unwrap(), abnormal).unwrap_err().to_string();
    assert!(error(None).contains("at least one normal video"));
    assert!(error(Some(0)).contains("at least one abnormal video"));
    features(at, "01_01.npy", &[2, 3], 0.0);
    let path = list(at, "01_01.npy");
    let error = TrainingSet::listed(&path, read_list(&path, at).unwrap(), None).unwrap_err().to_string();
    assert!(error.contains("the number of abnormal videos"), "{error}");
}

/// Arrays of objects are pickled; nothing of them is read.
///
/// Promise of `what_does_not_fit_is_refused_with_its_file`.
#[test]
fn pickled_and_transposed_arrays_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (header, part) in [
        (
            "{'descr': '|O', 'fortran_order': False, 'shape': (1,), }",
            "descr: expected one of <f2 <f4 <f8 |u1 |b1, found |O",
        ),
        ("{'descr': '<f4', 'fortran_order': True, 'shape': (1, 1), }", "fortran_order: expected False"),
    ] {
        let path = folder.path().join("Abuse1.npy");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend([0; 4]);
        std::fs::write(&path, bytes).unwrap();
        let error = weaver_vad::Features::open(&[path]).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    }
}
