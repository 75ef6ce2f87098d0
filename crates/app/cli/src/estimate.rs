//! Cameras that are estimated: `splatweaver cameras`, and for the commands that need them.

use crate::clip::Photos;
use crate::flags::MatchingFlags;
use std::path::{Path, PathBuf};
use std::time::Instant;
use weaver_command::{Console, Failure, Part, duration, memory};
use weaver_data::capture::HoldOut;
use weaver_data::{Doubt, EstimatePhotosOptions, EstimatedPhotos, LeftOut, OutputFolder, estimate_photos};
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Distortion, Pose, Similarity};

/// Name of the command in the record of a folder of estimated cameras.
pub const COMMAND: &str = "cameras";
/// One photo in this many is held out.
const HOLD_OUT: usize = 8;
/// From this logarithm of a factor on a focal length is not what was told.
const WRONG_FOCAL: f64 = 0.1;
/// Cameras that are more degrees than this from others are named.
const ELSEWHERE: f64 = 5.0;
/// Rounds of an alignment that leaves out what is far off.
const ROUNDS: usize = 5;
/// Bytes that a photo takes while it is matched with hundreds of others, as measured of 250 and of 1000.
const MATCHED: u64 = 3_300_000;
/// The shortest time that a fit takes, minutes.
const SHORTEST: f64 = 0.05;
/// The least share of the time that is the fit's, whatever matching took.
const SHARE: f64 = 0.5;
/// Names of photos in a message, at most.
const NAMED: usize = 8;

/// Photos with estimated cameras.
pub struct Estimated {
    pub found: EstimatedPhotos,
    /// The photos that the cameras are of: the files, or what was written of them upright.
    pub photos: Vec<PathBuf>,
}

/// Estimates cameras, says how it went, and writes a capture into a folder. Where `located` is true a photo is kept from what finds
/// points.
///
/// # Errors
/// When fewer than two photos get a camera; the message says why.
pub fn estimated(
    photos: &Photos,
    located: &[bool],
    flags: MatchingFlags,
    out: &OutputFolder,
    console: &mut Console,
) -> Result<Estimated, Failure> {
    let start = Instant::now();
    let Photos { paths: photos, sequence, .. } = photos;
    EstimatedPhotos::check(out, photos)?;
    memory::check(MATCHED * photos.len() as u64, "fewer photos at once take less")?;
    console.note(&format!("cameras: matching {} photos", photos.len()));
    let options = EstimatePhotosOptions { sequence: *sequence, ..flags.into() };
    let found = estimate_photos(photos, located, &options)?;
    found.remarks.iter().for_each(|remark| console.note(&format!("warning: {remark}")));
    let placed = found.placed().len();
    if placed < 2 {
        return Err(Failure::message(format!("cameras: {}", refusal(&found))));
    }
    let e = &found.estimate;
    console.note(&format!(
        "cameras: {placed} of {} photos placed, {} points, off by {:.2} pixels in the median; focal length {:.3}{} of the longer side; {}",
        photos.len(),
        e.points.len(),
        e.error,
        found.focal(),
        e.uncertainty.as_ref().map_or(String::new(), |u| format!(" +- {:.3}", u.focal * found.focal())),
        duration(start.elapsed().as_secs_f64())
    ));
    if found.lenses() > 1 && !flags.own_focal {
        let lenses = found.lenses();
        console.note(&format!(
            "cameras: photos of {lenses} proportions or focal lengths, cropped or of several lenses: each has a focal length of its own; --own-focal finds one for every photo"
        ));
    }
    console.note(&format!("cameras: {}", sureness(&found)));
    if let Some(Distortion::Radial { k: [k1, k2, ..], .. }) = e.distortion.iter().flatten().next() {
        console.note(&format!("cameras: the lens bends lines: radial distortion k1 {k1:+.4}, k2 {k2:+.4}"));
    }
    if (e.focal_factor.ln()).abs() > WRONG_FOCAL {
        let percent = 100.0 * (e.focal_factor - 1.0);
        console.note(&format!(
            "warning: by what photos show of each other the focal length is {percent:+.0} % off what was told; were photos cropped? --no-exif estimates it"
        ));
    }
    for reason in [LeftOut::Textureless, LeftOut::Unmatched, LeftOut::OnePlace, LeftOut::Unplaced] {
        let names: Vec<String> =
            found.left_out().iter().filter(|(_, r)| *r == reason).map(|(path, _)| path.display().to_string()).collect();
        if !names.is_empty() {
            console.note(&format!("warning: left out: {}: {}", listed(&names), explained(reason)));
        }
    }
    // All is said before anything is written: work that nobody waits for any longer ends at its next word, and writes nothing.
    console.tell(|| Part { label: COMMAND, done: placed, total: photos.len(), note: sureness(&found) });
    let photos = found.write(out)?;
    Ok(Estimated { found, photos })
}

/// Estimates cameras into the folder `cameras` of a result, where photos may be held out, and returns the capture.
///
/// # Errors
/// As [`estimated`].
pub fn estimated_capture(
    photos: &Photos,
    hold_out: HoldOut,
    flags: MatchingFlags,
    out: &OutputFolder,
    console: &mut Console,
) -> Result<PathBuf, Failure> {
    let step = match hold_out {
        HoldOut::Nothing => usize::MAX,
        HoldOut::Listed => HOLD_OUT,
        HoldOut::Every(step) => step,
    };
    let located: Vec<bool> = (0..photos.paths.len()).map(|i| step < usize::MAX && i % step == 0).collect();
    let folder = cameras_folder(out, &photos.paths)?;
    estimated(photos, &located, flags, &folder, console)?;
    photos.settle(out)?;
    Ok(folder.path().join("transforms.json"))
}

/// Minutes that are the fit's of those of a command that began at `start` and has estimated cameras since.
pub fn minutes_of_fit(minutes: f64, start: Instant) -> f64 {
    (minutes - start.elapsed().as_secs_f64() / 60.0).max(SHARE * minutes).max(SHORTEST)
}

/// Says where cameras took so much of the time that the fit exceeds it.
pub fn note_share(minutes: f64, start: Instant, console: &mut Console) {
    let (spent, fit) = (start.elapsed().as_secs_f64(), 60.0 * minutes_of_fit(minutes, start));
    if spent + fit > 60.0 * minutes + 0.5 {
        console.note(&format!("cameras took {spent:.0} s; the fit gets {fit:.0} s all the same"));
    }
}

/// The folder `cameras` of a result, a capture of its own.
pub fn cameras_folder(out: &OutputFolder, photos: &[PathBuf]) -> Result<OutputFolder, Failure> {
    Ok(OutputFolder::claim(out.path().join("cameras"), COMMAND, photos)?)
}

fn sureness(found: &EstimatedPhotos) -> String {
    match found.doubt() {
        Some(Doubt { what, help }) => format!("doubtful: {what}; {help}"),
        None => "good: nothing speaks against them".into(),
    }
}

fn explained(reason: LeftOut) -> &'static str {
    match reason {
        LeftOut::Textureless => "nothing in them to find again: no texture, or blurred",
        LeftOut::Unmatched => "nothing in common with the other photos; photos between would help",
        LeftOut::OnePlace => {
            "taken from the place of others, so that nothing tells how far anything is away; step aside between photos"
        }
        LeftOut::Unplaced => "too little in common with the others, or another place; photos between would help",
    }
}

/// Why there are no cameras.
fn refusal(found: &EstimatedPhotos) -> String {
    let left_out = found.left_out();
    match left_out.as_slice() {
        [] => "expected at least two photos, found none".into(),
        [_] => "expected at least two photos that overlap, found one: nothing tells how far anything is away".into(),
        _ if 2 * of_one_place(&left_out).len() > left_out.len() => format!(
            "expected photos from several places, found {} taken from the place of others, by turning or not at all: nothing tells how far anything is away; step aside between photos",
            listed(&of_one_place(&left_out))
        ),
        [(_, first), ..] if left_out.iter().all(|(_, reason)| reason == first) => {
            let names: Vec<String> = left_out.iter().map(|(path, _)| path.display().to_string()).collect();
            format!("expected photos that overlap, found none of {}: {}", listed(&names), explained(*first))
        }
        _ => {
            let each = left_out.iter().take(NAMED).map(|(path, r)| format!("{}: {}", path.display(), explained(*r)));
            format!("expected photos that overlap, found none; {}", each.collect::<Vec<_>>().join("; "))
        }
    }
}

/// Names of the photos that were taken from the place of others.
fn of_one_place(left_out: &[(&Path, LeftOut)]) -> Vec<String> {
    let those = left_out.iter().filter(|(_, reason)| *reason == LeftOut::OnePlace);
    those.map(|(path, _)| path.display().to_string()).collect()
}

fn listed(names: &[String]) -> String {
    let shown = names[..names.len().min(NAMED)].join(", ");
    if names.len() > NAMED { format!("{shown} and {} more", names.len() - NAMED) } else { shown }
}

/// Compares estimated cameras with others.
pub fn compared(found: &EstimatedPhotos, file: &Path) -> Result<String, Failure> {
    let placed = found.placed();
    let truth = weaver_data::capture::load_camera_files(file, &placed)?;
    let estimated: Vec<Camera> = found.estimate.cameras.iter().flatten().copied().collect();
    let poses = |cameras: &[Camera]| -> Vec<Pose> { cameras.iter().map(|c| c.pose).collect() };
    let (from, to) = (poses(&estimated), poses(&truth));
    let onto = aligned(&from, &to).ok_or_else(|| {
        Failure::message(format!("{}: expected cameras in several places, found one", file.display()))
    })?;
    let middle = to.iter().map(Pose::center).sum::<DVec3>() / to.len() as f64;
    let spread = to.iter().map(|p| p.center().distance(middle)).sum::<f64>() / to.len() as f64;
    let moved: Vec<Pose> = from.iter().map(|p| onto.apply_to_pose(p)).collect();
    let both = || moved.iter().zip(&to);
    let mut turned: Vec<f64> = both().map(|(a, b)| a.angle_to(b).to_degrees()).collect();
    let elsewhere = placed.iter().zip(&turned).filter(|(_, degrees)| **degrees > ELSEWHERE);
    let elsewhere: Vec<String> = elsewhere.map(|(path, _)| path.display().to_string()).collect();
    let mut off: Vec<f64> = both().map(|(a, b)| 100.0 * a.center().distance(b.center()) / spread).collect();
    let focal = |c: &Camera| c.intrinsics.fx / c.width as f64;
    let mut longer: Vec<f64> = estimated.iter().zip(&truth).map(|(a, b)| 100.0 * (focal(a) / focal(b) - 1.0)).collect();
    let median = |values: &mut Vec<f64>| {
        values.sort_by(f64::total_cmp);
        (values[values.len() / 2], values[values.len() - 1])
    };
    let ((turn, most_turn), (shift, most_shift)) = (median(&mut turned), median(&mut off));
    let named = match elsewhere.as_slice() {
        [] => String::new(),
        names => format!("; more than {ELSEWHERE} degrees apart: {}", listed(names)),
    };
    Ok(format!(
        "beside {}: {} of {} photos; rotation {turn:.3} degrees in the median, {most_turn:.2} at most; center {shift:.2} % of the cameras' spread, {most_shift:.1} at most; focal length {:+.2} %{named}",
        file.display(),
        placed.len(),
        found.paths.len(),
        median(&mut longer).0
    ))
}

/// The similarity that takes cameras to others, by those that are not far off: either side may have some that are wrong.
fn aligned(from: &[Pose], to: &[Pose]) -> Option<Similarity> {
    let mut kept: Vec<usize> = (0..from.len()).collect();
    let mut onto = None;
    for _ in 0..ROUNDS {
        let [a, b] = [from, to].map(|all| kept.iter().map(|i| all[*i]).collect::<Vec<Pose>>());
        let fitted = Similarity::fit_poses(&a, &b)?;
        let off = |i: usize| fitted.apply_to_pose(&from[i]).center().distance(to[i].center());
        let mut all: Vec<f64> = (0..from.len()).map(off).collect();
        all.sort_by(f64::total_cmp);
        let most = 5.0 * all[all.len() / 2];
        kept = (0..from.len()).filter(|i| off(*i) <= most).collect();
        onto = Some(fitted);
    }
    onto
}
