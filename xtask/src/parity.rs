//! `cargo xtask parity`: every module against files of reference numbers.

mod aggregator;
mod camera_head;
mod dense;
mod end_to_end;
mod gaussian_head;
mod losses;
mod metrics;
mod operations;
mod patch_encoder;
mod raster;
mod reference;
mod wavelet;

use reference::{Line, Reference};
use serde_json::json;
use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use weaver_autograd::Real;

/// What can be asked.
#[derive(Debug, Default)]
struct Options {
    folder: PathBuf,
    json: bool,
    flips: bool,
    weights: Option<PathBuf>,
    only: Option<String>,
}

const USAGE: &str = "usage: cargo xtask parity DIR [--json] [--flips] [--weights DIR] [--only NAME]

Compares every output and gradient of the reference files in DIR and its subfolders: relative L2 error, largest error,
what f32 costs the file's own code, verdict. All runs in f32. What fails is run in f64 as well, and its error there remarked:
where it is nothing, the formula is the same, and rounding has moved a number over the threshold of a rectifier or a maximum.
It fails all the same, unless --flips is given and it is off by less than 1e-2. LPIPS needs lpips_alex_f16.safetensors and lpips_vgg_f16.safetensors, looked
for in --weights, in WEAVER_SHARED/weights and in folders `weights` or `shared/weights` beside and above DIR.";

/// Runs the command; an error if anything differs.
pub fn command(arguments: &[String]) -> Result<(), String> {
    let mut options = Options::default();
    let mut rest = arguments.iter();
    while let Some(argument) = rest.next() {
        let mut value = || rest.next().ok_or_else(|| format!("{argument} needs a value\n{USAGE}"));
        match argument.as_str() {
            "--json" => options.json = true,
            "--flips" => options.flips = true,
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
    // What panics becomes a line of the report.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {}));
    let results: Vec<(&PathBuf, Vec<Line>)> = files
        .iter()
        .filter(wanted)
        .map(|file| (file, compare_with(file, options.weights.as_deref(), options.flips)))
        .collect();
    std::panic::set_hook(hook);
    if results.is_empty() {
        return Err(format!("{}: no reference files (.safetensors)", options.folder.display()));
    }
    report(&options, &results);
    let failed = results.iter().flat_map(|(_, lines)| lines).filter(|line| !line.passed).count();
    if failed == 0 { Ok(()) } else { Err(format!("parity: {failed} comparisons failed")) }
}

fn report(options: &Options, results: &[(&PathBuf, Vec<Line>)]) {
    let short = |file: &Path| file.strip_prefix(&options.folder).unwrap_or(file).display().to_string();
    let text = if options.json {
        let lines = |lines: &[Line]| lines.iter().map(Line::json).collect::<Vec<_>>();
        let files: Vec<_> =
            results.iter().map(|(file, all)| json!({"file": short(file), "lines": lines(all)})).collect();
        let passed = results.iter().flat_map(|(_, lines)| lines).all(|line| line.passed);
        format!("{:#}\n", json!({"files": files, "passed": passed}))
    } else {
        let lines = |(file, lines): &(&PathBuf, Vec<Line>)| {
            let lines: String = lines.iter().map(|line| line.text() + "\n").collect();
            format!("{}\n{lines}", short(file))
        };
        let summary = |(file, lines): &(&PathBuf, Vec<Line>)| {
            let failed = lines.iter().filter(|line| !line.passed).count();
            format!("{}: {} compared, {failed} failed\n", short(file), lines.len())
        };
        let (lines, summary): (String, String) =
            (results.iter().map(lines).collect(), results.iter().map(summary).collect());
        format!("  error largest     f32  verdict\n{lines}{summary}")
    };
    // A reader that has seen enough is no reason to fail.
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

/// Largest error in f32 that `--flips` puts down to rounding, which may flip a branch.
const FLIPPED: f64 = 1e-2;

/// All comparisons of one file in f32, and what failed once more in f64 to tell rounding from another formula.
fn compare_with(path: &Path, weights: Option<&Path>, flips: bool) -> Vec<Line> {
    let mut lines = compare::<f32>(path, weights);
    if lines.iter().all(|line| line.passed) {
        return lines;
    }
    let exact = compare::<f64>(path, weights);
    for line in lines.iter_mut().filter(|line| !line.passed) {
        let Some(exact) = exact.iter().find(|exact| exact.key == line.key) else { continue };
        line.remark += &format!("{}{:.1e} in f64", if line.remark.is_empty() { "" } else { "; " }, exact.error);
        if flips && exact.passed && line.error <= FLIPPED {
            line.passed = true;
            line.remark += ": the rounding of f32 alone";
        }
    }
    lines
}

/// All comparisons of one file in one precision. What cannot be run at all is a comparison that failed.
fn compare<T: Real>(path: &Path, weights: Option<&Path>) -> Vec<Line> {
    let broken = |message: String| {
        let nothing = f64::NAN;
        let key = name_of(path);
        vec![Line {
            key,
            error: nothing,
            largest: nothing,
            f32_error: None,
            allowed: 0.0,
            passed: false,
            remark: message,
        }]
    };
    let file = match Reference::read(path) {
        Ok(file) => file,
        Err(message) => return broken(message),
    };
    let item = file.metadata("item").map_or_else(|| name_of(path), str::to_string);
    let weights = || find_weights(path, weights);
    // A size that does not fit panics with the op, the model path and the shapes: the message is the result.
    let run = AssertUnwindSafe(|| -> Result<Reference, String> {
        let file = match item.as_str() {
            i if i.starts_with("dinov2") => patch_encoder::run::<T>(file),
            i if i.starts_with("aggregator") => aggregator::run::<T>(file),
            i if i.starts_with("camera_head") => camera_head::run::<T>(file),
            i if i.starts_with("dpt") => dense::run::<T>(file),
            i if i.starts_with("splatweaver_head") => gaussian_head::run::<T>(file),
            i if i.starts_with("losses") => losses::run::<T>(file),
            i if i.starts_with("wavelet") => wavelet::run::<T>(file),
            i if i.starts_with("ops") => operations::run::<T>(file),
            i if i.starts_with("metrics") => metrics::run::<T>(file, weights().as_deref()),
            i if i.starts_with("end_to_end") => end_to_end::run::<T>(file, weights().as_deref()),
            _ if file.has("in.viewmat") => raster::run::<T>(file),
            other => return Err(format!("item `{other}` is not known here")),
        };
        Ok(file)
    });
    match catch_unwind(run) {
        Ok(Ok(file)) => file.finish(),
        Ok(Err(message)) => broken(message),
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
mod tests {
    use super::*;

    fn failures(file: &Path) -> Vec<String> {
        let lines = compare::<f32>(file, None);
        assert!(lines.len() >= 10, "{}: only {} comparisons", file.display(), lines.len());
        lines.iter().filter(|line| !line.passed).map(Line::text).collect()
    }

    /// The files in the repository, and on machines that have them all the others.
    #[test]
    fn everything_equals_its_reference() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let shared = std::env::var_os("WEAVER_SHARED").map_or_else(|| root.join("../shared"), PathBuf::from);
        let mut files = files_below(&root.join("tests/fixtures")).unwrap();
        match files_below(&shared.join("fixtures")) {
            Ok(more) => files.extend(more),
            Err(_) => println!("skipped: no data ({})", shared.join("fixtures").display()),
        }
        for file in files {
            let failures = failures(&file);
            // Without weights there is no LPIPS to compare.
            let known = |line: &String| line.contains("lpips") && find_weights(&file, None).is_none();
            let failures: Vec<_> = failures.into_iter().filter(|line| !known(line)).collect();
            assert!(failures.is_empty(), "{}:\n{}", file.display(), failures.join("\n"));
        }
    }

    #[test]
    fn a_difference_is_found_and_so_is_what_was_left_out() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/wavelet.safetensors");
        let mut tensors = weaver_io::checkpoint::Tensors::read(&file).unwrap();
        let mut bands = tensors.values::<f32>("out.haar.16x20.low", &[1, 1, 8, 10]).unwrap().to_vec();
        bands[3] *= 1.001;
        tensors.insert("out.haar.16x20.low", &[1, 1, 8, 10], bands);
        tensors.insert("out.haar.16x20.unheard_of", &[1], vec![1.0f32]);
        let folder = tempfile::tempdir().unwrap();
        let changed = folder.path().join("wavelet.safetensors");
        tensors.write(&changed).unwrap();
        let failures = failures(&changed);
        assert_eq!(failures.len(), 2, "{failures:?}");
        assert!(failures[0].contains("out.haar.16x20.low") && failures[1].contains("unheard_of"), "{failures:?}");
        assert!(command(&[folder.path().display().to_string()]).is_err());
    }
}
