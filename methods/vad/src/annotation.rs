//! Labels of the frames of test videos.

use crate::metrics::{SNIPPET, ScoredVideo};
use crate::{Error, FileName, Result, classes_of};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use weaver_io::Npy;

/// Number of labeled frames of a video of UCF-Crime: published evaluators differ.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Length {
    /// Sixteen for each snippet of the feature file.
    #[default]
    Features,
    /// All complete snippets of the annotated length.
    Floor,
    /// All snippets of the annotated length, an incomplete last one included.
    Ceil,
}

/// Annotated intervals of one video.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Truth {
    /// Frames of the video; `None` for annotations without lengths.
    frames: Option<usize>,
    anomalies: Vec<Range<usize>>,
}

/// Ground truth of test videos.
#[derive(Clone, Debug)]
pub struct Annotation {
    path: PathBuf,
    kind: Kind,
}

#[derive(Clone, Debug)]
enum Kind {
    Intervals(BTreeMap<String, Truth>),
    /// A label for each frame of all videos in order.
    Frames(Vec<bool>),
}

impl Annotation {
    /// Reads an annotation: lines `path frames class a1 b1 a2 b2` (UCF-Crime: -1 for none, ends inclusive), lines
    /// `name start end ...` (XD-Violence: ends exclusive), or an `.npy` file with a label for each frame of all test
    /// videos in the order of their list.
    ///
    /// # Errors
    /// When the file cannot be read, a line has neither form, a video is there twice, or an interval is empty or begins
    /// beyond its video.
    pub fn read(path: &Path) -> Result<Self> {
        let kind = if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("npy")) {
            let array = Npy::open(path)?;
            Kind::Frames(array.numbers(0..array.len()).into_iter().map(|x| x > 0.5).collect())
        } else {
            Kind::Intervals(intervals(path)?)
        };
        Ok(Self { path: path.to_path_buf(), kind })
    }

    /// The names of the videos with a line of their own, in alphabetical order; none for frame labels.
    pub fn videos(&self) -> impl Iterator<Item = &str> {
        let intervals = match &self.kind {
            Kind::Intervals(videos) => Some(videos),
            Kind::Frames(_) => None,
        };
        intervals.into_iter().flat_map(|videos| videos.keys().map(String::as_str))
    }

    /// The annotated number of frames of a video, if the annotation has it.
    pub fn frames(&self, name: &str) -> Option<usize> {
        match &self.kind {
            Kind::Intervals(videos) => videos.get(name)?.frames,
            Kind::Frames(_) => None,
        }
    }

    /// Joins scores, by the names of their videos and in the order of the list, with labels of their frames. A surplus
    /// of less than two snippets is cut.
    ///
    /// # Errors
    /// When a video is unknown, or scores and annotation differ more in length.
    pub fn join(&self, scores: Vec<(String, Vec<f32>)>, length: Length) -> Result<Vec<ScoredVideo>> {
        let mut videos = Vec::with_capacity(scores.len());
        let mut start = 0;
        let snippets: usize = scores.iter().map(|(_, scores)| scores.len()).sum();
        for (name, scores) in scores {
            let labels = match &self.kind {
                Kind::Intervals(truths) => self.labels(truths, &name, scores.len(), length)?,
                Kind::Frames(labels) => {
                    let end = start + SNIPPET * scores.len();
                    let part = labels.get(start..end).ok_or_else(|| {
                        let found = format!("{} for {snippets} snippets", labels.len());
                        Error::invalid(&self.path, "labels", format!("{}", SNIPPET * snippets), found)
                    })?;
                    start = end;
                    part.to_vec()
                }
            };
            videos.push(ScoredVideo { scores, labels });
        }
        match &self.kind {
            Kind::Frames(labels) if labels.len() != start => {
                Err(Error::invalid(&self.path, "labels", format!("{start} for {snippets} snippets"), labels.len()))
            }
            _ => Ok(videos),
        }
    }

    fn labels(
        &self,
        truths: &BTreeMap<String, Truth>,
        name: &str,
        snippets: usize,
        length: Length,
    ) -> Result<Vec<bool>> {
        let scored = SNIPPET * snippets;
        let Some(truth) = truths.get(name) else {
            // XD-Violence, with lines without lengths, lists no normal videos.
            let only_abnormal = truths.values().all(|truth| truth.frames.is_none());
            if only_abnormal && classes_of(name).is_some_and(|classes| classes.is_empty()) {
                return Ok(vec![false; scored]);
            }
            return Err(Error::invalid(&self.path, "videos", format!("one of the name {name}"), "none"));
        };
        let counted = truth.frames.map(|frames| match length {
            Length::Features => frames,
            Length::Floor => frames / SNIPPET * SNIPPET,
            Length::Ceil => frames.next_multiple_of(SNIPPET),
        });
        if let Some(counted) = counted.filter(|counted| counted.abs_diff(scored) >= 2 * SNIPPET) {
            let expected = format!("scores for {} snippets, of {counted} frames", counted.div_ceil(SNIPPET));
            return Err(Error::invalid(&self.path, name, expected, snippets));
        }
        let frames = match length {
            Length::Features => scored,
            Length::Floor | Length::Ceil => counted.unwrap_or(scored).min(scored),
        };
        let mut labels = vec![false; frames];
        for anomaly in &truth.anomalies {
            if anomaly.start >= frames + 2 * SNIPPET {
                let expected = format!("anomalies within its {frames} frames");
                return Err(Error::invalid(&self.path, name, expected, format!("one from frame {}", anomaly.start)));
            }
            labels[anomaly.start.min(frames)..anomaly.end.min(frames)].fill(true);
        }
        Ok(labels)
    }
}

fn intervals(path: &Path) -> Result<BTreeMap<String, Truth>> {
    let text = weaver_io::read_text(path)?;
    let mut videos = BTreeMap::new();
    for (number, line) in text.lines().enumerate().map(|(i, line)| (i + 1, line)) {
        let fields: Vec<&str> = line.split_whitespace().collect();
        if fields.is_empty() {
            continue;
        }
        let place = format!("line {number}");
        let invalid = |expected: &str| Error::invalid(path, &place, expected, line.trim());
        let numbers = |fields: &[&str]| -> Option<Vec<i64>> { fields.iter().map(|field| field.parse().ok()).collect() };
        let ucf = || Some((fields.get(1)?.parse().ok()?, numbers(fields.get(3..)?)?));
        let (frames, bounds, inclusive) = match numbers(&fields[1..]) {
            Some(bounds) => (None, bounds, 0),
            None => {
                let (frames, bounds): (usize, _) =
                    ucf().ok_or_else(|| invalid("`path frames class a1 b1 a2 b2` or `name start end ...`"))?;
                (Some(frames), bounds, 1)
            }
        };
        if bounds.is_empty() || bounds.len() % 2 != 0 {
            return Err(invalid("pairs of a first and a last frame"));
        }
        let mut anomalies = Vec::new();
        for pair in bounds.chunks_exact(2).filter(|pair| **pair != [-1, -1]) {
            let (Ok(start), Ok(end)) = (usize::try_from(pair[0]), usize::try_from(pair[1] + inclusive)) else {
                return Err(invalid("frames from 0, or -1 -1 for none"));
            };
            // The lists of UCF-Crime end up to two frames beyond some videos.
            if start >= end || frames.is_some_and(|frames| start >= frames || end > frames + SNIPPET) {
                return Err(invalid("a last frame that is not before the first, within the video"));
            }
            anomalies.push(start..end);
        }
        let FileName { video, .. } = FileName::of(fields[0]);
        if videos.insert(video, Truth { frames, anomalies }).is_some() {
            return Err(invalid("each video once"));
        }
    }
    if videos.is_empty() {
        return Err(Error::invalid(path, "lines", "annotated videos", "none"));
    }
    Ok(videos)
}
