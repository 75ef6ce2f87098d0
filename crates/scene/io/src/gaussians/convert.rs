//! Scenes from one format to another, changed on the way.

use super::{
    Blocks, Chained, Changed, Drawing, SceneFormat, WrittenScene, open_scene, scene_bytes, write_blocks_checked,
};
use crate::{Error, Observe};
use serde_json::{Value, json};
use std::borrow::Cow;
use std::error::Error as StdError;
use std::fmt;
use std::path::Path;
use std::str::FromStr;
use weaver_geometry::Similarity;
use weaver_scene::{Difference, Gaussians, Region, forms};

/// Changes of a scene, in the order of the fields.
#[derive(Default)]
pub struct Conversion<'a> {
    /// Leaves out Gaussians of the scene as it is read.
    pub clean: Option<&'a CleanOf<'a>>,
    /// Turns, scales and moves.
    pub moved: Option<Similarity>,
    /// The region of the centers that stay.
    pub crop: Option<Region>,
    /// Leaves out Gaussians that are unusually far from all others.
    pub drop_floaters: bool,
    /// Gaussians that stay, by their score.
    pub keep: Option<Keep>,
    /// The score.
    pub by: Score<'a>,
    /// Gaussians that are left when neighbors are merged.
    pub merge: Option<Keep>,
    /// Largest degree of spherical harmonics that stays.
    pub degree: Option<usize>,
}

impl fmt::Debug for Conversion<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { moved, crop, keep, merge, degree, .. } = self;
        write!(f, "Conversion {{ {moved:?}, {crop:?}, {keep:?}, {merge:?}, {degree:?}, .. }}")
    }
}

/// Number of Gaussians that stay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Keep {
    /// So many, or all if there are fewer.
    Count(usize),
    /// This share of them.
    Share(f64),
}

impl Keep {
    /// The number that stays of so many.
    pub fn of(self, all: usize) -> usize {
        match self {
            Self::Count(count) => count,
            Self::Share(share) => (share * all as f64).round() as usize,
        }
    }
}

/// A whole number, or a share above 0 up to 1.0 with a point.
///
/// ```
/// use weaver_io::Keep;
/// assert_eq!(["1", "1.0"].map(str::parse), [Ok(Keep::Count(1)), Ok(Keep::Share(1.0))]);
/// ```
impl FromStr for Keep {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let count = text.parse().ok().map(Self::Count);
        let share = text.parse().ok().filter(|share| (0.0..=1.0).contains(share)).map(Self::Share);
        // Nothing is no scene.
        let some = count.or(share).filter(|keep| !matches!(keep, Self::Count(0) | Self::Share(0.0)));
        some.ok_or_else(|| "expected a number of Gaussians, or a share above 0.0 up to 1.0".into())
    }
}

/// A choice of Gaussians by the caller.
pub type CleanOf<'a> =
    dyn Fn(Gaussians, Drawing, &mut dyn Observe) -> Result<Gaussians, Box<dyn StdError + Send + Sync>> + 'a;

/// A score of each Gaussian that a caller computes.
pub type ScoreOf<'a> = dyn Fn(&Gaussians, Drawing) -> Result<Vec<f32>, Box<dyn StdError + Send + Sync>> + 'a;

/// A score that Gaussians are judged by.
#[derive(Default)]
pub enum Score<'a> {
    /// Opacity times the area seen from the broadest side.
    #[default]
    Importance,
    /// Opacity alone.
    Opacity,
    /// A score of the caller's.
    Of(&'a ScoreOf<'a>),
}

impl fmt::Debug for Score<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Importance => "Importance",
            Self::Opacity => "Opacity",
            Self::Of(_) => "Of",
        })
    }
}

/// Why a scene is not converted.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConvertError {
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] Error),
    /// Nothing would stay.
    #[error("{setting}: expected {expected}, found none of {before}, which lie from {:?} to {:?}", corners[0], corners[1])]
    Nothing {
        /// The field of [`Conversion`].
        setting: &'static str,
        /// The expected choice.
        expected: &'static str,
        /// Gaussians before the choice.
        before: usize,
        /// Corners of the box of their centers.
        corners: [[f32; 3]; 2],
    },
    /// The caller's score or choice failed.
    #[error(transparent)]
    Caller(Box<dyn StdError + Send + Sync>),
}

/// A scene that was converted.
#[derive(Clone, Debug, PartialEq)]
pub struct Converted {
    /// The format of the file.
    pub format: SceneFormat,
    /// Gaussians of the inputs.
    pub read: usize,
    /// Gaussians of the file.
    pub gaussians: usize,
    /// Bytes of the file.
    pub bytes: u64,
    /// The difference that writing made; `None` of a format that keeps every bit.
    pub loss: Option<Loss>,
}

/// A difference that writing made, found by reading.
#[derive(Clone, Debug, PartialEq)]
pub struct Loss {
    /// Of positions and colors.
    pub difference: Difference,
    /// The degree beyond which harmonics are gone.
    pub left_out: Option<usize>,
}

impl Converted {
    /// The conversion to a file in words.
    pub fn text(&self, to: &Path) -> String {
        let Self { format, gaussians, bytes, loss, .. } = self;
        let megabytes = *bytes as f64 / 1e6;
        let mut text = format!("{gaussians} Gaussians, {megabytes:.1} MB, {}: {}", format.keeps, to.display());
        if let Some(Loss { difference: Difference { position, color }, left_out }) = loss {
            let harmonics = left_out.map_or(String::new(), |degree| format!("; no harmonics beyond degree {degree}"));
            text += &format!(
                "\noff by (mean, largest): positions {:.2e}, {:.2e}; colors {:.4}, {:.4}{harmonics}",
                position.mean, position.largest, color.mean, color.largest
            );
        }
        text
    }

    /// The conversion of these files to one as JSON.
    pub fn json(&self, from: &[impl AsRef<Path>], to: &Path) -> Value {
        let path = |path: &Path| path.display().to_string();
        let mut report = json!({
            "inputs": from.iter().map(|file| path(file.as_ref())).collect::<Vec<_>>(),
            "output": path(to),
            "format": self.format.name,
            "read": self.read,
            "gaussians": self.gaussians,
            "bytes": self.bytes,
        });
        if let Some(Loss { difference: Difference { position, color }, left_out }) = &self.loss {
            report["position"] = json!({ "mean": position.mean, "largest": position.largest });
            report["color"] = json!({ "mean": color.mean, "largest": color.largest });
            report["degree"] = json!(left_out);
        }
        report
    }
}

/// Joins files of Gaussians, changes the scene, and writes it in the format of a file's name.
///
/// # Errors
/// When a file cannot be read or written, or nothing would stay.
pub fn convert(
    from: &[impl AsRef<Path>],
    to: &Path,
    conversion: &Conversion<'_>,
    observe: &mut dyn Observe,
) -> Result<Converted, ConvertError> {
    let format = SceneFormat::of(to)?;
    let (mut read, drawing) = joined(from, observe)?;
    let count = read.len();
    if let Some(clean) = conversion.clean {
        read = Box::new(clean(read.into_all()?, drawing, observe).map_err(ConvertError::Caller)?);
    }
    let mut gaussians = conversion.changed(read);
    // Where each Gaussian goes its own way, the scene passes through in blocks.
    if conversion.chooses() || !format.writes_blocks() {
        gaussians = Box::new(conversion.chosen(gaussians.into_all()?, drawing)?);
    }
    if gaussians.is_empty() {
        observe.warning(&format!("{}: a scene without Gaussians, as its inputs are", to.display()));
    }
    let loss = write_blocks_checked(to, &*gaussians, drawing, |written| loss(written, &*gaussians))?;
    Ok(Converted { format, read: count, gaussians: gaussians.len(), bytes: scene_bytes(to)?, loss })
}

/// The Gaussians of all files, and how they are to be drawn if they agree on it.
fn joined(files: &[impl AsRef<Path>], observe: &mut dyn Observe) -> Result<(Box<dyn Blocks>, Drawing), Error> {
    let mut scenes = files.iter().map(open_scene).collect::<Result<Vec<_>, Error>>()?;
    let drawing = scenes[0].drawing;
    if scenes.iter().any(|scene| scene.drawing != drawing) {
        observe.warning("some inputs were trained antialiased and some were not; the result says nothing about it");
    }
    let agree = scenes.iter().all(|scene| scene.drawing == drawing);
    let drawing = if agree { drawing } else { Drawing::default() };
    if scenes.len() == 1 {
        return Ok((scenes.remove(0).gaussians, drawing));
    }
    Ok((Box::new(Chained(scenes.into_iter().map(|scene| scene.gaussians).collect())), drawing))
}

impl Conversion<'_> {
    /// True if what stays of a scene depends on more than each Gaussian alone, or their number is not known before.
    fn chooses(&self) -> bool {
        self.crop.is_some() || self.drop_floaters || self.keep.is_some() || self.merge.is_some()
    }

    /// The Gaussians after a movement and with fewer harmonics, which change each of them whatever the others are.
    fn changed(&self, gaussians: Box<dyn Blocks>) -> Box<dyn Blocks> {
        let moved = self.moved;
        let degree = self.degree.map_or(gaussians.degree(), |degree| gaussians.degree().min(degree));
        if moved.is_none() && degree == gaussians.degree() {
            return gaussians;
        }
        let change = move |block: &Gaussians| match &moved {
            Some(moved) => block.transformed(moved).with_degree(degree),
            None => block.with_degree(degree),
        };
        Box::new(Changed { from: gaussians, degree, change: Box::new(change) })
    }

    /// The Gaussians that stay.
    fn chosen(&self, mut gaussians: Gaussians, drawing: Drawing) -> Result<Gaussians, ConvertError> {
        let nothing = |setting, expected, before: &Gaussians| ConvertError::Nothing {
            setting,
            expected,
            before: before.len(),
            corners: corners(before),
        };
        if let Some(region) = &self.crop {
            let inside = gaussians.inside(region);
            if inside.is_empty() && !gaussians.is_empty() {
                return Err(nothing("crop", "Gaussians in the region", &gaussians));
            }
            gaussians = gaussians.select(&inside);
        }
        if self.drop_floaters {
            gaussians = gaussians.select(&gaussians.without_floaters());
        }
        if let Some(keep) = &self.keep {
            let count = keep.of(gaussians.len());
            let values = match &self.by {
                Score::Importance => gaussians.importance(),
                Score::Opacity => gaussians.opacity_logits.iter().map(|logit| forms::opacity(*logit)).collect(),
                Score::Of(score) => score(&gaussians, drawing).map_err(ConvertError::Caller)?,
            };
            if count == 0 && !gaussians.is_empty() {
                return Err(nothing("keep", "a share that leaves Gaussians", &gaussians));
            }
            gaussians = gaussians.select(&gaussians.largest(&values, count));
        }
        if let Some(merge) = &self.merge {
            gaussians = gaussians.merged(merge.of(gaussians.len()));
        }
        Ok(gaussians)
    }
}

/// The corners of the box of all centers.
fn corners(gaussians: &Gaussians) -> [[f32; 3]; 2] {
    let side = |from: f32, choose: fn(f32, f32) -> f32| {
        std::array::from_fn(|axis| gaussians.means.iter().map(|mean| mean[axis]).fold(from, choose))
    };
    [side(f32::INFINITY, f32::min), side(f32::NEG_INFINITY, f32::max)]
}

/// The difference that writing made, found by reading: none of a format that keeps every bit.
fn loss(written: WrittenScene, gaussians: &dyn Blocks) -> Result<Option<Loss>, Error> {
    let WrittenScene { format, gaussians: back } = written;
    if format.is_exact() {
        return Ok(None);
    }
    let order = if format.writes_blocks() { None } else { Some(format.order(&*gaussians.all()?)) };
    let mut parts = Vec::new();
    for rows in back.blocks() {
        let before = match &order {
            Some(order) => Cow::Owned(gaussians.all()?.select(&order[rows.clone()])),
            None => gaussians.block(rows.clone())?,
        };
        parts.push((rows.len(), before.difference(&*back.block(rows)?)));
    }
    let difference = Difference::of_parts(parts);
    Ok(Some(Loss { difference, left_out: (gaussians.degree() > back.degree()).then_some(back.degree()) }))
}
