//! Line charts as SVG.

use std::fmt::Write;

const WIDTH: f64 = 400.0;
const HEIGHT: f64 = 140.0;

/// A small line chart of the finite points (step, value), and whether its axis is logarithmic, which it is if all values are
/// positive, and the last value; none without points.
pub(crate) fn svg(points: impl IntoIterator<Item = (usize, f64)>) -> Option<(String, bool, f64)> {
    let points: Vec<(f64, f64)> =
        points.into_iter().filter(|(_, v)| v.is_finite()).map(|(step, v)| (step as f64, v)).collect();
    let (first, (last, end)) = (points.first()?.0, *points.last()?);
    let last = last.max(first + 1.0);
    let logarithmic = points.iter().all(|p| p.1 > 0.0);
    let scale = |v: f64| if logarithmic { v.log10() } else { v };
    let (low, high) = points.iter().map(|p| scale(p.1)).fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(v), b.max(v)));
    let span = (high - low).max(1e-9);
    let mut path = String::new();
    for (step, v) in &points {
        let (x, y) = ((step - first) / (last - first) * WIDTH, HEIGHT - (scale(*v) - low) / span * HEIGHT);
        let _ = write!(path, "{x:.1},{y:.1} ");
    }
    let svg = format!(
        "<svg width=\"{WIDTH}\" height=\"{HEIGHT}\" viewBox=\"-2 -2 {} {}\"><rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"#fafafa\"/>\
         <polyline points=\"{path}\" fill=\"none\" stroke=\"#2563eb\" stroke-width=\"1.2\"/></svg>",
        WIDTH + 4.0,
        HEIGHT + 4.0,
    );
    Some((svg, logarithmic, end))
}
