//! Figures that a command reports of its own result, beside the figures of `eval` on the same files.

use crate::command::{capture, printed, splatweaver, text};
use serde_json::Value;
use std::path::Path;
use weaver_io::Image;

/// Beyond rounding of numbers that a file holds with fewer digits, decibels.
const SAME: f64 = 0.01;

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|e| panic!("{e}: {text}"))
}

fn summary(run: &Path) -> Value {
    json(&std::fs::read_to_string(run.join("summary.json")).unwrap())
}

/// A capture whose photos have masks, behind which is something that no other photo shows.
fn masked(folder: &Path) {
    capture(folder);
    std::fs::create_dir(folder.join("capture/masks")).unwrap();
    for i in 0..10 {
        let path = folder.join(format!("capture/images/{i:02}.png"));
        let mut photo = Image::read(&path, Default::default()).unwrap();
        let mut mask = Image::filled(40, 32, [1.0; 3]);
        for at in 400..400 + 37 * (i + 2) {
            photo.pixels[3 * at..3 * at + 3].copy_from_slice(&[1.0, 0.0, (i % 2) as f32]);
            mask.pixels[3 * at..3 * at + 3].fill(0.0);
        }
        photo.write_png(&path).unwrap();
        mask.write_png(folder.join(format!("capture/masks/{i:02}.png"))).unwrap();
    }
}

/// Promise (figures): figures of a fit equal the figures of `compare`, with and without masks, exposure, refined
/// cameras.
#[test]
fn a_fit_says_of_held_out_photos_what_eval_says() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    masked(folder);
    for (run, (flags, judged)) in [
        ("", "--data capture"),
        ("--masks", "--data capture --masks"),
        ("--long-side 24", "--data capture --long-side 24"),
        ("--antialiased --background black --exposure", "--data capture"),
        // Held-out photos are judged from where they were found: the cameras that the fit wrote.
        ("--refine-cameras --masks", "--data OUT --masks"),
    ]
    .into_iter()
    .enumerate()
    {
        let out = format!("out{run}");
        printed(folder, &format!("fit capture -o {out} --steps 120 --gaussians 400 {flags}"));
        let said = &summary(&folder.join(&out))["test"];
        let line = format!("compare {out}/scene.ply {} --json", judged.replace("OUT", &out));
        let found = json(&printed(folder, &line));
        assert_eq!(found["held_out"], true, "{found}");
        for (key, same) in [("psnr", SAME), ("ssim", 1e-3)] {
            let [a, b] = [&said[key], &found["mean"][key]].map(|value| value.as_f64().unwrap());
            assert!((a - b).abs() < same, "{flags}: {key}: the fit says {a}, eval {b}");
        }
    }
    // Without masks the same scene is another matter.
    let of = |flags: &str| json(&printed(folder, &format!("compare out1/scene.ply --data capture --json {flags}")));
    let [with, without] = ["--masks", ""].map(|flags| of(flags)["mean"]["psnr"].as_f64().unwrap());
    assert!(with > without + 1.0, "{with} dB with masks, {without} without");
}

/// Promise (figures): figures at the end of a training equal the figures of `eval --run`.
#[test]
fn a_training_says_of_its_network_what_eval_says() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    printed(folder, "train --preset micro --steps 3 --out run");
    let said = &summary(&folder.join("run"))["evaluation"]["mean"];
    let found = json(&printed(folder, "eval --run run --json"));
    assert_eq!(*said, found["mean"]);
}

/// Promise (figures): photos that a network saw are not called held out.
#[test]
fn photos_that_a_network_saw_are_not_called_held_out() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    capture(folder);
    printed(folder, "train --preset micro --data capture --set data.scene_scale=1 --steps 2 --out run");
    let done = splatweaver(folder, "infer --run run capture/images/00.png capture/images/01.png -o result");
    let stdout = text(&done.stdout);
    assert!(done.status.success(), "{}", text(&done.stderr));
    let said: f64 = stdout.split("come back at ").nth(1).and_then(|t| t.split(' ').next()).unwrap().parse().unwrap();
    let found = json(&printed(folder, "compare result/scene.ply --data result --json"));
    assert_eq!((&found["held_out"], found["views"].as_array().unwrap().len()), (&Value::Bool(false), 2));
    let judged = found["mean"]["psnr"].as_f64().unwrap();
    // The photos were written with 8 bits.
    assert!((said - judged).abs() < 0.05, "infer says {said}, eval {judged}");
}
