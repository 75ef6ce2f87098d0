//! Compares settings over captures, budgets and seeds, and prints a table of the PSNR of held-out photos, in the mean
//! also with their colors aligned: `study STEPS BUDGETS SEEDS CAPTURES NAME=SETTINGS...`, lists divided by commas,
//! settings as JSON.
//!
//! `study 3000 5000,15000 0,1,2 DATA/fox,DATA/bonsai 'split={}' 'even={"even":true}'`
//!
//! Beside the keys of [`FitSettings`], settings may hold `views` (so many of the training photos, evenly spread),
//! `by_photos` (background and dropout, unless it is given, follow from the photos, as in the command), `by_colors` (so
//! does the correction of exposures), `planted` (a thing of its own before every so many photos), `kinds` (things of
//! several kinds), `from` (the folder of the capture that things are cut from, where it is another one), `known`
//! (things are masked, as somebody who knows them would), `found` (1: statistics of the found things are printed, 2: of
//! each), `dense` (Gaussians begin on surfaces that photos agree about), `side` (the longest side of the photos that
//! are fitted to, where it differs from the size they are judged at), `looks` (so many times in a run the held-out
//! photos are met, which is printed), and `even` (no density control, but all of the budget from the beginning: points
//! that are too few are split evenly). A capture may end with `@SIDE`, the longest side of its photos.

mod things;

use rayon::prelude::*;
use serde_json::{Value, json};
use std::error::Error;
use std::path::Path;
use std::time::Instant;
use things::Things;
use weaver_data::posed::{self, PosedOptions, PosedPhoto, PosedPhotos};
use weaver_fit::{ColorAgreement, Exposure, Fit, FitSettings, Judge, Photo, Quality, init, mean_color};
use weaver_scene::Gaussians;
use weaver_stereo::{Stereo, StereoSettings};

type Failure = Box<dyn Error + Send + Sync>;

const USAGE: &str = "study STEPS BUDGETS SEEDS CAPTURES NAME=SETTINGS...";

/// A row of the table.
struct Variant {
    name: String,
    views: Option<usize>,
    even: bool,
    planted: Option<usize>,
    kinds: bool,
    from: Option<String>,
    known: bool,
    found: usize,
    side: Option<usize>,
    looks: usize,
    by_photos: bool,
    by_colors: bool,
    dense: bool,
    settings: Value,
}

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [steps, budgets, seeds, captures, variants @ ..] = &arguments[..] else { return Err(USAGE.into()) };
    let steps: usize = steps.parse()?;
    let budgets = budgets.split(',').map(str::parse).collect::<Result<Vec<usize>, _>>()?;
    let seeds = seeds.split(',').map(str::parse).collect::<Result<Vec<u64>, _>>()?;
    let variants = variants.iter().map(|v| variant(v)).collect::<Result<Vec<_>, _>>()?;
    let captures: Vec<&str> = captures.split(',').collect();
    let data = captures.iter().map(|c| load(c, None)).collect::<Result<Vec<_>, Failure>>()?;

    let names: Vec<_> =
        captures.iter().map(|c| Path::new(c).file_name().map_or((*c).into(), |n| n.to_string_lossy())).collect();
    println!(
        "| {steps} steps, {} seeds | Gaussians | {} | mean | aligned | SSIM | M pairs |",
        seeds.len(),
        names.join(" | ")
    );
    println!("|---|---|{}", "---|".repeat(names.len() + 4));
    for &budget in &budgets {
        for variant in &variants {
            let jobs: Vec<(usize, u64)> = (0..data.len()).flat_map(|c| seeds.iter().map(move |s| (c, *s))).collect();
            let results: Vec<(usize, Quality, f64)> = (jobs.par_iter())
                .map(|&(c, seed)| {
                    let base = json!({ "steps": steps, "gaussians": budget, "seed": seed });
                    let reduced = variant.side.map(|side| load(captures[c], Some(side))).transpose()?;
                    fit([reduced.as_ref().unwrap_or(&data[c]), &data[c]], variant, base)
                        .map(|(quality, pairs)| (c, quality, pairs))
                })
                .collect::<Result<_, Failure>>()?;
            let of = |c: usize| results.iter().filter(|r| r.0 == c).map(|r| r.1).collect::<Vec<_>>();
            let each: Vec<Quality> = (0..data.len()).filter_map(|c| Quality::mean(&of(c))).collect();
            let mean = Quality::mean(&each).ok_or("no capture")?;
            let pairs = results.iter().map(|r| r.2).sum::<f64>() / results.len() as f64;
            let columns: Vec<String> = each.iter().map(|q| format!("{:.2}", q.psnr)).collect();
            let [ssim, aligned] = [mean.ssim, mean.psnr_aligned].map(|x| x.unwrap_or(f64::NAN));
            let Variant { name, .. } = variant;
            let columns = columns.join(" | ");
            println!("| {name} | {budget} | {columns} | {:.2} | {aligned:.2} | {ssim:.4} | {pairs:.2} |", mean.psnr);
        }
    }
    Ok(())
}

fn load(capture: &str, side: Option<usize>) -> Result<PosedPhotos, Failure> {
    let (folder, own) = capture.split_once('@').unwrap_or((capture, ""));
    let own = (!own.is_empty()).then(|| own.parse()).transpose()?;
    let long_side = side.or(own);
    Ok(posed::load(folder, &PosedOptions { long_side, ..PosedOptions::default() })?)
}

fn variant(argument: &str) -> Result<Variant, Failure> {
    let (name, json) = argument.split_once('=').ok_or(USAGE)?;
    let mut settings: Value = serde_json::from_str(json)?;
    let own = settings.as_object_mut().ok_or("settings: expected an object")?;
    let mut count = |key: &str| own.remove(key).and_then(|v| v.as_u64()).map(|v| v as usize);
    let [views, planted, side, looks, found] = ["views", "planted", "side", "looks", "found"].map(&mut count);
    let mut flag = |key: &str| own.remove(key).is_some_and(|v| v == true);
    let [even, dense, kinds, known] = ["even", "dense", "kinds", "known"].map(&mut flag);
    let [by_photos, by_colors] = ["by_photos", "by_colors"].map(&mut flag);
    let from = own.remove("from").and_then(|v| v.as_str().map(String::from));
    let (name, looks, found) = (name.into(), looks.unwrap_or(0), found.unwrap_or(0));
    Ok(Variant {
        name,
        views,
        even,
        planted,
        kinds,
        from,
        known,
        found,
        side,
        looks,
        by_photos,
        by_colors,
        dense,
        settings,
    })
}

/// Fits a capture, and returns the quality of the held-out photos of another, the same at its own size, and the pairs,
/// in millions, of the last step.
fn fit([capture, judged]: [&PosedPhotos; 2], variant: &Variant, base: Value) -> Result<(Quality, f64), Failure> {
    let mut settings = serde_json::to_value(FitSettings::default())?;
    merge(&mut settings, base);
    merge(&mut settings, variant.settings.clone());
    if variant.even {
        settings["density"]["strategy"] = json!("keep");
    }
    let mut settings: FitSettings = serde_json::from_value(settings)?;
    let mut training: Vec<&PosedPhoto> = capture.photos.iter().filter(|p| !p.held_out).collect();
    let test: Vec<&PosedPhoto> = judged.photos.iter().filter(|p| p.held_out).collect();
    if let Some(views) = variant.views {
        let (all, views) = (training.len(), views.min(training.len()));
        training = (0..views).map(|i| training[(2 * i + 1) * all / (2 * views)]).collect();
    }
    let visible: Vec<Vec<u32>> = training.iter().map(|p| p.visible.clone()).collect();
    let mut training: Vec<Photo> = training.into_iter().map(photo).collect();
    if variant.by_photos {
        settings.background = mean_color(&training);
        if variant.settings.get("dropout").is_none() {
            settings.dropout = FitSettings::dropout_for(training.len());
        }
    }
    let mut things = None;
    if let Some(every) = variant.planted {
        let shown = match &variant.from {
            Some(folder) => load(folder, variant.side)?.photos.iter().map(photo).collect(),
            None => training.clone(),
        };
        let planted = Things::plant(&mut training, every, &shown, variant.kinds);
        if variant.known {
            planted.mask(&mut training);
        }
        things = Some(planted);
    }
    let mut initial = match capture.points.is_empty() {
        true => init::random(&training, &settings)?,
        false => init::from_points(&capture.points, &settings)?,
    };
    if variant.even {
        initial = init::divided(&initial, settings.gaussians, settings.seed);
    }
    if variant.dense {
        initial = dense(&training, capture, &visible, &settings)?;
    }
    initial = init::bounded(initial, &training);
    let agreement = ColorAgreement::of(&training, &capture.points, &visible);
    settings.exposure |= variant.by_colors && agreement.differ();
    let mut fit = Fit::new(training, &initial, settings)?;
    fit.begin_exposures(agreement.gains.iter().map(|gains| Exposure::of_gains(*gains)));
    let (mut pairs, steps) = (0, fit.settings().steps);
    while fit.steps_done() < steps {
        pairs = fit.step()?.pairs;
        if let Some(things) =
            things.as_ref().filter(|_| variant.found > 0 && fit.steps_done() % (steps / 20).max(1) == 0)
        {
            let found = things.found(&fit, variant.found > 1);
            eprintln!("{}, {}, step {}: {found}", capture.name, variant.name, fit.steps_done());
        }
        let [before, now] = [1, 0].map(|back| (fit.steps_done() - back) * variant.looks / steps);
        if now > before {
            let Quality { psnr, psnr_aligned, .. } = met(&mut fit, &test)?;
            eprintln!(
                "{}, {}, step {}: {psnr:.2} {:.2}",
                capture.name,
                variant.name,
                fit.steps_done(),
                psnr_aligned.unwrap_or(f64::NAN)
            );
        }
    }
    Ok((met(&mut fit, &test)?, pairs as f64 / 1e6))
}

/// Mean quality of photos, drawn as they are now.
fn met(fit: &mut Fit, photos: &[&PosedPhoto]) -> Result<Quality, Failure> {
    let judge = Judge::default();
    let mut compare = |photo: &Photo| -> Result<Quality, Failure> {
        let size = [photo.camera.height, photo.camera.width];
        let mut image = fit.render(&photo.camera)?;
        if let Some(exposure) = fit.exposure_at(&photo.camera) {
            let drawn = image.clone();
            exposure.apply(&drawn, &mut image);
        }
        Ok(judge.compare(&image, &photo.rgb, size))
    };
    let quality: Vec<Quality> = photos.iter().map(|p| compare(&p.photo)).collect::<Result<_, _>>()?;
    Ok(Quality::mean(&quality).ok_or("no held-out photos")?)
}

/// Gaussians on surfaces that photos agree about and on the points that these do not show, and the time for it.
fn dense(
    training: &[Photo],
    capture: &PosedPhotos,
    visible: &[Vec<u32>],
    settings: &FitSettings,
) -> Result<Gaussians, Failure> {
    let start = Instant::now();
    let options = StereoSettings { seed: settings.seed, ..StereoSettings::default() };
    let stereo = Stereo::of(training, &capture.points, visible, &options);
    let sparse = init::from_points(&stereo.unexplained(), settings).unwrap_or_default();
    let dense = stereo.surface().gaussians(init::room(settings) - sparse.len());
    let coverage = stereo.coverage().iter().sum::<f64>() / training.len() as f64;
    let (seconds, name) = (start.elapsed().as_secs_f64(), &capture.name);
    eprintln!("{name}: {seconds:.1} s, coverage {coverage:.2}, {} and {} Gaussians", dense.len(), sparse.len());
    Ok(Gaussians::joined(&[dense, sparse]))
}

fn photo(p: &PosedPhoto) -> Photo {
    p.photo.clone()
}

/// Lays one JSON tree over another.
fn merge(base: &mut Value, over: Value) {
    match (base, over) {
        (Value::Object(base), Value::Object(over)) => {
            over.into_iter().for_each(|(key, value)| merge(base.entry(key).or_insert(Value::Null), value));
        }
        (base, over) => *base = over,
    }
}
