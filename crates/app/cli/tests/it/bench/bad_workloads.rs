//! Workload files that are wrong in one place each.

use super::raster::{raster, small};
use crate::capture::halve;
use std::path::Path;
use weaver_io::safetensors::{TensorData, Tensors};

/// A workload spoilt by `spoil` is refused, in words that name the file and `parts`.
#[track_caller]
fn refused(spoil: impl FnOnce(&mut Tensors), parts: &[&str]) {
    let (_folder, path, mut workload) = small();
    spoil(&mut workload);
    workload.write(&path).unwrap();
    let parts = [&["w.safetensors: "], parts].concat();
    for mode in ["--json", "--forward-only"] {
        raster(&[&"--workload", &path, &mode]).refused(1, &parts);
    }
}

fn remove(key: &'static str) -> impl FnOnce(&mut Tensors) {
    move |workload| assert!(workload.tensors.remove(key).is_some())
}

/// The tensor with another shape and as many zeros.
fn reshape(key: &'static str, shape: &'static [usize]) -> impl FnOnce(&mut Tensors) {
    move |workload| workload.insert(key, shape, vec![0.0_f32; shape.iter().product()])
}

fn say(key: &'static str, value: &'static str) -> impl FnOnce(&mut Tensors) {
    move |workload| {
        workload.metadata.insert(key.into(), value.into());
    }
}

fn put(key: &'static str, at: usize, value: f32) -> impl FnOnce(&mut Tensors) {
    move |workload| {
        let TensorData::F32(values) = &mut workload.tensors.get_mut(key).unwrap().data else { panic!("F32 expected") };
        values[at] = value;
    }
}

#[test]
fn no_file() {
    raster(&[&"--workload", &"nowhere.safetensors"]).refused(1, &["nowhere.safetensors: "]);
}

#[test]
fn no_safetensors() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("w.safetensors");
    for content in ["", "short", "a text that is much longer than the length of a header"] {
        std::fs::write(&path, content).unwrap();
        raster(&[&"--workload", &path]).refused(1, &["w.safetensors: header: expected a complete safetensors file"]);
    }
    let (_folder, path, _) = small();
    halve(&path);
    raster(&[&"--workload", &path]).refused(1, &["w.safetensors: header: expected a complete safetensors file"]);
}

#[test]
fn missing_tensors() {
    for key in ["means", "quats", "scales", "opacities", "viewmat", "K", "background", "v_image", "v_alpha"] {
        refused(remove(key), &[&format!("tensor {key}: expected a tensor, found none")]);
    }
}

#[test]
fn colors_once() {
    refused(remove("colors"), &["expected either colors or sh, found neither"]);
    refused(reshape("sh", &[400, 4, 3]), &["expected either colors or sh, found both"]);
}

#[test]
fn other_types() {
    for key in ["means", "opacities", "K", "background"] {
        let spoil = |workload: &mut Tensors| {
            let shape = workload.tensors[key].shape.clone();
            workload.insert(key, &shape, vec![0.0_f64; shape.iter().product()]);
        };
        refused(spoil, &[&format!("tensor {key}: expected F32, found F64")]);
    }
}

#[test]
fn other_shapes() {
    refused(reshape("means", &[400, 4]), &["tensor means: expected [N, 3], found [400, 4]"]);
    refused(reshape("means", &[1200]), &["tensor means: expected [N, 3], found [1200]"]);
    refused(reshape("means", &[399, 3]), &["tensor quats: expected [399, 4], found [400, 4]"]);
    refused(reshape("scales", &[400, 1]), &["tensor scales: expected [400, 3], found [400, 1]"]);
    refused(reshape("opacities", &[400, 1]), &["tensor opacities: expected [400], found [400, 1]"]);
    refused(reshape("colors", &[399, 3]), &["tensor colors: expected [400, 3], found [399, 3]"]);
    refused(reshape("viewmat", &[3, 4]), &["tensor viewmat: expected [4, 4], found [3, 4]"]);
    refused(reshape("K", &[4]), &["tensor K: expected [3, 3], found [4]"]);
    refused(reshape("background", &[1]), &["tensor background: expected [3], found [1]"]);
    refused(reshape("v_image", &[121, 79, 3]), &["tensor v_image: expected [79, 121, 3], found [121, 79, 3]"]);
    refused(reshape("v_alpha", &[79, 121, 1]), &["tensor v_alpha: expected [79, 121], found [79, 121, 1]"]);
    refused(reshape("v_depth", &[79]), &["tensor v_depth: expected [79, 121], found [79]"]);
}

#[test]
fn harmonics_of_no_degree() {
    for shape in [&[400, 5, 3][..], &[400, 36, 3], &[400, 0, 3], &[400, 16], &[400, 4, 4]] {
        let spoil = |workload: &mut Tensors| {
            workload.tensors.remove("colors");
            workload.insert("sh", shape, vec![0.0_f32; shape.iter().product()]);
        };
        refused(spoil, &["tensor sh: expected [400, K, 3] with K of 1, 4, 9, 16 or 25", &format!("found {shape:?}")]);
    }
    let spoil = |workload: &mut Tensors| {
        workload.tensors.remove("colors");
        workload.insert("sh", &[399, 4, 3], vec![0.0_f32; 399 * 12]);
    };
    refused(spoil, &["tensor sh: expected [400, 4, 3], found [399, 4, 3]"]);
}

#[test]
fn sizes() {
    for key in ["width", "height"] {
        let spoil = |workload: &mut Tensors| assert!(workload.metadata.remove(key).is_some());
        refused(spoil, &[&format!("metadata {key}: expected a number of pixels"), "found none"]);
        for value in ["0", "-1", "12.5", "wide", "", "1048577", "99999999999999999999999"] {
            refused(say(key, value), &[&format!("metadata {key}: expected a number of pixels"), &format!("`{value}`")]);
        }
    }
    refused(say("width", "120"), &["tensor v_image: expected [79, 120, 3], found [79, 121, 3]"]);
}

#[test]
fn modes() {
    refused(say("mode", "sharp"), &["metadata mode: expected classic or antialiased, found `sharp`"]);
}

#[test]
fn matrices_of_no_pinhole_camera() {
    refused(put("K", 1, 0.5), &["tensor K: expected [fx, 0, cx, 0, fy, cy, 0, 0, 1], found"]);
    refused(put("K", 8, f32::NAN), &["tensor K: expected [fx, 0, cx", "NaN"]);
    refused(put("viewmat", 14, 0.5), &["tensor viewmat: expected 0 0 0 1 as the last row, found [0.0, 0.0, 0.5, 1.0]"]);
}

#[test]
fn numbers_that_are_none_are_drawn_around() {
    let (folder, path, mut workload) = small();
    put("means", 0, f32::NAN)(&mut workload);
    put("scales", 5, f32::INFINITY)(&mut workload);
    workload.write(&path).unwrap();
    let out = folder.path().join("o.safetensors");
    let done = raster(&[&"--workload", &path, &"--dump", &out]).fine();
    assert!(done.stdout.contains("Gaussians left out, not finite or without a rotation: 2"), "{}", done.stdout);
    let dump = Tensors::read(&out).unwrap();
    for (key, tensor) in &dump.tensors {
        let TensorData::F32(values) = &tensor.data else { panic!("F32 expected") };
        assert!(values.iter().all(|x| x.is_finite()), "{key}");
    }
}

#[test]
fn a_dump_that_cannot_be_written() {
    let (folder, path, _) = small();
    raster(&[&"--workload", &path, &"--dump", &path.join("o.safetensors")]).refused(1, &["w.safetensors", "a file"]);
    let taken = folder.path().join("taken.safetensors");
    std::fs::create_dir(&taken).unwrap();
    raster(&[&"--workload", &path, &"--dump", &taken]).refused(2, &["the name of a file", "a folder"]);
    std::fs::remove_dir(&taken).unwrap();
    raster(&[&"--workload", &path, &"--dump", &folder.path()]).refused(2, &["a name that ends with .safetensors"]);
    raster(&[&"--workload", &path, &"--dump", &path]).refused(2, &["w.safetensors", "what is read"]);
    assert_eq!(entries(folder.path()), ["w.safetensors"]);
}

fn entries(folder: &Path) -> Vec<String> {
    std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
}
