//! The results of methods as a table, and as a page with curves.

use serde::{Deserialize, Serialize};
use weaver_run::Page;

/// The size of a compressed scene, and its source.
#[derive(Deserialize, Serialize)]
pub struct Coded {
    /// Name of the method, or of the file by another program.
    pub method: String,
    pub setting: String,
    pub bytes: u64,
    /// Seconds of encoding, training included, and of decoding; encoding of a file is unknown.
    pub seconds: [Option<f64>; 2],
}

/// Result of a method on a scene.
#[derive(Deserialize, Serialize)]
pub struct Row {
    pub scene: String,
    pub coded: Coded,
    pub gaussians: usize,
    pub bits: f64,
    /// PSNR against pictures of the scene, dB.
    pub psnr: f64,
    /// PSNR against held-out photos, dB.
    pub photos: Option<f64>,
    /// Chamfer distance to the scene's surface, thousandths of the cameras' distance.
    pub chamfer: Option<f64>,
}

const COLUMNS: [&str; 9] =
    ["method", "Gaussians", "bytes", "bits each", "dB", "dB of photos", "Chamfer", "encode s", "decode s"];

fn cells(row: &Row) -> [String; 9] {
    let psnr = if row.psnr >= 99.99 { "equal".into() } else { format!("{:.2}", row.psnr) };
    let optional = |value: Option<f64>| value.map_or(String::new(), |value| format!("{value:.2}"));
    let Coded { method, setting, bytes, seconds } = &row.coded;
    let [encode, decode] = seconds.map(optional);
    [
        format!("{method} {setting}").trim_end().into(),
        row.gaussians.to_string(),
        bytes.to_string(),
        format!("{:.1}", row.bits),
        psnr,
        optional(row.photos),
        optional(row.chamfer),
        encode,
        decode,
    ]
}

/// Header and rows, without empty columns.
fn filled(group: &[Row]) -> Vec<Vec<String>> {
    let all: Vec<[String; 9]> = std::iter::once(COLUMNS.map(String::from)).chain(group.iter().map(cells)).collect();
    let used: Vec<usize> = (0..9).filter(|&k| all[1..].iter().any(|row| !row[k].is_empty())).collect();
    all.iter().map(|row| used.iter().map(|&k| row[k].clone()).collect()).collect()
}

/// A table for each scene.
pub fn table(rows: &[Row]) -> String {
    let mut text = String::new();
    for group in rows.chunk_by(|a, b| a.scene == b.scene) {
        let all = filled(group);
        let width = |k: usize| all.iter().map(|row| row[k].len()).max().unwrap_or(0);
        text += &format!("{}\n", group[0].scene);
        for row in &all {
            let cell = |(k, cell): (usize, &String)| match k {
                0 => format!("  {cell:<width$}", width = width(0)),
                _ => format!("  {cell:>width$}", width = width(k)),
            };
            text += &format!("{}\n", row.iter().enumerate().map(cell).collect::<String>());
        }
    }
    text.truncate(text.trim_end().len());
    text
}

/// PSNR of pictures that count as equal, at which curves end, dB.
const BEST: f64 = 70.0;

/// Tables, and curves of quality over bits and over Gaussians, and of geometry over bits.
pub fn page(rows: &[Row]) -> Page {
    let mut page = Page::new("Compression of scenes");
    page.paragraph(
        "Decibels are of pictures beside those of the scene before; bits are of one Gaussian of the scene before; Chamfer distances are of meshes \
         of the drawn depth, thousandths of the cameras' distance.",
    );
    for group in rows.chunk_by(|a, b| a.scene == b.scene) {
        page.heading(2, &group[0].scene);
        let all = filled(group);
        let header: Vec<&str> = all[0].iter().map(String::as_str).collect();
        page.table(&header, &all[1..]);
        curves(&mut page, "dB over bits of a Gaussian", group, |row| Some((row.bits, row.psnr.min(BEST))));
        curves(&mut page, "dB over Gaussians", group, |row| Some((row.gaussians as f64, row.psnr.min(BEST))));
        curves(&mut page, "Chamfer distance over bits of a Gaussian", group, |row| Some((row.bits, row.chamfer?)));
    }
    page
}

/// A plot with a line for each method.
fn curves(page: &mut Page, title: &str, rows: &[Row], point: impl Fn(&Row) -> Option<(f64, f64)>) {
    let series = |group: &[Row]| -> Vec<(f64, f64)> {
        let mut points: Vec<(f64, f64)> = group.iter().filter_map(&point).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points
    };
    let all: Vec<(&str, Vec<(f64, f64)>)> = rows
        .chunk_by(|a, b| a.coded.method == b.coded.method)
        .map(|group| (group[0].coded.method.as_str(), series(group)))
        .collect();
    if all.iter().any(|(_, points)| !points.is_empty()) {
        page.lines(title, &all);
    }
}
