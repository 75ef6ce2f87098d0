use half::{bf16, f16};
use proptest::prelude::*;
use std::path::Path;
use weaver_io::safetensors::{Tensor, TensorData, Tensors};

fn sample() -> Tensors {
    let mut tensors = Tensors::default();
    for (key, value) in [("step", "12"), ("config", "{\"a\": 1}"), ("who", "test"), ("zz", "")] {
        tensors.metadata.insert(key.into(), value.into());
    }
    tensors.insert("b.weight", &[2, 3], vec![1.0f32, -2.0, 3.5, f32::NAN, 0.0, -0.0]);
    tensors.insert("a.odd", &[3], vec![1u8, 2, 3]);
    tensors.insert("c.exact", &[1], vec![std::f64::consts::PI]);
    tensors.insert("d.scalar", &[], vec![u64::MAX]);
    tensors.insert("e.empty", &[0, 4], Vec::<f32>::new());
    tensors.insert("f.signed", &[2], vec![i64::MIN, 3]);
    tensors.insert("g.index", &[2], vec![-7i32, 9]);
    tensors.insert("h.half", &[2], vec![f16::from_f32(0.5), f16::from_f32(-2.0)]);
    tensors.insert("i.brain", &[1, 1], vec![bf16::from_f32(3.0)]);
    tensors
}

fn write(tensors: &Tensors, path: &Path) -> Vec<u8> {
    tensors.write(path).unwrap();
    std::fs::read(path).unwrap()
}

#[test]
fn round_trip_keeps_every_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.safetensors");
    let first = write(&sample(), &path);
    let back = Tensors::read(&path).unwrap();
    assert_eq!(back.metadata, sample().metadata);
    assert!(back.tensors.keys().eq(sample().tensors.keys()));
    let weight = back.values::<f32>("b.weight", &[2, 3]).unwrap();
    assert!(weight[3].is_nan() && weight[5].is_sign_negative());
    assert_eq!(back.values::<u64>("d.scalar", &[]).unwrap(), [u64::MAX]);
    assert_eq!(back.values::<f64>("c.exact", &[1]).unwrap(), [std::f64::consts::PI]);
    assert_eq!(*back.widened("h.half", &[2]).unwrap(), [0.5, -2.0]);
    assert_eq!(*back.widened("i.brain", &[1, 1]).unwrap(), [3.0]);
    assert_eq!(write(&back, &path), first, "the same content gives the same bytes");
}

#[test]
fn values_are_aligned_in_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = write(&sample(), &folder.path().join("a.safetensors"));
    let header = u64::from_le_bytes(*bytes.first_chunk().unwrap()) as usize;
    assert_eq!(header % 8, 0);
    let json: serde_json::Value = serde_json::from_slice(&bytes[8..8 + header]).unwrap();
    let offset = |key: &str| json[key]["data_offsets"][0].as_u64().unwrap();
    assert_eq!((offset("c.exact") % 8, offset("b.weight") % 4, offset("h.half") % 2), (0, 0, 0));
}

#[test]
fn messages_name_file_tensor_and_what_was_found() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.safetensors");
    write(&sample(), &path);
    let tensors = Tensors::read(&path).unwrap();
    let cases = [
        (tensors.values::<f32>("nope", &[1]).unwrap_err(), "tensor nope: expected a tensor, found none"),
        (tensors.values::<f32>("b.weight", &[3, 2]).unwrap_err(), "tensor b.weight: expected [3, 2], found [2, 3]"),
        (tensors.values::<f64>("b.weight", &[2, 3]).unwrap_err(), "tensor b.weight: expected F64, found F32"),
        (tensors.widened("g.index", &[2]).unwrap_err(), "tensor g.index: expected F32, F16 or BF16, found I32"),
    ];
    for (error, expected) in cases {
        let message = error.to_string();
        assert!(message.contains("a.safetensors: ") && message.contains(expected), "{message}");
    }
    let mut bytes = std::fs::read(&path).unwrap();
    bytes.pop();
    std::fs::write(&path, bytes).unwrap();
    let message = Tensors::read(&path).unwrap_err().to_string();
    assert!(message.contains("a.safetensors: header: expected a complete safetensors file"), "{message}");
}

#[test]
fn a_shape_that_does_not_fit_is_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.safetensors");
    let mut tensors = Tensors::default();
    tensors.tensors.insert("w".into(), Tensor { shape: vec![3], data: TensorData::F32(vec![0.0; 2]) });
    let message = tensors.write(&path).unwrap_err().to_string();
    assert!(message.contains("tensor w: expected values for [3], found 2"), "{message}");
    assert!(!path.exists());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 4))]

    #[test]
    fn hostile_files_never_panic(at in 0.0..1.0f64, byte in any::<u8>(), keep in 0.0..1.0f64) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        let mut bytes = write(&sample(), &path);
        let index = (at * bytes.len() as f64) as usize;
        bytes[index] = byte;
        bytes.truncate((keep * 2.0 * bytes.len() as f64) as usize);
        std::fs::write(&path, &bytes).unwrap();
        let _ = Tensors::read(&path);
    }
}
