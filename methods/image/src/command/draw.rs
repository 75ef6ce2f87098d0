//! `splatweaver image draw`.

use crate::command::arguments::ImageDraw;
use crate::command::read::{MOST_PIXELS, failure};
use crate::{CUT, Fitted, ImageError, Window, decode_region};
use serde_json::json;
use weaver_command::{Console, Failure, memory};
use weaver_io::{Image, file_length, read_part};

/// Bytes of memory for a drawn pixel.
const BYTES: u64 = 32;
/// Largest factor of a side.
const LARGEST: f64 = 1024.0;

pub fn run(arguments: &ImageDraw, console: &mut Console) -> Result<(), Failure> {
    let file = &arguments.file;
    let scale = arguments.scale;
    if !(scale > 0.0 && scale <= LARGEST) {
        return Err(Failure::Usage(format!("--scale: expected a number above 0 and at most {LARGEST}, found {scale}")));
    }
    let length = file_length(file)?;
    let mut taken = 0;
    let mut part = |window: Window| {
        let mut read = |range: std::ops::Range<u64>| {
            taken += range.end - range.start;
            read_part(file, range).map_err(std::io::Error::other)
        };
        decode_region(length, &mut read, window)
    };
    let named = |error: ImageError| failure(file, &error);
    let everything = Window::whole(usize::MAX, usize::MAX);
    // Published Gaussians end farther out; their region is widened by as much.
    let wide = 1.2 * CUT;
    let coded = part(arguments.region.map_or(everything, |region| region.around(scale, wide))).map_err(named)?;
    let [width, height] = [coded.width, coded.height].map(|side| ((side as f64 * scale).round() as usize).max(1));
    let window = arguments.region.unwrap_or(Window::whole(width, height));
    let inside = |first: usize, length: usize, side: usize| first.checked_add(length).is_some_and(|end| end <= side);
    if !inside(window.x, window.width, width) || !inside(window.y, window.height, height) {
        let Window { x, y, width: columns, height: rows } = window;
        let found = format!("{columns} x {rows} from column {x} and row {y}");
        return Err(Failure::Usage(format!("--region: expected pixels of {width} x {height}, found {found}")));
    }
    if window.width.checked_mul(window.height).is_none_or(|pixels| pixels > MOST_PIXELS) {
        let found = format!("{} x {}", window.width, window.height);
        return Err(Failure::Usage(format!(
            "--scale: expected a drawing of at most {MOST_PIXELS} pixels, found {found}"
        )));
    }
    memory::check(window.pixels() as u64 * BYTES, "a smaller --scale or --region takes less")?;
    let Fitted { gaussians, cut, .. } = coded.fitted;
    let scaled = Fitted { gaussians: gaussians.at_scale(scale), cut, reset: 0 };
    let pixels = scaled.draw_window(window).map_err(named)?;
    Image { width: window.width, height: window.height, pixels }.write_png(&arguments.out)?;
    let (count, out) = (scaled.gaussians.len(), arguments.out.display());
    let Window { width, height, .. } = window;
    let figures = json!({ "width": width, "height": height, "gaussians": count, "bytes_read": taken, "bytes": length });
    let text = format!("{width} x {height} of {count} Gaussians, {taken} of {length} bytes read: {out}");
    console.answer(arguments.json, &[&*arguments.out], figures, &text)
}
