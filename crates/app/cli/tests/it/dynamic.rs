//! Mixtures of moving Gaussians are trained, stopped, judged, drawn, pruned and distilled; mismatched inputs are
//! refused by name.

use crate::command::{BINARY, printed, refused};
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use weaver_io::{Background, Image};

const TRAIN: &str = "dynamic train --long-side 32 --shots 3x8 --gaussians 60 --steps 6 --router-steps 4 --threads 1";

fn json(folder: &Path, line: &str) -> serde_json::Value {
    serde_json::from_str(&printed(folder, line)).unwrap()
}

/// A film is learned judged drawn pruned and distilled.
///
/// Promise (results): `dynamic` on the command line: trained, judged, drawn, pruned, distilled, interrupted; inputs
/// that make no mixture are refused and leave nothing behind.
#[test]
fn a_film_from_training_to_distillation() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let out = printed(folder, &format!("{TRAIN} --experts keys,poly --out run"));
    for text in ["held-out cameras (6)", "uniform mean", "oracle", "gate is right", "120 Gaussians", "run/report.html"]
    {
        assert!(out.contains(text), "{text}: {out}");
    }
    assert!(!folder.join("run/checkpoint.safetensors").exists());
    let found = json(folder, "dynamic eval --run run --json");
    assert_eq!(found["experts"], serde_json::json!(["keys", "poly"]));
    let psnr = |run: &serde_json::Value, of: &str| run["held_out_times"][of]["psnr"].as_f64().unwrap();
    assert!(psnr(&found, "mixture") > 5.0 && psnr(&found, "oracle") >= psnr(&found, "mixture") - 1.0);

    printed(folder, "dynamic render --run run --times 0:1:3 --gate -o frames");
    for name in ["0000.png", "0002.png", "gate-0001.png"] {
        let image = Image::read(folder.join("frames").join(name), Background::Black).unwrap();
        assert_eq!((image.width, image.height), (32, 24), "{name}");
    }
    printed(folder, "dynamic render --run run --times 0:1:3 --expert poly --camera 0 -o poly");
    let bytes = |path: &str| fs::read(folder.join(path)).unwrap();
    assert!(bytes("poly/0000.png") != bytes("frames/0000.png"));

    printed(folder, "dynamic prune --run run --keep 0.5 --steps 2 --out smaller");
    let smaller = json(folder, "dynamic eval --run smaller --json");
    let counts: Vec<u64> = serde_json::from_value(smaller["gaussians"].clone()).unwrap();
    assert_eq!(counts.iter().sum::<u64>(), 60);
    let report = fs::read_to_string(folder.join("smaller/report.html")).unwrap();
    assert!(report.contains("Made from run by keeping 0.5 of the Gaussians by contribution."));
    printed(folder, "dynamic distil --run run --expert keys --steps 2 --out keys");
    printed(folder, "dynamic distil --run run --expert keys --steps 2 --photos-alone --out plain");
    assert!(bytes("keys/model.safetensors") != bytes("plain/model.safetensors"));

    let error = refused(folder, &format!("{TRAIN} --out run"), 2);
    assert!(error.contains("run: a run exists there already; give another --out"), "{error}");
    let error = refused(folder, "dynamic train --resume run", 2);
    assert!(error.contains("run: the run is complete"), "{error}");
    let error = refused(folder, "dynamic render --run run --expert field -o x", 2);
    assert!(error.contains("--expert: expected one of keys, poly, found field"), "{error}");
    let error = refused(folder, "dynamic render --run run --camera 9 -o x", 2);
    assert!(error.contains("--camera: expected 0 to 2, found 9"), "{error}");
    let error = refused(folder, "dynamic prune --run run --keep 0 --out x", 2);
    assert!(error.contains("--keep: expected above 0, at most 1, found 0"), "{error}");
}

/// Promise of `a_film_from_training_to_distillation`.
#[test]
fn what_makes_no_mixture_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let error = refused(folder, &format!("{TRAIN} --experts keys --out run"), 2);
    assert!(error.contains("--experts: expected at least two, found keys"), "{error}");
    let error = refused(folder, &format!("{TRAIN} --experts keys,spline --out run"), 2);
    assert!(error.contains("expected one of field, code, keys, poly"), "{error}");
    let error = refused(folder, &format!("{TRAIN} --data . --out run"), 2);
    assert!(error.contains("cannot be used with"), "{error}");
    let error = refused(folder, "dynamic train --data nowhere --out run", 1);
    assert!(error.contains("nowhere"), "{error}");
    let error = refused(folder, "dynamic train --temperature 0 --out run", 2);
    assert!(error.contains("--temperature: expected a positive number, found 0"), "{error}");
    let error = refused(folder, "dynamic eval --run nowhere", 1);
    assert!(error.contains("nowhere/run.json"), "{error}");
    let error = refused(folder, "dynamic render --run nowhere --times 0:2:5 -o x", 2);
    assert!(error.contains("times from 0 to 1, found 2"), "{error}");
    assert!(fs::read_dir(folder).unwrap().next().is_none(), "nothing is left behind");
}

/// Promise of `a_film_from_training_to_distillation`.
#[cfg(unix)]
#[test]
fn a_training_that_is_interrupted_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let line =
        "dynamic train --long-side 32 --shots 3x8 --gaussians 60 --steps 40 --router-steps 20 --experts keys,poly";
    printed(folder, &format!("{line} --threads 2 --out whole"));
    let mut child = Command::new(BINARY)
        .args(format!("{line} --threads 1 --out parts").split_whitespace())
        .current_dir(folder)
        .stderr(Stdio::null())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    while !folder.join("parts/metrics.jsonl").exists() {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let id = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
    assert!(child.wait().unwrap().success());
    if !folder.join("parts/model.safetensors").exists() {
        let error = refused(folder, "dynamic eval --run parts", 1);
        assert!(error.contains("expected a complete run, found one in stage"), "{error}");
        printed(folder, "dynamic train --resume parts --threads 2");
    }
    // The numbers; times of the stages differ.
    let numbers = |run: &str| {
        let file = weaver_io::safetensors::Tensors::read(folder.join(run).join("model.safetensors")).unwrap();
        file.tensors.into_iter().filter(|(name, _)| name != "seconds").collect::<Vec<_>>()
    };
    assert!(numbers("whole") == numbers("parts"));
}
