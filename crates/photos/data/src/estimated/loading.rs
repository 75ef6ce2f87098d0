//! Photos as they are matched.

use super::EstimatePhotosOptions;
use crate::Error;
use crate::capture::Mask;
use crate::spheres::Face;
use crate::unreadable::Fault;
use std::path::Path;
use weaver_io::{Bitmap, PhotoFile, path_in_utf8};

/// A photo for matching, upright.
pub(super) struct Loaded {
    pub image: Bitmap,
    /// Mask of the pixels that count, `[height, width]`; `None` if all do.
    pub mask: Option<Vec<bool>>,
    /// Width and height of the file once it is upright.
    pub size: (usize, usize),
    /// True if its size leaves the EXIF rotation ambiguous.
    pub ambiguous: bool,
    /// True if some of it is transparent.
    pub transparent: bool,
    /// The focal length in the file, if requested, in millimeters on 35 mm film.
    pub exif_focal: Option<f64>,
}

impl Loaded {
    /// True if its mask leaves nothing.
    pub fn is_masked(&self) -> bool {
        self.mask.as_ref().is_some_and(|mask| !mask.contains(&true))
    }
}

pub(super) fn load(path: &Path, mask: Option<&Mask>, options: &EstimatePhotosOptions) -> Result<Loaded, Fault> {
    // Its folder is another matter, which leaving a photo out would not mend.
    path_in_utf8(Path::new(path.file_name().unwrap_or_default())).map_err(|_| not_utf8(path))?;
    let file = PhotoFile::at(path).map_err(Fault::unreadable)?;
    let size = file.size();
    let longest = size.0.max(size.1);
    let to = longest.min(options.long_side);
    let shrunk = |side: usize| ((side * to) as f64 / longest as f64).round().max(1.0) as usize;
    let (width, height) = (shrunk(size.0), shrunk(size.1));
    let image = file.resize_whole(width, height).map_err(Fault::unreadable)?;
    let mask = mask.map(|mask| mask.open(path, file.clone())).transpose()?;
    let mask = mask.map(|mask| mask.resize_whole(width, height)).transpose().map_err(Error::from)?;
    let mask = mask.map(|mask| mask.pixels.chunks_exact(3).map(|pixel| pixel[0] >= 128).collect());
    let asked = options.exif && options.focal.is_none();
    let exif_focal = if asked { weaver_io::focal_35mm(path).map_err(Fault::unreadable)? } else { None };
    let (ambiguous, transparent) = (file.has_ambiguous_orientation(), file.was_transparent());
    Ok(Loaded { image, mask, size, ambiguous, transparent, exif_focal })
}

fn not_utf8(path: &Path) -> Fault {
    Fault::unreadable(Error::unexpected(path, "name", "UTF-8, for files that name it", "other bytes"))
}

/// Proportions of photos that differ by less than this part are the same: sizes are rounded.
const SAME_PROPORTIONS: f64 = 0.01;

/// Focal lengths that differ by less than this part are the same: files have whole millimeters.
const SAME_FOCAL: f64 = 0.05;

/// The number of each photo's lens, without gaps. If photos share lenses, photos of the same proportions, upright or
/// not, and of the same given focal length have one; else each has its own.
///
/// Photos without a focal length have the lens of the others of their proportions where these have one, else one of
/// their own. Faces of panoramas have the last number, which no other photo has.
pub(super) fn lenses_of(photos: &[Loaded], focals: &[Option<f64>], faces: &[Option<Face>], shared: bool) -> Vec<usize> {
    let usual: Vec<usize> = (0..photos.len()).filter(|i| faces[*i].is_none()).collect();
    let (own, own_focals): (Vec<&Loaded>, Vec<Option<f64>>) = usual.iter().map(|i| (&photos[*i], focals[*i])).unzip();
    let lenses = lenses_of_usual(&own, &own_focals, shared);
    let last = lenses.iter().max().map_or(0, |last| last + 1);
    let mut all = vec![last; photos.len()];
    usual.into_iter().zip(lenses).for_each(|(photo, lens)| all[photo] = lens);
    all
}

fn lenses_of_usual(photos: &[&Loaded], focals: &[Option<f64>], shared: bool) -> Vec<usize> {
    if !shared {
        return (0..photos.len()).collect();
    }
    let mut found: Vec<f64> = Vec::new();
    let proportions = photos.iter().map(|photo| {
        let (width, height) = photo.size;
        let proportions = width.max(height) as f64 / width.min(height) as f64;
        let same = |other: &f64| (proportions / other).ln().abs() < SAME_PROPORTIONS;
        found.iter().position(same).unwrap_or_else(|| {
            found.push(proportions);
            found.len() - 1
        })
    });
    let proportions: Vec<usize> = proportions.collect();
    // The shortest of each zoom.
    let mut zooms: Vec<Vec<f64>> = vec![Vec::new(); found.len()];
    let mut all: Vec<(f64, usize)> =
        focals.iter().zip(&proportions).filter_map(|(focal, proportions)| Some(((*focal)?, *proportions))).collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    for (focal, proportions) in all {
        if zooms[proportions].last().is_none_or(|zoom| (focal / zoom).ln() > SAME_FOCAL) {
            zooms[proportions].push(focal);
        }
    }
    let mut lenses: Vec<[usize; 2]> = Vec::new();
    let lens = |(focal, proportions): (&Option<f64>, &usize)| {
        let zooms = &zooms[*proportions];
        let zoom = match focal {
            Some(focal) => zooms.partition_point(|zoom| zoom <= focal),
            None => usize::from(zooms.len() == 1),
        };
        let lens = [*proportions, zoom];
        lenses.iter().position(|other| *other == lens).unwrap_or_else(|| {
            lenses.push(lens);
            lenses.len() - 1
        })
    };
    focals.iter().zip(&proportions).map(lens).collect()
}
