//! Figures from held-out cameras that were aligned with their photos.

use super::{Evaluation, mean, mean_of_three};
use serde::{Deserialize, Serialize};
use std::fmt::Write;
use weaver_pose::{PoseErrors, auc};

/// Degrees up to which areas under the recall curve are taken.
const UP_TO: [f64; 3] = [5.0, 10.0, 20.0];

/// Figures of views whose cameras were aligned with the held-out photos, or their mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AlignedFigures {
    /// PSNR, dB.
    pub psnr: f64,
    /// Structural similarity.
    pub ssim: f64,
    /// LPIPS, when its weights are given.
    pub lpips: Option<f64>,
    /// Gain by alignment with given cameras, dB, where the camera is right: six numbers fitted to the photo.
    pub gain_given: f64,
    /// PSNR after alignment with a photo of another scene, one view of each scene, and PSNR of this photo's mean color,
    /// dB: a control, since a scene must not match an unrelated photo.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub elsewhere: Option<[f64; 2]>,
    /// Turn of the cameras, degrees.
    pub degrees: f64,
    /// Movement of the cameras, in parts of the mean depth that they see.
    pub distance: f64,
    /// Steps of the descent.
    pub steps: f64,
    /// Share of views for which anything better than the guess was found.
    pub found: f64,
    /// Share of views whose PSNR rose.
    pub better: f64,
    /// Errors of the held-out cameras before and after.
    pub cameras: [CameraFigures; 2],
}

/// Errors of held-out cameras relative to each camera of their context, against the data's: alignment worked only where
/// these fall as well.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CameraFigures {
    /// Mean angle of rotations, degrees.
    pub rotation_deg: f64,
    /// Mean angle between directions of centers, degrees; `None` where no center is elsewhere.
    pub translation_deg: Option<f64>,
    /// Area under the recall curve of the larger of the two up to 5, 10 and 20 degrees, from 0 to 1.
    pub auc: [f64; 3],
}

/// Areas under the recall curve of the larger errors up to 5, 10 and 20 degrees; `None` without errors.
pub(crate) fn areas(errors: &PoseErrors) -> Option<[f64; 3]> {
    let [a, b, c] = UP_TO.map(|degrees| auc(errors.largest(), degrees));
    Some([a?, b?, c?])
}

impl CameraFigures {
    /// The figures of some errors; zeros without any.
    pub(crate) fn of(errors: &PoseErrors) -> Self {
        Self {
            rotation_deg: errors.mean_rotation().unwrap_or(0.0),
            translation_deg: errors.mean_translation(),
            auc: areas(errors).unwrap_or_default(),
        }
    }

    fn mean_of(all: impl Iterator<Item = Self> + Clone) -> Option<Self> {
        Some(Self {
            rotation_deg: mean(all.clone().map(|s| Some(s.rotation_deg)))?,
            translation_deg: mean(all.clone().map(|s| s.translation_deg)),
            auc: mean_of_three(all.map(|s| Some(s.auc)))?,
        })
    }
}

impl AlignedFigures {
    pub(super) fn mean_of(all: &[Self]) -> Option<Self> {
        let of = |f: fn(&Self) -> f64| mean(all.iter().map(|s| Some(f(s))));
        let [before, after] = [0, 1].map(|i| CameraFigures::mean_of(all.iter().map(move |s| s.cameras[i])));
        Some(Self {
            psnr: of(|s| s.psnr)?,
            ssim: of(|s| s.ssim)?,
            lpips: mean(all.iter().map(|s| s.lpips)),
            gain_given: of(|s| s.gain_given)?,
            elsewhere: mean(all.iter().map(|s| s.elsewhere.map(|e| e[0])))
                .zip(mean(all.iter().map(|s| s.elsewhere.map(|e| e[1]))))
                .map(|(aligned, flat)| [aligned, flat]),
            degrees: of(|s| s.degrees)?,
            distance: of(|s| s.distance)?,
            steps: of(|s| s.steps)?,
            found: of(|s| s.found)?,
            better: of(|s| s.better)?,
            cameras: [before?, after?],
        })
    }
}

/// The figures as text; nothing where no camera was aligned.
pub(super) fn table(Evaluation { scenes, mean, .. }: &Evaluation) -> String {
    let mut out = String::new();
    let Some(of_all) = &mean.aligned else { return out };
    let _ = writeln!(
        out,
        "\nheld-out cameras aligned with the held-out photos, which looks at them:\n{:<16} {:>7} {:>7} {:>7} {:>6} {:>11} {:>8} {:>12} {:>7} {:>5}  {:>15} {:>15}",
        "scene",
        "PSNR",
        "aligned",
        "gain",
        "SSIM",
        "gain, given",
        "degrees",
        "of the depth",
        "better",
        "steps",
        "rot deg, after",
        "tr deg, after"
    );
    let two = |[a, b]: [Option<f64>; 2]| match (a, b) {
        (Some(a), Some(b)) => format!("{a:.2}, {b:.2}"),
        _ => "-".into(),
    };
    for scene in scenes.iter().chain([mean]) {
        let Some(aligned) = &scene.aligned else { continue };
        let _ = writeln!(
            out,
            "{:<16} {:>7.2} {:>7.2} {:>+7.2} {:>6.3} {:>+11.2} {:>8.3} {:>12.4} {:>5.0} % {:>5.0}  {:>15} {:>15}",
            scene.name.as_deref().unwrap_or("mean"),
            scene.psnr,
            aligned.psnr,
            aligned.psnr - scene.psnr,
            aligned.ssim,
            aligned.gain_given,
            aligned.degrees,
            aligned.distance,
            100.0 * aligned.better,
            aligned.steps,
            two(aligned.cameras.map(|camera| Some(camera.rotation_deg))),
            two(aligned.cameras.map(|camera| camera.translation_deg))
        );
    }
    let [before, after] = of_all.cameras.map(|camera| camera.auc.map(|area| format!("{area:.2}")).join(" "));
    let _ = writeln!(out, "held-out cameras, area under the curve at 5, 10, 20 degrees: {before}; aligned {after}");
    if let Some([aligned, flat]) = of_all.elsewhere {
        let _ = writeln!(
            out,
            "aligned with a photo of another scene: {aligned:.2} dB, where that photo's mean color is worth {flat:.2}"
        );
    }
    out
}
