//! Cameras that are estimated from photos and clips.

mod comparison;
mod placement;
mod remarks;

pub use comparison::CameraComparison;

use crate::Error;
use placement::remark_placement;
use remarks::{refusal, remark, sureness};
use std::path::PathBuf;
use std::time::Instant;
use weaver_clip::PhotoFiles;
use weaver_data::capture::{HoldOut, MaskOptions, PhotoMasks};
use weaver_data::{EstimatePhotosOptions, EstimatedPhotos, OutputFolder, PhotoSet, Placing, estimate_set};
use weaver_io::{Observe, Part, check_memory, duration};

/// Name of the command in the record of a folder of estimated cameras, and of the stage.
const COMMAND: &str = "cameras";
/// The folder of estimated cameras within a result.
pub(crate) const FOLDER: &str = "cameras";
/// One photo in this many is held out.
const HOLD_OUT: usize = 8;
/// Bytes that a photo takes while it is matched with hundreds of others, as measured of 250 and of 1000.
const MATCHED: u64 = 3_300_000;

/// A request for cameras.
#[derive(Clone, Debug)]
pub struct CamerasRequest {
    /// Folder for the results.
    pub out: PathBuf,
    /// The most frames of each clip; `None` takes as many as show something new.
    pub frames: Option<usize>,
    /// Options of matching; clips override [`sequence`](EstimatePhotosOptions::sequence), since their frames follow one
    /// another.
    pub matching: EstimatePhotosOptions,
    /// Masks of the photos: their black pixels are not matched. `None` matches all of each photo.
    pub masks: Option<MaskOptions>,
    /// The world that they are brought to.
    pub placing: Placing,
    /// Further files that are read, and that no result may replace.
    pub read: Vec<PathBuf>,
}

impl CamerasRequest {
    /// Cameras into a folder, with everything else as usual.
    pub fn new(out: impl Into<PathBuf>) -> Self {
        let matching = EstimatePhotosOptions::default();
        let placing = Placing::default();
        Self { out: out.into(), frames: None, matching, masks: None, placing, read: Vec::new() }
    }
}

/// Estimates the cameras of photos, photos in folders, and frames of clips, and writes a capture into a folder, as
/// [`EstimatedPhotos::write`] does.
///
/// # Errors
/// When photos, clips or masks cannot be read, fewer than two photos get a camera, or a file cannot be written.
pub fn cameras(
    photos: &[PathBuf],
    request: &CamerasRequest,
    observe: &mut dyn Observe,
) -> Result<EstimatedPhotos, Error> {
    let masks = request.masks.as_ref();
    let read = photos
        .iter()
        .chain(&request.read)
        .chain(request.placing.files())
        .chain(masks.and_then(|masks| masks.folder.as_ref()));
    let out = OutputFolder::claim(&request.out, COMMAND, read)?;
    let photos = PhotoFiles::collect(photos, request.frames, &out, observe)?;
    let located = vec![false; photos.paths.len()];
    let matched = Matched { photos: &photos, located: &located, masks, placing: &request.placing };
    let EstimatedCameras { found, .. } = estimate(matched, &request.matching, &out, observe)?;
    photos.remove_earlier_frames(&out)?;
    Ok(found)
}

/// Photos with estimated cameras in a folder.
#[derive(Clone, Debug)]
pub struct EstimatedCameras {
    /// The cameras.
    pub found: EstimatedPhotos,
    /// The photos that the cameras are of: the files, or upright copies and faces of panoramas in the folder.
    pub photos: Vec<PathBuf>,
    /// True if they have masks.
    pub masked: bool,
}

impl EstimatedCameras {
    /// Estimates cameras into the folder `cameras` of a result, and returns them with their file.
    ///
    /// # Errors
    /// As [`cameras`].
    pub fn beside(
        photos: &PhotoFiles,
        matching: &EstimatePhotosOptions,
        out: &OutputFolder,
        observe: &mut dyn Observe,
    ) -> Result<(Self, PathBuf), Error> {
        let located = vec![false; photos.paths.len()];
        let folder = cameras_folder(out, &photos.paths)?;
        let matched = Matched { photos, located: &located, masks: None, placing: &Placing::KEEP };
        let estimated = estimate(matched, matching, &folder, observe)?;
        photos.remove_earlier_frames(out)?;
        Ok((estimated, folder.path().join("transforms.json")))
    }
}

/// Estimates cameras into the folder `cameras` of a result, where photos may be held out, and returns the capture, and
/// whether its photos have masks.
pub(crate) fn estimated_capture(
    photos: &PhotoFiles,
    (hold_out, masks): (HoldOut, Option<&MaskOptions>),
    (matching, placing): (&EstimatePhotosOptions, &Placing),
    out: &OutputFolder,
    observe: &mut dyn Observe,
) -> Result<(PathBuf, bool), Error> {
    let step = match hold_out {
        HoldOut::Nothing => usize::MAX,
        HoldOut::Listed => HOLD_OUT,
        HoldOut::Every(step) => step,
    };
    let located: Vec<bool> = (0..photos.paths.len()).map(|i| step < usize::MAX && i % step == 0).collect();
    let folder = cameras_folder(out, &photos.paths)?;
    let matched = Matched { photos, located: &located, masks, placing };
    let EstimatedCameras { masked, .. } = estimate(matched, matching, &folder, observe)?;
    photos.remove_earlier_frames(out)?;
    Ok((folder.path().join("transforms.json"), masked))
}

/// The choice of held-out photos for an estimated capture, which lists its photos for testing.
pub(crate) fn held_out_of_estimated(hold_out: HoldOut) -> HoldOut {
    match hold_out {
        HoldOut::Nothing => HoldOut::Nothing,
        HoldOut::Listed | HoldOut::Every(_) => HoldOut::Listed,
    }
}

/// The folder `cameras` of a result, a capture of its own.
fn cameras_folder(out: &OutputFolder, photos: &[PathBuf]) -> Result<OutputFolder, Error> {
    Ok(OutputFolder::claim(out.path().join(FOLDER), COMMAND, photos)?)
}

/// Photos to match.
#[derive(Clone, Copy)]
struct Matched<'a> {
    photos: &'a PhotoFiles,
    /// True for photos that are located alone, and find no points.
    located: &'a [bool],
    masks: Option<&'a MaskOptions>,
    placing: &'a Placing,
}

/// Estimates cameras, and writes a capture into a folder.
fn estimate(
    Matched { photos, located, masks, placing }: Matched<'_>,
    matching: &EstimatePhotosOptions,
    out: &OutputFolder,
    observe: &mut dyn Observe,
) -> Result<EstimatedCameras, Error> {
    let start = Instant::now();
    let PhotoFiles { paths: photos, originals, sequence, times, .. } = photos;
    let masks = masks.map(|masks| PhotoMasks::find(originals, masks)).transpose()?;
    EstimatedPhotos::check(out, photos)?;
    placing.check(originals)?;
    masks.as_ref().map_or(Ok(()), |masks| masks.check(out))?;
    let set = PhotoSet::new(photos, located, masks).cut(originals, &matching.spheres, out, observe)?;
    let PhotoSet { paths: photos, originals, .. } = &set;
    check_memory(MATCHED * photos.len() as u64, "fewer photos at once take less")?;
    observe.note(&format!("cameras: matching {} photos", photos.len()));
    let options = EstimatePhotosOptions { sequence: *sequence, ..*matching };
    let mut found = estimate_set(&set, &options)?;
    found.times = times.clone();
    found.remarks.iter().for_each(|remark| observe.warning(remark));
    let placed = found.placed().len();
    if placed < 2 {
        return Err(Error::Cameras(refusal(&found)));
    }
    let e = &found.estimate;
    observe.note(&format!(
        "cameras: {placed} of {} photos placed, {} points, off by {:.2} pixels in the median; focal length {:.3}{} of the longer side; {}",
        photos.len(),
        e.points.len(),
        e.error,
        found.focal(),
        e.uncertainty.as_ref().map_or(String::new(), |u| format!(" +- {:.3}", u.focal * found.focal())),
        duration(start.elapsed().as_secs_f64())
    ));
    remark(&found, options.shared, observe);
    // Photos that could not be read are missing among the found ones.
    let original = |path: &PathBuf| {
        let at = photos.iter().position(|photo| photo == path);
        at.and_then(|at| originals.get(at)).unwrap_or(path).clone()
    };
    let of_found: Vec<PathBuf> = found.paths.iter().map(original).collect();
    remark_placement(&found.place(&of_found, placing)?, observe);
    // All is reported before anything is written: an observer that unwinds, since its caller is gone, leaves nothing
    // written.
    let part = Part { label: COMMAND, done: placed, total: photos.len(), note: sureness(&found) };
    let _ = observe.progress(&part);
    let photos = found.write(out)?;
    set.remove_earlier_faces(out)?;
    Ok(EstimatedCameras { found, photos, masked: set.masks.is_some() })
}
