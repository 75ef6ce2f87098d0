//! A run and its report: `cargo run --release -p weaver-run --example descent`.
//!
//! Gradient descent with momentum in Rosenbrock's valley. Writes runs/descent: metrics.jsonl, events for TensorBoard
//! and report.html with the curves and a map of the way, and prints where it ended.

use serde::Serialize;
use weaver_io::{Image, false_color};
use weaver_run::{MetricsLog, Page, TensorBoard};

#[derive(Serialize)]
struct Record {
    step: usize,
    value: f64,
    gradient_norm: f64,
}

fn value([x, y]: [f64; 2]) -> f64 {
    (1.0 - x).powi(2) + 100.0 * (y - x * x).powi(2)
}

fn gradient([x, y]: [f64; 2]) -> [f64; 2] {
    [2.0 * (x - 1.0) - 400.0 * x * (y - x * x), 200.0 * (y - x * x)]
}

/// The logarithm of the function on [-2, 2] x [-1, 3], and the way in white.
fn map(way: &[[f64; 2]]) -> Image {
    const SIDE: usize = 256;
    let at = |pixel: usize| 4.0 * (pixel as f64 + 0.5) / SIDE as f64;
    let heights = (0..SIDE).flat_map(|row| (0..SIDE).map(move |column| [at(column) - 2.0, 3.0 - at(row)]));
    let heights: Vec<f32> = heights.map(|place| value(place).ln_1p() as f32).collect();
    let mut image = false_color(&heights, SIDE, SIDE, 0.0, 8.0);
    for [x, y] in way {
        let (column, row) = ((x + 2.0) / 4.0 * SIDE as f64, (3.0 - y) / 4.0 * SIDE as f64);
        if (0.0..SIDE as f64).contains(&column) && (0.0..SIDE as f64).contains(&row) {
            let start = (row as usize * SIDE + column as usize) * 3;
            image.pixels[start..start + 3].fill(1.0);
        }
    }
    image
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut board = TensorBoard::create("runs/descent/events")?;
    let mut log = MetricsLog::open("runs/descent/metrics.jsonl", 0)?;
    let (mut place, mut speed) = ([-1.5, 2.0], [0.0; 2]);
    let (mut records, mut way) = (Vec::new(), vec![place]);
    for step in 1..=2000 {
        let slope = gradient(place);
        for i in 0..2 {
            speed[i] = 0.9 * speed[i] - 2e-4 * slope[i];
            place[i] += speed[i];
        }
        way.push(place);
        let record = Record { step, value: value(place), gradient_norm: slope[0].hypot(slope[1]) };
        log.append(&record)?;
        board.scalars(step, &[("value", record.value as f32), ("gradient_norm", record.gradient_norm as f32)])?;
        records.push(record);
    }
    let mut page = Page::new("Descent");
    page.heading(1, "Descent");
    page.paragraph("Gradient descent with momentum in Rosenbrock's valley; the minimum is at (1, 1).");
    page.table(&["", "x", "y"], &[["end".into(), format!("{:.3}", place[0]), format!("{:.3}", place[1])]]);
    page.heading(2, "Way").picture("the logarithm of the function, and the way", &map(&way));
    page.heading(2, "Curves").curve("value", records.iter().map(|r| (r.step, r.value)));
    page.curve("gradient norm", records.iter().map(|r| (r.step, r.gradient_norm)));
    page.write("runs/descent/report.html")?;
    println!("({:.3}, {:.3}) after {} steps; see runs/descent/report.html", place[0], place[1], records.len());
    Ok(())
}
