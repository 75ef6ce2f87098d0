//! Weights in place: one file or several, of any type, and the faults of broken ones.

use half::{bf16, f16};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use weaver_io::safetensors::{Mapped, Planned, Storage, Tensors, write_weights};

fn sample(path: &Path) {
    let mut tensors = Tensors::default();
    tensors.insert("a.narrow", &[2, 2], [1.5, -2.0, 0.25, 3.0].map(bf16::from_f32).to_vec());
    tensors.insert("a.half", &[3], [1.0, 0.5, -4.0].map(f16::from_f32).to_vec());
    tensors.insert("b.wide", &[2], vec![1.0f32, f32::MIN_POSITIVE]);
    tensors.insert("b.count", &[1], vec![7i64]);
    tensors.write(path).unwrap();
}

#[test]
fn every_type_in_place() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.safetensors");
    sample(&path);
    // A folder will do.
    let weights = Mapped::open(folder.path()).unwrap();
    assert_eq!(weights.iter().len(), 4);
    let storage = |name: &str| weights.get(name).unwrap().storage();
    match (storage("a.narrow").unwrap(), storage("a.half").unwrap(), storage("b.wide").unwrap()) {
        (Storage::Bf16(narrow), Storage::F16(half), Storage::F32(wide)) => {
            assert_eq!(narrow.as_ref()[2].to_f32(), 0.25);
            assert_eq!(half.as_ref().iter().map(|x| x.to_f32()).collect::<Vec<_>>(), [1.0, 0.5, -4.0]);
            assert_eq!(wide.as_ref(), [1.0, f32::MIN_POSITIVE]);
        }
        other => panic!("{other:?}"),
    }
    let Storage::F32(wide) = storage("b.wide").unwrap() else { panic!() };
    weights.forget();
    assert_eq!(wide.as_ref(), [1.0, f32::MIN_POSITIVE]);
    let error = storage("b.count").unwrap_err().to_string();
    assert!(error.contains("tensor b.count: expected F32, F16 or BF16, found I64"), "{error}");
    let narrow = weights.get("a.narrow").unwrap();
    assert_eq!((narrow.shape(), narrow.len(), narrow.bytes(), narrow.dtype().as_str()), (&[2, 2][..], 4, 8, "BF16"));
}

/// The header moves the numbers by three bytes: they cannot be read in place, and are all the same.
#[test]
fn numbers_that_lie_askew() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("askew.safetensors");
    let header = br#"{"w":{"dtype":"F32","shape":[2],"data_offsets":[0,8]}}   "#;
    let header = &header[..header.len() - (header.len() + 3) % 4];
    let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
    bytes.extend(header);
    [1.5f32, -2.5].iter().for_each(|x| bytes.extend(x.to_le_bytes()));
    assert_ne!((8 + header.len()) % 4, 0);
    std::fs::write(&path, bytes).unwrap();
    let Storage::Widened(values) = Mapped::open(&path).unwrap().get("w").unwrap().storage().unwrap() else {
        panic!("not in place")
    };
    assert_eq!(values, [1.5, -2.5]);
}

#[test]
fn several_files_under_an_index() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    for (file, key) in [("model-1.safetensors", "a"), ("model-2.safetensors", "b")] {
        let mut tensors = Tensors::default();
        tensors.insert(key, &[1], vec![1.0f32]);
        tensors.write(path(file)).unwrap();
    }
    let index = |map: &str| {
        std::fs::write(path("model.safetensors.index.json"), format!("{{\"weight_map\": {map}}}")).unwrap();
        Mapped::open(folder.path())
    };
    let both = index(r#"{"a": "model-1.safetensors", "b": "model-2.safetensors"}"#).unwrap();
    assert_eq!(both.iter().map(|w| w.name()).collect::<Vec<_>>(), ["a", "b"]);
    for (map, message) in [
        (r#"{"a": "model-1.safetensors", "c": "model-2.safetensors"}"#, "also c"),
        (r#"{"a": "model-3.safetensors"}"#, "model-3.safetensors"),
        (r#"{"a": "../model-1.safetensors"}"#, "a file beside the index"),
        (r#"7"#, "files by tensor name"),
    ] {
        let error = index(map).unwrap_err().to_string();
        assert!(error.contains(message), "{error}");
    }
}

#[test]
fn broken_files_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.safetensors");
    sample(&path);
    let whole = std::fs::read(&path).unwrap();
    let refused = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        let error = Mapped::open(&path).unwrap_err().to_string();
        assert!(error.contains("model.safetensors") && error.contains("complete safetensors file"), "{error}");
    };
    refused(&whole[..whole.len() - 1]);
    refused(&whole[..20]);
    refused(&[]);
    refused(&[whole.as_slice(), &[0]].concat());
    refused(b"\x08\0\0\0\0\0\0\0{\"a\": 1}");
    refused(b"PK\x03\x04 no header at all, but long enough to be looked at");
    let error = Mapped::open(folder.path().join("model.pt")).unwrap_err().to_string();
    assert!(error.contains("convert-weights"), "{error}");
}

#[test]
fn what_is_not_finite_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.safetensors");
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for at in [0, 4095, 4096, 9999] {
            let mut values = vec![1e30f32; 10_000];
            values[at] = bad;
            let mut tensors = Tensors::default();
            tensors.insert("narrow", &[10_000], values.iter().map(|x| bf16::from_f32(*x)).collect::<Vec<_>>());
            tensors.insert("half", &[10_000], values.iter().map(|x| f16::from_f32(x / 1e30)).collect::<Vec<_>>());
            tensors.insert("fine", &[10_000], vec![f32::MAX; 10_000]);
            tensors.insert("wide", &[10_000], values);
            tensors.write(&path).unwrap();
            let weights = Mapped::open(&path).unwrap();
            let finite = |name: &str| weights.get(name).unwrap().storage().unwrap().is_finite();
            assert_eq!(["narrow", "half", "wide", "fine"].map(finite), [false, false, false, true], "{bad} at {at}");
        }
    }
}

#[test]
fn written_one_after_another() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.safetensors");
    let planned =
        |name: &str, dtype, width, shape: &[usize]| Planned { name: name.into(), dtype, width, shape: shape.to_vec() };
    let tensors = [planned("narrow", "BF16", 2, &[3]), planned("wide", "F32", 4, &[2, 1])];
    let metadata = BTreeMap::from([("a".to_string(), "b".to_string())]);
    let fill = |tensor: &Planned, w: &mut dyn std::io::Write| match tensor.name.as_str() {
        "wide" => [1.0f32, -2.0].iter().try_for_each(|x| w.write_all(&x.to_le_bytes())),
        _ => [0.5, 1.0, 2.0].iter().try_for_each(|x| w.write_all(&bf16::from_f32(*x).to_le_bytes())),
    };
    write_weights(&path, &metadata, &tensors, fill).unwrap();
    let weights = Mapped::open(&path).unwrap();
    assert_eq!(weights.metadata(), &metadata);
    let Storage::F32(wide) = weights.get("wide").unwrap().storage().unwrap() else { panic!() };
    assert_eq!(wide.as_ref(), [1.0, -2.0]);
    // A failure leaves the old file and nothing else.
    let before = std::fs::read(&path).unwrap();
    let short = write_weights(&path, &metadata, &tensors, |_, _| Ok(())).unwrap_err().to_string();
    assert!(short.contains("wide: 0 bytes written, 8 planned"), "{short}");
    assert_eq!((std::fs::read(&path).unwrap(), std::fs::read_dir(folder.path()).unwrap().count()), (before, 1));
}

const MANY: usize = (1 << 15) + 7;

fn of_four(folder: &Path) -> PathBuf {
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
    let file = Mapped::open(of_four(folder.path())).unwrap();
    assert_eq!((file.metadata().get("width").map(String::as_str), file.metadata().get("height")), (Some("640"), None));
    assert!(file.get("bytes").is_some() && file.get("width").is_none());
    let pair = file.array("pair").unwrap().f32s().unwrap();
    assert!(pair[0].is_nan() && pair[1].is_sign_negative());
    assert!(file.array("many").unwrap().f32s().unwrap().iter().enumerate().all(|(i, x)| *x == i as f32 / 3.0));
    assert!(file.array("empty").unwrap().f32s().unwrap().is_empty());
    assert_eq!((file.array("many").unwrap().shape(), file.array("empty").unwrap().shape()), (&[MANY][..], &[0, 4][..]));
}

#[test]
fn messages_name_file_tensor_and_what_was_found() {
    let folder = tempfile::tempdir().unwrap();
    let path = of_four(folder.path());
    let file = Mapped::open(&path).unwrap();
    let cases = [
        (file.array("nope").unwrap_err(), "tensor nope: expected a tensor, found none of that name among 4"),
        (file.array("bytes").unwrap().f32s().unwrap_err(), "tensor bytes: expected F32, found U8"),
        (Mapped::open(folder.path().join("none")).unwrap_err(), "none: "),
    ];
    for (error, expected) in cases {
        let message = error.to_string();
        assert!(message.contains(&*folder.path().to_string_lossy()) && message.contains(expected), "{message}");
    }
}
