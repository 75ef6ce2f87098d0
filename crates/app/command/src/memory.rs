//! Whether there is enough memory, asked before it is taken: an allocation that fails ends the process.

use crate::Failure;
use weaver_geometry::Camera;
use weaver_scene::Frame;

/// Refuses what would not fit into memory; `advice` says what would take less.
pub fn check(needed: u64, advice: &str) -> Result<(), Failure> {
    Ok(weaver_io::check_memory(needed, advice)?)
}

/// Bytes of a pixel while a picture is drawn, and while it waits to be written: a little more than docs/results/benchmarks.md measured.
const DRAWN: u64 = 36;
const WAITING: u64 = 13;

/// Bytes that pictures of these cameras take, of which so many are drawn before the first is written.
pub fn of_pictures(cameras: &[Frame], at_once: usize) -> u64 {
    cameras.iter().map(|frame| of_picture(&frame.camera, at_once)).max().unwrap_or(0)
}

/// Bytes that so many pictures of a camera's size take.
pub fn of_picture(camera: &Camera, at_once: usize) -> u64 {
    let pixels = (camera.width as u64).saturating_mul(camera.height as u64);
    pixels.saturating_mul(DRAWN + 2 * WAITING * at_once as u64)
}
