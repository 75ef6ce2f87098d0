//! One file of Gaussians against the photos of a capture.

use crate::Console;
use crate::arguments::{Drawing, Eval};
use crate::failure::Failure;
use crate::progress::Progress;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::Path;
use weaver_data::capture::posed::{self, PosedOptions};
use weaver_fit::{Judge, Quality};
use weaver_io::read_gaussians;
use weaver_splat::{RasterSettings, Workspace, render};
use weaver_trainer::evaluate::load_lpips;

pub fn run(arguments: &Eval, scene: &Path, console: &mut Console) -> Result<(), Failure> {
    let [data] = arguments.data.as_slice() else {
        let found = arguments.data.len();
        return Err(Failure::Usage(format!("--data: expected exactly one with --scene, found {found}")));
    };
    let (background, settings) = drawing(&arguments.drawing, scene)?;
    let judge = Judge::new(arguments.lpips.as_deref().map(load_lpips).transpose()?);
    let gaussians = read_gaussians(scene)?;
    let long_side = arguments.drawing.size.map(|size| size as usize);
    let capture = posed::load(data, &PosedOptions { long_side, background, ..PosedOptions::default() })?;
    capture.remarks.iter().for_each(|remark| console.note(&format!("warning: {remark}")));
    let mut photos = capture.photos;
    let held_out = photos.iter().any(|photo| photo.held_out);
    if held_out {
        photos.retain(|photo| photo.held_out);
    } else {
        console.note(&format!("{}: no photo is held out; these are all of them", data.display()));
    }
    let (activated, mut workspace) = (gaussians.to_activated(), Workspace::new());
    let mut progress = Progress::new("eval", 0, photos.len(), console);
    let mut views = Vec::new();
    for photo in &photos {
        let images = render(&activated, &[photo.camera], background, &settings, &mut workspace)
            .map_err(|e| Failure::message(format!("{}: {e}", scene.display())))?;
        let size = [photo.camera.height, photo.camera.width];
        views.push((photo.name.as_str(), judge.compare(&images.concat(), &photo.rgb, size)));
        progress.at(views.len(), photos.len(), String::new, console);
    }
    progress.finish();
    let all: Vec<Quality> = views.iter().map(|(_, quality)| *quality).collect();
    let mean = Quality::mean(&all)
        .ok_or_else(|| Failure::message(format!("{}: expected at least one photo, found none", data.display())))?;
    if arguments.json {
        let views: Vec<Value> = views.iter().map(|(name, quality)| figures(Some(name), quality)).collect();
        let report = json!({
            "scene": scene.display().to_string(),
            "gaussians": gaussians.len(),
            "held_out": held_out,
            "views": views,
            "mean": figures(None, &mean),
        });
        return console.print(&serde_json::to_string_pretty(&report)?);
    }
    let kind = if held_out { "held out" } else { "all, none held out" };
    console.print(&format!("{}views: {} ({kind}), Gaussians: {}", table(&views, &mean), views.len(), gaussians.len()))
}

fn figures(name: Option<&str>, quality: &Quality) -> Value {
    let mut figures = json!({ "psnr": quality.psnr, "ssim": quality.ssim, "lpips": quality.lpips });
    if let Some(name) = name {
        figures["name"] = name.into();
    }
    figures
}

fn table(views: &[(&str, Quality)], mean: &Quality) -> String {
    let width = views.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0).max("mean".len());
    let number = |value: Option<f64>| value.map_or("-".into(), |value| format!("{value:.4}"));
    let mut text = format!("{:<width$}     PSNR    SSIM   LPIPS\n", "view");
    for (name, quality) in views.iter().copied().chain([("mean", *mean)]) {
        let (ssim, lpips) = (number(quality.ssim), number(quality.lpips));
        let _ = writeln!(text, "{name:<width$}  {:>7.2}  {ssim:>6}  {lpips:>6}", quality.psnr);
    }
    text
}

/// The color behind the scene, and how the scene is drawn: by flags, else by the summary of the fit that made it.
fn drawing(flags: &Drawing, scene: &Path) -> Result<([f32; 3], RasterSettings), Failure> {
    let summary = Summary::beside(scene)?;
    let mut settings = RasterSettings::default();
    if let Some(antialiased) = flags.antialiased.or(summary.antialiased) {
        settings.antialiased = antialiased;
    }
    if let Some(near) = flags.near.or(summary.near) {
        settings.near = near;
    }
    let background = flags.background.map(|color| color.0).or(summary.background).unwrap_or([1.0; 3]);
    Ok((background, settings))
}

/// What the summary of a fit says about drawing its scene.
#[derive(Debug, Default, PartialEq)]
struct Summary {
    antialiased: Option<bool>,
    near: Option<f64>,
    background: Option<[f32; 3]>,
}

impl Summary {
    /// That of the summary.json in the scene's folder. There need not be one, and it need not say anything: a run of training
    /// has a file of that name as well.
    fn beside(scene: &Path) -> Result<Self, Failure> {
        let path = scene.with_file_name("summary.json");
        if !path.is_file() {
            return Ok(Self::default());
        }
        let text = weaver_io::read_text(&path)?;
        Self::parse(&text).map_err(|message| Failure::message(format!("{}: {message}", path.display())))
    }

    fn parse(text: &str) -> Result<Self, String> {
        let summary: Value = serde_json::from_str(text).map_err(|e| e.to_string())?;
        let color = |value: &Value| {
            let numbers =
                value.as_array()?.iter().map(|x| x.as_f64().map(|x| x as f32)).collect::<Option<Vec<f32>>>()?;
            <[f32; 3]>::try_from(numbers).ok().filter(|color| color.iter().all(|x| (0.0..=1.0).contains(x)))
        };
        let near = |value: &Value| value.as_f64().filter(|near| *near > 0.0);
        Ok(Self {
            antialiased: read(&summary, "antialiased", "true or false", Value::as_bool)?,
            near: read(&summary, "near", "a positive number", near)?,
            background: read(&summary, "background", "three numbers from 0 to 1", color)?,
        })
    }
}

/// The value of a key, if there is one.
fn read<T>(summary: &Value, key: &str, expected: &str, of: impl Fn(&Value) -> Option<T>) -> Result<Option<T>, String> {
    match summary.get(key) {
        None => Ok(None),
        Some(value) => of(value).map(Some).ok_or_else(|| format!("{key}: expected {expected}, found {value}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_summary_says_what_it_says() {
        let whole = r#"{"steps": 7, "antialiased": true, "near": 0.5, "background": [0, 0.5, 1.0]}"#;
        let expected = Summary { antialiased: Some(true), near: Some(0.5), background: Some([0.0, 0.5, 1.0]) };
        assert_eq!(Summary::parse(whole), Ok(expected));
        assert_eq!(Summary::parse(r#"{"preset": "micro"}"#), Ok(Summary::default()));
        for (text, part) in [
            ("{", "EOF"),
            (r#"{"near": 0}"#, "near: expected a positive number, found 0"),
            (r#"{"antialiased": 1}"#, "antialiased: expected true or false, found 1"),
            (r#"{"background": [0, 1]}"#, "background: expected three numbers from 0 to 1, found [0,1]"),
            (r#"{"background": [0, 1, "x"]}"#, "background"),
        ] {
            let message = Summary::parse(text).unwrap_err();
            assert!(message.contains(part) && message.lines().count() == 1, "{message}");
        }
    }
}
