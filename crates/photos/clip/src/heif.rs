//! HEIC and AVIF photos become JPEGs; a program on the PATH decodes them.

use crate::Error;
use crate::error::some_of;
use crate::frames::QUALITY;
use crate::program::Program;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use weaver_io::{HeifPhoto, Observe, OutputFolder, Part, Stage, Turned, atomic_write, read_bytes};

/// The folder of converted photos.
pub(crate) const CONVERTED: &str = "converted";
/// Name of the stage.
const LABEL: &str = "convert";
/// Photos that are decoded at once, at most: each takes the memory of its pixels, here and in the program.
const AT_ONCE: usize = 4;
/// More photos than one in this many that cannot be decoded mean that something else is wrong.
const ONE_IN: usize = 4;

/// A program that decodes HEIC, AVIF or both.
struct Decoder {
    name: &'static str,
    /// Its arguments, with the names of the files it reads and writes as IN and OUT.
    arguments: &'static [&'static str],
    turned: Turned,
    /// True if many installations of it decode no such photos, so that its failure tells nothing about a photo.
    partial: bool,
}

/// The programs that are tried, in this order: of libheif by its names, of macOS, ImageMagick, and ffmpeg, which joins
/// the tiles of a photo from version 7 on.
const DECODERS: [Decoder; 5] = [
    Decoder { name: "heif-convert", arguments: &["IN", "OUT"], turned: Turned::Always, partial: false },
    Decoder { name: "heif-dec", arguments: &["IN", "OUT"], turned: Turned::Always, partial: false },
    Decoder {
        name: "sips",
        arguments: &["-s", "format", "png", "IN", "--out", "OUT"],
        turned: Turned::AsTagged,
        partial: false,
    },
    Decoder { name: "magick", arguments: &["IN[0]", "OUT"], turned: Turned::Always, partial: true },
    Decoder {
        name: "ffmpeg",
        arguments: &[
            "-loglevel",
            "error",
            "-nostdin",
            "-noautorotate",
            "-i",
            "IN",
            "-frames:v",
            "1",
            "-pix_fmt",
            "rgb24",
            "-y",
            "OUT",
        ],
        turned: Turned::Never,
        partial: true,
    },
];

/// Photos, some of them in place of others.
pub(crate) struct Converted {
    /// The photos that were given.
    pub originals: Vec<PathBuf>,
    /// The files that take their places, as many.
    pub paths: Vec<PathBuf>,
    /// Names of the files that were written; `None` if there was nothing to convert.
    pub written: Option<Vec<String>>,
}

/// Writes JPEGs of all HEIC and AVIF photos into a folder of results.
///
/// Photos that cannot be decoded are named in a warning and left out. Where no program decodes them, they stay.
pub(crate) fn convert(photos: Vec<PathBuf>, out: &OutputFolder, observe: &mut dyn Observe) -> Result<Converted, Error> {
    let to_convert: Vec<usize> = (0..photos.len()).filter(|i| HeifPhoto::is_at(&photos[*i])).collect();
    if to_convert.is_empty() {
        return Ok(Converted { originals: photos.clone(), paths: photos, written: None });
    }
    let total = to_convert.len();
    observe.begin(&Stage { label: LABEL, done: 0, total, stops_after: None });
    let (mut paths, mut written, mut faults) = (photos.clone(), Vec::new(), Vec::new());
    for (done, part) in to_convert.chunks(AT_ONCE).enumerate() {
        let decoded: Vec<Result<Option<Vec<u8>>, Error>> = part.par_iter().map(|i| decode(&photos[*i])).collect();
        for (i, decoded) in part.iter().zip(decoded) {
            match decoded {
                Ok(Some(jpeg)) => {
                    let stem = photos[*i].file_stem().unwrap_or_default().to_string_lossy();
                    let name = out.keep(&format!("{CONVERTED}/{stem}.jpg"), &jpeg, &written)?;
                    paths[*i] = out.path().join(&name);
                    written.push(name);
                }
                Ok(None) => {}
                Err(error) => faults.push((*i, error.to_string())),
            }
        }
        let done = (done * AT_ONCE + part.len()).min(total);
        let _ = observe.progress(&Part { label: LABEL, done, total, note: "photos decoded".into() });
    }
    if !written.is_empty() {
        let folder = out.path().join(CONVERTED);
        observe.note(&format!("photos: {} of HEIC or AVIF converted, in {}", written.len(), folder.display()));
    }
    if faults.is_empty() {
        return Ok(Converted { originals: photos, paths, written: Some(written) });
    }
    let (bad, all) = (faults.len(), photos.len());
    // One reason is enough: most often it is the same.
    let others = faults[1..].iter().map(|(i, _)| photos[*i].display().to_string());
    let others = if bad > 1 { format!("; likewise {}", some_of(others, ", ")) } else { String::new() };
    let reasons = format!("{}{others}", faults[0].1);
    if ONE_IN * bad > all {
        return Err(Error::input(format!("photos: {bad} of {all} cannot be decoded: {reasons}")));
    }
    observe.warning(&format!("{bad} of {all} photos cannot be decoded and are left out: {reasons}"));
    let kept = |photos: Vec<PathBuf>| -> Vec<PathBuf> {
        let readable = |i: &usize| faults.iter().all(|(bad, _)| bad != i);
        photos.into_iter().enumerate().filter(|(i, _)| readable(i)).map(|(_, photo)| photo).collect()
    };
    Ok(Converted { originals: kept(photos), paths: kept(paths), written: Some(written) })
}

/// The JPEG of a photo; `None` if there is no program that would decode it if it is whole.
fn decode(path: &Path) -> Result<Option<Vec<u8>>, Error> {
    let photo = HeifPhoto::read(path)?;
    let failed = |source| weaver_io::Error::Io { path: std::env::temp_dir(), source };
    let folder = tempfile::tempdir().map_err(failed)?;
    // Under a name that no program takes for anything else.
    let input = format!("photo.{}", photo.kind().to_lowercase());
    let bytes = read_bytes(path)?;
    atomic_write(folder.path().join(&input), |w| w.write_all(&bytes))?;
    let mut faults = Vec::new();
    for decoder in &DECODERS {
        let fault = match decoder.run(folder.path(), &input) {
            Ok(None) => continue,
            Ok(Some(file)) => match photo.decoded(&file, decoder.turned) {
                Ok(pixels) => return Ok(Some(photo.to_jpeg(&pixels, QUALITY)?)),
                Err(error) => format!("{}: {error}", decoder.name),
            },
            Err(error) => error.to_string(),
        };
        faults.push((decoder.partial, fault));
    }
    if faults.iter().all(|(partial, _)| *partial) {
        return Ok(None);
    }
    let faults: Vec<String> = faults.into_iter().map(|(_, fault)| fault).collect();
    let expected = format!("expected a whole {} photo", photo.kind());
    Err(Error::input(format!("{}: {expected}, found one that is not decoded; {}", path.display(), faults.join("; "))))
}

impl Decoder {
    /// Decodes a file in a folder to another one there, whose path is returned; `None` where there is no such program.
    fn run(&self, folder: &Path, input: &str) -> Result<Option<PathBuf>, Error> {
        let output = format!("{}.png", self.name);
        let mut command = Command::new(self.name);
        command.args(self.arguments.iter().map(|part| part.replace("IN", input).replace("OUT", &output)));
        command.current_dir(folder).stdin(Stdio::null()).stdout(Stdio::null());
        let Some(mut program) = Program::find(command)? else { return Ok(None) };
        if let Some(fault) = program.end()?.fault() {
            return Err(Error::input(fault));
        }
        // Of a file with several photos, the names have numbers.
        let first = [output.clone(), format!("{}-1.png", self.name)].map(|name| folder.join(name));
        let written = first.into_iter().find(|path| path.is_file());
        written.map(Some).ok_or_else(|| Error::input(format!("{}: no picture was written", self.name)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_io::PhotoFile;

    /// Photos that stand on their side in their containers, one of them in tiles, through the programs that are there.
    ///
    /// Promise (photos): HEIC, of tiles and with EXIF, and AVIF are decoded upright and in sRGB.
    #[test]
    fn installed_programs_decode_photos_upright() {
        let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../tests/fixtures/heic");
        let folder = tempfile::tempdir().unwrap();
        for (name, size, last) in
            [("tiles.heic", (96, 128), [194, 209, 120]), ("turned.avif", (64, 96), [230, 30, 128])]
        {
            let Some(jpeg) = decode(&fixtures.join(name)).unwrap_or_else(|error| {
                println!("skipped: no program decodes {name}; {error}");
                None
            }) else {
                println!("skipped: no program for {name}");
                continue;
            };
            let path = folder.path().join("a.jpg");
            std::fs::write(&path, jpeg).unwrap();
            let photo = PhotoFile::at(&path).unwrap().read().unwrap();
            assert_eq!((photo.width, photo.height), size, "{name}");
            let corner = photo.pixels.last_chunk::<3>().unwrap();
            assert!(corner.iter().zip(last).all(|(a, b)| a.abs_diff(b) < 8), "{name}: {corner:?}");
        }
    }
}
