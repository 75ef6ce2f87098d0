//! report.html: the whole run in one file, without scripts or links, to open anywhere.

use super::StepReport;
use crate::{Error, Summary};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::fmt::Write;
use std::path::Path;
use weaver_inference::RunFolder;

/// Writes the report of a run from its log, its samples and its summary.
///
/// # Errors
/// When the log or the pictures cannot be read, or the report cannot be written.
pub fn write_report(folder: &RunFolder, summary: &Summary) -> Result<(), Error> {
    let metrics = super::read_metrics(&folder.metrics_path())?;
    let mut html = String::from(HEAD);
    let mut put = |text: String| html.push_str(&text);
    put(format!("<h1>SplatWeaver: {}</h1>", escape(&folder.path().display().to_string())));
    put(format!(
        "<p>Preset <b>{}</b>, seed {}, {} steps in {}.</p>",
        escape(&summary.preset),
        summary.seed,
        summary.steps,
        duration(summary.seconds)
    ));
    if let Some(evaluation) = &summary.evaluation {
        put("<h2>Held-out views</h2>".into());
        put(format!("<pre>{}</pre>", escape(&evaluation.table())));
    }
    let samples = weaver_io::list_files(folder.path().join("samples"), &["png"])?;
    put("<h2>Samples</h2><p>Rows: context views. Columns: input, render, depth, expert map (dark: no Gaussian; brighter: more).</p>".into());
    for path in pick(&samples, 6) {
        put(picture(path)?);
    }
    put("<h2>Curves</h2>".into());
    put(curve("loss", &metrics, |r| Some(r.loss)));
    put(curve("learning rate", &metrics, |r| Some(r.rate)));
    put(curve("gradient norm", &metrics, |r| Some(r.gradient_norm)));
    let mut names: Vec<&str> = Vec::new();
    for (name, _) in metrics.iter().flat_map(|r| &r.terms) {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    for name in names {
        put(curve(name, &metrics, |r| r.terms.iter().find(|(n, _)| n == name).map(|(_, v)| *v)));
    }
    put("</body></html>\n".into());
    Ok(weaver_io::write_text(folder.report_path(), &html)?)
}

const HEAD: &str =
    "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><title>SplatWeaver run</title><style>
body{font:15px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#222}
pre{background:#f5f5f5;padding:1rem;overflow-x:auto;font-size:13px}
figure{display:inline-block;margin:.5rem 1rem .5rem 0;vertical-align:top}
figcaption{font-size:13px;color:#666}
img{image-rendering:pixelated;max-width:100%;min-width:28rem}
</style></head><body>";

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

fn duration(seconds: f64) -> String {
    if seconds < 120.0 { format!("{seconds:.0} s") } else { format!("{:.1} min", seconds / 60.0) }
}

/// At most `n` of the list, evenly spread, the last included.
fn pick<T>(list: &[T], n: usize) -> impl Iterator<Item = &T> {
    let count = list.len().min(n);
    (0..count).map(move |i| &list[(i + 1) * list.len() / count - 1])
}

fn picture(path: &Path) -> Result<String, Error> {
    let name = path.file_stem().map_or(String::new(), |n| n.to_string_lossy().into_owned());
    let data = STANDARD.encode(weaver_io::read_bytes(path)?);
    Ok(format!(
        "<figure><img alt=\"{0}\" src=\"data:image/png;base64,{data}\"><figcaption>{0}</figcaption></figure>",
        escape(&name)
    ))
}

/// A small line chart with a logarithmic axis where the values allow it.
fn curve(name: &str, metrics: &[StepReport], value: impl Fn(&StepReport) -> Option<f32>) -> String {
    let points: Vec<(f64, f64)> = metrics
        .iter()
        .filter_map(|r| value(r).filter(|v| v.is_finite()).map(|v| (r.step as f64, f64::from(v))))
        .collect();
    let Some(&(first, _)) = points.first() else { return String::new() };
    let last = points.last().map_or(first, |p| p.0).max(first + 1.0);
    let logarithmic = points.iter().all(|p| p.1 > 0.0);
    let scale = |v: f64| if logarithmic { v.log10() } else { v };
    let (low, high) = points.iter().map(|p| scale(p.1)).fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(v), b.max(v)));
    let span = (high - low).max(1e-9);
    let (width, height) = (400.0, 140.0);
    let mut path = String::new();
    for (step, v) in &points {
        let (x, y) = ((step - first) / (last - first) * width, height - (scale(*v) - low) / span * height);
        let _ = write!(path, "{x:.1},{y:.1} ");
    }
    let end = points.last().map_or(0.0, |p| p.1);
    format!(
        "<figure><svg width=\"{width}\" height=\"{height}\" viewBox=\"-2 -2 {} {}\"><rect width=\"{width}\" height=\"{height}\" fill=\"#fafafa\"/>\
         <polyline points=\"{path}\" fill=\"none\" stroke=\"#2563eb\" stroke-width=\"1.2\"/></svg><figcaption>{} (last {end:.4}{})</figcaption></figure>",
        width + 4.0,
        height + 4.0,
        escape(name),
        if logarithmic { ", log axis" } else { "" }
    )
}
