//! `splatweaver image draw`.

use super::failure;
use crate::arguments::ImageDraw;
use weaver_command::{Console, Failure, memory};
use weaver_image::{Fitted, Window, decode};
use weaver_io::{Image, check_output_file, read_bytes};

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
