//! Films: photos of a scene that moves, by calibrated cameras, each with its time.
//!
//! [`procedural()`] generates one from a seed; [`open`] reads one from a folder, whose files determine the layout:
//!
//! | the folder holds | layout | times | held out |
//! |---|---|---|---|
//! | `transforms_train.json`, `transforms_test.json` | D-NeRF | `time` of each frame, over the largest | the test file's frames |
//! | `poses_bounds.npy`, `cam00/*.png`, `cam01/*.png` ... | Neural 3D Video | number of the frame, over how many there are | the first camera |
//! | `dataset.json`, `metadata.json`, `scene.json`, `camera/`, `rgb/` | HyperNeRF | `warp_id`, over the largest | `val_ids` |
//!
//! Photos are shrunk with a Lanczos filter, as in [captures](crate::capture), and kept in memory, as bytes: up to 2 GiB
//! of them, and the rest is read from its files whenever it is needed.
//!
//! - **D-NeRF**: transparent pixels are white. Axes are OpenGL's.
//! - **Neural 3D Video**: cameras in the order of their names; photos may lie in `cam00/images`. The default size is
//!   half the calibration's. Videos have to be taken apart first; the error names the command.
//! - **HyperNeRF**: photos of `rgb/2x`, else of `rgb/1x` or `rgb/4x`; lenses without distortion; `points.npy` where it
//!   is there.

mod dnerf;
mod hypernerf;
mod n3v;
pub(crate) mod pixels;
mod roll;
pub(crate) mod shots;

use crate::Error;
pub use crate::procedural::moving::{FilmOptions, MOTIONS, procedural};
pub use pixels::Pixels;
pub use shots::{Film, FilmPoint, HeldOut, Shot};
use std::path::Path;

/// Layout of a film in its folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FilmLayout {
    /// The layout of D-NeRF.
    DNerf,
    /// The layout of Neural 3D Video.
    N3v,
    /// The layout of HyperNeRF and Nerfies.
    HyperNerf,
}

impl FilmLayout {
    /// The layout of a folder.
    ///
    /// # Errors
    /// When it is no folder, or of no known layout.
    pub fn of(folder: impl AsRef<Path>) -> Result<Self, Error> {
        let folder = folder.as_ref();
        if !folder.is_dir() {
            let found = if folder.exists() { "a file" } else { "nothing" };
            return Err(Error::unexpected(folder, "film", "a folder", found));
        }
        let known = [(dnerf::TRAINING, Self::DNerf), (n3v::CAMERAS, Self::N3v), (hypernerf::SPLIT, Self::HyperNerf)];
        let layout = known.into_iter().find(|(file, _)| folder.join(file).is_file());
        layout.map(|(_, layout)| layout).ok_or_else(|| {
            let expected = known.map(|(file, layout)| format!("{file} ({})", layout.name())).join(", ");
            Error::unexpected(folder, "film", format!("one of {expected}"), "none of them")
        })
    }

    /// Name of the layout.
    pub fn name(self) -> &'static str {
        match self {
            Self::DNerf => "D-NeRF",
            Self::N3v => "Neural 3D Video",
            Self::HyperNerf => "HyperNeRF",
        }
    }
}

/// Reads the film in a folder, its photos shrunk to a longer side of `size` pixels if they are larger.
///
/// Without a size, photos of Neural 3D Video have half the size of the calibration, others the size of their files.
/// Held-out photos are held out for their camera, and for their time where no training photo has it.
///
/// ```
/// let error = weaver_data::film::open("no/such/folder", None).unwrap_err();
/// assert_eq!(error.to_string(), "no/such/folder: film: expected a folder, found nothing");
/// ```
///
/// # Errors
/// When the folder is of no known layout; a file is missing or malformed; there is one camera or one time alone; a time
/// is missing, negative or not finite; photos have different sizes, or cameras different numbers of them. The message
/// names the file, the entry, the expected and the found content.
pub fn open(path: impl AsRef<Path>, size: Option<usize>) -> Result<Film, Error> {
    open_keeping(path, size, MOST_KEPT)
}

/// Bytes of photos that are kept in memory if nothing else is said.
const MOST_KEPT: usize = 2 << 30;

/// Reads the film in a folder as [`open`] does, and keeps at most so many bytes of its photos in memory.
///
/// # Errors
/// As [`open`].
pub fn open_keeping(path: impl AsRef<Path>, size: Option<usize>, most: usize) -> Result<Film, Error> {
    let path = path.as_ref();
    if size == Some(0) {
        return Err(Error::unexpected(path, "size", "at least one pixel", "0"));
    }
    let roll = match FilmLayout::of(path)? {
        FilmLayout::DNerf => dnerf::read(path)?,
        FilmLayout::N3v => n3v::read(path)?,
        FilmLayout::HyperNerf => hypernerf::read(path)?,
    };
    roll.developed(path, size, most)
}
