//! `splatweaver lift --demo`: what the solvers do on built-in scenes, where the truth is known.

mod figures;
mod noise;
mod pictures;
mod stage;

use crate::Console;
use crate::failure::Failure;
use crate::progress::Progress;
use figures::{COLUMNS, Figures};
use noise::Noise;
use stage::{Size, Stage};
use std::fmt::Write;
use std::path::Path;

/// What one scene gives.
struct Outcome {
    figures: Figures,
    noise: Noise,
}

/// Prints the table of some seeds, and writes the pictures of the first into `out`.
pub fn run(seeds: &[u64], out: Option<&Path>, console: &mut Console) -> Result<(), Failure> {
    out.map_or(Ok(()), weaver_io::check_writable)?;
    let mut progress = Progress::new("lift", 0, seeds.len(), console);
    let mut outcomes = Vec::new();
    for &seed in seeds {
        let stage = Stage::of_seed(seed, Size::DEMO);
        let figures = Figures::of(&stage)?;
        let noise = Noise::of(&stage, seed)?;
        if let (Some(out), true) = (out, outcomes.is_empty()) {
            pictures::write(&stage, &noise, out)?;
        }
        outcomes.push(Outcome { figures, noise });
        progress.at(outcomes.len(), seeds.len(), String::new, console);
    }
    progress.finish();
    let all: Vec<&Figures> = outcomes.iter().map(|outcome| &outcome.figures).collect();
    let mut text = table(&Figures::mean(&all));
    let _ = writeln!(text, "\n{}", coverage(&all));
    let noises: Vec<&Noise> = outcomes.iter().map(|outcome| &outcome.noise).collect();
    text += &claims(&all, &noises);
    if let Some(out) = out {
        let _ = writeln!(text, "pictures of seed {}: {}", seeds[0], out.display());
    }
    console.print(text.trim_end())
}

fn table(mean: &Figures) -> String {
    let mut text = format!("{:<44}", "");
    COLUMNS.iter().for_each(|column| text += &format!(" {column:>11}"));
    let rows = [
        ("planted features: splats labeled right", mean.planted),
        ("ids of the ray caster: held-out mIoU", mean.held_out),
        ("ids of the ray caster: splats labeled right", mean.splats),
    ];
    for (name, values) in rows {
        let _ = write!(text, "\n{name:<44}");
        values.iter().for_each(|value| text += &format!(" {value:>11.3}"));
    }
    text
}

fn coverage(all: &[&Figures]) -> String {
    let mean = Figures::mean(all);
    format!(
        "{} scenes, {:.0} splats, {:.1} ids, mean alpha {:.2}, share off the diagonal {:.2}, unseen {:.1}",
        all.len(),
        mean.counts[0],
        mean.counts[1],
        mean.mean_alpha,
        mean.off_diagonal,
        mean.counts[2]
    )
}

/// In how many scenes each claim holds.
fn claims(all: &[&Figures], noises: &[&Noise]) -> String {
    let scenes = all.len();
    let count = |holds: &dyn Fn(&Figures) -> bool| all.iter().filter(|figures| holds(figures)).count();
    let mut text = String::new();
    let five = count(&|f| f.planted[3] >= 0.98);
    let rising = count(&|f| f.planted[1] < f.planted[3] && f.planted[3] <= f.planted[4]);
    let converged = Figures::mean(all).converged;
    let _ = writeln!(
        text,
        "1 planted: exact, 5 at least .98 in {five} of {scenes}; rises from row-sum to exact, 30 in {rising}; converged {converged:.4}"
    );
    let order = |a: usize, b: usize| count(&|f| f.held_out[a] < f.held_out[b]);
    let _ = writeln!(
        text,
        "2 held-out mIoU rises: center mean to row-sum in {} of {scenes}, to squared in {}, to exact, 5 in {}, to exact, 30 in {}",
        order(0, 1),
        order(1, 2),
        order(2, 3),
        order(3, 4)
    );
    let falls = count(&|f| f.splats[4] < f.splats[3]);
    let _ = writeln!(text, "3 splats: exact, 30 labels fewer right than exact, 5 in {falls} of {scenes}");
    let mean = |of: fn(&Noise) -> f64| noises.iter().map(|noise| of(noise)).sum::<f64>() / noises.len().max(1) as f64;
    let _ = writeln!(
        text,
        "4 wrong masks: recall {:.2}, precision {:.2}; cosine lifted {:.3}, aggregated {:.3}, random rejection {:.3}; above .99 in {} of {scenes}",
        mean(|noise| noise.recall),
        mean(|noise| noise.precision),
        mean(|noise| noise.lifted),
        mean(|noise| noise.aggregated),
        mean(|noise| noise.random),
        noises.iter().filter(|noise| noise.aggregated > 0.99).count()
    );
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_data::procedural::ProceduralOptions;

    /// The claims that hold on a scene as small as a test can have.
    #[test]
    fn a_scene_shows_what_is_claimed() {
        let photos = ProceduralOptions { width: 48, height: 36, views: 8 };
        let stage = Stage::of_seed(1000, Size { photos, step: 2 });
        let figures = Figures::of(&stage).unwrap();
        let Figures { planted, held_out, .. } = figures;
        assert!(planted[4] > planted[1] && planted[1] > planted[0], "{planted:?}");
        assert!(held_out[4] > held_out[1] && held_out[1] > held_out[0], "{held_out:?}");
        let noise = Noise::of(&stage, 1000).unwrap();
        // How many right masks go with the wrong ones is another matter.
        assert!(noise.recall == 1.0 && noise.wrong.contains(&true), "{:?}", noise.wrong);
    }
}
