//! LPIPS in training and in evaluation, with random weights.

use crate::in_process::splatweaver;
use crate::run::Run;
use std::ffi::OsStr;
use std::path::Path;
use weaver_io::safetensors::Tensors;
use weaver_kernels::random::Stream;
use weaver_run::{Record, read_records};

/// The shapes of AlexNet's convolutions, by their place in the file.
const ALEX: [(&str, [usize; 4]); 5] = [
    ("net.slice1.0", [64, 3, 11, 11]),
    ("net.slice2.3", [192, 64, 5, 5]),
    ("net.slice3.6", [384, 192, 3, 3]),
    ("net.slice4.8", [256, 384, 3, 3]),
    ("net.slice5.10", [256, 256, 3, 3]),
];

pub fn random_weights(path: &Path) {
    let mut file = Tensors::default();
    for (i, (name, shape)) in ALEX.into_iter().enumerate() {
        let stream = Stream::new(i as u64, 0, "test.lpips");
        let [outputs, fan_in] = [shape[0], shape[1] * shape[2] * shape[3]];
        let scale = (2.0 / fan_in as f64).sqrt();
        let weights = (0..(outputs * fan_in) as u64).map(|i| (scale * stream.normal::<f64>(i)) as f32).collect();
        file.insert(format!("{name}.weight"), &shape, weights);
        file.insert(format!("{name}.bias"), &[outputs], vec![0.01_f32; outputs]);
        file.insert(format!("lin{i}.model.1.weight"), &[1, outputs, 1, 1], vec![1.0 / outputs as f32; outputs]);
    }
    file.write(path).unwrap();
}

fn term(step: &Record, name: &str) -> Option<f64> {
    step.value(&format!("loss/{name}"))
}

/// Promise (options): LPIPS is a loss and a figure, and equals its definition, masked or not.
#[test]
fn lpips_is_a_loss_and_a_figure() {
    let folder = tempfile::tempdir().unwrap();
    let weights = folder.path().join("alex.safetensors");
    random_weights(&weights);
    let (data, run) = (Run::shared().data(), folder.path().join("run"));
    let file = format!("stages.1.losses.image.lpips_weights={:?}", weights.display().to_string());
    let train: [&dyn AsRef<OsStr>; 15] = [
        &"train",
        &"--preset",
        &"micro",
        &"--steps",
        &"4",
        &"--data",
        &data,
        &"--out",
        &run,
        &"--set",
        &"stages.1.losses.image.lpips=0.1",
        &"--set",
        &file,
        &"--set",
        &"output.log_every=1",
    ];
    splatweaver(&train).fine();
    // The second stage, whose loss it is.
    let steps = read_records(run.join("metrics.jsonl")).unwrap();
    let found: Vec<f64> = steps.iter().filter_map(|step| term(step, "lpips")).collect();
    let last = steps.last().unwrap();
    assert!(found.len() == 3 && found.iter().all(|lpips| *lpips > 0.0) && found[0] != found[1], "{found:?}");
    // The losses of that stage with their weights; the others are 0.
    let weighted = [("mse", 1.0), ("ssim", 0.15), ("pose", 2.0), ("pose_absolute", 1.0), ("depth", 0.2)];
    let all = weighted.into_iter().chain([("error_regression", 0.02), ("lpips", 0.1)]);
    let sum: f64 = all.map(|(name, weight)| weight * term(last, name).unwrap()).sum();
    assert!((sum - last.value("loss").unwrap()).abs() < 1e-4 * sum, "{sum}, {last:?}");

    let eval = |more: &[&dyn AsRef<OsStr>]| {
        let mut line: Vec<&dyn AsRef<OsStr>> = vec![&"eval", &"--run", &run];
        line.extend(more);
        splatweaver(&line).fine().stdout
    };
    let figures = |more: &[&dyn AsRef<OsStr>]| -> serde_json::Value { serde_json::from_str(&eval(more)).unwrap() };
    let (with, without) = (figures(&[&"--json", &"--lpips", &weights]), figures(&[&"--json"]));
    assert!(with["mean"]["lpips"].as_f64().unwrap() > 0.0 && without["mean"]["lpips"].is_null(), "{with} {without}");
    assert_eq!(with["mean"]["psnr"], without["mean"]["psnr"]);
    let lpips = |table: &str| -> String {
        let row = table.lines().find(|line| line.starts_with("capture")).unwrap();
        row.split_whitespace().nth(5).unwrap().to_string()
    };
    let figure = format!("{:.3}", with["mean"]["lpips"].as_f64().unwrap());
    assert_eq!([lpips(&eval(&[])), lpips(&eval(&[&"--lpips", &weights]))], ["-".to_string(), figure]);

    // Other weights in the same place: the run would not go on as it began.
    let mut other = Tensors::read(&weights).unwrap();
    other.insert("lin0.model.1.weight", &[1, 64, 1, 1], vec![0.5_f32; 64]);
    other.write(&weights).unwrap();
    let said = ["lpips_weights: expected the weights that the run began with", "alex.safetensors"];
    splatweaver(&[&"train", &"--resume", &run, &"--steps", &"5"]).refused(1, &said);
}
