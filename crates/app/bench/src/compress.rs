//! `splatweaver bench compress`: every format that holds scenes, and ours at several qualities, on the same pictures.

use crate::arguments::BenchCompress;
use ruzstd::encoding::{CompressionLevel, compress_to_vec};
use serde_json::json;
use std::path::Path;
use std::time::Instant;
use weaver_codec::lite;
use weaver_command::camera_files::{self, Size};
use weaver_command::{Console, Failure, Progress};
use weaver_compress::{Judge, Pictures, compress};
use weaver_geometry::Camera;
use weaver_io::{SCENE_FORMATS, SceneFormat, check_output_file, read_gaussians_from, read_scene, write_gaussians_to};
use weaver_kernels::random::Stream;
use weaver_run::Page;
use weaver_scene::Gaussians;
use weaver_splat::RasterSettings;

/// Qualities of `lite`, dB.
const QUALITIES: [f64; 5] = [37.0, 40.0, 43.0, 46.0, 50.0];
/// Pictures of an orbit, and their side.
const ORBIT: (usize, usize) = (6, 256);
/// Longest side of pictures from cameras of a file.
const LONG_SIDE: usize = 384;
/// The methods beside the formats: steps chosen for a quality; a control that only packs; half of the Gaussians by importance, and at random.
const OTHERS: [&str; 4] = ["lite", "zstd", "half", "half-random"];

/// Result of a method on a scene.
struct Row {
    scene: String,
    method: String,
    gaussians: usize,
    bytes: usize,
    bits: f64,
    psnr: f64,
    /// Seconds to encode and to decode.
    seconds: [f64; 2],
}

/// Compares methods on scenes, and prints a table or JSON.
pub fn run(arguments: &BenchCompress, console: &mut Console) -> Result<(), Failure> {
    let methods = methods(&arguments.methods)?;
    arguments.html.as_ref().map_or(Ok(()), |page| check_output_file(page, &arguments.scenes))?;
    let mut rows = Vec::new();
    let (mut done, all) = (0, arguments.scenes.len() * methods.len());
    let mut progress = Progress::new("bench", 0, all, console);
    for path in &arguments.scenes {
        let gaussians = read_scene(path)?.gaussians;
        let cameras = match &arguments.cameras {
            Some(file) => {
                camera_files::read(file, Size::default())?.iter().map(|f| f.camera.shrunk(LONG_SIDE)).collect()
            }
            None => weaver_scene::orbit(&gaussians, ORBIT.0, [ORBIT.1; 2]).unwrap_or_default(),
        };
        let mut bench = Bench::new(path, gaussians, &cameras)?;
        for method in &methods {
            bench.method(method)?;
            done += 1;
            progress.at(done, all, || method.clone(), console);
        }
        rows.append(&mut bench.rows);
    }
    progress.finish();
    if let Some(file) = &arguments.html {
        page(&rows).write(file)?;
        console.note(&format!("page: {}", file.display()));
    }
    if arguments.json {
        let row = |r: &Row| {
            json!({"scene": r.scene, "method": r.method, "gaussians": r.gaussians, "bytes": r.bytes, "bits_per_gaussian": r.bits,
                "psnr": r.psnr, "encode_seconds": r.seconds[0], "decode_seconds": r.seconds[1]})
        };
        return console.print(&serde_json::to_string_pretty(&rows.iter().map(row).collect::<Vec<_>>())?);
    }
    console.print(&table(&rows))
}

/// The methods asked for, or all.
fn methods(asked: &[String]) -> Result<Vec<String>, Failure> {
    let formats = SCENE_FORMATS.iter().filter(|format| format.writes_one_file()).map(|format| format.name);
    let all: Vec<&str> = formats.chain(OTHERS).collect();
    match asked.iter().find(|name| !all.contains(&name.as_str())) {
        Some(wrong) => Err(Failure::Usage(format!("--methods: expected some of {}, found {wrong}", all.join(", ")))),
        None if asked.is_empty() => Ok(all.into_iter().map(String::from).collect()),
        None => Ok(asked.to_vec()),
    }
}

struct Bench<'a> {
    path: &'a Path,
    gaussians: Gaussians,
    judge: Judge,
    rows: Vec<Row>,
}

impl<'a> Bench<'a> {
    fn new(path: &'a Path, gaussians: Gaussians, cameras: &[Camera]) -> Result<Self, Failure> {
        let pictures = Pictures { cameras, background: [1.0; 3], settings: RasterSettings::default() };
        let judge = Judge::new(&gaussians, &pictures);
        let judge = judge.map_err(|error| Failure::message(format!("{}: {error}", path.display())))?;
        Ok(Self { path, gaussians, judge, rows: Vec::new() })
    }

    fn method(&mut self, name: &str) -> Result<(), Failure> {
        match name {
            "lite" => QUALITIES.iter().try_for_each(|decibels| self.lite(*decibels)),
            "zstd" => {
                let start = Instant::now();
                let bytes =
                    compress_to_vec(&encoded(&self.gaussians, format_of("ply")?)?[..], CompressionLevel::Fastest);
                self.push(name, bytes.len(), [start.elapsed().as_secs_f64(), f64::NAN], None)
            }
            "half" | "half-random" => {
                let count = self.gaussians.len() / 2;
                let numbers = match name {
                    "half" => self.gaussians.largest(&self.gaussians.importance(), count),
                    _ => drawn(self.gaussians.len(), count),
                };
                let kept = self.gaussians.select(&numbers);
                let start = Instant::now();
                let bytes = encoded(&kept, format_of("ply")?)?;
                self.push(name, bytes.len(), [start.elapsed().as_secs_f64(), f64::NAN], Some(kept))
            }
            format => {
                let (format, start): (SceneFormat, _) = (format_of(format)?, Instant::now());
                let bytes = encoded(&self.gaussians, format)?;
                let (encoding, start) = (start.elapsed().as_secs_f64(), Instant::now());
                let decoded = read_gaussians_from(&bytes, format)?;
                self.push(name, bytes.len(), [encoding, start.elapsed().as_secs_f64()], Some(decoded))
            }
        }
    }

    fn lite(&mut self, decibels: f64) -> Result<(), Failure> {
        let start = Instant::now();
        let compressed = compress(&self.gaussians, decibels, &mut self.judge, |_| {});
        let compressed = compressed.map_err(|error| Failure::message(format!("{}: {error}", self.path.display())))?;
        let (encoding, start) = (start.elapsed().as_secs_f64(), Instant::now());
        let decoded = lite::decode(&compressed.bytes).map_err(|error| Failure::message(error.to_string()))?;
        let seconds = [encoding, start.elapsed().as_secs_f64()];
        self.push(&format!("lite {decibels} dB"), compressed.bytes.len(), seconds, Some(decoded))
    }

    /// Adds a row; nothing decoded is the scene itself.
    fn push(
        &mut self,
        method: &str,
        bytes: usize,
        seconds: [f64; 2],
        decoded: Option<Gaussians>,
    ) -> Result<(), Failure> {
        let decoded = decoded.as_ref().unwrap_or(&self.gaussians);
        let psnr = self.judge.psnr(decoded);
        let psnr = psnr.map_err(|error| Failure::message(format!("{}: {method}: {error}", self.path.display())))?;
        self.rows.push(Row {
            scene: self.path.display().to_string(),
            method: method.into(),
            gaussians: decoded.len(),
            bytes,
            // Of the scene as it was, whatever is left of it.
            bits: 8.0 * bytes as f64 / self.gaussians.len().max(1) as f64,
            psnr,
            seconds,
        });
        Ok(())
    }
}

fn format_of(name: &str) -> Result<SceneFormat, Failure> {
    name.parse().map_err(Failure::Usage)
}

fn encoded(gaussians: &Gaussians, format: SceneFormat) -> Result<Vec<u8>, Failure> {
    let mut bytes = Vec::new();
    write_gaussians_to(&mut bytes, format, gaussians)?;
    Ok(bytes)
}

/// `count` of `all` numbers, drawn without repetition, in order.
fn drawn(all: usize, count: usize) -> Vec<usize> {
    let stream = Stream::new(0, 0, "bench.compress");
    let mut keys: Vec<(u32, usize)> = (0..all).map(|i| (stream.below(i as u64, 1 << 30) as u32, i)).collect();
    keys.sort_unstable();
    let mut chosen: Vec<usize> = keys[..count.min(all)].iter().map(|(_, i)| *i).collect();
    chosen.sort_unstable();
    chosen
}

fn cells(row: &Row) -> [String; 7] {
    let seconds = row.seconds.map(|s| if s.is_nan() { "-".into() } else { format!("{s:.2}") });
    let [encode, decode] = seconds;
    let psnr = if row.psnr >= 99.99 { "equal".into() } else { format!("{:.2}", row.psnr) };
    [
        row.method.clone(),
        row.gaussians.to_string(),
        row.bytes.to_string(),
        format!("{:.1}", row.bits),
        psnr,
        encode,
        decode,
    ]
}

const COLUMNS: [&str; 7] = ["method", "Gaussians", "bytes", "bits each", "dB", "encode s", "decode s"];

fn table(rows: &[Row]) -> String {
    let mut text = String::new();
    for group in rows.chunk_by(|a, b| a.scene == b.scene) {
        let all: Vec<[String; 7]> = std::iter::once(COLUMNS.map(String::from)).chain(group.iter().map(cells)).collect();
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

fn page(rows: &[Row]) -> Page {
    let mut page = Page::new("Compression of scenes");
    page.paragraph(
        "Decibels are of pictures beside those of the scene before; bits are of one Gaussian of the scene before.",
    );
    for group in rows.chunk_by(|a, b| a.scene == b.scene) {
        page.heading(2, &group[0].scene);
        page.table(&COLUMNS, &group.iter().map(cells).collect::<Vec<_>>());
        let curve = group.iter().filter(|row| row.method.starts_with("lite "));
        page.curve("lite: dB by bits of a Gaussian", curve.map(|row| (row.bits.round() as usize, row.psnr)));
    }
    page
}
