//! The picture of the dial in the README, drawn from the table of its figures.

use std::fmt::Write;

const TABLE: &str = "docs/results/density.md";
const SECTION: &str = "## Density where the error is";
const PICTURE: &str = "docs/images/dial.svg";

/// A curve: the label of its row in the table, its name in the picture, and its style.
const CURVES: [(&str, &str, &str); 4] = [
    ("**refined: adaptive cells, PSNR**", "adaptive, refined", "stroke='#0a58ca'"),
    ("even cells, in place", "even grid, refined", "stroke='#0a58ca' stroke-dasharray='6 4'"),
    ("the network alone: adaptive cells, PSNR", "adaptive, network alone", "stroke='#b45309'"),
    ("even cells", "even grid, network alone", "stroke='#b45309' stroke-dasharray='6 4'"),
];
/// Settings with one Gaussian for every pixel, likewise.
const ONE: [(&str, &str); 2] = [
    ("*the same, refined in place*", "one for every pixel, refined"),
    ("*trained with one for every pixel: the network alone*", "one for every pixel, network alone"),
];

/// Left, top, right and bottom of the axes, and the size of the picture, pixels.
const AXES: [f64; 4] = [52.0, 14.0, 500.0, 316.0];
const SIZE: [f64; 2] = [720.0, 360.0];
/// Height of a line of text.
const LINE: f64 = 15.0;
/// The ends of the axes: Gaussians per pixel (logarithmic), PSNR.
const COUNTS: [f64; 2] = [0.018, 1.1];
const DECIBELS: [f64; 2] = [19.0, 28.0];

pub fn run() -> Result<(), String> {
    let text = std::fs::read_to_string(TABLE).map_err(|e| format!("{TABLE}: {e}"))?;
    let picture = draw(&text).map_err(|e| format!("{TABLE}: {SECTION}: {e}"))?;
    std::fs::write(PICTURE, picture).map_err(|e| format!("{PICTURE}: {e}"))
}

/// The picture of the table in a document.
fn draw(document: &str) -> Result<String, String> {
    let (_, section) = document.split_once(SECTION).ok_or("no such section")?;
    let section = section.split("\n## ").next().unwrap_or(section);
    let counts = row(section, "Gaussians per pixel")?;
    let [left, top, right, bottom] = AXES;
    let along = |x: f64, [low, high]: [f64; 2]| (x - low) / (high - low);
    let x = |count: f64| left + (right - left) * along(count.ln(), COUNTS.map(f64::ln));
    let y = |psnr: f64| bottom - (bottom - top) * along(psnr, DECIBELS);
    let mut svg = format!(
        "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {0} {1}' width='{0}' height='{1}' font-family='sans-serif' font-size='12'>\n\
         <rect width='100%' height='100%' fill='white'/>\n<g stroke='#ddd'>\n",
        SIZE[0], SIZE[1]
    );
    let decibels: Vec<f64> = (DECIBELS[0] as u32..=DECIBELS[1] as u32).map(f64::from).collect();
    for count in &counts {
        put(&mut svg, format_args!("<path d='M{0:.1} {top}V{bottom}'/>", x(*count)));
    }
    for psnr in &decibels {
        put(&mut svg, format_args!("<path d='M{left} {:.1}H{right}'/>", y(*psnr)));
    }
    put(&mut svg, format_args!("</g>\n<g fill='#444' text-anchor='middle'>"));
    for count in &counts {
        put(&mut svg, format_args!("<text x='{:.1}' y='{}'>{count}</text>", x(*count), bottom + 16.0));
    }
    let middle = (left + right) / 2.0;
    put(&mut svg, format_args!("<text x='{middle}' y='{}'>Gaussians per pixel</text>", bottom + 34.0));
    put(&mut svg, format_args!("</g>\n<g fill='#444' text-anchor='end'>"));
    for psnr in &decibels {
        put(&mut svg, format_args!("<text x='{}' y='{:.1}'>{psnr}</text>", left - 6.0, y(*psnr) + 4.0));
    }
    let middle = (top + bottom) / 2.0;
    put(
        &mut svg,
        format_args!(
            "</g>\n<text transform='translate(14 {middle}) rotate(-90)' text-anchor='middle' fill='#444'>PSNR of held-out photos, dB</text>"
        ),
    );
    let mut names = Vec::new();
    for (label, name, stroke) in CURVES {
        let psnr = row(section, label)?;
        if psnr.len() != counts.len() {
            return Err(format!("{label}: expected {} numbers, found {}", counts.len(), psnr.len()));
        }
        let points: Vec<[f64; 2]> = counts.iter().zip(&psnr).map(|(count, psnr)| [x(*count), y(*psnr)]).collect();
        let line: Vec<String> = points.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        put(&mut svg, format_args!("<polyline fill='none' stroke-width='2' {stroke} points='{}'/>", line.join(" ")));
        names.push((y(psnr[0]), name));
    }
    for (label, name) in ONE {
        let psnr = row(section, label)?[0];
        let [x, y] = [x(1.0), y(psnr)];
        put(&mut svg, format_args!("<circle cx='{x:.1}' cy='{y:.1}' r='4'/>"));
        names.push((y, name));
    }
    names.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let mut lowest = 0.0f64;
    for (y, name) in names {
        // Names of ends that are close go below each other.
        lowest = y.max(lowest + LINE);
        put(&mut svg, format_args!("<text x='{}' y='{:.1}'>{name}</text>", right + 8.0, lowest + 4.0));
    }
    svg.push_str("</svg>\n");
    Ok(svg)
}

fn put(svg: &mut String, line: std::fmt::Arguments<'_>) {
    writeln!(svg, "{line}").expect("text takes any line");
}

/// The first number in each cell of the row with this label.
fn row(section: &str, label: &str) -> Result<Vec<f64>, String> {
    let cells = |line: &str| line.trim_matches('|').split('|').map(|cell| cell.trim().to_string()).collect::<Vec<_>>();
    let mut rows = section.lines().filter(|line| line.starts_with('|')).map(cells);
    let row = rows.find(|row| row[0] == label).ok_or_else(|| format!("no row {label}"))?;
    let number = |cell: &String| {
        let word = cell.trim_start_matches('*').split([' ', '*']).next().unwrap_or("").to_string();
        word.parse().map_err(|_| format!("{label}: expected a number, found {cell}"))
    };
    row[1..].iter().filter(|cell| !cell.is_empty()).map(number).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn numbers_are_read_from_rows() {
        let table = "| a | 1.0 | 0.4 |\n|---|---|---|\n| b | **22.83** ± 0.11 | -0.5 |\n| c | x | |\n| d | 3 | |\n";
        assert_eq!(row(table, "b"), Ok(vec![22.83, -0.5]));
        assert_eq!(row(table, "d"), Ok(vec![3.0]));
        assert_eq!(row(table, "c"), Err("c: expected a number, found x".into()));
        assert_eq!(row(table, "e"), Err("no row e".into()));
    }

    #[test]
    fn the_picture_is_that_of_the_table() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        let read = |file| std::fs::read_to_string(root.join(file)).unwrap();
        assert!(draw(&read(TABLE)).unwrap() == read(PICTURE), "another table: run cargo xtask dial");
    }
}
