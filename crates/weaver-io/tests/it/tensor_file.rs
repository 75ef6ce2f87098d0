use proptest::prelude::*;
use std::path::{Path, PathBuf};
use weaver_io::TensorFile;
use weaver_io::checkpoint::Tensors;

/// More values than are decoded at a time, and no multiple of it.
const MANY: usize = (1 << 15) + 7;

fn written(folder: &Path) -> PathBuf {
    let path = folder.join("a.safetensors");
    let mut tensors = Tensors::default();
    tensors.metadata.insert("width".into(), "640".into());
    tensors.insert("many", &[MANY], (0..MANY).map(|i| i as f32 / 3.0).collect());
    tensors.insert("empty", &[0, 4], Vec::<f32>::new());
    tensors.insert("pair", &[2, 1], vec![f32::NAN, -0.0]);
    tensors.insert("bytes", &[3], vec![1u8, 2, 3]);
    tensors.write(&path).unwrap();
    path
}

#[test]
fn tensors_come_in_any_order() {
    let folder = tempfile::tempdir().unwrap();
    let mut file = TensorFile::open(written(folder.path())).unwrap();
    assert_eq!((file.metadata("width"), file.metadata("height")), (Some("640"), None));
    assert!(file.contains("bytes") && !file.contains("width"));
    let pair = file.f32s("pair").unwrap();
    assert!(pair[0].is_nan() && pair[1].is_sign_negative());
    assert!(file.f32s("many").unwrap().iter().enumerate().all(|(i, x)| *x == i as f32 / 3.0));
    assert!(file.f32s("empty").unwrap().is_empty());
    assert_eq!((file.shape("many").unwrap(), file.shape("empty").unwrap()), (&[MANY][..], &[0, 4][..]));
}

#[test]
fn messages_name_file_tensor_and_what_was_found() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path());
    let mut file = TensorFile::open(&path).unwrap();
    let cases = [
        (file.f32s("nope").unwrap_err(), "tensor nope: expected a tensor, found none of that name among 4"),
        (file.f32s("bytes").unwrap_err(), "tensor bytes: expected F32, found U8"),
        (TensorFile::open(folder.path().join("none")).unwrap_err(), "none: "),
    ];
    for (error, expected) in cases {
        let message = error.to_string();
        assert!(message.contains(&*folder.path().to_string_lossy()) && message.contains(expected), "{message}");
    }
}

#[test]
fn files_of_another_length_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path());
    let whole = std::fs::read(&path).unwrap();
    for length in [0, 7, 8, 100, whole.len() - 1, whole.len() + 1] {
        let mut bytes = whole.clone();
        bytes.resize(length, 0);
        std::fs::write(&path, bytes).unwrap();
        let message = TensorFile::open(&path).unwrap_err().to_string();
        assert!(message.contains("a.safetensors: header: expected a complete safetensors file, found "), "{message}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 4))]

    #[test]
    fn hostile_bytes_are_an_error_or_tensors(at in 0..400_usize, byte: u8) {
        let folder = tempfile::tempdir().unwrap();
        let path = written(folder.path());
        let mut bytes = std::fs::read(&path).unwrap();
        bytes[at] = byte;
        std::fs::write(&path, bytes).unwrap();
        if let Ok(mut file) = TensorFile::open(&path) {
            for key in ["many", "empty", "pair", "bytes"] {
                let shape = file.shape(key).map(|s| s.iter().product::<usize>());
                if let Ok(values) = file.f32s(key) {
                    prop_assert_eq!(values.len(), shape.unwrap());
                }
            }
        }
    }
}
