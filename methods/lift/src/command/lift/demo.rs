//! `splatweaver lift --demo`: the solvers on built-in scenes, with known truth.

mod figures;
mod gaussians;
mod noise;
mod pictures;
mod stage;

use crate::command::arguments::{DemoGaussians, Lift};
use figures::{COLUMNS, Figures, LAMBDA};
use noise::{BOUNDS, Noise};
use stage::{Size, Source, Stage};
use std::fmt::Write;
use weaver_command::{Console, Failure, Progress};
use weaver_inference::{OutputFolder, Predictor, RunFolder, SplatWeaverPredictor};
use weaver_trainer::Registry;
use weaver_two_experts::TwoExpertsRecipe;
use weaver_wild::WildRecipe;

/// Figures of one scene.
struct Outcome {
    figures: Figures,
    noise: Noise,
}

/// Prints the table of some seeds, and writes the pictures of the first into `--out`.
pub fn run(arguments: &Lift, console: &mut Console) -> Result<(), Failure> {
    let Lift { demo: seeds, out, .. } = arguments;
    let claimed = out.as_ref().map(|out| OutputFolder::claim(out, "lift --demo", &arguments.run)).transpose()?;
    claimed.as_ref().map_or(Ok(()), |out| out.check(pictures::NAMES))?;
    let mut source = source(arguments)?;
    let mut progress = Progress::new("lift", 0, seeds.len(), console);
    let mut outcomes = Vec::new();
    for &seed in seeds {
        let stage = Stage::new(seed, Size::DEMO, &mut source)?;
        let figures = Figures::of(&stage, arguments.least_alpha)?;
        let noise = Noise::of(&stage, seed)?;
        if let (Some(out), true) = (&claimed, outcomes.is_empty()) {
            pictures::write(&stage, &noise, out)?;
        }
        outcomes.push(Outcome { figures, noise });
        progress.at(outcomes.len(), seeds.len(), String::new, console);
    }
    progress.finish();
    let all: Vec<&Figures> = outcomes.iter().map(|outcome| &outcome.figures).collect();
    let mut text = table(&Figures::mean(&all));
    let _ = writeln!(text, "\n{}\n", coverage(&all));
    text += &claims(&all);
    let noises: Vec<&Noise> = outcomes.iter().map(|outcome| &outcome.noise).collect();
    text += &rejection(&noises);
    if let Some(out) = out {
        let _ = writeln!(text, "pictures of seed {}: {}", seeds[0], out.display());
    }
    console.print(text.trim_end())
}

fn source(arguments: &Lift) -> Result<Source, Failure> {
    match (arguments.demo_gaussians, &arguments.run) {
        (DemoGaussians::Predicted, Some(run)) => {
            let folder = RunFolder::at(run);
            let models = Registry::default().with::<TwoExpertsRecipe>().with::<WildRecipe>();
            Ok(Source::Predicted(models.of_run(&folder)?.open(&folder)?.predictor))
        }
        (DemoGaussians::Predicted, None) => {
            let predictor: Box<dyn Predictor> = Box::new(SplatWeaverPredictor::built_in()?);
            Ok(Source::Predicted(predictor))
        }
        (_, Some(_)) => Err(Failure::Usage("--run: expected --demo-gaussians predicted with it".into())),
        (DemoGaussians::Surface, None) => Ok(Source::Surface),
        (DemoGaussians::Fitted, None) => Ok(Source::Fitted),
    }
}

fn table(mean: &Figures) -> String {
    let mut text = format!("{:<44}", "");
    COLUMNS.iter().for_each(|column| text += &format!(" {column:>11}"));
    let rows = [
        ("planted features: splats labeled right", mean.planted),
        ("ids of the ray caster: held-out mIoU", mean.held_out),
        ("ids of the ray caster: splats labeled right", mean.splats),
        ("ids of the ray caster: mIoU of the splats", mean.splats_iou),
        ("ids of the ray caster: |AX - B|^2 / |B|^2", mean.loss),
        ("milliseconds a view and channel", mean.milliseconds),
    ];
    for (name, values) in rows {
        let _ = write!(text, "\n{name:<44}");
        for value in values {
            let shown = if value.is_nan() { "-".into() } else { format!("{value:.3}") };
            let _ = write!(text, " {shown:>11}");
        }
    }
    text
}

fn coverage(all: &[&Figures]) -> String {
    let mean = Figures::mean(all);
    let [splats, ids, unseen] = mean.counts;
    let [alpha, off_diagonal, held_out] = mean.guided;
    format!(
        "{} scenes, {splats:.0} splats, {ids:.1} ids, unseen {unseen:.1}; mean alpha {:.3}, share off the diagonal {:.3}\n\
         with opacities guided by lambda {LAMBDA}: {alpha:.3}, {off_diagonal:.3}; held-out mIoU of row-sum {held_out:.3}",
        all.len(),
        mean.mean_alpha,
        mean.off_diagonal,
    )
}

/// Figures of each claim.
fn claims(all: &[&Figures]) -> String {
    let scenes = all.len();
    let count = |holds: &dyn Fn(&Figures) -> bool| all.iter().filter(|figures| holds(figures)).count();
    let between = |of: fn(&Figures) -> &[f64; 5], from: usize, to: usize| {
        let differences: Vec<f64> = all.iter().map(|figures| of(figures)[to] - of(figures)[from]).collect();
        format!("  {} to {}: {}", COLUMNS[from], COLUMNS[to], paired(&differences))
    };
    let mut lines = vec![
        "1 planted: splats labeled right".to_string(),
        between(|f| &f.planted, 0, 1),
        between(|f| &f.planted, 1, 3),
        between(|f| &f.planted, 3, 4),
        format!("  {}: at least .98 in {} of {scenes}", COLUMNS[3], count(&|f| f.planted[3] >= 0.98)),
        format!("  converged: {:.5}", Figures::mean(all).converged),
        "2 ids of the ray caster: held-out mIoU".into(),
    ];
    lines.extend((1..COLUMNS.len()).map(|to| between(|f| &f.held_out, to - 1, to)));
    lines.extend([
        between(|f| &f.held_out, 1, 3),
        "3 ids of the ray caster: splats labeled right".into(),
        between(|f| &f.splats, 3, 4),
    ]);
    lines.join("\n") + "\n"
}

/// The mean of differences, its standard error, and the number above zero.
fn paired(differences: &[f64]) -> String {
    let count = differences.len() as f64;
    let mean = differences.iter().sum::<f64>() / count;
    let squares: f64 = differences.iter().map(|x| (x - mean) * (x - mean)).sum();
    let above = differences.iter().filter(|x| **x > 0.0).count();
    let error = if differences.len() > 1 {
        format!(" (standard error {:.4})", (squares / (count - 1.0) / count).sqrt())
    } else {
        String::new()
    };
    format!("{mean:+.4}{error}, up in {above} of {}", differences.len())
}

/// Effect of aggregation on wrong masks, for each bound on their overlap with a cluster.
fn rejection(noises: &[&Noise]) -> String {
    let scenes = noises.len();
    let mean = |of: &dyn Fn(&Noise) -> f64| noises.iter().map(|noise| of(noise)).sum::<f64>() / scenes.max(1) as f64;
    let mut text = format!(
        "4 masks of two things: {:.1} of {:.1}; cosine of their splats to their own feature {:.3}\n",
        mean(&|noise| noise.wrong.iter().filter(|wrong| **wrong).count() as f64),
        mean(&|noise| noise.wrong.len() as f64),
        mean(&|noise| noise.lifted)
    );
    let _ = writeln!(text, "  overlap above  recall  precision  cosine  above .99 in  as many rejected by chance");
    for (i, bound) in BOUNDS.into_iter().enumerate() {
        let _ = writeln!(
            text,
            "  {bound:<13} {:>7.2} {:>10.2} {:>7.4} {:>13} {:>27.4}",
            mean(&|noise| noise.cleaned[i].recall),
            mean(&|noise| noise.cleaned[i].precision),
            mean(&|noise| noise.cleaned[i].cosine),
            format!("{} of {scenes}", noises.iter().filter(|noise| noise.cleaned[i].cosine > 0.99).count()),
            mean(&|noise| noise.cleaned[i].by_chance)
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_procedural::ProceduralOptions;

    /// The claims hold on the smallest scene of a test.
    #[test]
    fn a_scene_shows_what_is_claimed() {
        let photos = ProceduralOptions { width: 48, height: 36, views: 8 };
        let stage = Stage::new(1000, Size { photos, step: 2 }, &mut Source::Surface).unwrap();
        let figures = Figures::of(&stage, 0.5).unwrap();
        let Figures { planted, held_out, .. } = figures;
        assert!(planted[4] > planted[1] && planted[1] > planted[0], "{planted:?}");
        assert!(held_out[4] > held_out[1] && held_out[1] > held_out[0], "{held_out:?}");
        let noise = Noise::of(&stage, 1000).unwrap();
        // The number of right masks among the rejected ones is not checked here.
        assert!(noise.cleaned[0].recall == 1.0 && noise.wrong.contains(&true), "{:?}", noise.wrong);
    }
}
