//! glTF with Gaussians that are packed as SPZ files.

use crate::fixtures::assert_same;
use crate::gltf::read;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};
use weaver_io::{read_gaussians_from, write_gaussians_to};
use weaver_scene::Gaussians;

/// A document whose Gaussians are packed as an SPZ file, as tiles of Cesium are.
///
/// With the Gaussians in it, and a number of positions.
pub fn packed(count: usize) -> (Value, Gaussians) {
    let gaussians = Gaussians {
        means: vec![[1.0, 2.0, 3.0], [-0.5, 0.25, 0.0]],
        log_scales: vec![[-1.0, -2.0, -3.0]; 2],
        quats: vec![[0.5, 0.5, -0.5, 0.5], [1.0, 0.0, 0.0, 0.0]],
        opacity_logits: vec![0.5, -1.0],
        sh: (0..24).map(|i| (i as f32 * 0.7).sin()).collect(),
        degree: 1,
    };
    let mut spz = Vec::new();
    write_gaussians_to(&mut spz, "spz".parse().unwrap(), &gaussians).unwrap();
    let unpacked = read_gaussians_from(&spz, "spz".parse().unwrap()).unwrap();
    let name = "KHR_gaussian_splatting_compression_spz_2";
    let document = json!({
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_gaussian_splatting", name],
        "extensionsRequired": ["KHR_gaussian_splatting", name],
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "translation": [1, 2, 3]}],
        "meshes": [{"primitives": [{"mode": 0, "attributes": {"POSITION": 0},
            "extensions": {"KHR_gaussian_splatting": {"extensions": {name: {"bufferView": 0}}}}}]}],
        "accessors": [{"componentType": 5126, "count": count, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": spz.len()}],
        "buffers": [{"byteLength": spz.len(), "uri": format!("data:application/octet-stream;base64,{}", STANDARD.encode(spz))}],
    });
    (document, unpacked)
}

#[test]
fn packed_gaussians_are_those_of_spz() {
    let (document, mut expected) = packed(2);
    // A step up is one along -y here.
    expected.means.iter_mut().for_each(|[x, y, z]| (*x, *y, *z) = (*x - 1.0, *y - 2.0, *z + 3.0));
    assert_same("a.gltf", &read(&document).unwrap(), &expected, 1e-6);

    let message = |document: &Value| read(document).unwrap_err().to_string();
    let (other, _) = packed(3);
    let counted = "KHR_gaussian_splatting_compression_spz_2: expected 3 Gaussians, as POSITION has, found 2";
    assert!(message(&other).contains(counted), "{}", message(&other));
    let mut cut = document.clone();
    cut["bufferViews"][0]["byteLength"] = json!(20);
    assert!(message(&cut).contains("a.gltf/meshes[0].primitives[0]: "), "{}", message(&cut));
}
