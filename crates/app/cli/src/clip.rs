//! Clips: frames that are worth matching become photos.

mod choice;
mod movement;
mod pictures;

use crate::flags::ClipFlags;
use choice::{Measured, choose};
use movement::{Follower, sharpness};
use pictures::{Picture, Pictures, about_how_many};
use std::fs::File;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};
use std::time::Instant;
use weaver_command::{Console, Failure, Progress, duration};
use weaver_data::OutputFolder;
use weaver_io::{Bitmap, PhotoFolder, ShellCommand, is_taken};

/// Extensions of what ffmpeg is asked to read.
const EXTENSIONS: [&str; 18] = [
    "mp4", "m4v", "mov", "mkv", "webm", "avi", "mpg", "mpeg", "m2ts", "mts", "ts", "3gp", "ogv", "wmv", "flv", "mxf",
    "y4m", "gif",
];
/// The folder that frames are written to.
const FRAMES: &str = "frames";
/// The longest side of the pictures that are measured: blur that is not seen there costs a match little.
const MEASURED: usize = 640;
/// Largest number of frames when none is given.
const MOST: usize = 120;
/// Least movement of the picture between two frames, over its longer side: when nothing is said, and where a number is asked for.
const APART: f32 = 0.04;
const CLOSEST: f32 = 0.01;
/// From this movement on two frames hardly have enough in common.
const FAR: f32 = 0.25;
/// Names in a line, at most.
const NAMED: usize = 8;
/// Quality of the frames that are written, of 100: nothing of what a clip holds is lost.
const QUALITY: u8 = 95;

/// The photos that a command is given.
#[derive(Debug)]
pub struct Photos {
    pub paths: Vec<PathBuf>,
    /// True if most of them are frames of clips, which follow one another.
    pub sequence: bool,
    /// The frames, relative to the folder of the result; `None` without a clip.
    frames: Option<Vec<String>>,
}

impl Photos {
    /// Removes the frames of an earlier choice. To be called once cameras are written: until then the earlier ones name them.
    ///
    /// # Errors
    /// When a file cannot be removed.
    pub fn settle(&self, out: &OutputFolder) -> Result<(), Failure> {
        Ok(self.frames.as_ref().map_or(Ok(()), |frames| out.remove_others(FRAMES, frames))?)
    }
}

/// The photos that a command is given: files, those in folders, and frames of clips, which are written to the folder `frames` of a result.
///
/// # Errors
/// When a path is not there or a folder has no photos; when a clip cannot be decoded, or its camera stands still; when `flags` ask for frames and there is no clip.
pub fn photos(
    paths: &[PathBuf],
    flags: ClipFlags,
    out: &OutputFolder,
    console: &mut Console,
) -> Result<Photos, Failure> {
    let clips = paths.iter().filter(|path| is_clip(path)).count();
    if clips == 0 {
        flags.check_unused("photos")?;
    }
    let mut photos = Vec::new();
    let (mut number, mut written) = (0, Vec::new());
    for path in paths {
        if !is_clip(path) {
            photos.extend(in_folder(path, paths, console)?);
            continue;
        }
        number += 1;
        // Two clips have frames of the same numbers.
        let folder = if clips > 1 { format!("{FRAMES}/{number}") } else { FRAMES.into() };
        let names = frames(path, flags, (&folder, out), console)?;
        photos.extend(names.iter().map(|name| out.path().join(name)));
        written.extend(names);
    }
    let sequence = 2 * written.len() > photos.len();
    Ok(Photos { paths: photos, sequence, frames: (clips > 0).then_some(written) })
}

/// A photo, or those in a folder. Photos in folders below it are not taken; a warning or the error names these folders, unless they are
/// among the paths that are given.
fn in_folder(path: &Path, given: &[PathBuf], console: &mut Console) -> Result<Vec<PathBuf>, Failure> {
    if !path.exists() {
        let message = format!("{}: no such file or folder", path.display());
        return Err(io::Error::new(io::ErrorKind::NotFound, message).into());
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
            console.note(&format!(
                "warning: {here}: photos in folders below it are not taken, {in_all} in all; to take them, name {folders}, too"
            ));
        }
        return Ok(photos);
    }
    let expected = "expected photos (JPEG, PNG, TIFF or WebP), found none";
    Err(Failure::message(if in_all > 0 {
        format!("{here}: {expected} but {in_all} in folders below it; give these in its place: {folders}")
    } else if others.is_empty() {
        format!("{here}: {expected}; clips are given by their own names")
    } else {
        let kinds = some_of(others.iter().map(|(extension, count)| format!("{count} .{extension}")), ", ");
        let remedy = "pictures of other formats are converted first, for instance with `magick IN OUT.jpg`";
        format!("{here}: {expected} among {kinds}; {remedy}, and clips are given by their own names")
    }))
}

/// The first of some names, and how many more there are.
fn some_of(names: impl ExactSizeIterator<Item = String>, between: &str) -> String {
    let more = names.len().saturating_sub(NAMED);
    let named = names.take(NAMED).collect::<Vec<_>>().join(between);
    if more > 0 { format!("{named} and {more} more") } else { named }
}

/// True if a path is that of a clip: by its extension, or by its first bytes where it has none that photos have.
pub fn is_clip(path: &Path) -> bool {
    if path.is_dir() {
        return false;
    }
    let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
    extension.is_some_and(|extension| EXTENSIONS.contains(&extension.as_str()))
        || beginning(path).is_ok_and(|start| begins_as_a_clip(&start))
}

/// The first bytes of a file.
fn beginning(path: &Path) -> std::io::Result<Vec<u8>> {
    let mut start = Vec::new();
    File::open(path)?.take(12).read_to_end(&mut start)?;
    Ok(start)
}

fn begins_as_a_clip(start: &[u8]) -> bool {
    if start.len() < 12 {
        return false;
    }
    const MATROSKA: &[u8] = &[0x1a, 0x45, 0xdf, 0xa3];
    // The same container as that of clips, of photos that are refused elsewhere with a word on how to convert them.
    let still = [&b"avi"[..], b"hei", b"hev", b"mif", b"msf"];
    let mp4 = &start[4..8] == b"ftyp" && !still.contains(&&start[8..11]);
    mp4 || start.starts_with(MATROSKA) || start.starts_with(b"RIFF") && &start[8..] == b"AVI "
}

/// Chooses frames of a clip and writes them to a folder; returns their names.
fn frames(
    clip: &Path,
    flags: ClipFlags,
    (folder, out): (&str, &OutputFolder),
    console: &mut Console,
) -> Result<Vec<String>, Failure> {
    let start = Instant::now();
    let refused = |found: &str| {
        let clip = clip.display();
        Failure::message(format!("{clip}: expected a clip of a camera that moves, found {found}"))
    };
    let start_of_file = beginning(clip).map_err(|error| Failure::message(format!("{}: {error}", clip.display())))?;
    // Of which ffmpeg would say less.
    if start_of_file.is_empty() {
        return Err(refused("an empty file"));
    }
    let measured = measured(clip, console)?;
    let (most, closest) = flags.frames.map_or((MOST, APART), |most| (most as usize, CLOSEST));
    let chosen = choose(&measured, most, closest);
    match (measured.len(), chosen.len()) {
        (0, _) => return Err(refused("no pictures")),
        (1, _) => return Err(refused("a single picture")),
        (_, 1) => return Err(refused("one that stands still: nothing tells how far anything is away")),
        _ => {}
    }
    let names: Vec<String> = chosen.iter().map(|number| format!("{folder}/{number:06}.jpg")).collect();
    out.check(&names)?;
    let names = write(clip, (&chosen, names), out, console)?;
    let steps = chosen.windows(2).map(|pair| measured[pair[1]].place - measured[pair[0]].place);
    let step = steps.fold(0.0, f32::max);
    let (all, written, seconds) = (measured.len(), names.len(), duration(start.elapsed().as_secs_f64()));
    console.note(&format!(
        "clip: {written} of {all} frames of {}, at most {:.0} % of a picture apart, in {}; {seconds}",
        clip.display(),
        100.0 * step,
        out.path().join(folder).display()
    ));
    if step > FAR && chosen.len() == most {
        let enough = (chosen.len() as f32 * step / (0.5 * FAR)).ceil();
        console.note(&format!(
            "warning: frames so far apart have little in common; --frames {enough:.0} takes them closer together"
        ));
    }
    Ok(names)
}

/// Describes a clip in a line, by its first picture.
///
/// # Errors
/// When there is no ffmpeg, or it does not read the file.
pub fn info(clip: &Path) -> Result<String, Failure> {
    let name = clip.display();
    let (mut pictures, mut picture) = (Pictures::of(clip, &[0])?, Picture::default());
    if !pictures.next(&mut picture)? {
        pictures.finish()?;
        return Err(Failure::message(format!("{name}: expected a clip, found no pictures")));
    }
    let about = about_how_many(clip).map_or(String::new(), |count| format!(", about {count} pictures"));
    Ok(format!("clip of {}x{} pixels{about}", picture.width, picture.height))
}

/// Measures every frame of a clip.
fn measured(clip: &Path, console: &mut Console) -> Result<Vec<Measured>, Failure> {
    let mut pictures = Pictures::small(clip, MEASURED)?;
    let about = about_how_many(clip).unwrap_or(0);
    let mut progress = Progress::new("clip", 0, about, console);
    let (mut picture, mut follower, mut measured) = (Picture::default(), Follower::default(), Vec::new());
    while pictures.next(&mut picture)? {
        measured.push(Measured { sharpness: sharpness(&picture), place: follower.follow(&picture) });
        progress.at(measured.len(), about.max(measured.len()), || "frames looked at".into(), console);
    }
    progress.finish();
    if let Some(complaints) = pictures.finish()? {
        console.note(&format!("warning: {}: ffmpeg: {complaints}", clip.display()));
    }
    Ok(measured)
}

/// Writes frames of a clip; returns what they are called.
fn write(
    clip: &Path,
    (numbers, mut names): (&[usize], Vec<String>),
    out: &OutputFolder,
    console: &mut Console,
) -> Result<Vec<String>, Failure> {
    let mut pictures = Pictures::of(clip, numbers)?;
    let mut progress = Progress::new("clip", 0, names.len(), console);
    let mut picture = Picture::default();
    for done in 0..names.len() {
        if !pictures.next(&mut picture)? {
            pictures.finish()?;
            let (clip, found) = (clip.display(), done);
            let expected = format!("{} frames, as it had a moment ago", names.len());
            return Err(Failure::message(format!("{clip}: expected {expected}, found {found}; did it change?")));
        }
        let Picture { width, height, pixels } = std::mem::take(&mut picture);
        let bitmap = Bitmap { width, height, pixels };
        names[done] = write_frame(&bitmap, &names[done], out)?;
        picture.pixels = bitmap.pixels;
        progress.at(done + 1, names.len(), || "frames written".into(), console);
    }
    progress.finish();
    // What it complains about was said when the clip was measured. Behind the last frame nothing is waited for.
    Ok(names)
}

/// Writes a frame, and returns what it is called: another name where one of another clip has its own, which earlier cameras may be of.
fn write_frame(bitmap: &Bitmap, name: &str, out: &OutputFolder) -> Result<String, Failure> {
    let bytes = bitmap.to_jpeg(QUALITY).map_err(|error| Failure::message(format!("{name}: {error}")))?;
    let stem = name.strip_suffix(".jpg").unwrap_or(name);
    let names = std::iter::once(name.to_string()).chain((2..).map(|i| format!("{stem}-{i}.jpg")));
    for name in names {
        let path = out.path().join(&name);
        if !is_taken(&path) {
            weaver_io::atomic_write(out.file(&name)?, |w| w.write_all(&bytes))?;
            return Ok(name);
        }
        // A link that leads nowhere is somebody's, too.
        if path.is_file() && weaver_io::read_bytes(&path)? == bytes {
            return Ok(name);
        }
    }
    unreachable!("one of infinitely many names is free")
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
