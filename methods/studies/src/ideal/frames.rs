//! Frames of the clip.

pub const FRAMES: usize = 24;

pub fn time(frame: usize) -> f64 {
    frame as f64 / FRAMES as f64
}

/// True if routers and experts are trained on it.
pub fn seen(frame: usize) -> bool {
    frame.is_multiple_of(2)
}
