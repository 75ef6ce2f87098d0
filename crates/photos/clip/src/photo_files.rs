//! The photos that paths stand for: files, files in folders, and frames of clips.

use crate::Error;
use crate::error::some_of;
use crate::frames::{FRAMES, FrameFolder, Written, is_clip, write_frames};
use crate::heif::{CONVERTED, Converted, convert};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use weaver_io::{Observe, OutputFolder, PhotoFolder, ShellCommand};

/// Files of photos.
#[derive(Clone, Debug)]
pub struct PhotoFiles {
    /// The files, in order.
    pub paths: Vec<PathBuf>,
    /// True if most of them are frames of clips, which follow one another.
    pub sequence: bool,
    /// The files that were given or were in folders that were given, one for each: other ones where photos were
    /// converted.
    pub originals: Vec<PathBuf>,
    /// When frames of clips were taken, seconds from the beginning of the clip, by their paths.
    pub times: BTreeMap<PathBuf, f64>,
    /// The frames, relative to the folder of the result; `None` without a clip.
    frames: Option<Vec<String>>,
    /// The converted photos, likewise.
    converted: Option<Vec<String>>,
}

impl PhotoFiles {
    /// Photos by their files, folders of photos, and clips, of which frames are written to the folder `frames` of a
    /// result: `most` of each, spread over the way of its camera, or as many as show something new.
    ///
    /// HEIC and AVIF photos become JPEGs in the folder `converted` of the result, upright, in sRGB and with their focal
    /// length. Without a program that decodes them they stay in the list, for their reader to say how to convert them.
    ///
    /// # Errors
    /// When a path is not there or a folder has no photos; when a clip cannot be decoded, or its camera stands still;
    /// when a number of frames is given and there is no clip; when more than a quarter of the photos are HEIC or AVIF
    /// that cannot be decoded.
    pub fn collect(
        paths: &[PathBuf],
        most: Option<usize>,
        out: &OutputFolder,
        observe: &mut dyn Observe,
    ) -> Result<Self, Error> {
        let clips = paths.iter().filter(|path| is_clip(path)).count();
        if clips == 0 && most.is_some() {
            return Err(Error::setting("frames", "expected a clip, found photos"));
        }
        let mut photos = Vec::new();
        let (mut number, mut written, mut times) = (0, Vec::new(), BTreeMap::new());
        for path in paths {
            if !is_clip(path) {
                photos.extend(in_folder(path, paths, observe)?);
                continue;
            }
            number += 1;
            // Two clips have frames of the same numbers.
            let name = if clips > 1 { format!("{FRAMES}/{number}") } else { FRAMES.into() };
            for Written { name, time } in write_frames(path, most, &FrameFolder { name, out }, observe)? {
                let photo = out.path().join(&name);
                times.extend(time.map(|time| (photo.clone(), time)));
                photos.push(photo);
                written.push(name);
            }
        }
        let sequence = 2 * written.len() > photos.len();
        let Converted { originals, paths, written: converted } = convert(photos, out, observe)?;
        Ok(Self { paths, originals, sequence, times, frames: (clips > 0).then_some(written), converted })
    }

    /// Removes the frames of an earlier choice, and photos that were converted for it. To be called once cameras are
    /// written: until then the earlier ones name them.
    ///
    /// # Errors
    /// When a file cannot be removed.
    pub fn remove_earlier_frames(&self, out: &OutputFolder) -> Result<(), Error> {
        for (folder, written) in [(FRAMES, &self.frames), (CONVERTED, &self.converted)] {
            written.as_ref().map_or(Ok(()), |written| out.remove_others(folder, written))?;
        }
        Ok(())
    }
}

/// A photo, or those in a folder. Photos in folders below it are not taken; a warning or the error names these folders,
/// unless they are among the paths that are given.
fn in_folder(path: &Path, given: &[PathBuf], observe: &mut dyn Observe) -> Result<Vec<PathBuf>, Error> {
    if !path.exists() {
        return Err(Error::Missing(path.display().to_string()));
    }
    if !path.is_dir() {
        return Ok(vec![path.into()]);
    }
    let PhotoFolder { photos, mut below, others } = PhotoFolder::open(path)?;
    let given: Vec<PathBuf> = given.iter().filter_map(|path| path.canonicalize().ok()).collect();
    below.retain(|(folder, _)| folder.canonicalize().is_ok_and(|folder| !given.contains(&folder)));
    let here = path.display();
    let in_all: usize = below.iter().map(|(_, count)| count).sum();
    let folders = some_of(below.iter().map(|(folder, _)| ShellCommand::quoted(folder)), " ");
    if !photos.is_empty() {
        if in_all > 0 {
            observe.warning(&format!(
                "{here}: photos in folders below it are not taken, {in_all} in all; to take them, name {folders}, too"
            ));
        }
        return Ok(photos);
    }
    let expected = "expected photos (JPEG, PNG, TIFF, WebP, HEIC or AVIF), found none";
    Err(Error::input(if in_all > 0 {
        format!("{here}: {expected} but {in_all} in folders below it; give these in its place: {folders}")
    } else if others.is_empty() {
        format!("{here}: {expected}; clips are given by their own names")
    } else {
        let kinds = some_of(others.iter().map(|(extension, count)| format!("{count} .{extension}")), ", ");
        let remedy = "pictures of other formats are converted first, for instance with `magick IN OUT.jpg`";
        format!("{here}: {expected} among {kinds}; {remedy}, and clips are given by their own names")
    }))
}
