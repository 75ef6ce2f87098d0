//! Measures the second look at weak pairs: `cargo run --release -p weaver-data --example weak_pairs -- CAMERAS PHOTOS
//! N[+FIRST] ...` estimates the cameras of every N-th photo of a folder, from the FIRST on, without and with it, and
//! compares them with the cameras of a transforms.json.
//!
//! `--whole OUT PHOTOS` writes the cameras of all photos into a folder, whose transforms.json may then be CAMERAS.
//!
//! Prints a row of a table for each N. A photo is wrong if it is more than 2 degrees or 5 % of the spread of centers
//! off after a similarity, the one that leaves the fewest wrong.

use std::collections::BTreeMap;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;
use weaver_data::{EstimatePhotosOptions, EstimatedPhotos, OutputFolder, estimate_photos};
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Pose, Similarity};
use weaver_io::Transforms;

/// A photo is wrong if it is turned by more degrees, or off by more than this part of the spread of centers.
const TURNED: f64 = 2.0;
const OFF: f64 = 0.05;
/// Photos, some of them the beginning of an alignment, and its rounds.
const BEGINNINGS: usize = 12;
const ROUNDS: usize = 4;

fn main() -> Result<(), Box<dyn Error>> {
    let mut words: Vec<String> = std::env::args().skip(1).collect();
    let whole = words.first().is_some_and(|word| word == "--whole");
    words.drain(..usize::from(whole));
    let [reference, folder] = [0, 1].map(|i| PathBuf::from(words.get(i).map_or("", String::as_str)));
    let photos = photos(&folder)?;
    if whole {
        let found = estimate_photos(&photos, &vec![false; photos.len()], &EstimatePhotosOptions::default())?;
        println!("{}: {} of {}, {:?}", folder.display(), found.placed().len(), photos.len(), found.confidence());
        found.write(&OutputFolder::claim(&reference, "weak_pairs", &photos)?)?;
        return Ok(());
    }
    let frames = Transforms::read_cameras(&reference)?.frames;
    let known: BTreeMap<String, Pose> =
        frames.into_iter().map(|frame| (name(&frame.path), frame.camera.pose)).collect();
    println!("| capture, every | photos | placed, wrong, says | s | with weak pairs | s | placed again |");
    println!("|---|---|---|---|---|---|---|");
    for word in words.iter().skip(2) {
        let (step, first) = word.split_once('+').unwrap_or((word, "0"));
        let some: Vec<PathBuf> = photos.iter().skip(first.parse()?).step_by(step.parse()?).cloned().collect();
        print!("| {}, {word} | {} |", folder.display(), some.len());
        for weak_pairs in [false, true] {
            let begun = Instant::now();
            let options = EstimatePhotosOptions { weak_pairs, ..EstimatePhotosOptions::default() };
            let found = estimate_photos(&some, &vec![false; some.len()], &options)?;
            print!(" {} | {:.1} |", row(&found, &known), begun.elapsed().as_secs_f64());
            if weak_pairs {
                println!(" {} |", found.estimate.second_look.len());
            }
        }
    }
    Ok(())
}

/// The photos of a folder, in the order of their names.
fn photos(folder: &Path) -> Result<Vec<PathBuf>, std::io::Error> {
    let mut photos: Vec<PathBuf> = std::fs::read_dir(folder)?.map(|e| Ok(e?.path())).collect::<std::io::Result<_>>()?;
    let is_photo = |path: &PathBuf| {
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        ["jpg", "jpeg", "png"].contains(&&*ending)
    };
    photos.retain(is_photo);
    photos.sort();
    Ok(photos)
}

fn name(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().to_lowercase()
}

/// Photos placed, wrong ones, and the confidence.
fn row(found: &EstimatedPhotos, known: &BTreeMap<String, Pose>) -> String {
    let cameras = found.paths.iter().zip(&found.estimate.cameras);
    let both = cameras.filter_map(|(path, camera)| Some((camera.ok()?.pose, *known.get(&name(path))?)));
    let both: Vec<(Pose, Pose)> = both.collect();
    format!("{}, {}, {:?}", found.placed().len(), wrong(&both), found.confidence())
}

/// Number of wrong cameras: the fewest that a similarity leaves, of those that fit all or a few of them.
fn wrong(pairs: &[(Pose, Pose)]) -> usize {
    let n = pairs.len();
    let middle = pairs.iter().map(|p| p.1.center()).sum::<DVec3>() / n.max(1) as f64;
    let spread = (pairs.iter().map(|p| p.1.center().distance_squared(middle)).sum::<f64>() / n.max(1) as f64).sqrt();
    let far = |onto: &Similarity, (from, to): &(Pose, Pose)| {
        let moved = onto.apply_to_pose(from);
        (moved.angle_to(to).to_degrees() / TURNED).max(moved.center().distance(to.center()) / spread / OFF)
    };
    let some = || (0..n).step_by(1 + n / BEGINNINGS);
    let pair = |a: usize, b: usize| vec![a, b];
    let mut beginnings: Vec<Vec<usize>> = vec![(0..n).collect()];
    beginnings.extend(some().flat_map(|a| some().filter(move |b| *b > a).map(move |b| pair(a, b))));
    let mut fewest = if n < 3 { 0 } else { n };
    for mut kept in beginnings {
        for _ in 0..ROUNDS {
            let [from, to]: [Vec<Pose>; 2] =
                [kept.iter().map(|i| pairs[*i].0).collect(), kept.iter().map(|i| pairs[*i].1).collect()];
            let Some(onto) = Similarity::fit_poses(&from, &to) else { break };
            let off: Vec<f64> = pairs.iter().map(|pair| far(&onto, pair)).collect();
            fewest = fewest.min(off.iter().filter(|off| **off > 1.0).count());
            kept = (0..n).filter(|i| off[*i] < 1.5).collect();
        }
    }
    fewest
}
