//! The pictures of a clip, one after the other, as an ffmpeg beside this process decodes them.

use crate::Error;
use crate::program::{Ended, INSTALL, Program};
use std::ffi::OsString;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{ChildStdout, Command, Stdio};

/// The longest side of a picture, pixels: a header may claim anything.
const LONGEST: usize = 1 << 16;
/// Filter of time for ffmpeg: each picture comes out once, whatever its own time is.
const ONE_EACH: &str = "settb=1/25,setpts=N";

/// The containers that ffmpeg opens, by its own names: none that names other files, as playlists and manifests do.
const CONTAINERS: &str =
    "mov,matroska,avi,mpeg,mpegts,mpegvideo,m4v,h264,hevc,obu,ivf,ogg,asf,flv,mxf,dv,yuv4mpegpipe,gif";

/// The pictures of a clip, upright and with square pixels.
#[derive(Debug)]
pub struct Pictures {
    clip: PathBuf,
    ffmpeg: Program,
    pipe: BufReader<ChildStdout>,
}

/// A picture of 8 bits.
#[derive(Clone, Debug, Default)]
pub struct Picture {
    pub width: usize,
    pub height: usize,
    /// `[height, width, channels]`.
    pub pixels: Vec<u8>,
}

impl Pictures {
    /// All pictures of a clip in gray, the longer side at most `long_side` pixels.
    pub fn small(clip: &Path, long_side: usize) -> Result<Self, Error> {
        let factor = format!("min(1,{long_side}/max(iw*sar,ih))");
        let side = |side: &str| format!("max(1,round({side}*{factor}))");
        let scale = format!("scale=w='{}':h='{}':flags=area,setsar=1,format=gray", side("iw*sar"), side("ih"));
        Self::start(clip, &format!("{scale},{ONE_EACH}"), "pgm")
    }

    /// The pictures of these numbers, from 0 and rising, in color and at their own size.
    pub fn of(clip: &Path, numbers: &[usize]) -> Result<Self, Error> {
        let scale = "scale=w='max(1,round(iw*sar))':h=ih:flags=bicubic+accurate_rnd+full_chroma_int,setsar=1";
        Self::start(clip, &format!("select='{}',{scale},format=rgb24,{ONE_EACH}", one_of(numbers)), "ppm")
    }

    fn start(clip: &Path, filter: &str, codec: &str) -> Result<Self, Error> {
        let mut command = reading(clip);
        command
            // Not covers, which are pictures of files that are heard.
            .args(["-map", "0:V:0", "-vf", filter, "-r", "25", "-c:v", codec, "-f", "image2pipe", "pipe:1"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped());
        let ffmpeg = Program::start(command, &missing(clip))?;
        let pipe = ffmpeg.stdout().ok_or_else(|| Error::input("ffmpeg: no pipe"))?;
        Ok(Self { clip: clip.into(), ffmpeg, pipe: BufReader::with_capacity(1 << 16, pipe) })
    }

    /// Reads the next picture in place of another one; false after the last.
    pub fn next(&mut self, picture: &mut Picture) -> Result<bool, Error> {
        read(&mut self.pipe, picture).map_err(|error| Error::input(format!("{}: ffmpeg: {error}", self.clip.display())))
    }

    /// Waits for ffmpeg after the last picture, and returns what it complains about.
    pub fn finish(mut self) -> Result<Option<String>, Error> {
        let ended: Ended = self.ffmpeg.end()?;
        match ended.fault() {
            Some(fault) => {
                let clip = self.clip.display();
                if fault.contains("not on whitelist") {
                    let expected = "expected a clip, found a list of other files, or a container that is none of";
                    return Err(Error::input(format!("{clip}: {expected} {CONTAINERS}")));
                }
                let found = if fault.contains("matches no streams") { "no pictures in it" } else { "another file" };
                let expected = "expected a clip with pictures that ffmpeg decodes";
                Err(Error::input(format!("{clip}: {expected}, found {found}; {fault}")))
            }
            None => Ok(ended.complaints()),
        }
    }
}

/// An expression of ffmpeg that is not 0 where `n` is one of some rising numbers. A tree, for a sum of a hundred terms
/// is too deep for ffmpeg.
fn one_of(numbers: &[usize]) -> String {
    match numbers {
        [] => "0".into(),
        [number] => format!("eq(n,{number})"),
        _ => {
            let (below, from) = numbers.split_at(numbers.len() / 2);
            format!("if(lt(n,{}),{},{})", from[0], one_of(below), one_of(from))
        }
    }
}

/// About how many pictures a clip has: its length times its rate, if ffmpeg tells both.
pub fn about_how_many(clip: &Path) -> Option<usize> {
    let mut command = reading(clip);
    // What is asked for here comes as a note, and without an output this is an error.
    let said = command.args(["-loglevel", "info"]).stdin(Stdio::null()).output().ok()?;
    let said = String::from_utf8_lossy(&said.stderr);
    let time = said.split("Duration: ").nth(1)?.split(',').next()?;
    let seconds = time.split(':').try_fold(0.0, |sum, part| Some(60.0 * sum + part.trim().parse::<f64>().ok()?))?;
    let stream = said.lines().find(|line| line.contains("Video:") && line.contains(" fps"))?;
    let rate: f64 = stream.split(" fps").next()?.rsplit(' ').next()?.parse().ok()?;
    Some((seconds * rate) as usize)
}

/// An ffmpeg that reads a clip.
fn reading(clip: &Path) -> Command {
    // Otherwise a name with a colon would be an address. Nothing is read but the clip itself.
    let mut input = OsString::from("file:");
    input.push(clip);
    let mut command = Command::new("ffmpeg");
    let threads = rayon::current_num_threads().to_string();
    command.args(["-hide_banner", "-loglevel", "error", "-nostdin", "-protocol_whitelist", "file"]);
    command.args(["-format_whitelist", CONTAINERS]);
    command.args(["-threads", &threads, "-i"]).arg(input);
    command
}

fn missing(clip: &Path) -> String {
    format!("{}: reading a clip needs the program ffmpeg, and there is none on the PATH; {INSTALL}", clip.display())
}

/// Reads a PGM or PPM picture of 8 bits; false at the end of the stream, and where it was cut off within a picture.
fn read(stream: &mut impl BufRead, picture: &mut Picture) -> std::io::Result<bool> {
    let Some(kind) = word(stream)? else { return Ok(false) };
    let channels = match kind.as_slice() {
        b"P5" => 1,
        b"P6" => 3,
        _ => return Err(unexpected()),
    };
    let mut numbers = [0; 3];
    for number in &mut numbers {
        let Some(text) = word(stream)? else { return Ok(false) };
        *number = std::str::from_utf8(&text).ok().and_then(|text| text.parse().ok()).ok_or_else(unexpected)?;
    }
    let [width, height, most] = numbers;
    if most != 255 || ![width, height].iter().all(|side| (1..=LONGEST).contains(side)) {
        return Err(unexpected());
    }
    (picture.width, picture.height) = (width, height);
    picture.pixels.resize(width * height * channels, 0);
    match stream.read_exact(&mut picture.pixels) {
        Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => Ok(false),
        read => read.map(|()| true),
    }
}

/// The next word and the one blank behind it; `None` at the end.
fn word(stream: &mut impl BufRead) -> std::io::Result<Option<Vec<u8>>> {
    let mut word = Vec::new();
    for byte in stream.by_ref().bytes().take(16) {
        match byte? {
            blank if blank.is_ascii_whitespace() => return Ok(Some(word)),
            byte => word.push(byte),
        }
    }
    if word.len() < 16 { Ok(None) } else { Err(unexpected()) }
}

fn unexpected() -> std::io::Error {
    std::io::Error::other("expected pictures in the formats PGM and PPM, found something else")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Promise of `frames_are_as_a_player_shows_them`.
    #[test]
    fn any_number_of_pictures_is_selected() {
        assert_eq!(one_of(&[3, 5, 8]), "if(lt(n,5),eq(n,3),if(lt(n,8),eq(n,5),eq(n,8)))");
        if Command::new("ffmpeg").arg("-version").output().is_err() {
            return println!("skipped: no ffmpeg (any_number_of_pictures_is_selected)");
        }
        let folder = tempfile::tempdir().unwrap();
        let clip = folder.path().join("clip.avi");
        let mut command = Command::new("ffmpeg");
        // As bright as its number, of 250.
        let source = "color=black:s=16x16:r=25,format=gray,geq=lum=mod(N\\,250)";
        command
            .args(["-loglevel", "error", "-f", "lavfi", "-i", source, "-frames:v", "4100", "-c:v", "ffv1"])
            .arg(&clip);
        assert!(command.status().unwrap().success());
        // As many as `--frames` may ask for, in two pieces with a gap between.
        let numbers: Vec<usize> = (0..1500).chain(2700..4100).step_by(2).chain(4099..4100).collect();
        let mut pictures = Pictures::of(&clip, &numbers).unwrap();
        let mut picture = Picture::default();
        for number in &numbers {
            assert!(pictures.next(&mut picture).unwrap(), "{number}");
            assert_eq!(usize::from(picture.pixels[0]), number % 250, "{number}");
        }
        assert!(!pictures.next(&mut picture).unwrap() && pictures.finish().unwrap().is_none());
        let all: Vec<usize> = (0..2000).map(|i| 2 * i + 1).collect();
        let mut pictures = Pictures::of(&clip, &all).unwrap();
        assert!(all.iter().all(|_| pictures.next(&mut picture).unwrap()));
    }

    #[test]
    fn a_stream_of_pictures_is_taken_apart() {
        let mut stream: &[u8] = b"P5\n2 1\n255\n\n P6\n1 1\n255\nabcP6\n1 1\n255\nab";
        let mut picture = Picture::default();
        assert!(read(&mut stream, &mut picture).unwrap());
        assert_eq!((picture.width, picture.height, picture.pixels.as_slice()), (2, 1, &b"\n "[..]));
        assert!(read(&mut stream, &mut picture).unwrap());
        assert_eq!((picture.width, picture.height, picture.pixels.as_slice()), (1, 1, &b"abc"[..]));
        // The last one was cut off.
        assert!(!read(&mut stream, &mut picture).unwrap());
        for wrong in
            [&b"P4\n1 1\n255\na"[..], b"P5\n0 1\n255\n", b"P5\n1 1\n65535\naa", b"<html>   ", b"P5\n70000 1\n255\n"]
        {
            assert!(read(&mut { wrong }, &mut picture).is_err(), "{}", String::from_utf8_lossy(wrong));
        }
        for end in [&b""[..], b"P5", b"P5\n1 ", b"P5\n1 1\n255\n"] {
            assert!(!read(&mut { end }, &mut picture).unwrap());
        }
    }
}
