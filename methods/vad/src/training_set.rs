//! Training videos, labeled as a whole.

use crate::list::Listed;
use crate::planted::{Planted, PlantedVideo};
use crate::resample::resample;
use crate::{Error, Features, Result};
use std::path::Path;
use weaver_io::Checksum;

/// A video to train on.
#[derive(Clone, Debug)]
pub struct TrainingVideo {
    /// True if it has an anomaly.
    pub abnormal: bool,
    /// The known classes of its anomalies.
    pub classes: Vec<usize>,
    /// Its features.
    pub features: Features,
}

/// Videos to train on, with at least one normal and one abnormal one.
#[derive(Clone, Debug)]
pub struct TrainingSet {
    /// The videos, with features of one width and one number of crops.
    pub videos: Vec<TrainingVideo>,
    /// The names of the classes.
    pub classes: Vec<String>,
}

impl TrainingSet {
    /// The planted videos.
    pub fn planted(planted: &Planted) -> Self {
        let video = |PlantedVideo { class, features, .. }| TrainingVideo {
            abnormal: class.is_some(),
            classes: class.into_iter().collect(),
            features,
        };
        Self { videos: planted.training().into_iter().map(video).collect(), classes: Planted::classes() }
    }

    /// A checksum of all labels and features; it reads all files.
    ///
    /// # Errors
    /// When features cannot be read.
    pub fn checksum(&self) -> Result<Checksum> {
        let mut sum = Checksum::default();
        for TrainingVideo { abnormal, classes, features } in &self.videos {
            sum.word(u64::from(*abnormal));
            classes.iter().for_each(|class| sum.word(*class as u64));
            (0..features.crops()).try_for_each(|crop| features.crop(crop).map(|crop| sum.floats(&crop)))?;
        }
        Ok(sum)
    }

    /// The videos of a list, with classes from their names. For names without classes, the first `abnormal` videos have
    /// an anomaly.
    ///
    /// # Errors
    /// When the videos with an anomaly are unknown, or are all, or none.
    pub fn listed(list: &Path, videos: Vec<Listed>, abnormal: Option<usize>) -> Result<Self> {
        let mut classes: Vec<String> =
            videos.iter().flat_map(|video| video.classes.iter().flatten()).cloned().collect();
        classes.sort();
        classes.dedup();
        let mut set = Self { videos: Vec::with_capacity(videos.len()), classes };
        for (i, Listed { name, classes, features }) in videos.into_iter().enumerate() {
            let known = abnormal.map(|count| i < count).or_else(|| classes.as_ref().map(|of| !of.is_empty()));
            let Some(abnormal) = known else {
                let expected = "a name that tells the class, or the number of abnormal videos, which come first";
                return Err(Error::invalid(list, format!("video {}", i + 1), expected, name));
            };
            let of = classes.unwrap_or_default();
            let classes = of.iter().filter_map(|class| set.classes.iter().position(|other| other == class)).collect();
            set.videos.push(TrainingVideo { abnormal, classes, features });
        }
        for (found, kind) in [(set.normal().len(), "normal"), (set.abnormal().len(), "abnormal")] {
            if found == 0 {
                return Err(Error::invalid(list, "videos", format!("at least one {kind} video"), "none"));
            }
        }
        Ok(set)
    }

    /// Numbers for each snippet.
    pub fn width(&self) -> usize {
        self.videos.first().map_or(0, |video| video.features.width())
    }

    /// The normal videos.
    pub fn normal(&self) -> Vec<usize> {
        (0..self.videos.len()).filter(|i| !self.videos[*i].abnormal).collect()
    }

    /// The abnormal videos.
    pub fn abnormal(&self) -> Vec<usize> {
        (0..self.videos.len()).filter(|i| self.videos[*i].abnormal).collect()
    }

    /// All crops of these videos.
    pub(crate) fn samples(&self, videos: &[usize]) -> Vec<(usize, usize)> {
        videos.iter().flat_map(|i| (0..self.videos[*i].features.crops()).map(move |crop| (*i, crop))).collect()
    }

    /// A crop of a video, resampled to `segments` segments, `[segments, width]`.
    pub(crate) fn bag(&self, video: usize, crop: usize, segments: usize) -> Result<Vec<f32>> {
        let features = &self.videos[video].features;
        Ok(resample(&features.crop(crop)?, features.width(), segments))
    }

    /// Class labels of each video, 1 or 0, `[videos, classes]`.
    pub(crate) fn class_labels(&self, videos: impl Iterator<Item = usize>) -> Vec<f32> {
        let has = |video: usize, class| f32::from(u8::from(self.videos[video].classes.contains(&class)));
        videos.flat_map(|video| (0..self.classes.len()).map(move |class| has(video, class))).collect()
    }
}
