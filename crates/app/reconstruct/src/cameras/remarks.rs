//! Remarks about estimated cameras.

use std::path::Path;
use weaver_data::{Doubt, EstimatedPhotos, LeftOut, some_of};
use weaver_geometry::Distortion;
use weaver_io::Observe;

/// Logarithm of the factor on a given focal length from which on the given length counts as wrong.
const WRONG_FOCAL: f64 = 0.1;
/// Factor on the distance of a corner from the axis below which a lens is likely a fisheye.
const BARREL: f64 = 0.8;
/// Photos with a reason each, at most.
const NAMED: usize = 8;

/// Remarks about the lens, the confidence, and the photos that are left out.
pub fn remark(found: &EstimatedPhotos, shared: bool, observe: &mut dyn Observe) {
    let e = &found.estimate;
    if found.lenses() > 1 && shared {
        let lenses = found.lenses();
        observe.note(&format!(
            "cameras: photos of {lenses} proportions or focal lengths, cropped or of several lenses: each has a focal length of its own; --own-focal finds one for every photo"
        ));
    }
    observe.note(&format!("cameras: {}", sureness(found)));
    if let Some(Distortion::Radial { k: [k1, k2, ..], .. }) = e.distortion.iter().flatten().next() {
        observe.note(&format!("cameras: the lens bends lines: radial distortion k1 {k1:+.4}, k2 {k2:+.4}"));
        let corner = found.corner();
        if 1.0 + corner * (k1 + corner * k2) < BARREL {
            observe.note("cameras: it bends them as a fisheye does; --lens fisheye finds k1 to k4 of one");
        }
    }
    if let Some((degrees, [k1, k2, k3, k4])) = found.fisheye() {
        observe.note(&format!(
            "cameras: a fisheye of {degrees:.0} degrees across the longer side: k1 {k1:+.5}, k2 {k2:+.5}, k3 {k3:+.5}, k4 {k4:+.5}"
        ));
    }
    if (e.focal_factor.ln()).abs() > WRONG_FOCAL {
        let percent = 100.0 * (e.focal_factor - 1.0);
        observe.warning(&format!(
            "by what photos show of each other the focal length is {percent:+.0} % off what was told; were photos cropped? --no-exif estimates it"
        ));
    }
    let again: Vec<String> = found.placed_by_second_look().iter().map(|path| path.display().to_string()).collect();
    if !again.is_empty() {
        observe.note(&format!("cameras: placed by a second look with a learned matcher: {}", some_of(&again)));
    }
    for reason in [LeftOut::Textureless, LeftOut::Unmatched, LeftOut::OnePlace, LeftOut::Unplaced] {
        let names: Vec<String> =
            found.left_out().iter().filter(|(_, r)| *r == reason).map(|(path, _)| path.display().to_string()).collect();
        if !names.is_empty() {
            observe.warning(&format!("left out: {}: {}", some_of(&names), explained(reason)));
        }
    }
}

/// Confidence in the cameras, in a line.
pub fn sureness(found: &EstimatedPhotos) -> String {
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
pub fn refusal(found: &EstimatedPhotos) -> String {
    let left_out = found.left_out();
    match left_out.as_slice() {
        [] => "expected at least two photos, found none".into(),
        [_] => "expected at least two photos that overlap, found one: nothing tells how far anything is away".into(),
        _ if 2 * of_one_place(&left_out).len() > left_out.len() => format!(
            "expected photos from several places, found {} taken from the place of others, by turning or not at all: nothing tells how far anything is away; step aside between photos",
            some_of(&of_one_place(&left_out))
        ),
        [(_, first), ..] if left_out.iter().all(|(_, reason)| reason == first) => {
            let names: Vec<String> = left_out.iter().map(|(path, _)| path.display().to_string()).collect();
            format!("expected photos that overlap, found none of {}: {}", some_of(&names), explained(*first))
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
