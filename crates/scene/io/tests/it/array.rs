//! Arrays as Python writes them.

use std::path::{Path, PathBuf};
use weaver_io::open_array;
use weaver_io::safetensors::Storage;
use weaver_io::safetensors::Tensors;

/// The bytes of an NPY file with this header, padded as NumPy pads it.
pub fn npy(version: u8, header: &str, data: &[u8]) -> Vec<u8> {
    let width = if version == 1 { 2 } else { 4 };
    let length = (8 + width + header.len() + 1).next_multiple_of(64) - 8 - width;
    let mut bytes = b"\x93NUMPY".to_vec();
    bytes.extend([version, 0]);
    bytes.extend(&(length as u32).to_le_bytes()[..width]);
    bytes.extend(format!("{header:<0$}\n", length - 1).bytes());
    bytes.extend(data);
    bytes
}

pub const HEADER: &str = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 1, 3), }";

fn floats() -> Vec<u8> {
    (0..6).flat_map(|i| (i as f32 * 0.5).to_le_bytes()).collect()
}

fn written(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    std::fs::write(folder.join(name), bytes).unwrap();
    folder.join(name)
}

fn values(path: &Path) -> Vec<f32> {
    match open_array(path).unwrap().storage().unwrap() {
        Storage::F32(slice) => slice.as_ref().to_vec(),
        Storage::F16(slice) => slice.as_ref().iter().map(|x| x.to_f32()).collect(),
        other => panic!("{other:?}"),
    }
}

#[test]
fn numpy_arrays_are_read_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    for version in 1..=3 {
        let path = written(folder.path(), "photo.npy", &npy(version, HEADER, &floats()));
        assert_eq!(values(&path), [0.0, 0.5, 1.0, 1.5, 2.0, 2.5]);
        let array = open_array(&path).unwrap();
        assert_eq!((array.name(), array.shape(), array.dtype()), ("photo", &[2, 1, 3][..], "F32".into()));
    }
    // 1.0 and -2.0 in half precision, and an array without sides.
    let half = npy(1, "{'descr': '<f2', 'fortran_order': False, 'shape': (2,), }", &[0x00, 0x3c, 0x00, 0xc0]);
    assert_eq!(values(&written(folder.path(), "half.NPY", &half)), [1.0, -2.0]);
    let single = npy(1, "{'descr': '<f4', 'fortran_order': False, 'shape': (), }", &1.0_f32.to_le_bytes());
    assert_eq!(values(&written(folder.path(), "single.npy", &single)), [1.0]);
}

#[test]
fn what_is_no_array_is_refused_with_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let message = |name: &str, bytes: &[u8]| open_array(written(folder.path(), name, bytes)).unwrap_err().to_string();
    let refused = |header: &str, part: &str| {
        let text = message("a.npy", &npy(1, header, &floats()));
        assert!(text.contains("a.npy") && text.contains(part), "{text}");
    };
    refused("{'descr': '<f8', 'fortran_order': False, 'shape': (3,), }", "descr: expected <f4 or <f2, as");
    refused("{'descr': '>f4', 'fortran_order': False, 'shape': (6,), }", "found >f4");
    refused("{'descr': '<f4', 'fortran_order': True, 'shape': (6,), }", "fortran_order: expected False");
    refused("{'descr': '<f4', 'fortran_order': False, 'shape': (7,), }", "24 bytes of numbers in a file of shape [7]");
    refused("{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999999, 99999999999999), }", "24 bytes");
    refused("{'descr': '<f4', 'fortran_order': False, 'shape': (a,), }", "without shape");
    refused("{'descr': '<f4', 'shape': (6,), }", "without fortran_order");
    refused("{}", "without descr");
    assert!(message("b.npy", b"PK\x03\x04").contains("a complete NPY file"));
    assert!(message("b.npy", b"\x93NUMPY\x04\x00").contains("version: expected 1, 2 or 3, found 4"));
    assert!(message("b.npy", b"\x93NUMPY\x01\x00\xff\xff{}").contains("fewer than its header says"));
    assert!(message("b.txt", b"").contains(".npy or .safetensors"));
}

#[test]
fn a_tensor_is_found_by_its_name_or_where_it_is_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.safetensors");
    let mut tensors = Tensors::default();
    tensors.insert("mask", &[1], vec![1.0_f32]);
    tensors.insert("other", &[1], vec![2.0_f32]);
    tensors.write(&path).unwrap();
    let text = open_array(&path).unwrap_err().to_string();
    assert!(text.contains("expected one of the name `features`, or a single one, found 2 others"), "{text}");
    tensors.insert("features", &[1, 1, 1], vec![3.0_f32]);
    tensors.write(&path).unwrap();
    assert_eq!(values(&path), [3.0]);
}
