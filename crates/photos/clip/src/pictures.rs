//! The pictures of a clip, one after the other, as an ffmpeg beside this process decodes them.

use crate::Error;
use crate::conversion::Conversion;
use crate::decoder;
use crate::program::Program;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::ChildStdout;
use std::sync::mpsc::{Receiver, channel};

/// The longest side of a picture, pixels: a header may claim anything.
const LONGEST: usize = 1 << 16;
/// Filter of time for ffmpeg: times are whole microseconds.
const MICROSECONDS: &str = "settb=1/1000000";
/// Filters of time: a picture's own time is told, and each comes out once, whatever its time.
const ONE_EACH: &str = "showinfo=checksum=0,settb=1/25,setpts=N";

/// The pictures of a clip, upright and with square pixels.
#[derive(Debug)]
pub struct Pictures {
    clip: PathBuf,
    ffmpeg: Program,
    pipe: BufReader<ChildStdout>,
    times: Receiver<Option<i64>>,
}

/// A picture of 8 bits.
#[derive(Clone, Debug, Default)]
pub struct Picture {
    pub width: usize,
    pub height: usize,
    /// `[height, width, channels]`.
    pub pixels: Vec<u8>,
}

/// Pictures of a clip, rising.
#[derive(Clone, Debug, PartialEq)]
pub enum Chosen {
    /// By their times, microseconds.
    Times(Vec<i64>),
    /// By their numbers from 0, where some have no time of their own.
    Numbers(Vec<i64>),
}

impl Pictures {
    /// All pictures of a clip in gray, the longer side at most `long_side` pixels.
    pub fn small(clip: &Path, conversion: &Conversion, long_side: usize) -> Result<Self, Error> {
        Self::start(clip, conversion, (&format!("{},{MICROSECONDS}", conversion.to_gray(long_side)), "pgm"))
    }

    /// Some pictures in color and at their own size.
    pub fn of(clip: &Path, conversion: &Conversion, chosen: &Chosen) -> Result<Self, Error> {
        let select = match chosen {
            Chosen::Times(times) => one_of("pts", times),
            Chosen::Numbers(numbers) => one_of("n", numbers),
        };
        let select = format!("{MICROSECONDS},select='{select}'");
        Self::start(clip, conversion, (&conversion.to_color(&select), "ppm"))
    }

    fn start(clip: &Path, conversion: &Conversion, (filter, codec): (&str, &str)) -> Result<Self, Error> {
        let (send, times) = channel();
        let output = ["-r", "25", "-c:v", codec, "-f", "image2pipe", "pipe:1"];
        let filter = format!("{filter},{ONE_EACH}");
        let listener = move |line: &str| time(line).map_or((), |time| send.send(time).unwrap_or_default());
        let ffmpeg = decoder::start(clip, (conversion.before(), &filter, &output), listener)?;
        let pipe = ffmpeg.stdout().ok_or_else(|| Error::input("ffmpeg: no pipe"))?;
        Ok(Self { clip: clip.into(), ffmpeg, pipe: BufReader::with_capacity(1 << 16, pipe), times })
    }

    /// Reads the next picture in place of another one; false after the last.
    pub fn next(&mut self, picture: &mut Picture) -> Result<bool, Error> {
        read(&mut self.pipe, picture).map_err(|error| Error::input(format!("{}: ffmpeg: {error}", self.clip.display())))
    }

    /// Waits for ffmpeg after the last picture, and returns the times of all pictures, microseconds from the beginning
    /// of the clip, where each has one of its own, and what ffmpeg complains about.
    pub fn finish(self) -> Result<(Option<Vec<i64>>, Option<String>), Error> {
        let complaints = decoder::end(&self.clip, self.ffmpeg)?;
        let times: Option<Vec<i64>> = self.times.iter().collect();
        Ok((times.filter(|times| times.windows(2).all(|pair| pair[0] < pair[1])), complaints))
    }
}

/// The time of a picture in a line of `showinfo`, if it has one; `None` of another line.
fn time(line: &str) -> Option<Option<i64>> {
    let time = line.contains("showinfo").then(|| line.split_once(" pts:"))??.1.split_whitespace().next()?;
    Some(time.parse().ok())
}

/// An expression of ffmpeg that is not 0 where a variable is one of some rising numbers. A tree, for a sum of a hundred
/// terms is too deep for ffmpeg.
fn one_of(variable: &str, numbers: &[i64]) -> String {
    match numbers {
        [] => "0".into(),
        [number] => format!("eq({variable},{number})"),
        _ => {
            let (below, from) = numbers.split_at(numbers.len() / 2);
            format!("if(lt({variable},{}),{},{})", from[0], one_of(variable, below), one_of(variable, from))
        }
    }
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
    use std::process::Command;

    /// Promise of `frames_are_as_a_player_shows_them`.
    #[test]
    fn any_number_of_pictures_is_selected() {
        assert_eq!(one_of("n", &[3, 5, 8]), "if(lt(n,5),eq(n,3),if(lt(n,8),eq(n,5),eq(n,8)))");
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
        // As many as `--frames` may ask for, and two pieces with a gap between.
        let pieces: Vec<i64> = (0..1500).chain(2700..4100).step_by(2).chain(4099..4100).collect();
        for numbers in [pieces, (0..2000).map(|i| 2 * i + 1).collect()] {
            // A picture takes 40 milliseconds.
            let times = Chosen::Times(numbers.iter().map(|number| 40_000 * number).collect());
            for chosen in [Chosen::Numbers(numbers.clone()), times.clone()] {
                let mut pictures = Pictures::of(&clip, &Conversion::default(), &chosen).unwrap();
                let mut picture = Picture::default();
                for number in &numbers {
                    assert!(pictures.next(&mut picture).unwrap(), "{number}");
                    assert_eq!(i64::from(picture.pixels[0]), number % 250, "{number}");
                }
                assert!(!pictures.next(&mut picture).unwrap());
                let (found, complaints) = pictures.finish().unwrap();
                assert_eq!((Chosen::Times(found.unwrap()), complaints), (times.clone(), None));
            }
        }
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
