//! report.html: the whole run in one file.

use crate::{Error, Summary};
use std::path::Path;
use weaver_run::{Page, Span};

/// Readable names of curves, by their names in the log.
pub const CURVES: [(&str, &str); 2] = [("rate", "learning rate"), ("gaussians_per_pixel", "Gaussians per pixel")];

/// The page about a run of a model in a folder, but for its curves.
///
/// # Errors
/// When the samples cannot be read.
pub fn page(model: &str, folder: &Path, summary: &Summary) -> Result<Page, Error> {
    let mut page = Page::new(&format!("{model} run"));
    page.heading(1, &format!("{model}: {}", folder.display()));
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
    let samples = weaver_io::list_files(folder.join("samples"), &["png"])?;
    for path in pick(&samples, 6) {
        page.picture_file(path)?;
    }
    Ok(page)
}

fn duration(seconds: f64) -> String {
    if seconds < 120.0 { format!("{seconds:.0} s") } else { format!("{:.1} min", seconds / 60.0) }
}

/// At most `n` of the list, evenly spread, the last included.
fn pick<T>(list: &[T], n: usize) -> impl Iterator<Item = &T> {
    let count = list.len().min(n);
    (0..count).map(move |i| &list[(i + 1) * list.len() / count - 1])
}
