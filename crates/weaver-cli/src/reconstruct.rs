//! `splatweaver reconstruct`.

use crate::arguments::{Command, CommandLine, Reconstruct};
use crate::estimate::{estimated_capture, photos};
use crate::failure::Failure;
use crate::{Console, Interrupt, fit};
use clap::Parser;
use std::path::Path;
use std::time::Instant;

/// The shortest time that `fit` takes, minutes.
const SHORTEST: f64 = 0.05;
/// The least share of the time that is the fit's, whatever matching took.
const SHARE: f64 = 0.5;
/// The least steps of a fit, whatever the time: fewer make nothing worth seeing.
const LEAST_STEPS: u32 = 200;

pub fn run(arguments: &Reconstruct, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    let start = Instant::now();
    let out = &arguments.out;
    let capture = match arguments.photos.as_slice() {
        [one] if is_capture(one) => {
            arguments.matching.check_unused("a capture with cameras of its own")?;
            console.note(&format!("cameras: those of {}", one.display()));
            one.clone()
        }
        paths => estimated_capture(&photos(paths)?, arguments.hold_out, arguments.matching, out, console)?,
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
    let text = |x: &Path| x.to_string_lossy().into_owned();
    let mut words = ["splatweaver", "fit"].map(String::from).to_vec();
    words.extend([text(&capture), "--out".into(), text(out), "--minutes".into(), format!("{minutes:.3}")]);
    words.extend(["--least-steps".into(), LEAST_STEPS.to_string()]);
    words.extend(["--size".into(), size.to_string(), "--seed".into(), arguments.seed.to_string()]);
    words.extend(arguments.gaussians.into_iter().flat_map(|n| ["--gaussians".into(), n.to_string()]));
    words.extend((!arguments.hold_out).then(|| "--all".into()));
    console.note(&words.join(" "));
    let Command::Fit(fitting) = CommandLine::try_parse_from(words)?.command else { unreachable!("words of a fit") };
    fit::run(&fitting, console, interrupt)
}

/// Whether a folder or file tells its cameras.
fn is_capture(path: &Path) -> bool {
    let files = ["transforms.json", "transforms_train.json", "sparse", "cameras.txt"];
    path.is_file() && path.extension().is_some_and(|e| e == "json") || files.iter().any(|name| path.join(name).exists())
}
