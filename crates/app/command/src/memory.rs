//! Checks of available memory before large allocations: an allocation that fails ends the process.

use crate::Failure;
use weaver_geometry::Camera;
use weaver_scene::Frame;

/// Refuses a need of `needed` bytes that exceeds the available memory; `advice` names a way to need less.
pub fn check(needed: u64, advice: &str) -> Result<(), Failure> {
    Ok(weaver_io::check_memory(needed, advice)?)
}

/// Bytes of a pixel while a picture is drawn, and while it waits to be written: a little more than
/// docs/results/benchmarks.md measured.
const DRAWN: u64 = 36;
const WAITING: u64 = 13;

/// Bytes for pictures of these cameras, `at_once` of them drawn before the first is written.
pub fn of_pictures(cameras: &[Frame], at_once: usize) -> u64 {
    cameras.iter().map(|frame| of_picture(&frame.camera, at_once)).max().unwrap_or(0)
}

/// Bytes for `at_once` pictures of a camera's size.
pub fn of_picture(camera: &Camera, at_once: usize) -> u64 {
    let pixels = (camera.width as u64).saturating_mul(camera.height as u64);
    pixels.saturating_mul(DRAWN + 2 * WAITING * at_once as u64)
}
