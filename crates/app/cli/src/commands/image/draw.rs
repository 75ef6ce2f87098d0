//! `splatweaver image draw`.

use super::failure;
use clap::Args;
use std::path::PathBuf;
use weaver_command::{Console, Failure, Threads, memory};
use weaver_image::{Fitted, Window, decode};
use weaver_io::{Image, check_output_file, read_bytes};

/// Draws a .wgi file, or a part of it, as PNG.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver image draw photo.wgi -o photo.png
  splatweaver image draw photo.wgi -o part.png --scale 2 --region 100,50,640,480")]
pub struct ImageDraw {
    /// The file to draw
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// The picture to write, PNG
    #[arg(short, long, value_name = "FILE")]
    pub out: PathBuf,
    /// Sides of the picture in parts of its own; smaller ones are filtered
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    pub scale: f64,
    /// Only these pixels of the scaled picture: first column, first row, columns, rows
    #[arg(long, value_name = "X,Y,W,H", value_parser = region)]
    pub region: Option<Window>,
    #[command(flatten)]
    pub threads: Threads,
}

/// Bytes of memory for a pixel that is drawn.
const BYTES: u64 = 32;
/// Largest factor of a side.
const LARGEST: f64 = 1024.0;

pub fn run(arguments: &ImageDraw, console: &mut Console) -> Result<(), Failure> {
    check_output_file(&arguments.out, [&arguments.file])?;
    let scale = arguments.scale;
    if !(scale > 0.0 && scale <= LARGEST) {
        return Err(Failure::Usage(format!("--scale: expected a number above 0 and at most {LARGEST}, found {scale}")));
    }
    let coded = decode(&read_bytes(&arguments.file)?).map_err(|error| failure(&arguments.file, &error))?;
    let [width, height] = [coded.width, coded.height].map(|side| ((side as f64 * scale).round() as usize).max(1));
    let window = arguments.region.unwrap_or(Window::whole(width, height));
    let inside = |first: usize, length: usize, side: usize| first.checked_add(length).is_some_and(|end| end <= side);
    if !inside(window.x, window.width, width) || !inside(window.y, window.height, height) {
        return Err(Failure::Usage(format!("--region: expected pixels of {width} x {height}, found {window:?}")));
    }
    memory::check(window.pixels() as u64 * BYTES, "a smaller --scale or --region takes less")?;
    let Fitted { gaussians, cut, .. } = coded.fitted;
    let scaled = Fitted { gaussians: gaussians.at_scale(scale), cut, reset: 0 };
    let pixels = scaled.draw_window(window).map_err(|error| failure(&arguments.file, &error))?;
    Image { width: window.width, height: window.height, pixels }.write_png(&arguments.out)?;
    let count = scaled.gaussians.len();
    console.print(&format!("{} x {} of {count} Gaussians: {}", window.width, window.height, arguments.out.display()))
}

fn region(text: &str) -> Result<Window, String> {
    let numbers: Result<Vec<usize>, _> = text.split(',').map(str::parse).collect();
    match numbers.as_deref() {
        Ok([x, y, width, height]) if *width > 0 && *height > 0 => {
            Ok(Window { x: *x, y: *y, width: *width, height: *height })
        }
        _ => Err("expected X,Y,W,H: four whole numbers, the last two above 0".into()),
    }
}
