//! One small run, trained once and looked at from all sides.

use crate::capture;
use crate::in_process::{Outcome, line, splatweaver};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use tempfile::TempDir;
use weaver_io::{Background, Image};

/// A run of a few steps on a small capture.
pub struct Run {
    folder: TempDir,
    pub outcome: Outcome,
}

static RUN: LazyLock<Run> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    capture::colmap(&folder.path().join("capture"), capture::VIEWS);
    let outcome = train(&folder.path().join("capture"), &folder.path().join("run"), 1);
    Run { folder, outcome }
});

fn train(data: &Path, out: &Path, threads: usize) -> Outcome {
    let threads = threads.to_string();
    line(&[&"train --preset micro --steps 4 --data", &data, &"--out", &out, &"--threads", &threads]).fine()
}

impl Run {
    pub fn shared() -> &'static Self {
        &RUN
    }

    pub fn path(&self) -> PathBuf {
        self.folder.path().join("run")
    }

    pub fn data(&self) -> PathBuf {
        self.folder.path().join("capture")
    }

    /// The run's configuration and checkpoint in a folder that may be spoilt.
    pub fn copy(&self) -> TempDir {
        let folder = tempfile::tempdir().unwrap();
        for name in ["config.toml", "checkpoint.safetensors"] {
            std::fs::copy(self.path().join(name), folder.path().join(name)).unwrap();
        }
        folder
    }
}

fn checksum(run: &Path) -> String {
    let text = std::fs::read_to_string(run.join("summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&text).unwrap();
    summary["checksum"].as_str().unwrap().to_string()
}

#[test]
fn a_run_leaves_a_table_and_a_folder() {
    let run = Run::shared();
    assert!(run.outcome.stdout.contains("PSNR") && run.outcome.stdout.contains("capture"), "{}", run.outcome.stdout);
    let report = run.path().join("report.html");
    assert!(run.outcome.stdout.contains(&report.display().to_string()));
    for name in ["config.toml", "checkpoint.safetensors", "metrics.jsonl", "summary.json", "report.html"] {
        assert!(run.path().join(name).is_file(), "{name}");
    }
}

/// Promise (options): a seed determines the weights, at any number of threads.
#[test]
fn the_number_of_threads_does_not_change_the_weights() {
    let run = Run::shared();
    let folder = tempfile::tempdir().unwrap();
    train(&run.data(), folder.path(), 3);
    assert_eq!(checksum(folder.path()), checksum(&run.path()));
}

#[test]
fn a_run_is_not_overwritten() {
    let run = Run::shared();
    let before = std::fs::read(run.path().join("checkpoint.safetensors")).unwrap();
    splatweaver(&[&"train", &"--preset", &"micro", &"--out", &run.path()]).refused(2, &["already", "--resume"]);
    assert_eq!(std::fs::read(run.path().join("checkpoint.safetensors")).unwrap(), before);
}

#[test]
fn json_is_all_that_is_printed() {
    let run = Run::shared();
    let done = splatweaver(&[&"eval", &"--run", &run.path(), &"--json", &"--cameras", &"given"]).fine();
    let figures: serde_json::Value = serde_json::from_str(&done.stdout).unwrap();
    assert_eq!((&figures["cameras"], &figures["step"]), (&"given".into(), &4.into()));
    assert_eq!(figures["scenes"][0]["name"], "capture");
    assert!(figures["mean"]["psnr"].is_number());
}

#[test]
fn the_budget_sets_the_number_of_gaussians() {
    let run = Run::shared();
    let per_pixel = |budget: &str| {
        let budget: &[&dyn AsRef<std::ffi::OsStr>] =
            &[&"eval", &"--run", &run.path(), &"--json", &"--allocation", &"grid", &"--budget", &budget];
        let figures: serde_json::Value = serde_json::from_str(&splatweaver(budget).fine().stdout).unwrap();
        figures["mean"]["gaussians_per_pixel"].as_f64().unwrap()
    };
    assert!((per_pixel("0.25") - 0.25).abs() < 0.01 && (per_pixel("0.5") - 0.5).abs() < 0.01);
}

#[test]
fn scenes_never_trained_on_are_built_in() {
    let run = Run::shared();
    let done = splatweaver(&[&"eval", &"--run", &run.path(), &"--unseen"]).fine();
    assert!(["unseen-00", "unseen-03"].iter().all(|name| done.stdout.contains(name)), "{}", done.stdout);
}

#[test]
fn photos_become_a_scene_that_renders() {
    let run = Run::shared();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("result");
    let images = run.data().join("images");
    let (a, b) = (images.join("01.png"), images.join("02.png"));
    let done = splatweaver(&[&"infer", &"--run", &run.path(), &a, &b, &"-o", &out]).fine();
    assert!(done.stdout.contains("Gaussians"), "{}", done.stdout);
    for name in
        ["scene.ply", "transforms.json", "sparse/0/cameras.bin", "overview.png", "render/01.png", "depth/02.png"]
    {
        assert!(out.join(name).is_file(), "{name}");
    }
    let renders = folder.path().join("renders");
    let (scene, cameras) = (out.join("scene.ply"), out.join("transforms.json"));
    splatweaver(&[&"render", &scene, &"--cameras", &cameras, &"-o", &renders]).fine();
    let ours = Image::read(renders.join("02.png"), Background::White).unwrap();
    let theirs = Image::read(out.join("render/02.png"), Background::White).unwrap();
    // Up to the rounding of logarithms in the PLY, and of 8 bits.
    let largest = ours.pixels.iter().zip(&theirs.pixels).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(largest <= 1.5 / 255.0, "{largest}");
}

/// Promise of `photos_of_one_name_in_two_folders`.
#[test]
fn given_cameras_are_matched_by_name() {
    let run = Run::shared();
    let folder = tempfile::tempdir().unwrap();
    let images = run.data().join("images");
    let (a, b) = (images.join("01.png"), images.join("02.png"));
    splatweaver(&[&"infer", &"--run", &run.path(), &a, &b, &"--cameras", &run.data(), &"-o", &folder.path()]).fine();
    let other = folder.path().join("other.png");
    std::fs::copy(&a, &other).unwrap();
    let out = folder.path().join("none");
    splatweaver(&[&"infer", &"--run", &run.path(), &other, &"--cameras", &run.data(), &"-o", &out])
        .refused(1, &["other.png", "camera"]);
    let smaller = folder.path().join("01.png");
    Image::filled(20, 16, [0.5; 3]).write_png(&smaller).unwrap();
    splatweaver(&[&"infer", &"--run", &run.path(), &smaller, &"--cameras", &run.data(), &"-o", &out])
        .refused(1, &["01.png", "40x32", "20x16"]);
    assert!(!out.exists());
}

/// Promise of `contradictions_are_refused_before_the_start`.
#[test]
fn a_budget_needs_an_allocation_that_has_one() {
    let run = Run::shared();
    splatweaver(&[&"eval", &"--run", &run.path(), &"--allocation", &"sampled", &"--budget", &"0.3"])
        .refused(2, &["--budget", "sampled"]);
    let photo = run.data().join("images/01.png");
    let out = run.path().join("never");
    line(&[&"infer --run", &run.path(), &photo, &"--allocation fixed:1 --budget 1 -o", &out])
        .refused(2, &["--budget", "fixed:1"]);
    assert!(!out.exists());
}

/// Promise of `refinement_meets_photos_better`.
#[test]
fn flags_of_refinement_need_one() {
    let run = Run::shared();
    let (photo, out) = (run.data().join("images/01.png"), run.path().join("unrefined"));
    let infer = [&"infer" as &dyn AsRef<std::ffi::OsStr>, &"--run", &run.path(), &photo, &"-o", &out];
    splatweaver(&[&infer[..], &[&"--refine-in-place"]].concat())
        .refused(2, &["--refine-in-place: expected --refine or --refine-steps with it"]);
    splatweaver(&[&infer[..], &[&"--refine-size", &"64"]].concat())
        .refused(2, &["--refine-size: expected --refine or --refine-steps with it"]);
    assert!(!out.exists());
}
