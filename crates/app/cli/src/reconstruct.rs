//! `splatweaver reconstruct`.

use crate::arguments::Reconstruct;
use crate::estimate::estimated_capture;
use crate::{Console, Interrupt, clip, fit};
use std::path::Path;
use std::time::Instant;
use weaver_command::Failure;
use weaver_fit::FitSettings;
use weaver_fit_run::{Outcome, Run, RunError, RunSettings, plan};

/// The shortest time that `fit` takes, minutes.
const SHORTEST: f64 = 0.05;
/// The least share of the time that is the fit's, whatever matching took.
const SHARE: f64 = 0.5;
/// The least steps of a fit, whatever the time: fewer make nothing worth seeing.
const LEAST_STEPS: usize = 200;

pub fn run(arguments: &Reconstruct, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    let start = Instant::now();
    let out = match Run::claim(&arguments.out, &arguments.photos) {
        Err(RunError::Run(weaver_run::Error::RunExists { folder })) => return Err(exists(&folder)),
        claimed => claimed?,
    };
    let (capture, hold_out) = match arguments.photos.as_slice() {
        [one] if is_capture(one) => {
            arguments.matching.check_unused("a capture with cameras of its own")?;
            arguments.clip.check_unused("a capture with cameras of its own")?;
            console.note(&format!("cameras: those of {}", one.display()));
            (one.clone(), arguments.hold_out)
        }
        paths => {
            let photos = clip::photos(paths, arguments.clip, out.out(), console)?;
            let capture = estimated_capture(&photos, arguments.hold_out, arguments.matching, out.out(), console)?;
            (capture, fit::listed(arguments.hold_out))
        }
    };
    let (minutes, size) = arguments.quality.effort();
    let spent = start.elapsed().as_secs_f64() / 60.0;
    let minutes = arguments.minutes.unwrap_or(minutes);
    let (left, least) = (minutes - spent, (SHARE * minutes).max(SHORTEST));
    if left < least {
        let [spent, more] = [spent, least].map(|minutes| 60.0 * minutes);
        console.note(&format!("cameras took {spent:.0} s; the fit gets {more:.0} s all the same"));
    }
    let minutes = left.max(least);
    let mut settings = RunSettings {
        minutes: Some(minutes),
        least_steps: LEAST_STEPS,
        long_side: Some(size as usize),
        hold_out,
        measure_exposure: true,
        ..RunSettings::new(capture, FitSettings::default())
    };
    let usual = plan(&settings)?.usual();
    let gaussians = arguments.gaussians.map_or(usual.gaussians, |gaussians| gaussians as usize);
    settings.fit = FitSettings { gaussians, seed: arguments.seed, ..usual };
    settings.fit.check()?;
    let capture = settings.capture.display();
    console.note(&format!("fit: {capture}, {minutes:.2} minutes, photos of at most {size} pixels"));
    fit::begin(settings, fit::Means::usual()?, out, console, interrupt)
}

/// Why nothing is made in a folder with a run, and how to go on with one that did not come to its end.
fn exists(folder: &Path) -> Failure {
    let path = folder.display();
    let outcome = weaver_io::read_text(folder.join("summary.json")).ok();
    let outcome = outcome.and_then(|text| serde_json::from_str::<Outcome>(&text).ok());
    Failure::Usage(if outcome.is_some_and(|outcome| outcome.steps >= outcome.planned) {
        format!("{path}: a finished scene is there already; give another --out")
    } else {
        format!("{path}: a fit was begun there and did not come to its end; to go on: splatweaver fit --resume {path}")
    })
}

/// Whether a folder or file tells its cameras.
fn is_capture(path: &Path) -> bool {
    let files = ["transforms.json", "transforms_train.json", "sparse", "cameras.txt"];
    path.is_file() && path.extension().is_some_and(|e| e == "json") || files.iter().any(|name| path.join(name).exists())
}
