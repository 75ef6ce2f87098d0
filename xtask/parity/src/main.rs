//! `cargo xtask parity`: every module against files of reference numbers.
//!
//! A package of its own, so that `cargo xtask tidy` does without compiling the model.

mod aggregator;
mod alignment;
mod anomaly;
mod camera_head;
mod dense;
mod end_to_end;
mod gaussian_head;
mod lifting;
mod losses;
mod metrics;
mod motion;
mod operations;
mod patch_encoder;
mod raster;
mod rectifiers;
mod reference;
mod router;
mod two_experts;
mod wavelet;
mod wild;

use rectifiers::{Flip, Rectified};
use reference::{Line, Reference, Verdict};
use serde_json::json;
use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use weaver_autograd::Real;

/// The options.
#[derive(Debug, Default)]
struct Options {
    folder: PathBuf,
    json: bool,
    strict: bool,
    weights: Option<PathBuf>,
    only: Option<String>,
}

const USAGE: &str = "usage: cargo xtask parity DIR [--json] [--strict] [--weights DIR] [--only NAME]

Compares every output and gradient of the reference files in DIR and its subfolders: relative L2 error, largest error,
what f32 costs the file's own code, verdict. All runs in f32. Where something is beyond its bar, the file is run in f64 too,
and the outputs of every rectifier are compared unit by unit. A gradient of LPIPS passes as `flip` if it is within the bar in f64
and below 1e-2 in f32, and the runs differ in rectifiers whose sums are so close to 0 that rounding moves them over it, and in no
others; any other gradient fails. A file about an item that does not exist here is listed as `not implemented`. With --strict
that fails, too, and so does a flip in LPIPS. LPIPS needs lpips_alex_f16.safetensors and lpips_vgg_f16.safetensors, looked for in --weights,
in WEAVER_SHARED/weights and in folders `weights` or `shared/weights` beside and above DIR.";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match command(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}

/// The comparisons of one file.
#[derive(Debug)]
struct Comparison {
    lines: Vec<Line>,
    /// Rectifiers that differ between f32 and f64; looked for where a line is beyond its bar.
    flips: Vec<Flip>,
}

impl Comparison {
    fn count(&self, verdict: Verdict) -> usize {
        self.lines.iter().filter(|line| line.verdict == verdict).count()
    }

    /// Comparisons that fail the command. A file without a comparison here fails it in `strict` mode alone.
    fn failures(&self, strict: bool) -> usize {
        self.count(Verdict::Fail) + if strict { self.count(Verdict::Unknown) } else { 0 }
    }
}

/// Runs the command; an error if anything differs.
pub fn command(arguments: &[String]) -> Result<(), String> {
    let mut options = Options::default();
    let mut rest = arguments.iter();
    while let Some(argument) = rest.next() {
        let mut value = || rest.next().ok_or_else(|| format!("{argument} needs a value\n{USAGE}"));
        match argument.as_str() {
            "--json" => options.json = true,
            "--strict" => options.strict = true,
            "--weights" => options.weights = Some(value()?.into()),
            "--only" => options.only = Some(value()?.clone()),
            flag if flag.starts_with('-') => return Err(format!("unknown flag {flag}\n{USAGE}")),
            folder if options.folder.as_os_str().is_empty() => options.folder = folder.into(),
            extra => return Err(format!("unexpected argument {extra}\n{USAGE}")),
        }
    }
    if options.folder.as_os_str().is_empty() {
        return Err(USAGE.into());
    }
    let files = files_below(&options.folder)?;
    let wanted = |file: &&PathBuf| options.only.as_ref().is_none_or(|only| name_of(file).contains(only.as_str()));
    // Panics become lines of the report.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {}));
    let results: Vec<(&PathBuf, Comparison)> = files
        .iter()
        .filter(wanted)
        .map(|file| (file, compare(file, options.weights.as_deref(), |key| !options.strict && of_lpips(key))))
        .collect();
    std::panic::set_hook(hook);
    if results.is_empty() {
        return Err(format!("{}: no reference files (.safetensors)", options.folder.display()));
    }
    report(&options, &results);
    match results.iter().map(|(_, file)| file.failures(options.strict)).sum() {
        0 => Ok(()),
        failed => Err(format!("parity: {failed} comparisons failed")),
    }
}

fn report(options: &Options, results: &[(&PathBuf, Comparison)]) {
    let short = |file: &Path| file.strip_prefix(&options.folder).unwrap_or(file).display().to_string();
    let text = if options.json {
        let file = |(path, file): &(&PathBuf, Comparison)| {
            let lines: Vec<_> = file.lines.iter().map(Line::json).collect();
            let flips: Vec<_> = file.flips.iter().map(Flip::json).collect();
            json!({"file": short(path), "lines": lines, "flips": flips})
        };
        let passed = results.iter().all(|(_, file)| file.failures(options.strict) == 0);
        format!("{:#}\n", json!({"files": results.iter().map(file).collect::<Vec<_>>(), "passed": passed}))
    } else {
        let lines = |(path, file): &(&PathBuf, Comparison)| {
            let lines: String = file.lines.iter().map(|line| line.text() + "\n").collect();
            format!("{}\n{lines}", short(path))
        };
        let summary = |(path, file): &(&PathBuf, Comparison)| {
            if file.count(Verdict::Unknown) > 0 {
                return format!("{}: not implemented\n", short(path));
            }
            let (compared, failed) = (file.lines.len(), file.count(Verdict::Fail));
            let flipped = match file.count(Verdict::Flip) {
                0 => String::new(),
                flipped => format!(", {flipped} by a flipped rectifier"),
            };
            format!("{}: {compared} compared, {failed} failed{flipped}\n", short(path))
        };
        let (lines, summary): (String, String) =
            (results.iter().map(lines).collect(), results.iter().map(summary).collect());
        format!("  error largest     f32  verdict\n{lines}{summary}")
    };
    // A closed pipe is no failure.
    let _ = std::io::stdout().write_all(text.as_bytes());
}

fn name_of(file: &Path) -> String {
    file.file_stem().map_or(String::new(), |name| name.to_string_lossy().into_owned())
}

/// All safetensors files of a folder and its subfolders, in order.
fn files_below(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let entries = std::fs::read_dir(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let mut paths: Vec<PathBuf> = entries.filter_map(|entry| entry.ok().map(|entry| entry.path())).collect();
    paths.sort();
    let mut files = Vec::new();
    for path in paths {
        if path.is_dir() {
            files.extend(files_below(&path)?);
        } else if path.extension().is_some_and(|extension| extension == "safetensors") {
            files.push(path);
        }
    }
    Ok(files)
}

/// Largest error in f32 that flipped rectifiers explain.
const FLIPPED: f64 = 1e-2;

/// True if a comparison is of LPIPS, with so many rectifiers and maxima that some sum is always close to a branch.
fn of_lpips(key: &str) -> bool {
    key.contains("lpips")
}

/// All comparisons of one file in f32. A comparison beyond its bar is repeated in f64, to distinguish rectifiers that
/// rounding flipped from another formula; a comparison that may flip is then excused.
fn compare(path: &Path, weights: Option<&Path>, may_flip: impl Fn(&str) -> bool) -> Comparison {
    let (mut lines, rectified) = compare_in::<f32>(path, weights);
    if lines.iter().all(|line| matches!(line.verdict, Verdict::Pass | Verdict::Unknown)) {
        return Comparison { lines, flips: Vec::new() };
    }
    let (exact_lines, exact_rectified) = compare_in::<f64>(path, weights);
    let flips = rectifiers::flips(&rectified, &exact_rectified).unwrap_or_default();
    let rounding = rectifiers::are_rounding(&flips);
    for line in lines.iter_mut().filter(|line| line.verdict != Verdict::Pass) {
        let of_line = exact_lines.iter().filter(|exact| exact.key == line.key);
        let Some(exact) = of_line.max_by(|a, b| a.error.total_cmp(&b.error)) else { continue };
        let in_f64 = format!("{:.1e} in f64", exact.error);
        let given = (!line.remark.is_empty()).then(|| line.remark.clone());
        line.remark =
            given.into_iter().chain(rectifiers::remark(&flips)).chain([in_f64]).collect::<Vec<_>>().join("; ");
        if may_flip(&line.key) && rounding && exact.verdict == Verdict::Pass && line.error <= FLIPPED {
            line.verdict = Verdict::Flip;
        }
    }
    Comparison { lines, flips }
}

/// All comparisons of one file in one precision, and the outputs of rectifiers. A file that cannot be run at all counts
/// as a failed comparison.
fn compare_in<T: Real>(path: &Path, weights: Option<&Path>) -> (Vec<Line>, Vec<Rectified>) {
    let without_numbers =
        |verdict: Verdict, remark: String| (vec![Line::without_numbers(name_of(path), verdict, remark)], Vec::new());
    let broken = |message: String| without_numbers(Verdict::Fail, message);
    let file = match Reference::read(path) {
        Ok(file) => file,
        Err(message) => return broken(message),
    };
    let item = file.metadata("item").map_or_else(|| name_of(path), str::to_string);
    let weights = || find_weights(path, weights);
    // A size that does not fit panics with the op, the model path and the shapes: the message is the result.
    let run = AssertUnwindSafe(|| -> Option<Reference> {
        let file = match item.as_str() {
            i if i.starts_with("dinov2") => patch_encoder::run::<T>(file),
            i if i.starts_with("aggregator") => aggregator::run::<T>(file),
            i if i.starts_with("camera_head") => camera_head::run::<T>(file),
            i if i.starts_with("dpt") => dense::run::<T>(file),
            i if i.starts_with("splatweaver_head") => gaussian_head::run::<T>(file),
            i if i.starts_with("losses") => losses::run::<T>(file),
            i if i.starts_with("clusters") => lifting::clusters::<T>(file),
            i if i.starts_with("align") => alignment::run(file),
            i if i.starts_with("lifting") => lifting::run::<T>(file),
            i if i.starts_with("vad_urdmu") => anomaly::urdmu::<T>(file),
            i if i.starts_with("vad_experts") => anomaly::experts::<T>(file),
            i if i.starts_with("vad_splat_metrics") => anomaly::splatting_and_metrics::<T>(file),
            i if i.starts_with("prope") => two_experts::attention::<T>(file),
            i if i.starts_with("rays") => two_experts::rays::<T>(file),
            i if i.starts_with("camera_loss") => two_experts::cameras::<T>(file),
            i if i.starts_with("moegs_router") => router::run::<T>(file),
            i if i.starts_with("moegs_motion") => motion::run::<T>(file),
            i if i.starts_with("looks") => wild::run::<T>(file),
            i if i.starts_with("pyramid") => two_experts::pyramid::<T>(file),
            i if i.starts_with("wavelet") => wavelet::run::<T>(file),
            i if i.starts_with("ops") => operations::run::<T>(file),
            i if i.starts_with("metrics") => metrics::run::<T>(file, weights().as_deref()),
            i if i.starts_with("end_to_end") => end_to_end::run::<T>(file, weights().as_deref()),
            _ if raster::describes(&file) => raster::run::<T>(file),
            _ => return None,
        };
        Some(file)
    });
    match catch_unwind(run) {
        Ok(Some(file)) => file.finish(),
        Ok(None) => without_numbers(Verdict::Unknown, format!("there is no `{item}` to compare with")),
        Err(panic) => {
            let text = panic.downcast_ref::<String>().cloned();
            broken(text.or_else(|| panic.downcast_ref::<&str>().map(|s| s.to_string())).unwrap_or_default())
        }
    }
}

/// The folder of LPIPS weights.
fn find_weights(path: &Path, given: Option<&Path>) -> Option<PathBuf> {
    let path = path.canonicalize().ok()?;
    let above = path.ancestors().skip(1).flat_map(|folder| [folder.join("weights"), folder.join("shared/weights")]);
    let here = std::env::current_dir().ok()?;
    let beside = here.ancestors().map(|folder| folder.join("shared/weights")).collect::<Vec<_>>();
    let named = std::env::var_os("WEAVER_SHARED").map(|root| PathBuf::from(root).join("weights"));
    let all = given.map(Path::to_path_buf).into_iter().chain(named).chain(above).chain(beside);
    all.into_iter().find(|folder| folder.join("lpips_vgg_f16.safetensors").is_file())
}

#[cfg(test)]
mod tests;
