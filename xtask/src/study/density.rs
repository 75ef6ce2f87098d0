//! Benefit of adaptive density: the same training with cells that follow the photos, with even cells, and with one
//! Gaussian for every pixel; and ablations of each part of the method.

use super::{Study, mean_and_spread};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Gaussians per pixel at which runs are compared.
const BUDGETS: [f64; 7] = [1.0, 0.4, 0.3, 0.25, 0.1, 0.05, 0.02];
/// Index of the budget at which an arm without a budget is compared.
const SPARSE: usize = 2;
/// Seeds of the arms that are compared with each other.
const SEEDS: u64 = 3;
/// Steps by which predictions of these arms are refined on their own photos as well.
const REFINED: &str = "300";
/// The preset of all runs.
const PRESET: &str = "small";
/// The arm that the others are compared with.
const ADAPTIVE: &str = "adaptive";

/// One way of training, and its evaluation.
struct Arm {
    name: &'static str,
    /// Its settings in the configuration.
    settings: &'static [&'static str],
    /// Allocations that it is evaluated with.
    allocations: &'static [&'static str],
    seeds: u64,
}

/// Gaussians that stand for pixels.
const PIXELS: &str = "model.gaussians.parametrization={kind=\"footprint\",offset_reach=2.0,scale=0.7}";
const MIX: &str = "stages.0.model.allocation=mix";
const SAMPLED: [&str; 4] = [
    PIXELS,
    "stages.0.model.allocation=sampled",
    "stages.0.losses.router.budget=0.3",
    "stages.0.losses.router.error_regression=0",
];

const ARMS: [Arm; 10] = [
    Arm { name: ADAPTIVE, settings: &[], allocations: &["quadtree"], seeds: SEEDS },
    Arm {
        name: "even",
        settings: &["stages.0.model.allocation=quadtree-grid-mix"],
        allocations: &["quadtree-grid"],
        seeds: SEEDS,
    },
    Arm {
        name: "one-per-pixel",
        settings: &[PIXELS, "stages.0.model.allocation=fixed:1"],
        allocations: &["fixed:1"],
        seeds: SEEDS,
    },
    Arm { name: "no-stereo", settings: &["model.dense.stereo=none"], allocations: &["quadtree"], seeds: 1 },
    Arm {
        name: "no-neighbor-attention",
        settings: &["model.gaussians.neighbor_attention=false"],
        allocations: &["quadtree"],
        seeds: 1,
    },
    // Cells do without the router; density by pixels uses it.
    Arm { name: "dithered", settings: &[PIXELS, MIX], allocations: &["dithered", "grid"], seeds: 1 },
    Arm {
        name: "dithered-no-frequency-prior",
        settings: &[PIXELS, MIX, "model.gaussians.frequency_prior=false"],
        allocations: &["dithered"],
        seeds: 1,
    },
    Arm {
        name: "dithered-haar",
        settings: &[PIXELS, MIX, "model.gaussians.wavelet=haar"],
        allocations: &["dithered"],
        seeds: 1,
    },
    Arm {
        name: "sampled",
        settings: &[SAMPLED[0], SAMPLED[1], SAMPLED[2], SAMPLED[3], "stages.0.losses.router.rank=0.3"],
        allocations: &["sampled", "argmax"],
        seeds: 1,
    },
    Arm { name: "sampled-no-ranking", settings: &SAMPLED, allocations: &["sampled", "argmax"], seeds: 1 },
];

impl Arm {
    /// True if predictions are judged refined, too.
    fn refined(&self) -> bool {
        self.seeds > 1
    }

    /// True if refinement may give up Gaussians for others where the error is; controls stay where they are.
    fn adapts(&self) -> bool {
        self.name == ADAPTIVE
    }
}

fn budgets(allocation: &str) -> Vec<Option<f64>> {
    match allocation {
        "fixed:1" | "sampled" | "argmax" => vec![None],
        _ => BUDGETS.map(Some).to_vec(),
    }
}

pub fn run(out: &Path, captures: &[&str], lpips: Option<&str>, more: &[String]) -> Result<(), String> {
    let study = Study::new(out, lpips)?;
    let data: Vec<String> =
        captures.iter().flat_map(|capture| ["--data".to_string(), (*capture).to_string()]).collect();
    let head = "| trained with | evaluated at | refined | Gaussians per pixel | PSNR | energetic | SSIM | LPIPS | against adaptive |";
    let mut of_experts = Vec::new();
    let mut rows = vec![String::new(), head.into(), "|---|---|---|---|---|---|---|---|---|".into()];
    // By refinement, then by budget.
    let mut adaptive: [Vec<Vec<f64>>; 2] = Default::default();
    for arm in &ARMS {
        let runs = (0..arm.seeds).map(|seed| {
            let mut arguments: Vec<String> =
                ["--preset", PRESET, "--init", "built-in", "--seed", &seed.to_string()].map(String::from).to_vec();
            arguments.extend(data.iter().chain(more).cloned());
            arguments.extend(arm.settings.iter().flat_map(|setting| ["--set", setting].map(String::from)));
            study.train(&format!("{}-{seed}", arm.name), &arguments)
        });
        let runs: Vec<_> = runs.collect::<Result<_, _>>()?;
        for refined in [false, true].into_iter().filter(|refined| !refined || arm.refined()) {
            let adaptive = &mut adaptive[usize::from(refined)];
            for allocation in arm.allocations {
                for (i, budget) in budgets(allocation).into_iter().enumerate() {
                    let evaluations = runs.iter().map(|run| evaluate(&study, run, arm, (allocation, budget), refined));
                    let evaluations: Vec<Value> = evaluations.collect::<Result<_, _>>()?;
                    let psnr = figures(&evaluations, "psnr");
                    if arm.adapts() {
                        adaptive.push(psnr.clone());
                    }
                    let same = if budget.is_some() { i } else { SPARSE };
                    let difference = against(&adaptive[same], &psnr);
                    rows.push(row(arm, (allocation, budget), refined, &evaluations, &difference));
                }
            }
        }
        if arm.adapts() {
            of_experts = experts(&study, &runs)?;
        }
    }
    rows.iter().chain(&of_experts).for_each(|row| println!("{row}"));
    Ok(())
}

/// Quality of each expert on every pixel, by held-out photos and by context photos.
fn experts(study: &Study, runs: &[PathBuf]) -> Result<Vec<String>, String> {
    let head = ["", "| Gaussians for every pixel | held-out photos, PSNR | context photos |", "|---|---|---|"];
    let mut rows = head.map(String::from).to_vec();
    for expert in 1..=3 {
        let allocation = format!("fixed:{expert}");
        let mut columns = Vec::new();
        for targets in ["data", "context"] {
            let words = |run: &Path| {
                ["--run", &run.display().to_string(), "--allocation", &allocation, "--targets", targets, "--json"]
                    .map(String::from)
            };
            let of_run =
                |run: &PathBuf| study.evaluate(&run.join(format!("expert-{expert}-{targets}.json")), &words(run));
            let evaluations: Vec<Value> = runs.iter().map(of_run).collect::<Result<_, _>>()?;
            columns.push(text(&figures(&evaluations, "psnr"), 2));
        }
        rows.push(format!("| {expert} | {} |", columns.join(" | ")));
    }
    Ok(rows)
}

/// By allocation and budget.
type Density<'a> = (&'a str, Option<f64>);

fn evaluate(
    study: &Study,
    run: &Path,
    arm: &Arm,
    (allocation, budget): Density<'_>,
    refined: bool,
) -> Result<Value, String> {
    let budget = budget.map(|budget| budget.to_string());
    let mut name = format!("{allocation}-{}", budget.as_deref().unwrap_or("all")).replace(':', "-");
    let mut words =
        ["--run", &run.display().to_string(), "--allocation", allocation, "--json"].map(String::from).to_vec();
    words.extend(budget.iter().flat_map(|budget| ["--budget".to_string(), budget.clone()]));
    if refined {
        name += "-refined";
        words.extend(["--refine-steps", REFINED].map(String::from));
        words.extend((!arm.adapts()).then(|| "--refine-in-place".to_string()));
    }
    study.evaluate(&run.join(name + ".json"), &words)
}

fn figures(evaluations: &[Value], key: &str) -> Vec<f64> {
    evaluations.iter().map(|evaluation| evaluation["mean"][key].as_f64().unwrap_or(f64::NAN)).collect()
}

/// Differences seed by seed.
fn against(adaptive: &[f64], other: &[f64]) -> Vec<f64> {
    other.iter().zip(adaptive).map(|(other, adaptive)| other - adaptive).collect()
}

fn text(values: &[f64], digits: usize) -> String {
    match mean_and_spread(values) {
        (mean, Some(spread)) => format!("{mean:.digits$} ± {spread:.digits$}"),
        (mean, None) => format!("{mean:.digits$}"),
    }
}

fn row(
    arm: &Arm,
    (allocation, budget): Density<'_>,
    refined: bool,
    evaluations: &[Value],
    difference: &[f64],
) -> String {
    let [psnr, energetic, ssim, lpips, count] =
        ["psnr", "psnr_energetic", "ssim", "lpips", "gaussians_per_pixel"].map(|key| figures(evaluations, key));
    format!(
        "| {} | {} | {} | {:.3} | {} | {} | {} | {} | {} |",
        arm.name,
        budget.map_or(allocation.to_string(), |budget| format!("{allocation} {budget}")),
        match (refined, arm.adapts()) {
            (false, _) => "",
            (true, true) => "yes",
            (true, false) => "in place",
        },
        mean_and_spread(&count).0,
        text(&psnr, 2),
        text(&energetic, 2),
        text(&ssim, 3),
        if lpips.iter().all(|x| x.is_nan()) { String::new() } else { text(&lpips, 3) },
        text(difference, 2),
    )
}
