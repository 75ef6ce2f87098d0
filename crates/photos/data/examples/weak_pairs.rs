//! Estimates the cameras of every n-th photo of a capture, and compares them with known ones: `cargo run --release -p
//! weaver-data --example weak_pairs -- CAMERAS PHOTOS N ...`, where CAMERAS is a transforms.json and PHOTOS a folder.
//! With `--whole OUT` in place of CAMERAS it writes the cameras of the whole capture into a folder.
//!
//! Prints a row of a table for each N: photos, placed ones, wrong ones (more than 2 degrees or 5 % of the spread of
//! centers off after the similarity that fits best), the confidence, and seconds.

use std::collections::BTreeMap;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;
use weaver_data::{EstimatePhotosOptions, EstimatedPhotos, OutputFolder, estimate_photos};
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Pose, Similarity};
use weaver_io::Transforms;

/// A photo is wrong if it is turned by more degrees, or off by more than this part of the spread of centers.
const TURNED: f64 = 2.0;
const OFF: f64 = 0.05;

fn main() -> Result<(), Box<dyn Error>> {
    let mut words: Vec<String> = std::env::args().skip(1).collect();
    let whole = words.first().is_some_and(|word| word == "--whole");
    if whole {
        words.remove(0);
    }
    let [reference, folder] = [0, 1].map(|i| PathBuf::from(words.get(i).map_or("", String::as_str)));
    let mut photos: Vec<PathBuf> =
        std::fs::read_dir(&folder)?.map(|e| Ok(e?.path())).collect::<Result<_, std::io::Error>>()?;
    photos.retain(|path| {
        path.extension().is_some_and(|e| ["jpg", "jpeg", "png"].contains(&&*e.to_string_lossy().to_lowercase()))
    });
    photos.sort();
    if whole {
        let found = estimate_photos(&photos, &vec![false; photos.len()], &EstimatePhotosOptions::default())?;
        println!("{}: {} of {} {:?}", folder.display(), found.placed().len(), photos.len(), found.confidence());
        found.write(&OutputFolder::claim(&reference, "example", &photos)?)?;
        return Ok(());
    }
    let known = cameras(&reference)?;
    for step in &words[2..] {
        let (step, from) = step.split_once('+').unwrap_or((step, "0"));
        let some: Vec<PathBuf> = photos.iter().skip(from.parse()?).step_by(step.parse()?).cloned().collect();
        let begun = Instant::now();
        let found = estimate_photos(&some, &vec![false; some.len()], &EstimatePhotosOptions::default())?;
        let seconds = begun.elapsed().as_secs_f64();
        let row = row(&found, &known);
        println!("| {} {step}+{from} | {} | {row} | {seconds:.1} |", folder.display(), some.len());
    }
    Ok(())
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().to_lowercase()
}

fn cameras(file: &Path) -> Result<BTreeMap<String, Camera>, Box<dyn Error>> {
    let frames = Transforms::read_cameras(file)?.frames;
    Ok(frames.into_iter().map(|frame| (name(&frame.path), frame.camera)).collect())
}

/// Photos placed, wrong ones, and the confidence.
fn row(found: &EstimatedPhotos, known: &BTreeMap<String, Camera>) -> String {
    let placed = found
        .paths
        .iter()
        .zip(&found.estimate.cameras)
        .filter_map(|(path, camera)| Some((camera.ok()?.pose, known.get(&name(path))?.pose)));
    let pairs: Vec<(Pose, Pose)> = placed.collect();
    let wrong = wrong(&pairs);
    format!("{} | {wrong} of {} | {:?}", found.placed().len(), pairs.len(), found.confidence())
}

/// Number of wrong cameras: the fewest that any similarity leaves, among those that fit three of them or all.
fn wrong(pairs: &[(Pose, Pose)]) -> usize {
    let n = pairs.len();
    if n < 3 {
        return 0;
    }
    let middle = pairs.iter().map(|p| p.1.center()).sum::<DVec3>() / n as f64;
    let spread = (pairs.iter().map(|p| p.1.center().distance_squared(middle)).sum::<f64>() / n as f64).sqrt();
    let far = |onto: &Similarity, (from, to): &(Pose, Pose)| {
        let moved = onto.apply_to_pose(from);
        (moved.angle_to(to).to_degrees() / TURNED).max(moved.center().distance(to.center()) / spread / OFF)
    };
    let fit = |kept: &[usize]| {
        let [from, to]: [Vec<Pose>; 2] =
            [kept.iter().map(|i| pairs[*i].0).collect(), kept.iter().map(|i| pairs[*i].1).collect()];
        Similarity::fit_poses(&from, &to)
    };
    let mut fewest = n;
    let all: Vec<usize> = (0..n).collect();
    let stride = 1 + n / 12;
    let mut starts = vec![all];
    for a in (0..n).step_by(stride) {
        for b in (a + 1..n).step_by(stride) {
            starts.push((0..n).filter(|i| [a, b, (a + b) / 2, (b + 1) % n].contains(i)).collect());
        }
    }
    for start in starts {
        let mut kept = start;
        for _ in 0..4 {
            let Some(onto) = fit(&kept) else { break };
            let off: Vec<f64> = pairs.iter().map(|pair| far(&onto, pair)).collect();
            fewest = fewest.min(off.iter().filter(|off| **off > 1.0).count());
            kept = (0..n).filter(|i| off[*i] < 1.5).collect();
            if kept.len() < 2 {
                break;
            }
        }
    }
    fewest
}
