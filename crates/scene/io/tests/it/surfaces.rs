//! Surfaces in files are read back as they were written.

use serde_json::Value;
use std::path::Path;
use weaver_io::ply::{read_points, read_triangles};
use weaver_io::{Bitmap, Image, PhotoFile, Surface, SurfaceTexture, read_gaussians, write_gaussians};
use weaver_scene::Gaussians;

const VERTICES: [[f32; 3]; 4] = [[0.5, 1.0, 2.0], [1.0, -0.25, 3.0], [-1.5, 0.0, 0.125], [2.0, 2.0, 2.0]];
const TRIANGLES: [[u32; 3]; 2] = [[0, 1, 2], [2, 1, 3]];
const COLORS: [[u8; 3]; 4] = [[255, 0, 0], [0, 128, 255], [10, 20, 30], [255; 3]];
const PLACES: [[f32; 2]; 5] = [[0.0, 0.25], [0.5, 0.5], [1.0, 0.75], [0.25, 1.0], [0.125, 0.0]];
const OF: [u32; 5] = [0, 1, 2, 2, 3];
const CORNERS: [[u32; 3]; 2] = [[0, 1, 2], [3, 1, 4]];

fn picture() -> Bitmap {
    let pixels = (0..16 * 16).flat_map(|i| [(i % 16 * 16) as u8, (i / 16 * 16) as u8, 90]).collect();
    Bitmap { width: 16, height: 16, pixels }
}

fn surface(picture: Option<&Bitmap>) -> Surface<'_> {
    let texture =
        picture.map(|picture| SurfaceTexture { coordinates: &PLACES, vertices: &OF, corners: &CORNERS, picture });
    Surface { vertices: &VERTICES, triangles: &TRIANGLES, colors: &COLORS, texture }
}

/// The document of a GLB, and its binary chunk.
fn parts(path: &Path) -> (Value, Vec<u8>) {
    let bytes = std::fs::read(path).unwrap();
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!((&bytes[..4], word(4), word(8), &bytes[16..20]), (&b"glTF"[..], 2, bytes.len(), &b"JSON"[..]));
    let end = 20 + word(12);
    assert!(end.is_multiple_of(4) && &bytes[end + 4..end + 8] == b"BIN\0" && word(end) + end + 8 == bytes.len());
    (serde_json::from_slice(&bytes[20..end]).unwrap(), bytes[end + 8..].to_vec())
}

/// The bytes of an accessor.
fn accessor(document: &Value, binary: &[u8], index: &Value) -> Vec<u8> {
    let accessor = &document["accessors"][index.as_u64().unwrap() as usize];
    view(document, binary, &accessor["bufferView"])
}

fn view(document: &Value, binary: &[u8], index: &Value) -> Vec<u8> {
    let view = &document["bufferViews"][index.as_u64().unwrap() as usize];
    let [start, length] = ["byteOffset", "byteLength"].map(|key| view[key].as_u64().unwrap() as usize);
    assert!(start.is_multiple_of(4));
    binary[start..start + length].to_vec()
}

fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect()
}

/// Positions, coordinates, triangles and the picture come back; y is up, so that x and y are negated.
#[test]
fn a_glb_has_its_texture_inside() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.glb");
    surface(Some(&picture())).write(&path).unwrap();
    let (document, binary) = parts(&path);
    let primitive = &document["meshes"][0]["primitives"][0];
    let read = |index: &Value| accessor(&document, &binary, index);
    let positions = floats(&read(&primitive["attributes"]["POSITION"]));
    let expected: Vec<f32> = OF.iter().map(|v| VERTICES[*v as usize]).flat_map(|[x, y, z]| [-x, -y, z]).collect();
    assert_eq!(positions, expected);
    assert_eq!(floats(&read(&primitive["attributes"]["TEXCOORD_0"])), PLACES.as_flattened());
    let indices: Vec<u32> =
        read(&primitive["indices"]).chunks_exact(4).map(|b| u32::from_le_bytes(b.try_into().unwrap())).collect();
    assert_eq!(indices, CORNERS.as_flattened());
    let image = &document["images"][0];
    assert_eq!((&image["mimeType"], &document["textures"][0]["source"]), (&"image/jpeg".into(), &0.into()));
    let jpeg = folder.path().join("a.jpg");
    std::fs::write(&jpeg, view(&document, &binary, &image["bufferView"])).unwrap();
    let found = PhotoFile::at(&jpeg).unwrap().read().unwrap();
    assert_eq!((found.width, found.height), (16, 16));
    let off = found.pixels.iter().zip(&picture().pixels).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
    assert!(off < 12, "{off}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
}

/// A mesh lies on its Gaussians: both are turned alike. Colors of vertices are shares of light.
#[test]
fn a_glb_lies_on_its_gaussians() {
    let folder = tempfile::tempdir().unwrap();
    let [path, splats] = ["a.glb", "b.glb"].map(|name| folder.path().join(name));
    surface(None).write(&path).unwrap();
    let scene = Gaussians {
        means: VERTICES.to_vec(),
        log_scales: vec![[-1.0; 3]; 4],
        quats: vec![[1.0, 0.0, 0.0, 0.0]; 4],
        opacity_logits: vec![0.0; 4],
        sh: vec![0.0; 12],
        degree: 0,
    };
    write_gaussians(&splats, &scene).unwrap();
    assert_eq!(read_gaussians(&splats).unwrap().means, VERTICES);
    let positions = |path: &Path| {
        let (document, binary) = parts(path);
        let attributes = document["meshes"][0]["primitives"][0]["attributes"].clone();
        (floats(&accessor(&document, &binary, &attributes["POSITION"])), attributes, document, binary)
    };
    let (own, attributes, document, binary) = positions(&path);
    assert_eq!(own, positions(&splats).0);
    let accessor_of = &document["accessors"][attributes["COLOR_0"].as_u64().unwrap() as usize];
    assert_eq!((&accessor_of["componentType"], &accessor_of["normalized"]), (&5123.into(), &true.into()));
    let colors = accessor(&document, &binary, &attributes["COLOR_0"]);
    let colors: Vec<u16> = colors.chunks_exact(2).map(|b| u16::from_le_bytes(b.try_into().unwrap())).collect();
    assert_eq!(colors[..4], [65535, 0, 0, 65535]);
    // 128 of 255 is 21.6 % of the light.
    assert!((f64::from(colors[5]) / 65535.0 - 0.2159).abs() < 1e-3, "{}", colors[5]);
}

#[test]
fn an_obj_has_its_texture_beside() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("house.obj");
    surface(Some(&picture())).write(&path).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    let rows = |key: &str| -> Vec<Vec<&str>> {
        let words = text.lines().map(|line| line.split_whitespace().collect::<Vec<_>>());
        words.filter(|words| words[0] == key).map(|words| words[1..].to_vec()).collect()
    };
    let numbers = |key: &str| rows(key).concat().iter().map(|x| x.parse::<f32>().unwrap()).collect::<Vec<_>>();
    assert_eq!(numbers("v"), VERTICES.as_flattened());
    assert_eq!(numbers("vt"), PLACES.iter().flat_map(|[u, v]| [*u, 1.0 - v]).collect::<Vec<_>>());
    assert_eq!(rows("f"), [["1/1", "2/2", "3/3"], ["3/4", "2/2", "4/5"]]);
    assert_eq!((rows("mtllib"), rows("usemtl")), (vec![vec!["house.mtl"]], vec![vec!["texture"]]));
    let material = std::fs::read_to_string(folder.path().join("house.mtl")).unwrap();
    assert!(material.contains("newmtl texture\n") && material.ends_with("map_Kd house.png\n"), "{material}");
    let found = PhotoFile::at(folder.path().join("house.png")).unwrap().read().unwrap();
    assert_eq!(found.pixels, picture().pixels);
    // An earlier one is replaced.
    surface(Some(&picture())).write(&path).unwrap();
    // Without a texture, colors stand behind coordinates.
    let plain = folder.path().join("plain.obj");
    surface(None).write(&plain).unwrap();
    let text = std::fs::read_to_string(&plain).unwrap();
    assert!(text.contains("v 1 -0.25 3 0.0000 0.5020 1.0000\n") && text.ends_with("f 1 2 3\nf 3 2 4\n"), "{text}");
}

/// A picture that is somebody's stays, and nothing is written beside it.
#[test]
fn an_obj_replaces_nothing_of_others() {
    let folder = tempfile::tempdir().unwrap();
    let [path, photo] = ["house.obj", "house.png"].map(|name| folder.path().join(name));
    Image::filled(2, 2, [0.5; 3]).write_png(&photo).unwrap();
    let before = std::fs::read(&photo).unwrap();
    let error = surface(Some(&picture())).write(&path).unwrap_err().to_string();
    assert!(error.contains("house.png") && error.contains("expected no file"), "{error}");
    assert_eq!((std::fs::read(&photo).unwrap(), std::fs::read_dir(folder.path()).unwrap().count()), (before, 1));
    assert!(Surface::check(&path, false).is_ok() && Surface::check(&path, true).is_err());
}

#[test]
fn a_surface_as_ply_has_colors_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.PLY");
    surface(None).write(&path).unwrap();
    assert_eq!(read_triangles(&path).unwrap(), (VERTICES.to_vec(), TRIANGLES.to_vec()));
    assert_eq!(read_points(&path).unwrap().colors, COLORS);
    let error = surface(Some(&picture())).write(&path).unwrap_err().to_string();
    assert!(error.contains("a name that ends with .glb or .obj"), "{error}");
    let error = surface(None).write(folder.path().join("a.stl")).unwrap_err().to_string();
    assert!(error.contains("expected ply, glb or obj"), "{error}");
    let nothing = Surface { vertices: &[], triangles: &[], colors: &[], texture: None };
    nothing.write(folder.path().join("b.glb")).unwrap();
    assert_eq!(parts(&folder.path().join("b.glb")).0["scenes"], serde_json::json!([{}]));
}
