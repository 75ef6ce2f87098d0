//! `convert --clean`: scenes of any origin without what no photo needs.

use crate::compare::{folder, gaussians};
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};
use weaver_io::{read_gaussians, write_gaussians};
use weaver_scene::{Gaussians, forms};
use weaver_splat::RasterSettings;

fn convert(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_splatweaver"))
        .current_dir(folder)
        .args(["convert", "planted.ply", "clean.ply", "--json"])
        .args(arguments)
        .output()
        .unwrap()
}

/// Gaussians and one more.
fn with(mut scene: Gaussians, mean: [f32; 3], log_scale: f32, opacity: f32) -> Gaussians {
    scene.means.push(mean);
    scene.log_scales.push([log_scale; 3]);
    scene.quats.push([1.0, 0.0, 0.0, 0.0]);
    scene.opacity_logits.push(forms::opacity_logit(opacity));
    scene.sh.extend([1.5, -1.0, 0.5]);
    scene
}

/// Promise (kept): `convert --clean` takes junk that hangs before cameras out of a scene of any origin by its photos,
/// and without photos what cannot show or is far from everything.
#[test]
fn convert_cleans_by_photos_and_without() {
    let folder = folder(&RasterSettings::default(), &[]);
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path("summary.json"), r#"{"background": [0.4, 0.4, 0.4]}"#).unwrap();
    let (before, faint, far) = ([0.1, 0.0, 0.6], [0.2, 0.0, 2.5], [0.0, 0.0, 900.0]);
    let planted = with(gaussians(), before, -3.0, 0.9);
    write_gaussians(path("planted.ply"), &planted).unwrap();
    let done = convert(folder.path(), &["--clean", "--cameras", "capture"]);
    let text = String::from_utf8_lossy(&done.stderr).into_owned();
    assert!(done.status.success() && text.contains("Gaussians were removed"), "{text}");
    let left = read_gaussians(path("clean.ply")).unwrap();
    assert!(!left.means.contains(&before) && left.len() >= 20, "{} are left: {text}", left.len());
    let report: Value = serde_json::from_slice(&done.stdout).unwrap();
    let reasons = report["cleaned"].as_object().unwrap();
    let removed: u64 = reasons.values().map(|count| count.as_u64().unwrap()).sum();
    assert_eq!((removed, report["gaussians"].as_u64()), ((25 - left.len()) as u64, Some(left.len() as u64)));

    write_gaussians(path("planted.ply"), &with(with(planted, faint, -3.0, 0.003), far, -3.0, 0.9)).unwrap();
    let done = convert(folder.path(), &["--clean"]);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let left = read_gaussians(path("clean.ply")).unwrap();
    assert_eq!((left.len(), left.means.contains(&faint), left.means.contains(&far)), (25, false, false));
}

#[test]
fn cameras_without_use_and_missing_photos_are_refused() {
    let folder = folder(&RasterSettings::default(), &[]);
    write_gaussians(folder.path().join("planted.ply"), &gaussians()).unwrap();
    std::fs::remove_file(folder.path().join("capture/03.png")).unwrap();
    for (arguments, code, expected) in [
        (&["--cameras", "capture"][..], 2, "--cameras: expected --clean or --by contribution with it"),
        (&["--clean", "--cameras", "capture", "--scale", "2"], 2, "cannot be used with"),
        (&["--clean", "--cameras", "capture"], 1, "03.png"),
        (&["--clean", "--cameras", "nowhere"], 1, "nowhere"),
    ] {
        let done = convert(folder.path(), arguments);
        let text = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(done.status.code() == Some(code) && text.contains(expected), "{arguments:?}: {text}");
        assert!(!folder.path().join("clean.ply").exists(), "{arguments:?}");
    }
}
