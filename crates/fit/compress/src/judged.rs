//! A scene compressed by some of its pictures, and judged by others.

use crate::{CompressError, Compressed, Judge, Pictures, compress};
use std::fmt;
use weaver_geometry::Camera;
use weaver_io::{Observe, Part, Stage};
use weaver_scene::Gaussians;

/// Name of the stage.
const LABEL: &str = "compress";

/// A compressed scene, and its quality in pictures that have no say in it.
#[derive(Clone, Debug, PartialEq)]
pub struct Judged {
    /// The stream, and the quality in the pictures that chose its steps.
    pub compressed: Compressed,
    /// Pictures that chose the steps.
    pub choosing: usize,
    /// Pictures between these.
    pub judging: usize,
    /// Quality in the pictures between, dB; `None` of a single picture.
    pub psnr: Option<f64>,
}

impl fmt::Display for Judged {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { compressed, choosing, judging, psnr } = self;
        let of_choosing = format!("{:.2} dB in {choosing} that the steps were chosen by", compressed.psnr);
        match psnr {
            Some(psnr) => write!(f, "{psnr:.2} dB beside the scene in {judging} pictures, {of_choosing}"),
            None => write!(f, "beside the scene {of_choosing}, and no other to judge"),
        }
    }
}

/// Compresses a scene as [`compress`] does, by every other picture, and judges it by the pictures between.
///
/// # Errors
/// As [`compress`]; without pictures.
pub fn compress_judged(
    gaussians: &Gaussians,
    pictures: &Pictures<'_>,
    decibels: f64,
    observe: &mut dyn Observe,
) -> Result<Judged, CompressError> {
    let every_other =
        |first: usize| -> Vec<Camera> { pictures.cameras.iter().skip(first).step_by(2).copied().collect() };
    let [choosing, judging] = [0, 1].map(every_other);
    let judge = |cameras: &[Camera]| Judge::new(gaussians, &Pictures { cameras, ..*pictures });
    observe.note(&format!(
        "{} Gaussians; {} pictures choose the steps, {} others judge",
        gaussians.len(),
        choosing.len(),
        judging.len()
    ));
    let mut chooser = judge(&choosing)?;
    observe.begin(&Stage { label: LABEL, done: 0, total: 0, stops_after: None });
    let compressed = compress(gaussians, decibels, &mut chooser, |round| {
        let note = round.psnr.map_or("measuring steps".into(), |psnr| format!("{psnr:.2} dB"));
        let _ = observe.progress(&Part { label: LABEL, done: round.done, total: round.of, note });
    })?;
    let psnr = match judging.as_slice() {
        [] => None,
        cameras => Some(compressed.judged_by(&mut judge(cameras)?)?),
    };
    Ok(Judged { compressed, choosing: choosing.len(), judging: judging.len(), psnr })
}
