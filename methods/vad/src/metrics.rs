//! Frame metrics as the published evaluators compute them.

/// Frames of a snippet: a frame has its snippet's score.
pub const SNIPPET: usize = 16;

/// The scores of a video and its ground truth.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScoredVideo {
    /// A score for each snippet of [`SNIPPET`] frames.
    pub scores: Vec<f32>,
    /// Labels of the frames, true if anomalous; at most `SNIPPET * scores.len()`.
    pub labels: Vec<bool>,
}

impl ScoredVideo {
    /// True if it has an anomalous frame.
    pub fn is_abnormal(&self) -> bool {
        self.labels.contains(&true)
    }
}

/// The area under a precision-recall curve, by both conventions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AveragePrecision {
    /// The trapezoid from (recall 0, precision 1): AP in the literature on anomalies.
    pub trapezoid: f64,
    /// The sum of precision times the growth of recall: scikit-learn's `average_precision_score`.
    pub step: f64,
}

/// Metrics over all frames of all test videos. `None` stands for a metric without frames of a required kind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameMetrics {
    /// Frames in all.
    pub frames: usize,
    /// Anomalous frames.
    pub positives: usize,
    /// Frames of videos with an anomalous one.
    pub abnormal_frames: usize,
    /// Area under the ROC curve, ties by trapezoid.
    pub auc: Option<f64>,
    /// Area under the precision-recall curve.
    pub ap: Option<AveragePrecision>,
    /// AUC over videos with an anomalous frame: only this measures the localization of anomalies within videos.
    pub auc_abnormal: Option<f64>,
    /// AP over videos with an anomalous frame.
    pub ap_abnormal: Option<AveragePrecision>,
    /// The share of frames of normal videos with a score of at least 0.5.
    pub false_alarms: Option<f64>,
}

/// AUC, AP, both again over abnormal videos alone, and the false-alarm rate. Frames of all videos are pooled, without
/// smoothing.
///
/// Sultani et al., arXiv 1801.04264, section 4.1, for AUC and false alarms; Wu et al., arXiv 2007.04687, for AP.
///
/// ```
/// use weaver_vad::metrics::{ScoredVideo, frame_metrics};
/// let abnormal = ScoredVideo { scores: vec![0.1, 0.9], labels: [[false; 16], [true; 16]].concat() };
/// let normal = ScoredVideo { scores: vec![0.6], labels: vec![false; 16] };
/// let metrics = frame_metrics(&[abnormal, normal]);
/// assert_eq!((metrics.auc, metrics.false_alarms), (Some(1.0), Some(1.0)));
/// ```
pub fn frame_metrics(videos: &[ScoredVideo]) -> FrameMetrics {
    let all = Ranking::of(videos.iter());
    let abnormal = Ranking::of(videos.iter().filter(|video| video.is_abnormal()));
    let normal = || videos.iter().filter(|video| !video.is_abnormal());
    let normal_frames: usize = normal().map(|video| video.labels.len()).sum();
    let alarms: usize = normal().flat_map(snippets).filter(|part| part.score >= 0.5).map(|part| part.negatives).sum();
    FrameMetrics {
        frames: all.positives + all.negatives,
        positives: all.positives,
        abnormal_frames: abnormal.positives + abnormal.negatives,
        auc: all.auc(),
        ap: all.average_precision(),
        auc_abnormal: abnormal.auc(),
        ap_abnormal: abnormal.average_precision(),
        false_alarms: (normal_frames > 0).then(|| alarms as f64 / normal_frames as f64),
    }
}

/// Frames with one score.
#[derive(Clone, Copy, Debug)]
struct Part {
    score: f32,
    positives: usize,
    negatives: usize,
}

fn snippets(video: &ScoredVideo) -> impl Iterator<Item = Part> {
    video.scores.iter().zip(video.labels.chunks(SNIPPET)).map(|(score, labels)| {
        let positives = labels.iter().filter(|label| **label).count();
        Part { score: *score, positives, negatives: labels.len() - positives }
    })
}

/// Frames by descending score, grouped by equal scores.
struct Ranking {
    parts: Vec<Part>,
    positives: usize,
    negatives: usize,
}

impl Ranking {
    fn of<'a>(videos: impl Iterator<Item = &'a ScoredVideo>) -> Self {
        let mut parts: Vec<Part> = videos.flat_map(snippets).collect();
        parts.sort_by(|a, b| b.score.total_cmp(&a.score));
        parts.dedup_by(|next, part| {
            let tied = next.score == part.score;
            if tied {
                part.positives += next.positives;
                part.negatives += next.negatives;
            }
            tied
        });
        let positives = parts.iter().map(|part| part.positives).sum();
        let negatives = parts.iter().map(|part| part.negatives).sum();
        Self { parts, positives, negatives }
    }

    fn auc(&self) -> Option<f64> {
        let mut above = 0;
        let mut area = 0.0;
        for part in &self.parts {
            area += part.negatives as f64 * (above as f64 + 0.5 * part.positives as f64);
            above += part.positives;
        }
        (self.positives > 0 && self.negatives > 0).then(|| area / (self.positives as f64 * self.negatives as f64))
    }

    fn average_precision(&self) -> Option<AveragePrecision> {
        let (mut hits, mut found) = (0, 0);
        let (mut trapezoid, mut step, mut last) = (0.0, 0.0, 1.0);
        for part in &self.parts {
            hits += part.positives;
            found += part.positives + part.negatives;
            let precision = hits as f64 / found as f64;
            let recall = part.positives as f64 / self.positives as f64;
            trapezoid += recall * 0.5 * (last + precision);
            step += recall * precision;
            last = precision;
        }
        (self.positives > 0).then_some(AveragePrecision { trapezoid, step })
    }
}
