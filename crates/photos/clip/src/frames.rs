//! Frames of clips that become photos.

use crate::Error;
use crate::choice::{Measured, choose};
use crate::conversion::{Conversion, Remarks};
use crate::movement::{Follower, sharpness};
use crate::pictures::{Chosen, Picture, Pictures};
use crate::spherical::is_spherical;
use std::path::Path;
use std::time::Instant;
use weaver_io::{
    Bitmap, Observe, OutputFolder, Panorama, Part, Stage, duration, file_length, jpeg_of_panorama, read_part,
};

/// Name of the stage.
const LABEL: &str = "clip";
/// Extensions of what ffmpeg is asked to read.
const EXTENSIONS: [&str; 18] = [
    "mp4", "m4v", "mov", "mkv", "webm", "avi", "mpg", "mpeg", "m2ts", "mts", "ts", "3gp", "ogv", "wmv", "flv", "mxf",
    "y4m", "gif",
];
/// The folder that frames are written to.
pub(crate) const FRAMES: &str = "frames";
/// The longest side of the pictures that are measured: blur that is not seen there costs a match little.
const MEASURED: usize = 640;
/// Largest number of frames when none is given.
const MOST: usize = 120;
/// Least movement of the picture between two frames, over its longer side: when nothing is said, and where a number is
/// asked for.
const APART: f32 = 0.04;
const CLOSEST: f32 = 0.01;
/// From this movement on two frames hardly have enough in common.
const FAR: f32 = 0.25;
/// Quality of the JPEGs that are written, of 100: nothing that a clip or a HEIC holds is lost.
pub(crate) const QUALITY: u8 = 95;

/// True if a path leads to a clip: by its extension, or by its first bytes where it has none that photos have.
pub fn is_clip(path: &Path) -> bool {
    if path.is_dir() {
        return false;
    }
    let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
    extension.is_some_and(|extension| EXTENSIONS.contains(&extension.as_str()))
        || beginning(path).is_ok_and(|start| begins_as_a_clip(&start))
}

/// The first bytes of a file.
fn beginning(path: &Path) -> Result<Vec<u8>, weaver_io::Error> {
    read_part(path, 0..file_length(path)?.min(12))
}

fn begins_as_a_clip(start: &[u8]) -> bool {
    if start.len() < 12 {
        return false;
    }
    const MATROSKA: &[u8] = &[0x1a, 0x45, 0xdf, 0xa3];
    // Photos in the container of clips, which are refused elsewhere with a word on how to convert them.
    let still = [&b"avi"[..], b"hei", b"hev", b"mif", b"msf"];
    let mp4 = &start[4..8] == b"ftyp" && !still.contains(&&start[8..11]);
    mp4 || start.starts_with(MATROSKA) || start.starts_with(b"RIFF") && &start[8..] == b"AVI "
}

/// A folder of frames within the folder of a result.
pub(crate) struct FrameFolder<'a> {
    /// Its name there.
    pub name: String,
    pub out: &'a OutputFolder,
}

/// A frame that was written.
pub(crate) struct Written {
    /// Its name in the folder of the result.
    pub name: String,
    /// When it was taken, seconds from the beginning of the clip, where the clip tells.
    pub time: Option<f64>,
}

/// Chooses frames of a clip, at most so many, and writes them to a folder.
pub(crate) fn write_frames(
    clip: &Path,
    most: Option<usize>,
    folder: &FrameFolder<'_>,
    observe: &mut dyn Observe,
) -> Result<Vec<Written>, Error> {
    let start = Instant::now();
    let refused = |found: &str| {
        let clip = clip.display();
        Error::input(format!("{clip}: expected a clip of a camera that moves, found {found}"))
    };
    let start_of_file = beginning(clip)?;
    // Of which ffmpeg would say less.
    if start_of_file.is_empty() {
        return Err(refused("an empty file"));
    }
    let (conversion, stream, Remarks { notes, warnings }) = Conversion::of(clip)?;
    notes.iter().for_each(|note| observe.note(note));
    warnings.iter().for_each(|warning| observe.warning(warning));
    let (measured, times) = measured(clip, (&conversion, stream.about.unwrap_or(0)), observe)?;
    let (most, closest) = most.map_or((MOST, APART), |most| (most, CLOSEST));
    let numbers = choose(&measured, most, closest);
    match (measured.len(), numbers.len()) {
        (0, _) => return Err(refused("no pictures")),
        (1, _) => return Err(refused("a single picture")),
        (_, 1) => return Err(refused("one that stands still: nothing tells how far anything is away")),
        _ => {}
    }
    let names: Vec<String> = numbers.iter().map(|number| format!("{}/{number:06}.jpg", folder.name)).collect();
    folder.out.check(&names)?;
    let times = times.map(|times| numbers.iter().map(|number| times[*number]).collect::<Vec<_>>());
    let chosen = match &times {
        Some(times) => Chosen::Times(times.clone()),
        None => Chosen::Numbers(numbers.iter().map(|number| *number as i64).collect()),
    };
    let names = write(clip, (Pictures::of(clip, &conversion, &chosen)?, names), folder.out, observe)?;
    let steps = numbers.windows(2).map(|pair| measured[pair[1]].place - measured[pair[0]].place);
    let step = steps.fold(0.0, f32::max);
    let (all, written, seconds) = (measured.len(), names.len(), duration(start.elapsed().as_secs_f64()));
    observe.note(&format!(
        "clip: {written} of {all} frames of {}, at most {:.0} % of a picture apart, in {}; {seconds}",
        clip.display(),
        100.0 * step,
        folder.out.path().join(&folder.name).display()
    ));
    if step > FAR && numbers.len() == most {
        let enough = (numbers.len() as f32 * step / (0.5 * FAR)).ceil();
        observe.warning(&format!(
            "frames so far apart have little in common; --frames {enough:.0} takes them closer together"
        ));
    }
    let time = |i: usize| times.as_ref().map(|times| times[i] as f64 * 1e-6);
    Ok(names.into_iter().enumerate().map(|(i, name)| Written { name, time: time(i) }).collect())
}

/// Describes a clip in a line, by its first picture.
///
/// # Errors
/// When there is no ffmpeg, or it does not read the file.
pub fn info(clip: &Path) -> Result<String, Error> {
    let (conversion, stream, _) = Conversion::of(clip)?;
    let mut pictures = Pictures::of(clip, &conversion, &Chosen::Numbers(vec![0]))?;
    let mut picture = Picture::default();
    if !pictures.next(&mut picture)? {
        pictures.finish()?;
        return Err(Error::input(format!("{}: expected a clip, found no pictures", clip.display())));
    }
    let about = stream.about.map_or(String::new(), |count| format!(", about {count} pictures"));
    Ok(format!("clip of {}x{} pixels{about}", picture.width, picture.height))
}

/// Measures every frame of a clip, of which there are about so many; returns their times, too, where each has one.
fn measured(
    clip: &Path,
    (conversion, about): (&Conversion, usize),
    observe: &mut dyn Observe,
) -> Result<(Vec<Measured>, Option<Vec<i64>>), Error> {
    let mut pictures = Pictures::small(clip, conversion, MEASURED)?;
    observe.begin(&stage(about));
    let (mut picture, mut follower, mut measured) = (Picture::default(), Follower::default(), Vec::new());
    while pictures.next(&mut picture)? {
        measured.push(Measured { sharpness: sharpness(&picture), place: follower.follow(&picture) });
        let note = "frames looked at".into();
        let _ = observe.progress(&Part { label: LABEL, done: measured.len(), total: about.max(measured.len()), note });
    }
    let (times, complaints) = pictures.finish()?;
    if let Some(complaints) = complaints {
        observe.warning(&format!("{}: ffmpeg: {complaints}", clip.display()));
    }
    let times = times.filter(|times| times.len() == measured.len());
    Ok((measured, times))
}

/// A stage of reading a clip.
fn stage(total: usize) -> Stage {
    Stage { label: LABEL, done: 0, total, stops_after: None }
}

/// Writes frames of a clip under these names; returns the names that they have got.
fn write(
    clip: &Path,
    (mut pictures, mut names): (Pictures, Vec<String>),
    out: &OutputFolder,
    observe: &mut dyn Observe,
) -> Result<Vec<String>, Error> {
    let spherical = is_spherical(clip);
    observe.begin(&stage(names.len()));
    let mut picture = Picture::default();
    for done in 0..names.len() {
        if !pictures.next(&mut picture)? {
            pictures.finish()?;
            let (clip, found) = (clip.display(), done);
            let expected = format!("{} frames, as it had a moment ago", names.len());
            return Err(Error::input(format!("{clip}: expected {expected}, found {found}; did it change?")));
        }
        let Picture { width, height, pixels } = std::mem::take(&mut picture);
        let bitmap = Bitmap { width, height, pixels };
        let fault = |error| Error::input(format!("{}: {error}", names[done]));
        let mut jpeg = bitmap.to_jpeg(QUALITY).map_err(fault)?;
        let fits = Panorama::fits((width, height));
        if spherical && fits {
            // The record by which the frame is cut into faces, here and by other programs.
            jpeg = jpeg_of_panorama(jpeg, (width, height));
        } else if spherical && done == 0 {
            observe.warning(&format!(
                "{}: a spherical clip of {width} x {height} pixels: expected twice as wide as high, of one eye; its frames are taken for photos of a usual lens",
                clip.display()
            ));
        }
        // Another name where a frame of another clip has its own, which earlier cameras may be of.
        names[done] = out.keep(&names[done], &jpeg, &[])?;
        picture.pixels = bitmap.pixels;
        let note = "frames written".into();
        let _ = observe.progress(&Part { label: LABEL, done: done + 1, total: names.len(), note });
    }
    // What it complains about was said when the clip was measured. Behind the last frame nothing is waited for.
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clips_are_told_by_their_names_or_their_first_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            is_clip(&path)
        };
        assert!(file("a.mp4", b"") && file("b.MOV", b"") && file("-c d.webm", b"x"));
        assert!(
            !file("a.jpg", b"")
                && !file("b.png", b"\x89PNG\r\n\x1a\n0000")
                && !file("c", b"")
                && !file("d.txt", b"clip")
        );
        assert!(
            file("e", b"\0\0\0\x20ftypisom0000")
                && file("f", b"RIFF0000AVI LIST")
                && file("g", b"\x1a\x45\xdf\xa30000000000")
        );
        assert!(
            !file("h", b"\0\0\0\x20ftypheic0000")
                && !file("i.jpg", b"\0\0\0\x20ftypavif0000")
                && !file("j", b"RIFF0000WEBPVP8 ")
        );
        std::fs::create_dir(folder.path().join("k.mp4")).unwrap();
        assert!(!is_clip(&folder.path().join("k.mp4")));
        assert!(is_clip(&folder.path().join("missing.mp4")) && !is_clip(&folder.path().join("missing")));
    }
}
