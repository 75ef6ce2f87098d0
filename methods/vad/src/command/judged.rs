//! Test videos with the scores of a detector.

use crate::metrics::{FrameMetrics, SNIPPET, ScoredVideo, frame_metrics};
use crate::{Curves, Detector, Planted};
use weaver_command::Failure;

/// Test videos with all their curves and their ground truth.
pub struct Judged {
    pub names: Vec<String>,
    pub curves: Vec<Curves>,
    pub scored: Vec<ScoredVideo>,
}

impl Judged {
    pub fn metrics(&self) -> FrameMetrics {
        frame_metrics(&self.scored)
    }
}

/// The planted test videos.
pub fn planted(detector: &Detector, planted: &Planted) -> Result<Judged, Failure> {
    let (mut names, mut curves, mut scored) = (Vec::new(), Vec::new(), Vec::new());
    for video in planted.test() {
        let of = detector.curves(&video.features)?;
        let labels = video.labels.iter().flat_map(|label| [*label; SNIPPET]).collect();
        scored.push(ScoredVideo { scores: of.scores().to_vec(), labels });
        curves.push(of);
        names.push(video.name);
    }
    Ok(Judged { names, curves, scored })
}
