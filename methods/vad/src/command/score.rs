//! `splatweaver vad score`.

use crate::command::arguments::VadScore;
use crate::command::{check_width, open};
use crate::metrics::SNIPPET;
use crate::{Annotation, Chart, Curves, Features, FileName, Length};
use serde_json::json;
use std::fmt::Write;
use std::path::PathBuf;
use weaver_command::{Console, Failure, Progress};
use weaver_io::{OutputFolder, write_npy, write_text};

pub fn run(arguments: &VadScore, console: &mut Console) -> Result<(), Failure> {
    let out = OutputFolder::claim(&arguments.out, "vad score", arguments.files.iter().chain(&arguments.annotation))?;
    let (detector, model, _) = open(&arguments.run)?;
    let annotation = arguments.annotation.as_deref().map(Annotation::read).transpose()?;
    let mut videos: Vec<(String, Vec<(usize, PathBuf)>)> = Vec::new();
    for path in &arguments.files {
        let name = path.file_name().map_or(String::new(), |name| name.to_string_lossy().into_owned());
        let FileName { video, crop } = FileName::of(&name);
        match videos.iter_mut().find(|(other, _)| *other == video) {
            Some((_, files)) => files.push((crop, path.clone())),
            None => videos.push((video, vec![(crop, path.clone())])),
        }
    }
    let results = |name: &String| ["npy", "csv", "png"].map(|extension| format!("{name}.{extension}"));
    out.check(videos.iter().flat_map(|(name, _)| results(name)))?;
    let total = videos.len();
    let mut progress = Progress::new("score", 0, total, console);
    for (i, (name, mut files)) in videos.into_iter().enumerate() {
        files.sort();
        let paths: Vec<PathBuf> = files.into_iter().map(|(_, path)| path).collect();
        let features = Features::open(&paths)?;
        check_width(&detector, features.width(), &paths[0].display().to_string(), &model)?;
        let curves = detector.curves(&features)?;
        let scores = curves.scores().to_vec();
        let anomalous = match &annotation {
            None => Vec::new(),
            Some(annotation) => {
                shares(&annotation.join(vec![(name.clone(), scores.clone())], Length::Features)?[0].labels)
            }
        };
        let [npy, table, picture] = results(&name);
        write_npy(out.file(npy)?, &[scores.len()], &scores)?;
        write_text(out.file(table)?, &csv(&curves, detector.experts()))?;
        let others = others(&curves);
        Chart { scores: &scores, others, anomalous }.draw().write_png(out.file(picture)?)?;
        progress.at(i + 1, total, || name.clone(), console);
    }
    progress.finish();
    let text = format!("{total} videos: {}", arguments.out.display());
    console.answer(arguments.json, &[&*arguments.out], json!({ "videos": total }), &text)
}

/// The curves beside the final one: the experts' and, with a gate, the encoder's.
pub fn others(curves: &Curves) -> Vec<&[f32]> {
    let encoder = curves.gate.is_some().then_some(&curves.encoder);
    curves.experts.iter().chain(encoder).map(Vec::as_slice).collect()
}

/// Anomalous share of the frames of each snippet.
pub fn shares(labels: &[bool]) -> Vec<f32> {
    let share = |part: &[bool]| part.iter().filter(|label| **label).count() as f32 / part.len() as f32;
    labels.chunks(SNIPPET).map(share).collect()
}

fn csv(curves: &Curves, experts: &[String]) -> String {
    let mut text = String::from("snippet,first_frame,score,encoder");
    experts.iter().for_each(|name| text += &format!(",{}", name.replace(',', " ")));
    text.push('\n');
    for (i, score) in curves.scores().iter().enumerate() {
        // Writing to a string cannot fail.
        let _ = write!(text, "{i},{},{score},{}", i * SNIPPET, curves.encoder[i]);
        curves.experts.iter().for_each(|curve| text += &format!(",{}", curve[i]));
        text.push('\n');
    }
    text
}
