//! Weights from files: to start from, to evaluate and to use.

use crate::in_process::{Outcome, splatweaver};
use crate::run::Run;
use std::ffi::OsStr;
use std::path::Path;
use weaver_io::Transforms;
use weaver_io::colmap::Model;

fn with(first: &[&dyn AsRef<OsStr>], more: &[&str]) -> Outcome {
    let mut line = first.to_vec();
    more.iter().for_each(|argument| line.push(argument));
    splatweaver(&line)
}

/// Promise (options): `eval` and `infer` take a checkpoint's file as they take a run.
#[test]
fn the_checkpoint_of_a_run_is_used_like_the_run() {
    let run = Run::shared();
    let folder = tempfile::tempdir().unwrap();
    let checkpoint = run.path().join("checkpoint.safetensors");
    let photos = run.data().join("images");
    let [by_run, by_file] = ["a", "b"].map(|name| folder.path().join(name));
    with(&[&"infer", &"--run", &run.path(), &photos, &"-o", &by_run], &[]).fine();
    with(&[&"infer", &"--weights", &checkpoint, &photos, &"-o", &by_file], &[]).fine();
    let scene = |out: &Path| std::fs::read(out.join("scene.ply")).unwrap();
    assert_eq!(scene(&by_run), scene(&by_file));
    let posed = folder.path().join("c");
    let done =
        with(&[&"infer", &"--weights", &checkpoint, &photos, &"--cameras", &run.data(), &"-o", &posed], &[]).fine();
    assert!(done.stderr.contains("cameras given") && scene(&posed) != scene(&by_file), "{}", done.stderr);
    with(&[&"infer", &"--weights", &checkpoint, &photos, &"-o", &posed], &["--size", "64"])
        .refused(2, &["--size", "published checkpoint"]);

    let figures = |weights: &[&dyn AsRef<OsStr>]| -> serde_json::Value {
        let data = run.data();
        let line = [&[&"eval" as &dyn AsRef<OsStr>, &"--data", &data, &"--json"][..], weights].concat();
        let line = [&line[..], &[&"--views" as &dyn AsRef<OsStr>, &"2"]].concat();
        serde_json::from_str(&splatweaver(&line).fine().stdout).unwrap()
    };
    assert_eq!(figures(&[&"--run", &run.path()]), figures(&[&"--weights", &checkpoint]));
}

/// The COLMAP model that is written says the same as transforms.json.
///
/// Promise (options): the COLMAP model of a result is read back.
#[test]
fn the_colmap_model_of_a_result_is_read_back() {
    let run = Run::shared();
    let folder = tempfile::tempdir().unwrap();
    let (photos, out) = (run.data().join("images"), folder.path().join("out"));
    with(&[&"infer", &"--run", &run.path(), &photos, &"-o", &out], &[]).fine();
    let frames = Transforms::read(out.join("transforms.json")).unwrap().frames;
    let model = Model::read(out.join("sparse/0")).unwrap().frames();
    assert_eq!((frames.len(), model.len()), (10, 10));
    for (own, colmap) in frames.iter().zip(&model) {
        assert_eq!(own.name, format!("input/{}", colmap.name));
        let (a, b) = (own.camera, colmap.camera);
        assert_eq!((a.width, a.height), (b.width, b.height));
        assert!(a.pose.center().distance(b.pose.center()) < 1e-9 && a.pose.angle_to(&b.pose) < 1e-7);
        let (k, l) = (a.intrinsics, b.intrinsics);
        let apart = [k.fx - l.fx, k.fy - l.fy, k.cx - l.cx, k.cy - l.cy];
        assert!(apart.iter().all(|d| d.abs() < 1e-9), "{apart:?}");
    }
}

/// Promise (options): `--init` starts from other weights as far as they fit, and reports how far.
#[test]
fn training_starts_from_a_run_as_far_as_it_fits() {
    let run = Run::shared();
    let folder = tempfile::tempdir().unwrap();
    let (data, init) = (run.data(), run.path());
    let train = |out: &Path, init: &Path, more: &[&str]| {
        let line: &[&dyn AsRef<OsStr>] = &[&"train", &"--data", &data, &"--init", &init, &"--out", &out];
        with(line, &[&["--preset", "micro", "--steps", "1"], more].concat())
    };
    let whole = train(&folder.path().join("whole"), &init, &[]).fine();
    let said = whole.stderr.lines().find(|line| line.starts_with("weights of ")).unwrap();
    let counts: Vec<usize> = said.split(' ').filter_map(|word| word.parse().ok()).collect();
    assert!(counts.len() == 2 && counts[0] == counts[1] && said.ends_with("parameters taken"), "{said}");
    let config = std::fs::read_to_string(folder.path().join("whole/config.toml")).unwrap();
    let weights = init.join("checkpoint.safetensors").display().to_string();
    assert!(config.lines().any(|line| line.starts_with("init = ") && line.contains(&weights)), "{config}");

    let file = init.join("checkpoint.safetensors");
    let partly = train(&folder.path().join("partly"), &file, &["--set", "model.gaussians.router_hidden=4"]).fine();
    let said = partly.stderr.lines().find(|line| line.starts_with("weights of ")).unwrap();
    assert!(said.contains(" random: gaussian_param_head.gs_moe.gating") && said.contains("there ["), "{said}");
    // It goes on where it was, even without the file of the first weights.
    let moved = folder.path().join("partly/config.toml");
    crate::capture::edit(&moved, |text| text.replace("checkpoint.safetensors\"", "gone.safetensors\""));
    with(&[&"train", &"--resume", &folder.path().join("partly")], &["--steps", "2"]).fine();
    // The weights that come with the program, by name: hardly any fit this small network.
    let known = train(&folder.path().join("built-in"), Path::new("built-in"), &[]).fine();
    assert!(known.stderr.contains("weights of built-in: ") && known.stderr.contains(" random: "), "{}", known.stderr);
    train(&folder.path().join("none"), &folder.path().join("missing"), &[]).refused(1, &["missing"]);
    assert!(!folder.path().join("none").exists());
}

/// Backbones have the same names in every model, as in published files.
#[test]
fn training_starts_from_other_weights() {
    let run = Run::shared();
    let folder = tempfile::tempdir().unwrap();
    let data = run.data();
    let train = |init: &Path, name: &str| {
        let out = folder.path().join(name);
        let line: &[&dyn AsRef<OsStr>] = &[&"train", &"--data", &data, &"--init", &init, &"--out", &out];
        with(line, &["--model", "wild", "--preset", "micro", "--steps", "3"])
    };
    let taken = |said: &Outcome| -> usize {
        let line = said.stderr.lines().find(|line| line.starts_with("weights of ")).expect("it says what it took");
        line.split(' ').find_map(|word| word.parse().ok()).unwrap()
    };
    let other = train(&run.path(), "other").fine();
    let mut tensors = crate::published::checkpoint("encoder.");
    let published = folder.path().join("published.safetensors");
    tensors.write(&published).unwrap();
    let said = train(&published, "published").fine();
    assert!(
        said.stderr.contains(" random: ") && said.stderr.contains("aggregator.patch_embed.pos_embed ("),
        "{}",
        said.stderr
    );
    // The table of positions, of another size there, is not taken.
    assert!(taken(&said) > 40 && taken(&said) < taken(&other), "{} {}", taken(&said), taken(&other));

    tensors.insert("encoder.aggregator.camera_token", &[1, 2, 1, 32], vec![f32::NAN; 64]);
    tensors.write(&published).unwrap();
    train(&published, "nan").refused(1, &["published.safetensors", "encoder.aggregator.camera_token", "NaN"]);
    train(&data.join("transforms.json"), "cameras").refused(1, &["transforms.json"]);
}

/// Promise (options): `--resume RUN --steps N` makes a run longer.
#[test]
fn a_run_is_prolonged() {
    let run = Run::shared().copy();
    let done = with(&[&"train", &"--resume", &run.path()], &["--steps", "6"]).fine();
    assert!(done.stderr.contains("6 steps done"), "{}", done.stderr);
    let summary = std::fs::read_to_string(run.path().join("summary.json")).unwrap();
    assert!(summary.contains("\"planned\": 6"), "{summary}");
    with(&[&"train", &"--resume", &run.path()], &["--steps", "5"]).refused(1, &["steps", "6", "found 5"]);
}

/// Promise of `untrained_experts_are_named_and_trained_ones_pass`.
#[test]
fn experts_that_were_not_trained_are_spoken_of() {
    let run = Run::shared();
    let folder = tempfile::tempdir().unwrap();
    let (data, all) = (run.data(), run.path());
    let (photos, out, one) = (data.join("images"), folder.path().join("out"), folder.path().join("one"));
    let line: &[&dyn AsRef<OsStr>] = &[&"train", &"--data", &data, &"--out", &one];
    with(line, &["--preset", "micro", "--steps", "4", "--set", "stages.1.model.dense=0"]).fine();
    let infer = |allocation: &str| {
        with(&[&"infer", &"--run", &one, &photos, &"-o", &out], &["--allocation", allocation]).fine().stderr
    };
    assert!(infer("fixed:2").contains("warning: allocation fixed:2"));
    assert!(!infer("fixed:1").contains("warning"));
    let eval = |run: &Path, more: &[&str]| with(&[&"eval", &"--run", &run, &"--json"], more).fine();
    let said = |run: &Path| eval(run, &["--allocation", "sampled"]).stderr;
    assert!(said(&one).contains("warning: allocation sampled"), "{}", said(&one));
    assert!(!said(&all).contains("warning"), "{}", said(&all));
}

#[test]
fn the_photos_that_gaussians_were_made_of_judge_them() {
    let run = Run::shared();
    let figures = |targets: &str| -> serde_json::Value {
        let line: &[&dyn AsRef<OsStr>] = &[&"eval", &"--run", &run.path(), &"--cameras", &"given", &"--json"];
        serde_json::from_str(&with(line, &["--targets", targets]).fine().stdout).unwrap()
    };
    let (held_out, own) = (figures("data"), figures("context"));
    let views = |found: &serde_json::Value| found["mean"]["views"].as_u64().unwrap();
    assert_eq!(views(&own), views(&held_out) * held_out["context_views"].as_u64().unwrap());
    assert!(own["cameras"].as_str().unwrap().contains("judged by the context photos"), "{own}");
    assert!(own["mean"]["psnr_nearest"].as_f64().unwrap() < 60.0, "no photo is copied to itself: {own}");
}
