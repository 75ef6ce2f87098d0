//! Figures, and values and gradients against stored references, through the command line.

use crate::in_process::{Outcome, splatweaver};
use serde_json::Value;
use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use weaver_io::safetensors::{Tensor, TensorData, Tensors};

/// Runs `bench raster` once with these arguments besides.
pub fn raster(arguments: &[&dyn AsRef<OsStr>]) -> Outcome {
    splatweaver(&[&[&"bench" as &dyn AsRef<OsStr>, &"raster", &"--runs", &"1", &"--threads", &"2"], arguments].concat())
}

fn fixture(name: &str) -> Tensors {
    Tensors::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../tests/fixtures/raster").join(name)).unwrap()
}

/// The workload that a stored reference was computed from.
pub fn workload(reference: &Tensors) -> Tensors {
    let mut workload = Tensors::default();
    for (key, tensor) in &reference.tensors {
        if let Some(input) = key.strip_prefix("in.") {
            workload.tensors.insert(input.into(), tensor.clone());
        } else if let Some(output) = key.strip_prefix("cot.") {
            workload.tensors.insert(format!("v_{output}"), tensor.clone());
        }
    }
    for key in ["width", "height", "mode"] {
        workload.metadata.insert(key.into(), reference.metadata[key].clone());
    }
    workload
}

/// A small workload of plain colors in a folder of its own.
pub fn small() -> (tempfile::TempDir, PathBuf, Tensors) {
    let folder = tempfile::tempdir().unwrap();
    let workload = workload(&fixture("small_rgb_antialiased.safetensors"));
    let path = folder.path().join("w.safetensors");
    workload.write(&path).unwrap();
    (folder, path, workload)
}

fn floats(tensor: &Tensor) -> Vec<f64> {
    let TensorData::F32(values) = &tensor.data else { panic!("F32 expected") };
    values.iter().map(|&x| f64::from(x)).collect()
}

/// Relative L2 distance over the values that are `kept`.
fn distance(ours: &[f64], theirs: &[f64], kept: impl Fn(usize) -> bool) -> f64 {
    assert_eq!(ours.len(), theirs.len());
    let norm =
        |of: &dyn Fn(usize) -> f64| (0..ours.len()).filter(|&i| kept(i)).map(|i| of(i) * of(i)).sum::<f64>().sqrt();
    norm(&|i| ours[i] - theirs[i]) / norm(&|i| theirs[i])
}

#[track_caller]
fn agrees(name: &str, colors: &str) {
    let reference = fixture(name);
    let folder = tempfile::tempdir().unwrap();
    let (path, out) = (folder.path().join("w.safetensors"), folder.path().join("o.safetensors"));
    workload(&reference).write(&path).unwrap();
    let done = raster(&[&"--workload", &path, &"--json", &"--dump", &out]).fine();
    let dump = Tensors::read(&out).unwrap();
    let TensorData::U8(safe) = &reference.get("safe").unwrap().data else { panic!("U8 expected") };
    let mut compared = BTreeSet::new();
    for (key, theirs) in &reference.tensors {
        let kept: Box<dyn Fn(usize) -> bool> = match key.as_str() {
            "out.image" => Box::new(|i| safe[i / 3] != 0),
            "out.alpha" | "out.depth" => Box::new(|i| safe[i] != 0),
            "grad.K" => Box::new(|i| [0, 2, 4, 5].contains(&i)),
            "grad.viewmat" => Box::new(|i| i < 12),
            key if key.starts_with("grad.") => Box::new(|_| true),
            _ => continue,
        };
        let ours = dump.get(key).unwrap();
        assert_eq!(ours.shape, theirs.shape, "{key}");
        let error = distance(&floats(ours), &floats(theirs), kept);
        assert!(error < 1e-4, "{key}: {error:e}");
        compared.insert(key.as_str());
    }
    let colors = format!("grad.{colors}");
    for key in ["out.image", "out.alpha", "out.depth", "grad.means", "grad.quats", "grad.scales", &colors] {
        assert!(compared.contains(key), "{key}");
    }
    // The reference has none for some inputs; the dump has them all.
    for (key, shape) in [("grad.opacities", None), ("grad.background", Some([3]))] {
        let tensor = dump.get(key).unwrap();
        assert!(shape.is_none_or(|shape| tensor.shape == shape), "{key}");
    }
    assert_eq!(dump.tensors.len(), 3 + 8);
    let constant = floats(dump.get("grad.K").unwrap());
    assert!([1, 3, 6, 7, 8].iter().all(|&i| constant[i] == 0.0));
    assert!(floats(dump.get("grad.viewmat").unwrap())[12..].iter().all(|&x| x == 0.0));
    // A pixel whose branches are within rounding of flipping may gain or lose a pair.
    let figures: Value = serde_json::from_str(&done.stdout).unwrap();
    let (ours, theirs) = (figures["pairs"].as_f64().unwrap(), reference.metadata["pairs"].parse::<f64>().unwrap());
    assert!((ours / theirs - 1.0).abs() < 1e-3, "{ours} pairs, {theirs} in the reference");
    assert!(figures["evaluated"].as_f64().unwrap() >= ours);
}

#[test]
fn harmonics_and_depth_agree_with_the_reference() {
    agrees("small_sh3_depth.safetensors", "sh");
}

#[test]
fn plain_colors_antialiased_agree_with_the_reference() {
    agrees("small_rgb_antialiased.safetensors", "colors");
}

#[test]
fn json_has_every_figure_and_nothing_else_is_printed() {
    let (_folder, path, _) = small();
    let done = raster(&[&"--workload", &path, &"--json"]).fine();
    assert_eq!(done.stderr, "");
    let figures: Value = serde_json::from_str(&done.stdout).unwrap();
    let keys = [
        "workload",
        "mode",
        "n",
        "width",
        "height",
        "pairs",
        "evaluated",
        "forward_ms",
        "forward_backward_ms",
        "processor_forward_ms",
        "processor_forward_backward_ms",
        "stages_ms",
        "device",
        "bytes_to_device",
        "bytes_from_device",
        "entries",
        "threads",
        "peak_gflops",
        "peak_rss_mb",
    ];
    let found: BTreeSet<&str> = figures.as_object().unwrap().keys().map(String::as_str).collect();
    assert_eq!(found, BTreeSet::from(keys));
    assert_eq!(figures["workload"], path.to_str().unwrap());
    assert_eq!((&figures["mode"], &figures["n"]), (&"antialiased".into(), &400.into()));
    assert_eq!((&figures["width"], &figures["height"], &figures["threads"]), (&121.into(), &79.into(), &2.into()));
    let ms = |value: &Value| value.as_f64().unwrap();
    let stages = &figures["stages_ms"];
    let forward = ["project", "bin", "composite"].map(|stage| ms(&stages[stage]));
    assert!(forward.iter().all(|&ms| ms > 0.0) && ms(&stages["backward"]) > 0.0, "{stages}");
    // One run: medians add up.
    assert!(forward.iter().sum::<f64>() <= ms(&figures["forward_ms"]));
    assert!(ms(&figures["forward_ms"]) + ms(&stages["backward"]) <= ms(&figures["forward_backward_ms"]));
    assert!(ms(&figures["peak_gflops"]) > 0.1);
    assert!(figures["peak_rss_mb"].is_number() || !cfg!(target_os = "linux"));
}

#[test]
fn forward_alone_leaves_out_what_it_has_not() {
    let (folder, path, _) = small();
    let out = folder.path().join("o.safetensors");
    let done = raster(&[&"--workload", &path, &"--forward-only", &"--json", &"--dump", &out]).fine();
    let figures: Value = serde_json::from_str(&done.stdout).unwrap();
    assert!(figures["forward_backward_ms"].is_null() && figures["stages_ms"]["backward"].is_null());
    assert!(figures["forward_ms"].is_number() && figures["stages_ms"]["composite"].is_number());
    let dump = Tensors::read(&out).unwrap();
    assert!(dump.tensors.keys().eq(["out.alpha", "out.depth", "out.image"]), "{:?}", dump.tensors.keys());
    let whole = folder.path().join("whole.safetensors");
    raster(&[&"--workload", &path, &"--dump", &whole]).fine();
    let whole = Tensors::read(&whole).unwrap();
    assert!(dump.tensors.iter().all(|(key, tensor)| whole.tensors[key] == *tensor));
}

#[test]
fn depth_is_no_part_of_it_unless_it_is_asked_for() {
    let (folder, path, mut workload) = small();
    let out = folder.path().join("o.safetensors");
    let gradient = |path: &PathBuf| {
        raster(&[&"--workload", path, &"--dump", &out]).fine();
        Tensors::read(&out).unwrap().get("grad.means").unwrap().clone()
    };
    let with = gradient(&path);
    workload.tensors.remove("v_depth");
    workload.write(&path).unwrap();
    assert_ne!(gradient(&path), with, "the gradient of the depth counts");
    assert!(Tensors::read(&out).unwrap().tensors.contains_key("out.depth"), "a dump has the depth in any case");
}

/// Made up scenes are the same at any number of threads.
#[test]
fn made_up_scenes_do_not_depend_on_threads() {
    let folder = tempfile::tempdir().unwrap();
    let dump = |threads: &str| {
        let out = folder.path().join(format!("{threads}.safetensors"));
        let threads: &[&dyn AsRef<OsStr>] = &[&"--threads", &threads, &"--dump", &out];
        let line: &[&dyn AsRef<OsStr>] = &[&"bench", &"raster", &"--synthetic", &"500,40,30", &"--runs", &"2"];
        splatweaver(&[line, threads].concat()).fine();
        std::fs::read(out).unwrap()
    };
    assert!(dump("1") == dump("3"));
}

#[test]
fn the_table_names_stages_and_the_peak() {
    let done = raster(&[&"--synthetic", &"500,40,30"]).fine();
    let words =
        ["500 Gaussians", "SH degree 3", "40x30", "classic", "2 threads", "project", "bin and sort", "composite"];
    for part in words.iter().chain(&["backward", "forward + backward", "pairs composited", "GFLOP/s", "%"]) {
        assert!(done.stdout.contains(part), "{part} is not in\n{}", done.stdout);
    }
}

#[test]
fn the_emptiest_scene_is_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("o.safetensors");
    let done = raster(&[&"--synthetic", &"0,1,1", &"--json", &"--dump", &out]).fine();
    let figures: Value = serde_json::from_str(&done.stdout).unwrap();
    assert_eq!((&figures["n"], &figures["pairs"], &figures["evaluated"]), (&0.into(), &0.into(), &0.into()));
    let dump = Tensors::read(&out).unwrap();
    assert_eq!(dump.values::<f32>("grad.sh", &[0, 16, 3]).unwrap(), [] as [f32; 0]);
    assert_eq!(dump.values::<f32>("out.alpha", &[1, 1]).unwrap(), [0.0]);
}
