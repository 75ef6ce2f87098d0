//! What is known of estimated cameras, for programs to read.

use serde_json::{Map, Value, json};
use weaver_data::{Confidence, EstimatedPhotos, LeftOut};

/// How good cameras are and how exact: what `cameras.json` says.
pub fn summary(found: &EstimatedPhotos) -> Value {
    let e = &found.estimate;
    let mut photos = Map::new();
    for (i, camera) in e.cameras.iter().enumerate() {
        let of = match camera {
            Err(reason) => json!({ "left_out": left_out(*reason) }),
            Ok(camera) => {
                // Photos that are only located have no part in what is known of deviations.
                let told = e.uncertainty.as_ref().filter(|u| u.rotations[i] > 0.0);
                json!({
                    "points": e.seen[i],
                    "focal_length": camera.intrinsics.fx / camera.width.max(camera.height) as f64,
                    "rotation_deviation_degrees": told.map(|u| u.rotations[i].to_degrees()),
                    "center_deviation": told.map(|u| u.centers[i]),
                })
            }
        };
        photos.insert(found.paths[i].display().to_string(), of);
    }
    json!({
        "confidence": confidence(found.confidence()),
        "points": e.points.len(),
        "error_pixels": e.error,
        "focal_length": found.focal(),
        "focal_length_deviation": e.uncertainty.as_ref().map(|u| u.focal * found.focal()),
        "spread_of_centers": e.uncertainty.as_ref().map(|u| u.spread),
        "rival": e.rival,
        "photos": photos,
    })
}

fn confidence(of: Confidence) -> &'static str {
    match of {
        Confidence::Good => "good",
        Confidence::Ambiguous => "doubtful: other cameras explain nearly as much",
        Confidence::Inexact => "doubtful: points are not where photos see them",
        Confidence::Guessed => "doubtful: focal length guessed",
        Confidence::LooseFocal => "doubtful: focal length",
        Confidence::LooseRotation => "doubtful: rotations",
        Confidence::LooseCenter => "doubtful: centers",
        Confidence::None => "none",
    }
}

fn left_out(reason: LeftOut) -> &'static str {
    match reason {
        LeftOut::Textureless => "no texture",
        LeftOut::Unmatched => "nothing in common with others",
        LeftOut::OnePlace => "taken from the place of others",
        LeftOut::Unplaced => "too little in common with others",
    }
}
