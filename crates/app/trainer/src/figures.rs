//! Results of an evaluation, as JSON and as a table.

mod align;

pub(crate) use align::areas;
pub use align::{AlignedFigures, CameraFigures};
use serde::{Deserialize, Serialize};
use std::fmt::Write;

/// The figures of one scene, or their mean over scenes. `None` where a figure does not apply.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SceneFigures {
    /// The scene's name.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub name: Option<String>,
    /// Held-out views.
    pub views: usize,
    /// PSNR, dB.
    pub psnr: f64,
    /// With estimated cameras, PSNR where the held-out view's camera has the capture's own scale and lens; `psnr` has
    /// the scale of the estimated cameras' spread, and their lens.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub psnr_strict: Option<f64>,
    /// PSNR over the quarter of each view's pixels with most wavelet energy, dB.
    pub psnr_energetic: f64,
    /// Structural similarity.
    pub ssim: f64,
    /// LPIPS, when its weights are given.
    pub lpips: Option<f64>,
    /// PSNR of the nearest context view, copied.
    pub psnr_nearest: f64,
    /// PSNR of the mean color of the scene's training views.
    pub psnr_mean_color: f64,
    /// Gaussians over context pixels.
    pub gaussians_per_pixel: f64,
    /// Fraction of context pixels that went to each expert, E_0 first.
    pub expert_share: Vec<f64>,
    /// Mean angle of the context cameras' rotations relative to camera 0, degrees.
    pub pose_rotation_deg: Option<f64>,
    /// Mean angle between predicted and true direction of the centers from camera 0, degrees.
    pub pose_translation_deg: Option<f64>,
    /// Area under the recall curve of the larger of the two up to 5, 10 and 20 degrees, from 0 to 1.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub pose_auc: Option<[f64; 3]>,
    /// The same views from cameras aligned with the held-out photos, if the options align.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub aligned: Option<AlignedFigures>,
    /// Figures of the light that views were drawn in, if one was chosen.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub look: Option<LookFigures>,
}

/// Quality of the light of held-out views, or the mean of that.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LookFigures {
    /// PSNR after the best gain and offset of each channel, which measures structure alone, dB.
    pub psnr_fitted: f64,
    /// |difference of the mean color|, mean over channels.
    pub color_error: f64,
    /// Of planted looks: the slope of log(mean of the render in one light / in another) by log(mean of the photo in the
    /// one / in the other), over a scene's views, red, green and blue.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub slope: Option<[f64; 3]>,
    /// The correlation of the two.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub correlation: Option<[f64; 3]>,
}

impl LookFigures {
    fn mean_of(all: &[Self]) -> Option<Self> {
        let of = |f: &dyn Fn(&Self) -> Option<f64>| mean(all.iter().map(f));
        Some(Self {
            psnr_fitted: of(&|s| Some(s.psnr_fitted))?,
            color_error: of(&|s| Some(s.color_error))?,
            slope: mean_of_three(all.iter().map(|s| s.slope)),
            correlation: mean_of_three(all.iter().map(|s| s.correlation)),
        })
    }
}

/// An evaluation on the held-out views of some scenes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// Source of the cameras: predicted, given or estimated.
    pub cameras: String,
    /// True if depth was brought to the scenes' points.
    #[serde(skip_serializing_if = "std::ops::Not::not", default)]
    pub points: bool,
    /// Which pixels got Gaussians, for models with a choice.
    pub allocation: Option<String>,
    /// The budget of Gaussians per context pixel, if the allocation has one.
    pub budget: Option<f64>,
    /// The choice of light for held-out views, if there was one; all figures are then of the views' right halves.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub look: Option<String>,
    /// Context views for each held-out view.
    pub context_views: usize,
    /// Seed of the run, and of sampled allocations.
    pub seed: u64,
    /// Steps that the weights were trained for.
    pub step: usize,
    /// The scenes.
    pub scenes: Vec<SceneFigures>,
    /// Unweighted mean over scenes; views are summed.
    pub mean: SceneFigures,
    /// Notes for the reader.
    #[serde(skip)]
    pub remarks: Vec<String>,
}

/// The mean of the values that are present; `None` when none is.
pub(crate) fn mean(values: impl IntoIterator<Item = Option<f64>>) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0usize);
    for value in values.into_iter().flatten() {
        sum += value;
        count += 1;
    }
    (count > 0).then(|| sum / count as f64)
}

/// The means of three values that are present together.
fn mean_of_three(all: impl Iterator<Item = Option<[f64; 3]>> + Clone) -> Option<[f64; 3]> {
    let [a, b, c] = [0, 1, 2].map(|i| mean(all.clone().map(|three| Some(three?[i]))));
    Some([a?, b?, c?])
}

impl SceneFigures {
    /// The unweighted mean of some figures; views are summed, or, when these are single views, counted.
    pub fn mean_of(all: &[Self], name: Option<String>) -> Self {
        let of = |f: fn(&Self) -> f64| mean(all.iter().map(|s| Some(f(s)))).unwrap_or(f64::NAN);
        let experts = all.first().map_or(0, |s| s.expert_share.len());
        Self {
            name,
            views: all.iter().map(|s| s.views).sum(),
            psnr: of(|s| s.psnr),
            psnr_strict: mean(all.iter().map(|s| s.psnr_strict)),
            psnr_energetic: of(|s| s.psnr_energetic),
            ssim: of(|s| s.ssim),
            lpips: mean(all.iter().map(|s| s.lpips)),
            psnr_nearest: of(|s| s.psnr_nearest),
            psnr_mean_color: of(|s| s.psnr_mean_color),
            gaussians_per_pixel: of(|s| s.gaussians_per_pixel),
            expert_share: (0..experts)
                .map(|e| all.iter().map(|s| s.expert_share[e]).sum::<f64>() / all.len() as f64)
                .collect(),
            pose_rotation_deg: mean(all.iter().map(|s| s.pose_rotation_deg)),
            pose_translation_deg: mean(all.iter().map(|s| s.pose_translation_deg)),
            pose_auc: mean_of_three(all.iter().map(|s| s.pose_auc)),
            aligned: AlignedFigures::mean_of(&all.iter().filter_map(|s| s.aligned).collect::<Vec<_>>()),
            look: LookFigures::mean_of(&all.iter().filter_map(|s| s.look).collect::<Vec<_>>()),
        }
    }
}

impl Evaluation {
    /// The results as a text table.
    pub fn table(&self) -> String {
        let mut out = String::new();
        let points = if self.points { " with points" } else { "" };
        let allocation = self.allocation.as_ref().map_or(String::new(), |a| format!(", allocation {a}"));
        let budget = self.budget.map_or(String::new(), |b| format!(", budget {b:.2}"));
        let _ = writeln!(
            out,
            "cameras {}{points}{allocation}{budget}, {} context views, step {}",
            self.cameras, self.context_views, self.step
        );
        let _ = writeln!(
            out,
            "{:<16} {:>5} {:>7} {:>7} {:>6} {:>6} {:>8} {:>7} {:>6} {:>7} {:>7}  expert share",
            "scene", "views", "PSNR", "energ.", "SSIM", "LPIPS", "nearest", "mean c.", "G/px", "rot deg", "tr deg"
        );
        for scene in self.scenes.iter().chain([&self.mean]) {
            let optional = |v: Option<f64>, digits: usize| v.map_or("-".into(), |v| format!("{v:.digits$}"));
            let shares: Vec<String> = scene.expert_share.iter().map(|s| format!("{s:.2}")).collect();
            let _ = writeln!(
                out,
                "{:<16} {:>5} {:>7.2} {:>7.2} {:>6.3} {:>6} {:>8.2} {:>7.2} {:>6.3} {:>7} {:>7}  {}",
                scene.name.as_deref().unwrap_or("mean"),
                scene.views,
                scene.psnr,
                scene.psnr_energetic,
                scene.ssim,
                optional(scene.lpips, 3),
                scene.psnr_nearest,
                scene.psnr_mean_color,
                scene.gaussians_per_pixel,
                optional(scene.pose_rotation_deg, 2),
                optional(scene.pose_translation_deg, 2),
                shares.join(" ")
            );
        }
        let strict: Vec<String> = (self.scenes.iter().chain([&self.mean]))
            .filter_map(|s| Some(format!("{} {:.2}", s.name.as_deref().unwrap_or("mean"), s.psnr_strict?)))
            .collect();
        if !strict.is_empty() {
            let _ = writeln!(out, "PSNR with the held-out camera's own scale and lens: {}", strict.join(", "));
        }
        if let Some([a, b, c]) = self.mean.pose_auc {
            let _ = writeln!(out, "context cameras, area under the curve at 5, 10, 20 degrees: {a:.2} {b:.2} {c:.2}");
        }
        out += &align::table(self);
        out += &self.look_table();
        for remark in &self.remarks {
            let _ = writeln!(out, "note: {remark}");
        }
        out
    }

    /// The figures of light; empty where none was chosen.
    fn look_table(&self) -> String {
        let mut out = String::new();
        let Some(which) = &self.look else { return out };
        let _ = writeln!(
            out,
            "\nlight: {which}; all figures are of the right half of each held-out view\n{:<16} {:>7} {:>15} {:>9} {:>20} {:>20}",
            "scene", "PSNR", "gain and offset", "color off", "slope r g b", "correlation r g b"
        );
        for scene in self.scenes.iter().chain([&self.mean]) {
            let Some(look) = &scene.look else { continue };
            let channels =
                |all: Option<[f64; 3]>| all.map_or("-".into(), |all| all.map(|x| format!("{x:.2}")).join(" "));
            let _ = writeln!(
                out,
                "{:<16} {:>7.2} {:>15.2} {:>9.4} {:>20} {:>20}",
                scene.name.as_deref().unwrap_or("mean"),
                scene.psnr,
                look.psnr_fitted,
                look.color_error,
                channels(look.slope),
                channels(look.correlation)
            );
        }
        out
    }
}

/// Evaluations of several runs on the same views, one row each: the means over scenes, then PSNR scene by scene.
///
/// ```
/// use weaver_trainer::{Evaluation, comparison};
/// let text = comparison(&[("runs/a".into(), Evaluation::default()), ("runs/b".into(), Evaluation::default())]);
/// assert_eq!(text.lines().filter(|line| line.starts_with("runs/")).count(), 2);
/// ```
pub fn comparison(all: &[(String, Evaluation)]) -> String {
    let mut out = String::new();
    let Some((_, first)) = all.first() else { return out };
    let width = all.iter().map(|(name, _)| name.len()).max().unwrap_or(0).max(16);
    let _ =
        writeln!(out, "cameras {}, {} context views, {} views", first.cameras, first.context_views, first.mean.views);
    let heads = ["PSNR", "energ.", "SSIM", "LPIPS", "G/px", "rot deg", "tr deg"].into_iter().map(String::from);
    let names = first.scenes.iter().map(|scene| scene.name.clone().unwrap_or_default());
    let row = |out: &mut String, name: &str, cells: &mut dyn Iterator<Item = String>| {
        let _ = write!(out, "{name:<width$}");
        cells.for_each(|cell| {
            let _ = write!(out, " {cell:>8}");
        });
        out.push('\n');
    };
    row(&mut out, "run", &mut heads.chain(names));
    for (name, Evaluation { mean, scenes, .. }) in all {
        let optional = |v: Option<f64>, digits: usize| v.map_or("-".into(), |v| format!("{v:.digits$}"));
        let figures = [
            format!("{:.2}", mean.psnr),
            format!("{:.2}", mean.psnr_energetic),
            format!("{:.3}", mean.ssim),
            optional(mean.lpips, 3),
            format!("{:.3}", mean.gaussians_per_pixel),
            optional(mean.pose_rotation_deg, 2),
            optional(mean.pose_translation_deg, 2),
        ];
        row(&mut out, name, &mut figures.into_iter().chain(scenes.iter().map(|scene| format!("{:.2}", scene.psnr))));
    }
    row(
        &mut out,
        "nearest photo",
        &mut [format!("{:.2}", first.mean.psnr_nearest)].into_iter().chain(
            ["-"; 6].map(String::from).into_iter().chain(first.scenes.iter().map(|s| format!("{:.2}", s.psnr_nearest))),
        ),
    );
    for remark in all.iter().flat_map(|(_, evaluation)| &evaluation.remarks) {
        let _ = writeln!(out, "note: {remark}");
    }
    out
}

/// The outcome of a training run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// The preset.
    pub preset: String,
    /// The seed.
    pub seed: u64,
    /// Steps done.
    pub steps: usize,
    /// Steps planned.
    pub planned: usize,
    /// Trainable numbers.
    pub parameters: usize,
    /// Seconds of training in the last session.
    pub seconds: f64,
    /// A checksum of the parameters: equal runs have equal ones.
    pub checksum: String,
    /// The evaluation at the end, when the run was finished.
    pub evaluation: Option<Evaluation>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_unweighted_and_views_summed() {
        let a = SceneFigures { views: 2, psnr: 20.0, expert_share: vec![0.5, 0.5], ..SceneFigures::default() };
        let b = SceneFigures {
            views: 4,
            psnr: 10.0,
            lpips: Some(0.3),
            expert_share: vec![1.0, 0.0],
            ..SceneFigures::default()
        };
        let m = SceneFigures::mean_of(&[a, b], None);
        assert_eq!((m.views, m.psnr, m.lpips, m.expert_share), (6, 15.0, Some(0.3), vec![0.75, 0.25]));
        assert_eq!(m.pose_rotation_deg, None);
    }

    #[test]
    fn json_has_the_documented_keys() {
        let text = serde_json::to_value(Evaluation {
            scenes: vec![SceneFigures { name: Some("fox".into()), ..SceneFigures::default() }],
            ..Evaluation::default()
        })
        .unwrap();
        for key in ["cameras", "allocation", "budget", "context_views", "seed", "step", "scenes", "mean"] {
            assert!(text.get(key).is_some(), "{key}");
        }
        let scene = &text["scenes"][0];
        assert_eq!(scene["name"], "fox");
        assert!(scene["pose_rotation_deg"].is_null() && scene.get("lpips").is_some());
    }
}
