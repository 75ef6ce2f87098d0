//! SOG: round trips, scenes of another tool, and files that lie about themselves.

use crate::formats::{Tolerance, assert_near, gaussians, ordered, round_trip};
use crate::shared;
use image_webp::{ColorType, WebPEncoder};
use proptest::prelude::*;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::{Cursor, Read, Write};
use std::path::Path;
use weaver_io::{Drawing, read_gaussians, read_scene, write_gaussians, write_scene};
use weaver_scene::Gaussians;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

/// Sixteen bits of `ln(1 + |x|)` up to 500 on both sides; rotations of 8 bits. Of so few Gaussians tables hold every
/// number, but not palettes of harmonics.
const FEW: Tolerance = Tolerance {
    position: 0.51 * 12.5 / 65535.0 * 501.0,
    scale: 1e-6,
    rotation: 1.5,
    opacity: 0.51 / 255.0,
    color: 1e-6,
    harmonics: f32::INFINITY,
};

fn scene(n: usize) -> Gaussians {
    let wave = |i: usize, step: f32| (i as f32 * step).sin();
    Gaussians {
        means: (0..n).map(|i| [wave(i, 0.37), 3.0 * wave(i, 0.11), i as f32 / n as f32]).collect(),
        log_scales: (0..n).map(|i| [-3.0 + wave(i, 0.7), -4.0, -5.0 + wave(i, 1.3)]).collect(),
        quats: (0..n).map(|i| [1.0, wave(i, 0.2), wave(i, 0.5), wave(i, 0.9)]).collect(),
        opacity_logits: (0..n).map(|i| 4.0 * wave(i, 0.01)).collect(),
        sh: (0..n * 12).map(|i| 0.4 * wave(i / 12 % 20, 1.7) + 0.1 * (i % 12) as f32).collect(),
        degree: 1,
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 5))]

    #[test]
    fn sog_rounds_and_orders_anew(gaussians in gaussians()) {
        let back = round_trip("a.sog", &gaussians);
        prop_assert_eq!(back.len(), gaussians.len());
        assert_near(&ordered("a.sog", &gaussians), &back, &FEW);
        prop_assert_eq!(round_trip("meta.json", &gaussians), back);
    }
}

/// Twenty different colors: the palette holds them all.
#[test]
fn few_colors_are_kept_by_the_palette() {
    let gaussians = scene(1500);
    let back = round_trip("a.sog", &gaussians);
    assert_eq!((back.len(), back.degree), (1500, 1));
    let tolerance = Tolerance { scale: 0.02, harmonics: 1e-5, color: 1e-5, ..FEW };
    assert_near(&ordered("a.sog", &gaussians), &back, &tolerance);
}

/// The same scene gives the same file at any number of threads.
#[test]
fn files_do_not_depend_on_threads() {
    let folder = tempfile::tempdir().unwrap();
    let file = |threads: usize| {
        let path = folder.path().join(format!("{threads}.sog"));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| write_gaussians(&path, &scene(700)).unwrap());
        std::fs::read(path).unwrap()
    };
    assert_eq!(file(1), file(3));
}

#[test]
fn harmonics_beyond_the_third_degree_are_left_out() {
    let gaussians = scene(40).with_degree(4);
    assert_eq!(round_trip("a.sog", &gaussians), round_trip("a.sog", &gaussians.with_degree(3)));
}

#[test]
fn drawing_is_passed_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.sog");
    write_scene(&path, &scene(3), Drawing::antialiased(true)).unwrap();
    assert!(read_scene(&path).unwrap().drawing.antialiased);
}

#[test]
fn a_folder_is_read_by_its_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene");
    write_gaussians(path.join("meta.json"), &scene(30)).unwrap();
    assert_eq!(read_gaussians(&path).unwrap(), read_gaussians(path.join("meta.json")).unwrap());
    let bytes: u64 = std::fs::read_dir(&path).unwrap().map(|entry| entry.unwrap().metadata().unwrap().len()).sum();
    assert_eq!(weaver_io::scene_bytes(path.join("meta.json")).unwrap(), bytes);
    assert!(weaver_io::info(&path).unwrap().contains("30 of SH degree 1"));
}

/// The Gaussians of one scene that are nearest to another's.
fn matched(from: &Gaussians, to: &Gaussians) -> Gaussians {
    let apart =
        |i: usize, j: usize| -> f32 { from.means[i].iter().zip(&to.means[j]).map(|(a, b)| (a - b).abs()).sum() };
    let nearest = |j: usize| (0..from.len()).min_by(|a, b| apart(*a, j).total_cmp(&apart(*b, j))).unwrap();
    from.select(&(0..to.len()).map(nearest).collect::<Vec<_>>())
}

/// Two scenes that splat-transform has written, beside the PLY that it read.
///
/// Promise of `fixtures_of_splat_transform`.
#[test]
fn scenes_of_splat_transform() {
    let Some(folder) = shared::samples() else { return };
    let (ply, sog) =
        (read_gaussians(folder.join("own-sh3.ply")).unwrap(), read_gaussians(folder.join("own-sh3.sog")).unwrap());
    assert_eq!((sog.len(), sog.degree), (ply.len(), 3));
    // Tables of 256 entries for 900 numbers each, and a palette of 256 rows for 300.
    let tolerance = Tolerance { position: 1e-3, scale: 0.2, rotation: 1.5, opacity: 0.01, color: 0.2, harmonics: 1.0 };
    assert_near(&matched(&ply, &sog), &sog, &tolerance);
    assert_eq!(read_gaussians(folder.join("own-sh1.sog")).unwrap().degree, 1);
}

/// The files of a scene by name.
fn files(gaussians: &Gaussians) -> Vec<(String, Vec<u8>)> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.sog");
    write_gaussians(&path, gaussians).unwrap();
    let mut zip = ZipArchive::new(Cursor::new(std::fs::read(path).unwrap())).unwrap();
    let names: Vec<String> = zip.file_names().map(String::from).collect();
    let mut content = |name: &String| {
        let mut bytes = Vec::new();
        zip.by_name(name).unwrap().read_to_end(&mut bytes).unwrap();
        bytes
    };
    names.iter().map(|name| (name.clone(), content(name))).collect()
}

/// The message of reading these files.
fn message(files: &[(String, Vec<u8>)]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.sog");
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, content) in files {
        zip.start_file(name, SimpleFileOptions::default().compression_method(CompressionMethod::Stored)).unwrap();
        zip.write_all(content).unwrap();
    }
    std::fs::write(&path, zip.finish().unwrap().into_inner()).unwrap();
    read_gaussians(&path).unwrap_err().to_string()
}

fn changed(change: impl Fn(&mut Value)) -> String {
    let mut files = files(&scene(200));
    let (_, meta) = files.iter_mut().find(|(name, _)| name == "meta.json").unwrap();
    let mut value = serde_json::from_slice(meta).unwrap();
    change(&mut value);
    *meta = serde_json::to_vec(&value).unwrap();
    message(&files)
}

fn picture(width: u32, height: u32, pixel: [u8; 4]) -> Vec<u8> {
    let mut data = Vec::new();
    let pixels = pixel.repeat((width * height) as usize);
    WebPEncoder::new(&mut data).encode(&pixels, width, height, ColorType::Rgba8).unwrap();
    data
}

#[test]
fn messages_say_what() {
    let replaced = |name: &str, content: Vec<u8>| {
        let mut files = files(&scene(200));
        files.iter_mut().find(|(n, _)| n == name).unwrap().1 = content;
        message(&files)
    };
    let without = |name: &str| message(&files(&scene(200)).into_iter().filter(|(n, _)| n != name).collect::<Vec<_>>());
    let cases = [
        (changed(|m| m["version"] = json!(1)), "meta.json, version: expected 2, found 1"),
        (changed(|m| m["count"] = json!(1_000_000_000)), "meta.json, count: expected at most"),
        (changed(|m| m["count"] = json!(300)), "means_l.webp: expected a picture of 300 pixels"),
        (changed(|m| m["count"] = json!(-1)), "meta.json: expected the keys of SOG 2"),
        (changed(|m| m["means"]["mins"] = json!([0, 0])), "meta.json: expected the keys of SOG 2"),
        (changed(|m| m["scales"]["codebook"] = json!([1.0])), "meta.json, scales, codebook: expected more than"),
        (changed(|m| m["shN"]["bands"] = json!(4)), "meta.json, shN, bands: expected 1, 2 or 3, found 4"),
        (changed(|m| m["shN"]["bands"] = json!(2)), "shN_centroids.webp: expected a picture of 512 columns"),
        (changed(|m| m["shN"]["count"] = json!(3)), "expected a row below 3"),
        (changed(|m| m["shN"]["count"] = json!(70000)), "shN, count: expected at most 65536"),
        (changed(|m| m["means"]["maxs"] = json!([1e38, 1, 1])), "position: expected finite numbers"),
        (
            changed(|m| m["quats"]["files"] = json!(["../quats.webp"])),
            "../quats.webp: expected a file of this name in the archive",
        ),
        (
            replaced("quats.webp", picture(16, 16, [0; 4])),
            "quats.webp, pixel 0: expected a fourth channel from 252 to 255, found 0",
        ),
        (
            replaced("sh0.webp", picture(4, 4, [0; 4])),
            "sh0.webp: expected a picture of 200 pixels, of which a few may be left, found 4x4",
        ),
        (replaced("sh0.webp", picture(4000, 4000, [0; 4])), "found 4000x4000 pixels"),
        (replaced("sh0.webp", b"RIFF".to_vec()), "sh0.webp: expected lossless WebP"),
        (replaced("meta.json", b"{".to_vec()), "meta.json line 1 column 1: expected JSON"),
        (without("scales.webp"), "scales.webp: expected a file of this name in the archive, found none"),
        (without("meta.json"), "archive: expected meta.json, found other files"),
    ];
    for (message, expected) in cases {
        assert!(message.contains("a.sog: ") && message.contains(expected), "{message} for {expected}");
    }
}

#[test]
fn a_folder_names_no_files_beyond_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("meta.json");
    write_gaussians(&path, &scene(20)).unwrap();
    let change = |name: &str| {
        let mut meta: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        meta["quats"]["files"] = json!([name]);
        std::fs::write(&path, meta.to_string()).unwrap();
        read_gaussians(Path::new(&path)).unwrap_err().to_string()
    };
    for name in ["../quats.webp", "/etc/passwd", "a/quats.webp", "."] {
        let message = change(name);
        assert!(message.contains("files: expected names of files in this folder"), "{message}");
    }
    assert!(change("gone.webp").contains("gone.webp"));
}

/// A scene in a folder replaces no file of others, and a scene that was there as a whole.
///
/// Promise (files): a scene in several files is replaced as a whole, and replaces no file of others.
#[test]
fn a_scene_in_a_folder_replaces_its_own_files_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let write = |degree| write_gaussians(path("meta.json"), &scene(30).with_degree(degree));
    let files = || {
        let names = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name());
        names.map(|name| (name.clone(), std::fs::read(folder.path().join(name)).unwrap())).collect::<BTreeMap<_, _>>()
    };
    for (name, content) in [("sh0.webp", "a picture of mine"), ("meta.json", "{\"mine\": true}")] {
        std::fs::write(path(name), content).unwrap();
        let message = write(1).unwrap_err().to_string();
        assert!(message.contains(name) && message.contains("found another one"), "{message}");
        assert_eq!(files().len(), 1, "nothing else is written");
        assert_eq!(std::fs::read_to_string(path(name)).unwrap(), content);
        std::fs::remove_file(path(name)).unwrap();
    }
    std::fs::write(path("mine.webp"), "mine").unwrap();
    write(1).unwrap();
    let whole = files();
    write(0).unwrap();
    assert!(!path("shN_labels.webp").exists(), "no file of the scene before is left");
    write(1).unwrap();
    assert!(files() == whole);
    // A file that cannot be replaced leaves the scene as it was.
    let mut broken = scene(31);
    broken.means[0][0] = f32::NAN;
    assert!(write_gaussians(path("meta.json"), &broken).is_err());
    assert!(files() == whole);
}
