//! glTF: round trips, a scene of another tool, accessors of every kind, and documents that lie.

use crate::fixtures::assert_same;
use crate::formats::{gaussians, round_trip};
use crate::shared;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use proptest::prelude::*;
use serde_json::{Value, json};
use weaver_geometry::Similarity;
use weaver_geometry::glam::{DMat3, DQuat, DVec3};
use weaver_io::{read_gaussians, write_gaussians};
use weaver_scene::Gaussians;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 5))]

    #[test]
    fn gltf_keeps_floats(gaussians in gaussians()) {
        for name in ["a.glb", "a.gltf"] {
            let back = round_trip(name, &gaussians);
            prop_assert_eq!((&back.means, &back.sh, back.degree), (&gaussians.means, &gaussians.sh, if gaussians.is_empty() { 0 } else { gaussians.degree }));
            if !gaussians.is_empty() {
                assert_same(name, &back, &gaussians, 1e-5);
            }
        }
    }
}

/// Promise of `fixtures_of_splat_transform`.
#[test]
fn a_scene_of_splat_transform() {
    let Some(folder) = shared::samples() else { return };
    for degree in [0, 3] {
        let ply = read_gaussians(folder.join("own-sh3.ply")).unwrap();
        let glb = read_gaussians(folder.join(format!("own-sh{degree}.glb"))).unwrap();
        assert_eq!((glb.len(), glb.degree), (300, degree));
        if degree == 3 {
            assert_same("own-sh3.glb", &glb, &ply, 1e-5);
        }
    }
}

/// Two Gaussians by accessors of every kind: positions as interleaved normalized shorts, rotations as normalized signed
/// bytes, scales as floats, opacities as normalized bytes, colors sparse over nothing.
pub fn hard() -> Value {
    let mut buffer = Vec::new();
    // Positions and opacities, 8 bytes each: (1, -1, 0.5) and (0, 0.5, -1); 0.2 and 1.
    for (position, opacity) in [([32767_i16, -32767, 16384], 51_u8), ([0, 16384, -32768], 255)] {
        position.iter().for_each(|x| buffer.extend(x.to_le_bytes()));
        buffer.extend([opacity, 0]);
    }
    buffer.extend([0_i8, 0, 0, 127, 0, 127, 0, 0].map(|x| x as u8)); // at 16, xyzw
    [1.0_f32, 1.0, 1.0, 2.0, 1.0, 0.5].iter().for_each(|x| buffer.extend(x.to_le_bytes())); // at 24
    buffer.extend([1, 0, 0, 0]); // at 48, the index of the color that is not zero
    [0.25_f32, -0.5, 1.0].iter().for_each(|x| buffer.extend(x.to_le_bytes())); // at 52
    let view = |start: usize, length: usize| json!({"buffer": 0, "byteOffset": start, "byteLength": length});
    json!({
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_gaussian_splatting"],
        "scenes": [{"nodes": [1]}],
        "nodes": [{"mesh": 0}, {"children": [0]}],
        "meshes": [{"primitives": [{"mode": 0, "extensions": {"KHR_gaussian_splatting": {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}}, "attributes": {
            "POSITION": 0, "KHR_gaussian_splatting:ROTATION": 1, "KHR_gaussian_splatting:SCALE": 2,
            "KHR_gaussian_splatting:OPACITY": 3, "KHR_gaussian_splatting:SH_DEGREE_0_COEF_0": 4}}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5122, "normalized": true, "count": 2, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5120, "normalized": true, "count": 2, "type": "VEC4"},
            {"bufferView": 2, "componentType": 5126, "count": 2, "type": "VEC3"},
            {"bufferView": 0, "byteOffset": 6, "componentType": 5121, "normalized": true, "count": 2, "type": "SCALAR"},
            {"componentType": 5126, "count": 2, "type": "VEC3", "sparse": {"count": 1,
                "indices": {"bufferView": 3, "componentType": 5123}, "values": {"bufferView": 4, "byteOffset": 0}}}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 16, "byteStride": 8}, view(16, 8), view(24, 24), view(48, 4), view(52, 12)],
        "buffers": [{"byteLength": 64, "uri": format!("data:application/octet-stream;base64,{}", STANDARD.encode(buffer))}],
    })
}

pub fn read(document: &Value) -> weaver_io::Result<Gaussians> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.gltf");
    std::fs::write(&path, document.to_string()).unwrap();
    read_gaussians(&path)
}

#[test]
fn accessors_of_every_kind() {
    let found = read(&hard()).unwrap();
    let half = 16384.0 / 32767.0;
    let expected = Gaussians {
        // x and y turn around.
        means: vec![[-1.0, 1.0, half], [0.0, -half, -1.0]],
        log_scales: vec![[0.0; 3], [2.0_f32.ln(), 0.0, 0.5_f32.ln()]],
        // The identity becomes half a turn about z; half a turn about y becomes one about x.
        quats: vec![[0.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 0.0]],
        opacity_logits: vec![0.25_f32.ln(), f32::INFINITY],
        sh: vec![0.0, 0.0, 0.0, 0.25, -0.5, 1.0],
        degree: 0,
    };
    assert_same("a.gltf", &found, &expected, 1e-6);
}

#[test]
fn a_document_beside_its_buffer() {
    let folder = tempfile::tempdir().unwrap();
    let mut document = hard();
    let uri = document["buffers"][0]["uri"].as_str().unwrap();
    let buffer = STANDARD.decode(uri.split_once(',').unwrap().1).unwrap();
    std::fs::write(folder.path().join("a b.bin"), buffer).unwrap();
    document["buffers"][0]["uri"] = json!("a%20b.bin");
    let path = folder.path().join("a.gltf");
    std::fs::write(&path, document.to_string()).unwrap();
    assert_eq!(read_gaussians(&path).unwrap(), read(&hard()).unwrap());
}

/// Nodes carry Gaussians as [`Gaussians::transformed`] does, before the axes turn.
#[test]
fn transforms_of_nodes_apply() {
    let gaussians = Gaussians {
        means: vec![[1.0, 2.0, 3.0], [-0.5, 0.25, 0.0]],
        log_scales: vec![[-1.0, -2.0, -3.0]; 2],
        quats: vec![[0.5, 0.5, -0.5, 0.5], [1.0, 0.0, 0.0, 0.0]],
        opacity_logits: vec![0.5, -1.0],
        sh: (0..24).map(|i| (i as f32 * 0.7).sin()).collect(),
        degree: 1,
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.gltf");
    write_gaussians(&path, &gaussians).unwrap();
    let mut document: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let q = DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 0.8);
    document["nodes"] = json!([
        {"mesh": 0, "scale": [2.0, 2.0, 2.0], "rotation": q.to_array()},
        {"children": [0], "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 2, 3, 1]}]);
    document["scenes"][0]["nodes"] = json!([1]);
    let found = read(&document).unwrap();
    // In axes of captures, half a turn about z is done and undone around it.
    let turn = DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0));
    let to = Similarity {
        scale: 2.0,
        rotation: turn * DMat3::from_quat(q) * turn,
        translation: DVec3::new(-1.0, -2.0, 3.0),
    };
    assert_same("a.gltf", &found, &gaussians.transformed(&to), 1e-5);

    let message = |node: Value| {
        let mut document = document.clone();
        document["nodes"][0] = node;
        read(&document).unwrap_err().to_string()
    };
    let transform = "nodes[0]: expected a transform of positive scales, rotation and translation";
    for node in [json!({"mesh": 0, "scale": [-1.0, 1.0, 1.0]}), json!({"mesh": 0, "scale": [0, 0, 0]})] {
        assert!(message(node).contains(transform));
    }
    assert!(message(json!({"children": [1]})).contains("nodes[1]: expected a node of one parent"));
    assert!(message(json!({"mesh": 7})).contains("nodes: expected a mesh below 1, found 7"));
}

/// A stretch along the axes of a node carries a Gaussian as its covariance.
#[test]
fn several_scales_stretch() {
    let mut document = hard();
    document["nodes"][0] = json!({"mesh": 0, "scale": [2.0, 3.0, 0.5], "translation": [1.0, 0.0, 0.0]});
    let half = 16384.0 / 32767.0;
    let found = read(&document).unwrap();
    let plain = read(&hard()).unwrap();
    // Scales (2, 1, 0.5) about half a turn are along x, y and z.
    let expected = Gaussians {
        means: vec![[-3.0, 3.0, 0.5 * half], [-1.0, -3.0 * half, -0.5]],
        log_scales: vec![[2.0_f32.ln(), 3.0_f32.ln(), 0.5_f32.ln()], [4.0_f32.ln(), 3.0_f32.ln(), 0.25_f32.ln()]],
        ..plain
    };
    assert_same("a.gltf", &found, &expected, 1e-6);
}

/// Points have linear colors, in which programs without the extension show them, and opacities.
#[test]
fn colors_of_points_are_linear() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.gltf");
    let one = Gaussians {
        means: vec![[0.0; 3]],
        log_scales: vec![[0.0; 3]],
        quats: vec![[1.0, 0.0, 0.0, 0.0]],
        opacity_logits: vec![0.0],
        sh: [0.5, -1.0, 2.0].map(weaver_scene::forms::harmonic).to_vec(),
        degree: 0,
    };
    write_gaussians(&path, &one).unwrap();
    let document: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let at = document["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"].as_u64().unwrap() as usize;
    let accessor = &document["accessors"][at];
    assert_eq!((&accessor["componentType"], &accessor["normalized"]), (&json!(5123), &json!(true)));
    let start = document["bufferViews"][at]["byteOffset"].as_u64().unwrap() as usize;
    let uri = document["buffers"][0]["uri"].as_str().unwrap();
    let buffer = STANDARD.decode(uri.split_once(',').unwrap().1).unwrap();
    let color: Vec<u16> = buffer[start..start + 8].as_chunks::<2>().0.iter().map(|x| u16::from_le_bytes(*x)).collect();
    // Half in sRGB is 0.21404 of light.
    assert_eq!(color, [14027, 0, 65535, 32768]);
}

#[test]
fn messages_say_what() {
    let changed = |change: &dyn Fn(&mut Value)| {
        let mut document = hard();
        change(&mut document);
        read(&document).unwrap_err().to_string()
    };
    let attributes = |d: &mut Value| std::mem::take(&mut d["meshes"][0]["primitives"][0]["attributes"]);
    let set = |pointer: &'static str, to: Value| changed(&move |d| *d.pointer_mut(pointer).unwrap() = to.clone());
    let splatting = |key: &'static str, to: Value| {
        let extension = "/meshes/0/primitives/0/extensions/KHR_gaussian_splatting";
        changed(&move |d| d.pointer_mut(extension).unwrap()[key] = to.clone())
    };
    let with_float = |at: usize, number: f32| {
        changed(&move |d| {
            let uri = d["buffers"][0]["uri"].as_str().unwrap().to_string();
            let (start, coded) = uri.split_once(',').unwrap();
            let mut buffer = STANDARD.decode(coded).unwrap();
            buffer[at..at + 4].copy_from_slice(&number.to_le_bytes());
            d["buffers"][0]["uri"] = json!(format!("{start},{}", STANDARD.encode(buffer)));
        })
    };
    let cases = [
        (with_float(40, -1.0), "primitives[0]: expected scales of 0 and more, found [2.0, -1.0, 0.5] at 1"),
        (with_float(36, f32::NAN), "accessors[2]: expected finite numbers, found [NaN, 1.0, 0.5] at 1"),
        (set("/extensionsUsed", json!([])), "extensionsUsed: expected KHR_gaussian_splatting"),
        (changed(&|d| d["extensionsRequired"] = json!(["KHR_draco"])), "or KHR_mesh_quantization, found KHR_draco"),
        (set("/meshes/0/primitives/0/mode", json!(4)), "expected mode 0 (points), found Some(4)"),
        (
            changed(&|d| {
                d["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"]["kernel"] = json!("cone")
            }),
            "expected kernel \"ellipse\", found \"cone\"",
        ),
        (splatting("kernel", Value::Null), "expected kernel \"ellipse\", found none"),
        (splatting("colorSpace", Value::Null), "expected colorSpace \"srgb_rec709_display\", found none"),
        (splatting("colorSpace", json!("lin_rec709_display")), "found \"lin_rec709_display\""),
        (splatting("projection", json!("fisheye")), "expected projection \"perspective\", found \"fisheye\""),
        (splatting("sortingMethod", json!("zDepth")), "expected sortingMethod \"cameraDistance\""),
        (changed(&|d| drop(attributes(d).take())), "a.gltf: line 1 column"),
        (
            changed(&|d| {
                drop(
                    d["meshes"][0]["primitives"][0]["attributes"]
                        .as_object_mut()
                        .unwrap()
                        .remove("KHR_gaussian_splatting:SCALE"),
                )
            }),
            "expected an attribute KHR_gaussian_splatting:SCALE, found none",
        ),
        (
            changed(&|d| {
                d["meshes"][0]["primitives"][0]["attributes"]["KHR_gaussian_splatting:SH_DEGREE_1_COEF_2"] = json!(4)
            }),
            "an attribute KHR_gaussian_splatting:SH_DEGREE_1_COEF_0",
        ),
        (
            changed(&|d| {
                d["meshes"][0]["primitives"][0]["attributes"]["KHR_gaussian_splatting:SH_DEGREE_3_COEF_6"] = json!(4)
            }),
            "an attribute KHR_gaussian_splatting:SH_DEGREE_1_COEF_0",
        ),
        (
            set("/accessors/1/normalized", json!(false)),
            "accessors[1]: expected a componentType of 5126, 5120 normalized, 5122 normalized, found 5120",
        ),
        (
            changed(&|d| {
                d["accessors"][3] =
                    json!({"bufferView": 2, "byteOffset": 8, "componentType": 5126, "count": 2, "type": "SCALAR"});
            }),
            "expected opacities from 0 to 1, found [2.0] at 1",
        ),
        (set("/accessors/1/count", json!(3)), "accessors[1]: expected 2 elements of VEC4, found 3 of VEC4"),
        (
            set("/accessors/0/count", json!(1_000_000)),
            "expected at most 64 Gaussians in buffers of this length, found 1000000",
        ),
        (
            changed(&|d| {
                let mut other = d["meshes"][0]["primitives"][0].clone();
                other["attributes"]["POSITION"] = json!(5);
                d["meshes"][0]["primitives"].as_array_mut().unwrap().push(other);
                let none = json!({"componentType": 5126, "count": u64::MAX, "type": "VEC3"});
                d["accessors"].as_array_mut().unwrap().push(none);
            }),
            "primitives[1]: expected at most 64 Gaussians in buffers of this length",
        ),
        (set("/accessors/2/componentType", json!(5125)), "accessors[2]: expected a componentType"),
        (
            set("/accessors/3/byteOffset", json!(8)),
            "accessors[3]: expected 2 elements of 1 bytes within the 16 of its view, found steps of 8 from 8",
        ),
        (set("/accessors/3/byteOffset", json!(u64::MAX)), "accessors[3]: expected 2 elements"),
        (set("/accessors/2/bufferView", json!(9)), "bufferViews[9]: expected fewer than 5"),
        (
            set("/bufferViews/2/byteLength", json!(1000)),
            "bufferViews[2]: expected bytes within the 64 of its buffer, found 1000 from 24",
        ),
        (set("/bufferViews/2/byteLength", json!(20)), "accessors[2]: expected 2 elements of 12 bytes within the 20"),
        (set("/bufferViews/0/byteStride", json!(4)), "accessors[0]: expected 2 elements of 6 bytes"),
        (set("/bufferViews/2/buffer", json!(1)), "bufferViews[2]: expected a buffer below 1, found 1"),
        (
            set("/accessors/4/sparse/indices/componentType", json!(5126)),
            "accessors[4]: expected indices of componentType",
        ),
        (
            set("/accessors/4/sparse/values/byteOffset", json!(4)),
            "accessors[4]: expected 1 elements of 12 bytes within the 12",
        ),
        (set("/bufferViews/3/byteOffset", json!(26)), "accessors[4]: expected sparse indices below 2"),
        (set("/buffers/0/byteLength", json!(65)), "buffers[0]: expected 65 bytes, found 64"),
        (set("/buffers/0/uri", json!("data:,x")), "buffers[0]: expected base64"),
        (set("/buffers/0/uri", json!("../secret.bin")), "the name of a file in the document's folder"),
        (set("/buffers/0/uri", json!("https://example.com/a.bin")), "the name of a file in the document's folder"),
        (set("/scenes/0/nodes", json!([9])), "nodes[9]: expected fewer than 2 nodes"),
        (changed(&|d| d["scene"] = json!(3)), "scene: expected below 1, found 3"),
    ];
    for (message, expected) in cases {
        assert!(message.contains("a.gltf: ") && message.contains(expected), "{message} for {expected}");
    }
}

#[test]
fn chunks_are_checked() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.glb");
    let one = Gaussians {
        means: vec![[1.0, 2.0, 3.0]],
        log_scales: vec![[0.0; 3]],
        quats: vec![[1.0, 0.0, 0.0, 0.0]],
        opacity_logits: vec![0.0],
        sh: vec![0.0; 3],
        degree: 0,
    };
    write_gaussians(&path, &one).unwrap();
    let whole = std::fs::read(&path).unwrap();
    assert_eq!((whole.len() % 4, u32::from_le_bytes(whole[8..12].try_into().unwrap()) as usize), (0, whole.len()));
    let message = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        read_gaussians(&path).unwrap_err().to_string()
    };
    let change = |at: usize, byte: u8| {
        let mut bytes = whole.clone();
        bytes[at] = byte;
        message(&bytes)
    };
    let cases = [
        (change(4, 1), "byte 8: expected version 2, found 1"),
        (change(11, 255), "at most"),
        (change(15, 255), "bytes of a chunk"),
        (change(16, b'X'), "chunks: expected one of JSON first, found 4e4f5358"),
        (message(&whole[..whole.len() - 1]), "expected at most"),
        (message(b"glTF"), "bytes of a version"),
    ];
    for (message, expected) in cases {
        assert!(message.contains("a.glb: ") && message.contains(expected), "{message} for {expected}");
    }
}
