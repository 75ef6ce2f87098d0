//! Files that a run leaves for its reader match its course: report, sample pictures, TensorBoard's events.

use crate::in_process::line;
use crate::run::Run;
use std::collections::BTreeMap;
use std::path::Path;
use weaver_data::capture::{CaptureOptions, load};
use weaver_data::evaluation_tuples;
use weaver_inference::{CameraSource, Density, Photos, Predictor, SplatWeaverPredictor, planar};
use weaver_io::{Background, Image};
use weaver_kernels::random::Stream;
use weaver_run::{Record, read_records};

const STEPS: usize = 4;

fn trained(out: &Path) -> Vec<Record> {
    let (data, steps) = (Run::shared().data(), STEPS.to_string());
    let settings = ["output.log_every=1", "output.sample_every=3"];
    let [logged, sampled] = &settings;
    line(&[
        &"train --preset micro --steps",
        &steps,
        &"--data",
        &data,
        &"--out",
        &out,
        &"--set",
        logged,
        &"--set",
        sampled,
    ])
    .fine();
    read_records(out.join("metrics.jsonl")).unwrap()
}

/// The scalars of a TensorBoard file: values by tag and step.
fn scalars(path: &Path) -> BTreeMap<(String, u64), f32> {
    let bytes = std::fs::read(path).unwrap();
    let (mut found, mut at) = (BTreeMap::new(), 0);
    while at < bytes.len() {
        let length = u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
        let event = fields(&bytes[at + 12..at + 12 + length]);
        at += 12 + length + 4;
        let step = event.iter().find(|(field, _)| *field == 2).map_or(0, |(_, value)| number(value));
        for (_, summary) in event.iter().filter(|(field, _)| *field == 5) {
            for (_, value) in fields(summary) {
                let value: BTreeMap<u64, Vec<u8>> = fields(&value).into_iter().collect();
                let tag = String::from_utf8(value[&1].clone()).unwrap();
                found.insert((tag, step), f32::from_le_bytes(value[&2][..].try_into().unwrap()));
            }
        }
    }
    found
}

/// The fields of a protocol buffer: numbers as they are written, the rest as bytes.
fn fields(mut bytes: &[u8]) -> Vec<(u64, Vec<u8>)> {
    let mut found = Vec::new();
    while !bytes.is_empty() {
        let key = take_number(&mut bytes);
        let length = match key & 7 {
            0 => bytes.iter().position(|byte| byte & 0x80 == 0).unwrap() + 1,
            1 => 8,
            2 => take_number(&mut bytes) as usize,
            _ => 4,
        };
        let (value, rest) = bytes.split_at(length);
        found.push((key >> 3, value.to_vec()));
        bytes = rest;
    }
    found
}

fn take_number(bytes: &mut &[u8]) -> u64 {
    let length = bytes.iter().position(|byte| byte & 0x80 == 0).unwrap() + 1;
    let (digits, rest) = bytes.split_at(length);
    *bytes = rest;
    number(digits)
}

fn number(digits: &[u8]) -> u64 {
    digits.iter().rev().fold(0, |sum, byte| sum << 7 | u64::from(byte & 0x7f))
}

/// Promise (options): logs, report and samples are right.
#[test]
fn logs_and_report_say_what_happened() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let steps = trained(&run);
    assert_eq!(steps.iter().map(|step| step.step).collect::<Vec<_>>(), [1, 2, 3, 4]);

    let events = std::fs::read_dir(&run).unwrap().map(|entry| entry.unwrap().path());
    let below = |path: std::path::PathBuf| std::fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path());
    let all: Vec<_> = events.flat_map(|path| if path.is_dir() { below(path).collect() } else { vec![path] }).collect();
    let file = all.iter().find(|path| path.display().to_string().contains("tfevents")).unwrap();
    let found = scalars(file);
    let mut expected = BTreeMap::new();
    for step in &steps {
        for (name, value) in &step.values {
            expected.insert((name.clone(), step.step as u64), *value as f32);
        }
    }
    assert_eq!(found, expected);

    let report = std::fs::read_to_string(run.join("report.html")).unwrap();
    let summary: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(run.join("summary.json")).unwrap()).unwrap();
    let last = steps.last().unwrap();
    let psnr = format!("{:.2}", summary["evaluation"]["scenes"][0]["psnr"].as_f64().unwrap());
    assert!(report.lines().any(|line| line.contains("capture ") && line.contains(&psnr)), "{psnr}");
    for (name, value) in &last.values {
        let title = match name.as_str() {
            "rate" => "learning rate".into(),
            "gaussians_per_pixel" => "Gaussians per pixel".into(),
            "loss" => format!("loss, {}", last.stage),
            name => name.replace('_', " "),
        };
        let digits = if value.fract() == 0.0 { 0 } else { 4 };
        assert!(report.contains(&format!("<figcaption>{title} (last {value:.digits$}")), "{title} {value}");
    }
    for sample in ["step-000003", "step-000004"] {
        assert!(report.contains(&format!("<figcaption>{sample}</figcaption>")), "{sample}");
    }
    assert_eq!(report.matches("<img ").count(), 2);
}

/// A sample is input render depth and gaussians per pixel.
///
/// Promise of `logs_and_report_say_what_happened`.
#[test]
fn a_sample_has_four_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    trained(&run);
    let picture = Image::read(run.join("samples/step-000004.png"), Background::Black).unwrap();

    let mut predictor = SplatWeaverPredictor::open(&run).unwrap();
    let [height, width] = predictor.image_size();
    let scene = load(Run::shared().data(), &CaptureOptions { width, height, ..CaptureOptions::default() }).unwrap();
    let context = evaluation_tuples(&scene, 0, 2).remove(0).context;
    let planes = planar(context.iter().map(|view| &scene.views[*view].image));
    let density = predictor.density(Density::default()).unwrap();
    let photos = Photos { planes: &planes, inside: None, height, width };
    let prediction = predictor.predict(photos, CameraSource::Predicted, density, Stream::new(0, 0, "samples")).unwrap();
    let render = predictor.render(&prediction, &prediction.cameras).unwrap().remove(0);

    let times = picture.height / height;
    assert_eq!((picture.width, picture.height), (4 * width * times, height * times));
    let at = |column: usize, x: usize, y: usize| -> [f32; 3] {
        let middle = times / 2;
        let pixel = (times * y + middle) * picture.width + times * (column * width + x) + middle;
        std::array::from_fn(|c| picture.pixels[3 * pixel + c])
    };
    let most = *prediction.counts.iter().max().unwrap();
    let near = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 0.01);
    let (mut nearest, mut farthest) = ((f32::MAX, 0.0), (0.0_f32, 0.0));
    for (i, (x, y)) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).enumerate() {
        let of = |image: &Image| std::array::from_fn(|c| image.pixels[3 * i + c].clamp(0.0, 1.0));
        assert!(near(at(0, x, y), of(&scene.views[context[0]].image)), "input at {x}, {y}");
        assert!(near(at(1, x, y), of(&render)), "render at {x}, {y}");
        assert!(near(at(3, x, y), [(prediction.density[i] / f32::from(most)).sqrt(); 3]), "expert map at {x}, {y}");
        let (depth, light) = (prediction.depth[i], at(2, x, y).iter().sum::<f32>());
        nearest = if depth < nearest.0 { (depth, light) } else { nearest };
        farthest = if depth > farthest.0 { (depth, light) } else { farthest };
    }
    assert!(nearest.0 < farthest.0 && nearest.1 > farthest.1, "near is bright: {nearest:?} {farthest:?}");
    let counts = &prediction.counts[..width * height];
    assert!(counts.contains(&0) && most > 0, "a map with something in it");
}
