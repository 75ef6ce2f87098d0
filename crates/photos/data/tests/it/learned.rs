//! The learned matcher with its weights.

use std::path::Path;
use weaver_data::{built_in_matcher, read_matcher};
use weaver_io::safetensors::Tensors;
use weaver_sfm::{LearnedFeatures, LearnedMatcher};

const TOLERANCE: f32 = 1e-3;

/// Features of a photo of the fixture, and the number of the reference's keypoint for each.
fn compared(matcher: &LearnedMatcher, reference: &Tensors, name: &str) -> (LearnedFeatures, Vec<u32>) {
    let photo = reference.get(&format!("{name}.rgb")).unwrap();
    let [height, width, 3] = photo.shape[..] else { panic!("a photo of {:?}", photo.shape) };
    let rgb = reference.values::<u8>(&format!("{name}.rgb"), &photo.shape).unwrap();
    let numbers = |part: &str, shape: &[usize]| reference.values::<f32>(&format!("{name}.{part}"), shape).unwrap();
    let count = reference.get(&format!("{name}.scores")).unwrap().shape[0];
    let (points, scores) = (numbers("points", &[count, 2]), numbers("scores", &[count]));
    let descriptors = numbers("descriptors", &[count, 64]);
    let found = matcher.features(rgb, [height, width], None, count);
    assert_eq!(found.points.len(), count);
    let number = |i: usize| {
        let near = |j: &usize| (0..2).all(|k| (points[2 * j + k] - found.points[i][k]).abs() < TOLERANCE);
        let j = (0..count).find(near).unwrap_or_else(|| panic!("{name}: no such keypoint: {:?}", found.points[i]));
        assert!((found.scores[i] - scores[j]).abs() < TOLERANCE, "{name}: score of {i}");
        let mut both = found.descriptors[64 * i..][..64].iter().zip(&descriptors[64 * j..]);
        assert!(both.all(|(a, b)| (a - b).abs() < TOLERANCE), "{name}: descriptor of {i}");
        j as u32
    };
    let numbers = (0..count).map(number).collect();
    (found, numbers)
}

/// Keypoints, descriptors and matches equal the original's, computed by PyTorch.
///
/// Promise (results): keypoints, descriptors and probabilities of the learned matcher are XFeat's and LighterGlue's
/// within 1e-3.
#[test]
fn learned_matches_equal_the_original() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/learned.safetensors");
    let reference = Tensors::read(file).unwrap();
    let matcher = built_in_matcher().unwrap();
    let (first, of_first) = compared(&matcher, &reference, "first");
    let (second, of_second) = compared(&matcher, &reference, "second");
    let count = reference.get("matches.scores").unwrap().shape[0];
    let numbers = reference.values::<i32>("matches.numbers", &[count, 2]).unwrap();
    let scores = reference.values::<f32>("matches.scores", &[count]).unwrap();
    let found = matcher.matches(&first, &second, 0.1);
    assert!(count > 100 && found.len() == count, "{} matches of {count}", found.len());
    for m in &found {
        let pair = [of_first[m.first as usize] as i32, of_second[m.second as usize] as i32];
        let i = numbers.chunks_exact(2).position(|other| other == pair).expect("a match of the original");
        assert!((m.score - scores[i]).abs() < TOLERANCE, "{pair:?}: {} for {}", m.score, scores[i]);
    }
    // What a mask hides has no keypoints.
    let rgb = reference.values::<u8>("first.rgb", &[160, 224, 3]).unwrap();
    let left: Vec<bool> = (0..160 * 224).map(|i| i % 224 < 112).collect();
    let masked = matcher.features(rgb, [160, 224], Some(&left), 300);
    assert!(!masked.points.is_empty() && masked.points.iter().all(|[x, _]| *x < 112.0));
    assert!(matcher.features(&rgb[..20 * 20 * 3], [20, 20], None, 300).points.is_empty(), "too small");
}

/// Promise (files): weights that are not the learned matcher's are refused with file, tensor, expected and
/// found.
#[test]
fn other_weights_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("weights.safetensors");
    let built_in = Path::new(env!("CARGO_MANIFEST_DIR")).join("weights/xfeat-lighterglue.safetensors");
    let whole = Tensors::read(&built_in).unwrap();
    read_matcher(&built_in).unwrap();
    let refused = |change: &dyn Fn(&mut Tensors)| {
        let mut other = whole.clone();
        change(&mut other);
        other.write(&path).unwrap();
        let said = read_matcher(&path).unwrap_err().to_string();
        said.strip_prefix(&format!("{}: ", path.display())).expect("the file").to_string()
    };
    let name = "block3.1.layer.0.weight";
    let missing = refused(&|t| _ = t.tensors.remove(name));
    assert_eq!(missing, format!("tensor {name}: expected [64, 64, 3, 3], found no such tensor"));
    let small = refused(&|t| t.insert(name, &[2, 2], vec![0.0_f32; 4]));
    assert_eq!(small, format!("tensor {name}: expected [64, 64, 3, 3], found [2, 2]"));
    let whole_numbers = refused(&|t| t.insert(name, &[64, 64, 3, 3], vec![0_i32; 64 * 64 * 9]));
    assert_eq!(whole_numbers, format!("tensor {name}: expected [64, 64, 3, 3], found numbers of type I32"));
    let name = "matcher.input_proj.bias";
    let unknown = refused(&|t| t.insert(name, &[96], vec![f32::NAN; 96]));
    assert_eq!(unknown, format!("tensor {name}: expected [96], found numbers that are not finite"));
    std::fs::write(&path, b"no weights").unwrap();
    assert!(read_matcher(&path).unwrap_err().to_string().starts_with(&path.display().to_string()));
}
