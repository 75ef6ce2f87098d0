//! Line charts as SVG.

use std::fmt::Write;

const WIDTH: f64 = 400.0;
const HEIGHT: f64 = 140.0;
/// Room for numbers beside the chart.
const LEFT: f64 = 64.0;

/// Quotient of the largest and the smallest value above which an axis is logarithmic.
const TENFOLD: f64 = 10.0;

/// A small line chart of points (step, value), finite ones, with true for a logarithmic axis, and the last value; none
/// without points. The axis is logarithmic if all values are positive and the largest is more than ten times the
/// smallest.
pub(crate) fn svg(points: &[(usize, f64)]) -> Option<(String, bool, f64)> {
    let points: Vec<(f64, f64)> = points.iter().map(|(step, value)| (*step as f64, *value)).collect();
    let (first, (last, end)) = (points.first()?.0, *points.last()?);
    let last = last.max(first + 1.0);
    let (smallest, largest) = points.iter().map(|p| p.1).fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(v), b.max(v)));
    let logarithmic = smallest > 0.0 && largest > TENFOLD * smallest;
    let scale = |v: f64| if logarithmic { v.log10() } else { v };
    let (low, high) = points.iter().map(|p| scale(p.1)).fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(v), b.max(v)));
    let span = (high - low).max(1e-9);
    let mut path = String::new();
    for (step, v) in &points {
        let (x, y) = ((step - first) / (last - first) * WIDTH, HEIGHT - (scale(*v) - low) / span * HEIGHT);
        let _ = write!(path, "{x:.1},{y:.1} ");
    }
    let svg = format!(
        "<svg width=\"{}\" height=\"{}\" viewBox=\"-{LEFT} -8 {0} {1}\" font-size=\"11\" fill=\"#666\">\
         <rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"#fafafa\"/>\
         <polyline points=\"{path}\" fill=\"none\" stroke=\"#2563eb\" stroke-width=\"1.2\"/>{}</svg>",
        LEFT + WIDTH + 24.0,
        HEIGHT + 28.0,
        numbers([first, last], [smallest, largest]),
    );
    Some((svg, logarithmic, end))
}

/// Colors of series.
const COLORS: [&str; 5] = ["#2563eb", "#c2410c", "#15803d", "#7e22ce", "#525252"];

/// A line chart of several series of finite points; none without points.
pub(crate) fn lines(series: &[(String, &[(f64, f64)])]) -> Option<String> {
    let finite = |points: &[(f64, f64)]| -> Vec<(f64, f64)> {
        points.iter().copied().filter(|(x, y)| x.is_finite() && y.is_finite()).collect()
    };
    let all: Vec<(f64, f64)> = series.iter().flat_map(|(_, points)| finite(points)).collect();
    all.first()?;
    let ends = |of: fn(&(f64, f64)) -> f64| {
        let numbers = all.iter().map(of);
        [numbers.clone().fold(f64::MAX, f64::min), numbers.fold(f64::MIN, f64::max)]
    };
    let (x, y) = (ends(|point| point.0), ends(|point| point.1));
    let along = |value: f64, [low, high]: [f64; 2]| (value - low) / (high - low).max(1e-9);
    let mut body = String::new();
    for (i, (name, points)) in series.iter().enumerate() {
        let color = COLORS[i % COLORS.len()];
        let path: String = finite(points)
            .iter()
            .map(|point| format!("{:.1},{:.1} ", along(point.0, x) * WIDTH, HEIGHT - along(point.1, y) * HEIGHT))
            .collect();
        let top = 10 + 14 * i;
        let _ = write!(
            body,
            "<polyline points=\"{path}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.5\"/>\
             <text x=\"{}\" y=\"{top}\" fill=\"{color}\">{name}</text>",
            WIDTH + 8.0
        );
    }
    Some(format!(
        "<svg width=\"{0}\" height=\"{1}\" viewBox=\"-{LEFT} -8 {0} {1}\" font-size=\"11\" fill=\"#666\">\
         <rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"#fafafa\"/>{body}{2}</svg>",
        LEFT + WIDTH + 96.0,
        HEIGHT + 28.0,
        numbers(x, y),
    ))
}

/// The numbers at the ends of both axes: the largest value at the top, the smallest at the bottom, steps below.
fn numbers([first, last]: [f64; 2], [smallest, largest]: [f64; 2]) -> String {
    let mut text = String::new();
    let mut put = |x: f64, y: f64, anchor: &str, number: String| {
        let _ = write!(text, "<text x=\"{x}\" y=\"{y}\" text-anchor=\"{anchor}\">{number}</text>");
    };
    put(-4.0, 4.0, "end", short(largest));
    if smallest < largest {
        put(-4.0, HEIGHT, "end", short(smallest));
    }
    put(0.0, HEIGHT + 14.0, "start", format!("{first}"));
    put(WIDTH, HEIGHT + 14.0, "end", format!("{last}"));
    text
}

/// A number in few characters.
fn short(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 || (1e-3..1e5).contains(&size) {
        let digits = if size >= 100.0 {
            0
        } else if size >= 1.0 {
            2
        } else {
            4
        };
        format!("{value:.digits$}")
    } else {
        format!("{value:.1e}")
    }
}
