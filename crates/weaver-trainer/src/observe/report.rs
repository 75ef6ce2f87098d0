//! report.html: the whole run in one file.

use super::StepReport;
use crate::{Error, Recipe, Summary};
use weaver_inference::RunFolder;
use weaver_report::{Page, Span, read_metrics};

/// Writes the report of a run from its log, its samples and its summary.
///
/// # Errors
/// When the log or the pictures cannot be read, or the report cannot be written.
pub fn write_report<R: Recipe>(folder: &RunFolder, summary: &Summary) -> Result<(), Error> {
    let metrics: Vec<StepReport> = read_metrics(folder.metrics_path())?;
    let mut page = Page::new(&format!("{} run", R::ARCHITECTURE));
    page.heading(1, &format!("{}: {}", R::ARCHITECTURE, folder.path().display()));
    let course = format!(", seed {}, {} steps in {}.", summary.seed, summary.steps, duration(summary.seconds));
    page.spans(&[Span::Plain("Preset "), Span::Bold(&summary.preset), Span::Plain(&course)]);
    if let Some(evaluation) = &summary.evaluation {
        page.heading(2, "Held-out views").preformatted(&evaluation.table());
    }
    page.heading(2, "Samples").paragraph(
        "Rows: context views. Columns: input, render, depth, Gaussians per pixel (dark: none; brighter: more). Where a model makes one of \
         each pixel, the last column is a plan of the cameras instead: gray the data's, dark the model's. Where it knows about light, a second \
         row shows the view in that of two photos: photo, render, render, photo.",
    );
    let samples = weaver_io::list_files(folder.path().join("samples"), &["png"])?;
    for path in pick(&samples, 6) {
        page.picture_file(path)?;
    }
    page.heading(2, "Curves");
    let mut curve = |name: &str, value: &dyn Fn(&StepReport) -> Option<f32>| {
        page.curve(name, metrics.iter().filter_map(|r| value(r).map(|v| (r.step, f64::from(v)))));
    };
    curve("loss", &|r| Some(r.loss));
    curve("learning rate", &|r| Some(r.rate));
    curve("gradient norm", &|r| Some(r.gradient_norm));
    let mut names: Vec<&str> = Vec::new();
    for (name, _) in metrics.iter().flat_map(|r| &r.terms) {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    for name in names {
        curve(name, &|r| r.terms.iter().find(|(n, _)| n == name).map(|(_, v)| *v));
    }
    Ok(page.write(folder.report_path())?)
}

fn duration(seconds: f64) -> String {
    if seconds < 120.0 { format!("{seconds:.0} s") } else { format!("{:.1} min", seconds / 60.0) }
}

/// At most `n` of the list, evenly spread, the last included.
fn pick<T>(list: &[T], n: usize) -> impl Iterator<Item = &T> {
    let count = list.len().min(n);
    (0..count).map(move |i| &list[(i + 1) * list.len() / count - 1])
}
