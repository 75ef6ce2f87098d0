//! Cost of photos that are distorted, stored on their side or masked: the same capture clean and in each of these ways,
//! by the weights that come with the program and by weights trained on it, judged by the same pixels of the same
//! photos.

use super::{Study, mean_and_spread};
use crate::cargo;
use std::path::{Path, PathBuf};

/// Steps of each training, from the weights that come with the program.
const STEPS: &str = "300";
const SEEDS: u64 = 3;
/// Largest difference of a copy, dB.
const WITHIN: f64 = 0.1;

/// A copy that the example makes, the one that it is compared with, and whether their masks are used.
struct Pair {
    what: &'static str,
    copy: &'static str,
    with: &'static str,
    masks: bool,
}

const PAIRS: [Pair; 4] = [
    Pair { what: "distorted", copy: "distorted", with: "clean", masks: false },
    Pair { what: "stored on their side", copy: "turned", with: "clean", masks: false },
    Pair { what: "noise under masks, against the photo there", copy: "masked", with: "covered", masks: true },
    Pair { what: "the same, against photos without masks", copy: "masked", with: "whole", masks: true },
];

pub fn run(out: &Path, captures: &[&str], lpips: Option<&str>, more: &[String]) -> Result<(), String> {
    let study = Study::new(out, lpips)?;
    let head =
        "| capture | photos | built-in weights: clean | copy | difference | trained: clean | copy | difference |";
    let mut rows = vec![String::new(), head.into(), "|---|---|---|---|---|---|---|---|".into()];
    for capture in captures {
        let folder = Path::new(capture);
        let name = folder.file_name().ok_or_else(|| format!("{capture}: expected a folder"))?;
        let name = name.to_string_lossy();
        let of = Capture { study: &study, name: &name, copies: copies(&out.join(&*name), folder)?, more };
        let clean: Vec<f64> = (0..SEEDS).map(|seed| of.trained("clean", false, seed)).collect::<Result<_, _>>()?;
        let (mean, spread) = mean_and_spread(&clean);
        let untrained = of.as_it_comes("clean", false)?;
        rows.push(format!("| {name} | clean | {untrained:.2} | | | {mean:.2} ± {:.2} | | |", spread.unwrap_or(0.0)));
        for pair in &PAIRS {
            let figures = |of: &dyn Fn(&str) -> Result<f64, String>| Ok::<_, String>((of(pair.with)?, of(pair.copy)?));
            let untrained = figures(&|copy| of.as_it_comes(copy, pair.masks))?;
            let trained = (0..SEEDS).map(|seed| figures(&|copy| of.trained(copy, pair.masks, seed)));
            let trained = trained.collect::<Result<Vec<_>, _>>()?;
            rows.push(format!("| {name} | {} | {} | {} |", pair.what, columns(&[untrained]), columns(&trained)));
        }
    }
    rows.iter().for_each(|row| println!("{row}"));
    Ok(())
}

/// A capture's copies, and how they are trained on.
struct Capture<'a> {
    study: &'a Study,
    name: &'a str,
    copies: PathBuf,
    more: &'a [String],
}

impl Capture<'_> {
    /// PSNR of held-out photos by the weights that come with the program.
    fn as_it_comes(&self, copy: &str, masks: bool) -> Result<f64, String> {
        let data = self.copies.join(copy).display().to_string();
        let mut arguments = vec!["--data".to_string(), data];
        arguments.extend(masks.then(|| "--masks".into()));
        self.psnr(&self.copies.join(copy).join("built-in.json"), arguments)
    }

    /// PSNR of held-out photos by weights trained on the copy.
    fn trained(&self, copy: &str, masks: bool, seed: u64) -> Result<f64, String> {
        let data = self.copies.join(copy).display().to_string();
        let fixed = ["--preset", "tiny-endless", "--init", "built-in", "--steps", STEPS, "--data", &data];
        let settings =
            ["data.endless=none", "optimizer.ema=0.99"].into_iter().chain(masks.then_some("data.masks=true"));
        let mut arguments: Vec<String> = fixed.map(String::from).to_vec();
        arguments.extend(["--seed".to_string(), seed.to_string()]);
        arguments.extend(settings.flat_map(|setting| ["--set", setting].map(String::from)));
        arguments.extend(self.more.iter().cloned());
        let run = self.study.train(&format!("{}/{copy}-{seed}", self.name), &arguments)?;
        self.psnr(&run.join("held-out.json"), vec!["--run".to_string(), run.display().to_string()])
    }

    fn psnr(&self, file: &Path, mut arguments: Vec<String>) -> Result<f64, String> {
        arguments.extend(["--cameras", "given", "--points", "--json"].map(String::from));
        let psnr = self.study.evaluate(file, &arguments)?["mean"]["psnr"].as_f64();
        psnr.ok_or_else(|| format!("{}: mean.psnr: expected a number", file.display()))
    }
}

/// The copies of a capture, in its folder within the study's.
fn copies(out: &Path, capture: &Path) -> Result<PathBuf, String> {
    let copies = out.join("copies");
    if !copies.exists() {
        let part = copies.with_extension("part");
        let [from, to] = [capture, &part].map(|path| path.display().to_string());
        let example =
            ["run", "--release", "--locked", "-p", "weaver-data", "--example", "own_photos", "--", &from, &to];
        cargo(&example, &[])?;
        std::fs::rename(&part, &copies).map_err(|e| format!("{}: {e}", copies.display()))?;
    }
    Ok(copies)
}

/// Clean photos, their copies, and the differences, seed by seed.
fn columns(pairs: &[(f64, f64)]) -> String {
    let mean = |of: fn(&(f64, f64)) -> f64| mean_and_spread(&pairs.iter().map(of).collect::<Vec<_>>());
    let (difference, spread) = mean(|(clean, copy)| copy - clean);
    let spread = spread.map_or(String::new(), |spread| format!(" ± {spread:.2}"));
    let beyond = if difference.abs() > WITHIN { " (beyond)" } else { "" };
    format!("{:.2} | {:.2} | {difference:+.2}{spread}{beyond}", mean(|pair| pair.0).0, mean(|pair| pair.1).0)
}
